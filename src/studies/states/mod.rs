//! Machines as first-order equations, for state-space methods: the Cramér–Rao bound, Kalman
//! filters, prediction errors.
//!
//! ```text
//! x(k + 1) = f(x(k), θ, u(k) + w(k))        y_j(k) = x_{p_j}(k) + v_j(k)
//! ```
//!
//! with w the noise of the recorded input, which acts as process noise, and v that of the position
//! sensors.

mod arm;
mod axis;

pub use arm::{ARM_STATES, ArmStates};
pub use axis::{AXIS_STATES, AxisStates};

use nalgebra::{SMatrix, SVector};

/// Derivatives of x(k + 1) with respect to state, parameters and inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jacobian<const X: usize, const P: usize, const U: usize> {
    /// F = ∂f/∂x.
    pub state: SMatrix<f64, X, X>,
    /// ∂f/∂θ.
    pub theta: SMatrix<f64, X, P>,
    /// G = ∂f/∂u.
    pub input: SMatrix<f64, X, U>,
}

/// A machine with X states, P parameters and U inputs, each of which drives a joint with a position
/// sensor.
pub trait StateSpace<const X: usize, const P: usize, const U: usize> {
    /// Index of each joint's position in x.
    const POSITIONS: [usize; U];

    /// x one sample period later, with a held input.
    fn advance(
        &self,
        x: &SVector<f64, X>,
        theta: &SVector<f64, P>,
        input: &SVector<f64, U>,
    ) -> (SVector<f64, X>, Jacobian<X, P, U>);
}

/// Variances of the sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorVariance {
    /// Of a measured position \[rad² or m²\], > 0.
    pub position: f64,
    /// Of a recorded input, its unit squared, ≥ 0.
    pub input: f64,
}

/// Covariance of (x, θ) in blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCovariance<const X: usize, const P: usize> {
    /// Of x.
    pub states: SMatrix<f64, X, X>,
    /// Of x with θ.
    pub cross: SMatrix<f64, X, P>,
    /// Of θ.
    pub theta: SMatrix<f64, P, P>,
}

impl<const X: usize, const P: usize> JointCovariance<X, P> {
    /// Independent states and parameters with these standard deviations.
    pub fn independent(states: &SVector<f64, X>, theta: &SVector<f64, P>) -> Self {
        Self {
            states: SMatrix::from_diagonal(&states.component_mul(states)),
            cross: SMatrix::zeros(),
            theta: SMatrix::from_diagonal(&theta.component_mul(theta)),
        }
    }

    /// P ← P − P h hᵀ P/(hᵀ P h + r), h the unit vector of the position with index `place` in x;
    /// returns the gains of x and θ.
    pub fn measure(&mut self, place: usize, variance: f64) -> (SVector<f64, X>, SVector<f64, P>) {
        let states: SVector<f64, X> = self.states.column(place).into();
        let theta: SVector<f64, P> = self.cross.row(place).transpose();
        let s = states[place] + variance;
        let (gain_states, gain_theta) = (states / s, theta / s);
        // Joseph's form, (I − k hᵀ) P (I − h kᵀ) + r k kᵀ, written out
        let joseph = |gain_a: f64, b: f64, a: f64, gain_b: f64| -gain_a * b - a * gain_b + gain_a * gain_b * s;
        self.states += SMatrix::from_fn(|i, j| joseph(gain_states[i], states[j], states[i], gain_states[j]));
        self.cross += SMatrix::<f64, X, P>::from_fn(|i, j| joseph(gain_states[i], theta[j], states[i], gain_theta[j]));
        self.theta += SMatrix::from_fn(|i, j| joseph(gain_theta[i], theta[j], theta[i], gain_theta[j]));
        (gain_states, gain_theta)
    }

    /// Standard deviations of θ.
    pub fn theta_std(&self) -> SVector<f64, P> {
        self.theta.diagonal().map(|variance| variance.max(0.0).sqrt())
    }

    /// P ← F P Fᵀ + σ_u² G Gᵀ, F the Jacobian of (x, θ) with θ constant.
    pub fn propagate<const U: usize>(&mut self, jacobian: &Jacobian<X, P, U>, input_variance: f64) {
        let Jacobian { state, theta, input } = jacobian;
        let product = state * self.states + theta * self.cross.transpose();
        self.cross = state * self.cross + theta * self.theta;
        let states = product * state.transpose() + self.cross * theta.transpose();
        // keep it symmetric in spite of rounding
        self.states = (states + states.transpose()) * 0.5 + input * input.transpose() * input_variance;
    }
}
