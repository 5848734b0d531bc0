//! A baseline: the extended Kalman filter with the parameters in its state.
//!
//! ```text
//! x = (q₂, q̇₁, q̇₂, q̈₁, q̈₂, ln θ₁ … ln θ₉)        14 states; q₁ enters nothing
//! ẋ = (q̇₂, q̈₁, q̈₂, q⃛₁, q⃛₂, 0 … 0)              the jerks from (26), solved for them
//! z = (q₂, q̇₁, q̇₂, q̈₁, q̈₂)                        measured at each sample
//! ```
//!
//! Logarithms keep θ positive, and one random walk suits all parameters. u is measured at the
//! samples, and its noise drives the process; between samples it is linear up to its value before
//! the next setpoint step, which follows from the gains. One Runge-Kutta step per sample, with its
//! Jacobian by automatic differentiation, and sequential scalar updates. Source: Ljung, Asymptotic
//! behavior of the extended Kalman filter as a parameter estimator for linear systems, IEEE TAC 24
//! (1979).

use super::Scenario;
use crate::model::{MANIPULATOR_PARAMS, Scalar};
use nalgebra::{Const, SMatrix, SVector};
use num_dual::DualSVec64;

const MEASURED: usize = 5;
const STATES: usize = MEASURED + MANIPULATOR_PARAMS;
type Dual = DualSVec64<STATES>;

/// Tuning of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EkfTuning {
    /// Standard deviation of the parameters' random walk per block of 1900 samples, relative.
    pub random_walk: f64,
    /// Standard deviation of the voltage that drives the process \[V\].
    pub voltage_std_v: f64,
}

/// The running filter.
#[derive(Debug, Clone)]
pub struct Ekf {
    gravity: f64,
    tuning: EkfTuning,
    period_s: f64,
    x: SVector<f64, STATES>,
    p: SMatrix<f64, STATES, STATES>,
}

/// q⃛ from (26) at θ, both joints.
fn jerks<D: Scalar>(gravity: f64, [q2, dq1, dq2, ddq1, ddq2]: [D; MEASURED], theta: &[D], voltage: [D; 2]) -> [D; 2] {
    let (sin, cos) = (q2.sin(), q2.cos());
    let (sin_2q2, cos_2q2, cos2) = (sin * cos * 2.0, cos * cos - sin * sin, cos * cos);
    // (26), first equation, everything but the jerk's own term
    let rest_1 = theta[4] * dq1 * 12.0 - theta[3] * sin_2q2 * dq1 * dq2 * 3.0
        + (theta[2] + theta[3] * cos2 * 3.0) * ddq1
        - theta[1] * (cos_2q2 * dq1 * dq2 * dq2 * 6.0 + sin_2q2 * (dq2 * ddq1 * 6.0 + dq1 * ddq2 * 3.0));
    // (26), second equation
    let (theta_6, theta_7, theta_9) = (theta[5], theta[6], theta[8]);
    let rest_2 = theta_7 * (cos * (6.0 * gravity) + theta_9 * (sin_2q2 * dq1 * dq1 * 1.5 + ddq2 * 4.0))
        + theta[7] * dq2 * 12.0
        - theta_6 * sin * dq2 * (6.0 * gravity)
        + theta_6 * theta_9 * (cos_2q2 * dq1 * dq1 * dq2 + sin_2q2 * dq1 * ddq1) * 3.0;
    [
        (voltage[0] * 12.0 - rest_1) / (theta[0] + theta[1] * cos2 * 3.0),
        (voltage[1] * 12.0 - rest_2) / (theta_6 * theta_9 * 4.0),
    ]
}

impl Ekf {
    /// Standard deviations of the measurement in rad, rad/s and rad/s². The signals are exact, but
    /// with smaller values the filter trusts its first linearisations too much: with a hundredth of
    /// these and noise on the voltage it diverges in the first block, with a tenth it follows a
    /// jump more slowly.
    const MEASUREMENT_STD: [f64; MEASURED] = [1e-3, 1e-2, 1e-2, 1.0, 1.0];
    /// Standard deviation of ln θ at the start: a factor of 2.7.
    const START_STD: f64 = 1.0;

