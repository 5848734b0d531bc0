//! State-space estimators: the filter with θ in its state, and maximum likelihood by prediction
//! errors.
//!
//! ```text
//! −2 ln L(θ) = Σ e²/s + ln s        e, s: innovations of the Kalman filter at θ, their variances
//! Δη = (Σ ψψᵀ/s)⁻¹ Σ ψ e/s           ψ = −∂e/∂η,  η = ln θ, or θ if it may have either sign
//! ```
//!
//! Logarithms keep parameters positive and make steps relative.
//!
//! Sources: A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970, for the filter;
//! L. Ljung, System Identification, 2nd ed. 1999, sections 7.4 and 10.2, for prediction errors and
//! their Gauss-Newton search.

use crate::studies::states::{Jacobian, JointCovariance, SensorVariance, StateSpace};
use nalgebra::{SMatrix, SVector};

/// Largest step of a search, as a logarithm.
const LARGEST_STEP: f64 = 1.0;
/// Rounds of Gauss-Newton, rejected steps included.
const ROUNDS: usize = 60;
/// A search ends if no parameter moves by more than this share of its standard deviation.
const DONE: f64 = 1e-3;

/// A run as used by these estimators.
#[derive(Debug, Clone)]
pub struct Record<const U: usize> {
    /// Measured positions \[rad or m\].
    pub positions: Vec<[f64; U]>,
    /// Recorded input that acts from sample k to the next.
    pub inputs: Vec<SVector<f64, U>>,
    /// Variance of the sensors.
    pub variance: SensorVariance,
}

impl<const U: usize> Record<U> {
    /// The same with exact inputs: prediction errors become output errors.
    pub fn with_exact_input(&self) -> Self {
        Self {
            variance: SensorVariance {
                input: 0.0,
                ..self.variance
            },
            ..self.clone()
        }
    }
}

/// Start of the estimators.
#[derive(Debug, Clone, Copy)]
pub struct Start<const X: usize, const P: usize> {
    /// Guess of the state; its positions are replaced by the first measured ones.
    pub state: SVector<f64, X>,
    /// Standard deviation of that.
    pub state_std: SVector<f64, X>,
    /// Start values of θ.
    pub theta: SVector<f64, P>,
    /// Standard deviation of a θ of either sign; 0 if θ is positive.
    pub either_sign: SVector<f64, P>,
}

impl<const X: usize, const P: usize> Start<X, P> {
    /// θ in the estimators' coordinates: logarithms of positive parameters.
    fn coordinates(&self) -> SVector<f64, P> {
        SVector::from_fn(|i, _| {
            if self.is_positive(i) {
                self.theta[i].ln()
            } else {
                self.theta[i]
            }
        })
    }

    fn is_positive(&self, i: usize) -> bool {
        self.either_sign[i] == 0.0
    }

    /// True if a search may start at this θ.
    pub fn can_be(&self, theta: &SVector<f64, P>) -> bool {
        (0..P).all(|i| theta[i] > 0.0 || !self.is_positive(i))
    }

    fn theta_at(&self, eta: &SVector<f64, P>) -> SVector<f64, P> {
        SVector::from_fn(|i, _| if self.is_positive(i) { eta[i].exp() } else { eta[i] })
    }

    /// ∂x/∂θ becomes ∂x/∂η.
    fn chain<const U: usize>(&self, jacobian: &mut Jacobian<X, P, U>, theta: &SVector<f64, P>) {
        for i in (0..P).filter(|&i| self.is_positive(i)) {
            jacobian.theta.column_mut(i).scale_mut(theta[i]);
        }
    }

    fn first_state<const U: usize>(&self, record: &Record<U>, places: [usize; U]) -> SVector<f64, X> {
        let mut x = self.state;
        if let Some(first) = record.positions.first() {
            for (place, q) in places.into_iter().zip(first) {
                x[place] = *q;
            }
        }
        x
    }
}

/// The extended Kalman filter with (x, θ) as its state; θ̂ after the last sample. θ has the relative
/// standard deviation `start_std` at the start.
pub fn augmented_filter<const X: usize, const P: usize, const U: usize, S: StateSpace<X, P, U>>(
    machine: &S,
    record: &Record<U>,
    start: &Start<X, P>,
    start_std: f64,
) -> SVector<f64, P> {
    let mut x = start.first_state(record, S::POSITIONS);
    let mut eta = start.coordinates();
    let eta_std = SVector::from_fn(|i, _| {
        start_std
            * if start.is_positive(i) {
                1.0
            } else {
                start.either_sign[i]
            }
    });
    let mut covariance = JointCovariance::independent(&start.state_std, &eta_std);
    for (positions, input) in record.positions.iter().zip(&record.inputs) {
        for (place, q) in S::POSITIONS.into_iter().zip(positions) {
            let innovation = q - x[place];
            let (gain_x, gain_eta) = covariance.measure(place, record.variance.position);
            x += gain_x * innovation;
            eta += gain_eta * innovation;
        }
        let theta = start.theta_at(&eta);
        let (next, mut jacobian) = machine.advance(&x, &theta, input);
        start.chain(&mut jacobian, &theta);
        covariance.propagate(&jacobian, record.variance.input);
        x = next;
    }
    start.theta_at(&eta)
}

/// Likelihood of a θ by prediction errors.
struct Likelihood<const P: usize> {
    /// −2 ln of it, up to a constant.
    loss: f64,
    /// Σ ψ ψᵀ/s.
    information: SMatrix<f64, P, P>,
    /// Σ ψ e/s.
    gradient: SVector<f64, P>,
}

/// Innovations of the Kalman filter at a fixed θ, with their sensitivities; the gain is taken as
/// constant, because its change only multiplies errors of mean 0.
fn likelihood<const X: usize, const P: usize, const U: usize, S: StateSpace<X, P, U>>(
    machine: &S,
    record: &Record<U>,
    start: &Start<X, P>,
    eta: &SVector<f64, P>,
) -> Likelihood<P> {
    let theta = start.theta_at(eta);
    let mut x = start.first_state(record, S::POSITIONS);
    let mut covariance = SMatrix::<f64, X, X>::from_diagonal(&start.state_std.component_mul(&start.state_std));
    let mut sensitivity = SMatrix::<f64, X, P>::zeros();
    let mut sum = Likelihood {
        loss: 0.0,
        information: SMatrix::zeros(),
        gradient: SVector::zeros(),
    };
    for (positions, input) in record.positions.iter().zip(&record.inputs) {
        for (place, q) in S::POSITIONS.into_iter().zip(positions) {
            let column: SVector<f64, X> = covariance.column(place).into();
            let s = column[place] + record.variance.position;
            let innovation = q - x[place];
            let psi = sensitivity.row(place).transpose();
            sum.loss += innovation * innovation / s + s.ln();
            sum.information += psi * psi.transpose() / s;
            sum.gradient += psi * (innovation / s);
            let gain = column / s;
            x += gain * innovation;
            sensitivity -= gain * psi.transpose();
            covariance -= gain * column.transpose();
        }
        let (next, mut jacobian) = machine.advance(&x, &theta, input);
        start.chain(&mut jacobian, &theta);
        x = next;
        sensitivity = jacobian.state * sensitivity + jacobian.theta;
        covariance = jacobian.state * covariance * jacobian.state.transpose()
            + jacobian.input * jacobian.input.transpose() * record.variance.input;
        covariance = (covariance + covariance.transpose()) * 0.5;
    }
    sum
}

/// The most likely θ, by Gauss-Newton with Levenberg-Marquardt damping; `None` if the search does
/// not settle.
///
/// With exact inputs the errors are those of the simulated positions: the output error.
pub fn maximum_likelihood<const X: usize, const P: usize, const U: usize, S: StateSpace<X, P, U>>(
    machine: &S,
    record: &Record<U>,
    start: &Start<X, P>,
) -> Option<SVector<f64, P>> {
    let mut eta = start.coordinates();
    let mut here = likelihood(machine, record, start, &eta);
    let mut damping = 1e-3;
    for _ in 0..ROUNDS {
        let mut normal = here.information;
        for i in 0..P {
            normal[(i, i)] += damping * here.information[(i, i)];
        }
        let mut step = normal.cholesky()?.solve(&here.gradient);
        for i in (0..P).filter(|&i| start.is_positive(i)) {
            step[i] = step[i].clamp(-LARGEST_STEP, LARGEST_STEP);
        }
        let size = (0..P)
            .map(|i| step[i].abs() * here.information[(i, i)].sqrt())
            .fold(0.0, f64::max);
        if size < DONE {
            return Some(start.theta_at(&eta));
        }
        let there = likelihood(machine, record, start, &(eta + step));
        if there.loss < here.loss {
            eta += step;
            here = there;
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping *= 10.0;
            if damping > 1e8 {
                return None;
            }
        }
    }
    None
}