    /// A filter at positive start values.
    pub fn new(scenario: &Scenario, theta_start: &[f64], tuning: EkfTuning) -> Self {
        let first = scenario.samples()[0];
        let mut x = SVector::<f64, STATES>::zeros();
        let measured = [first.q[1], first.dq[0], first.dq[1], first.ddq[0], first.ddq[1]];
        x.as_mut_slice()[..MEASURED].copy_from_slice(&measured);
        let mut p = SMatrix::<f64, STATES, STATES>::zeros();
        for i in 0..MEASURED {
            p[(i, i)] = Self::MEASUREMENT_STD[i].powi(2);
        }
        for (i, theta) in theta_start.iter().enumerate() {
            x[MEASURED + i] = theta.ln();
            p[(MEASURED + i, MEASURED + i)] = Self::START_STD.powi(2);
        }
        Self {
            gravity: scenario.model().gravity_m_s2(),
            tuning,
            period_s: scenario.options().sample_period_s,
            x,
            p,
        }
    }

    /// θ̂.
    pub fn theta(&self) -> [f64; MANIPULATOR_PARAMS] {
        std::array::from_fn(|i| self.x[MEASURED + i].exp())
    }

    /// Standard deviation of θ̂ to first order.
    pub fn theta_std(&self) -> [f64; MANIPULATOR_PARAMS] {
        std::array::from_fn(|i| self.x[MEASURED + i].exp() * self.p[(MEASURED + i, MEASURED + i)].max(0.0).sqrt())
    }

    /// ẋ of the measured part.
    fn rate<D: Scalar>(&self, y: [D; MEASURED], theta: &[D], voltage: [f64; 2]) -> [D; MEASURED] {
        let [ddd1, ddd2] = jerks(self.gravity, y, theta, voltage.map(D::from));
        [y[2], y[3], y[4], ddd1, ddd2]
    }

    /// From one sample to the next; the voltage runs from `start` to `end`.
    pub fn predict(&mut self, start: [f64; 2], end: [f64; 2]) {
        let h = self.period_s;
        let state: [Dual; STATES] = std::array::from_fn(|i| {
            Dual::new(
                self.x[i],
                num_dual::Derivative::derivative_generic(Const::<STATES>, nalgebra::U1, i),
            )
        });
        let theta: [Dual; MANIPULATOR_PARAMS] = std::array::from_fn(|i| num_dual::DualNum::exp(&state[MEASURED + i]));
        let y: [Dual; MEASURED] = std::array::from_fn(|i| state[i]);
        let middle = [0, 1].map(|joint| 0.5 * (start[joint] + end[joint]));
        let ahead = |k: &[Dual; MEASURED], by: f64| -> [Dual; MEASURED] { std::array::from_fn(|i| y[i] + k[i] * by) };
        let k1 = self.rate(y, &theta, start);
        let k2 = self.rate(ahead(&k1, 0.5 * h), &theta, middle);
        let k3 = self.rate(ahead(&k2, 0.5 * h), &theta, middle);
        let k4 = self.rate(ahead(&k3, h), &theta, end);
        let mut jacobian = SMatrix::<f64, STATES, STATES>::identity();
        for i in 0..MEASURED {
            let next = y[i] + (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
            self.x[i] = next.re;
            jacobian.set_row(i, &next.eps.unwrap_generic(Const::<STATES>, nalgebra::U1).transpose());
        }
        // The same voltage error over a sample moves the accelerations by h ∂q⃛/∂u.
        let at: [f64; MANIPULATOR_PARAMS] = self.theta();
        let cos2 = self.x[0].cos().powi(2);
        let gains = [12.0 / (at[0] + 3.0 * at[1] * cos2), 12.0 / (4.0 * at[5] * at[8])];
        self.p = jacobian * self.p * jacobian.transpose();
        for (joint, gain) in gains.iter().enumerate() {
            self.p[(3 + joint, 3 + joint)] += (h * gain * self.tuning.voltage_std_v).powi(2);
        }
        for i in MEASURED..STATES {
            self.p[(i, i)] += self.tuning.random_walk.powi(2) / 1900.0;
        }
    }

    /// Updates with the measurement of a sample.
    pub fn update(&mut self, measured: [f64; MEASURED]) {
        for (i, z) in measured.into_iter().enumerate() {
            let column = self.p.column(i).clone_owned();
            let variance = column[i] + Self::MEASUREMENT_STD[i].powi(2);
            let gain = column / variance;
            let innovation = z - self.x[i];
            self.x += gain * innovation;
            self.p -= gain * column.transpose();
        }
        self.p = (self.p + self.p.transpose()) * 0.5;
    }
}
