//! The paper's arm as first-order equations, in which the voltages are not differentiated.
//!
//! ```text
//! p₁ = (θ₁ + 3θ₂ cos²q₂) q̇₁        a₁ = ṗ₁ + (θ₃ + 3θ₄ cos²q₂) q̇₁            ȧ₁ = 12u₁ − 12θ₅q̇₁
//! p₂ = 4θ₆θ₉ q̇₂                    a₂ = ṗ₂ + 4θ₇θ₉ q̇₂ + θ₆(1.5θ₉ sin 2q₂ q̇₁² + 6g cos q₂)
//!                                  ȧ₂ = 12u₂ − 12θ₈q̇₂ − 1.5θ₇θ₉ sin 2q₂ q̇₁² − 6gθ₇ cos q₂
//! ```
//!
//! x = (q₁, p₁, a₁, q₂, p₂, a₂). The second derivative of p is that of the plant (26).

use super::{Jacobian, StateSpace};
use crate::model::MANIPULATOR_PARAMS;
use nalgebra::{SMatrix, SVector};

/// States of the arm.
pub const ARM_STATES: usize = 6;
const X: usize = ARM_STATES;
const P: usize = MANIPULATOR_PARAMS;
/// Columns of sensitivities: states, parameters, voltages.
const COLUMNS: usize = X + P + 2;
/// Runge-Kutta steps per second.
const STEPS_PER_S: f64 = 2000.0;

type Rows = [[f64; COLUMNS]; X];

/// The arm at a sample period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmStates {
    /// g \[m/s²\].
    pub gravity_m_s2: f64,
    /// Δ \[s\].
    pub sample_period_s: f64,
}

impl ArmStates {
    /// x of the arm at rest at these positions \[rad\].
    pub fn at_rest(&self, [q1, q2]: [f64; 2], theta: &SVector<f64, P>) -> SVector<f64, X> {
        SVector::from([q1, 0.0, 0.0, q2, 0.0, 6.0 * self.gravity_m_s2 * theta[5] * q2.cos()])
    }

    /// Range of the arm: x at 1 rad, 1 rad/s, 1 rad/s² and under its weight; the standard
    /// deviations of an unknown state.
    pub fn reach(&self, theta: &SVector<f64, P>) -> SVector<f64, X> {
        let (inertia, damping) = (
            [theta[0] + 3.0 * theta[1], 4.0 * theta[5] * theta[8]],
            [theta[2] + 3.0 * theta[3], 4.0 * theta[6] * theta[8]],
        );
        let weight = 6.0 * self.gravity_m_s2 * theta[5];
        SVector::from([
            1.0,
            inertia[0],
            inertia[0] + damping[0],
            1.0,
            inertia[1],
            inertia[1] + damping[1] + weight,
        ])
    }

    /// q̇ \[rad/s\].
    pub fn velocities(x: &SVector<f64, X>, theta: &SVector<f64, P>) -> [f64; 2] {
        let c = x[3].cos();
        [
            x[1] / (theta[0] + 3.0 * theta[1] * c * c),
            x[4] / (4.0 * theta[5] * theta[8]),
        ]
    }

    /// ẋ and the rate of its sensitivities to the first state, θ and u.
    fn rate(&self, x: &[f64; X], s: &Rows, th: &SVector<f64, P>, input: &SVector<f64, 2>) -> ([f64; X], Rows) {
        let [_, p1, a1, q2, p2, a2] = *x;
        let g = self.gravity_m_s2;
        let (sin, c) = q2.sin_cos();
        let (s2, c2) = (2.0 * sin * c, c * c - sin * sin);
        let m1 = th[0] + 3.0 * th[1] * c * c;
        let k1 = th[2] + 3.0 * th[3] * c * c;
        let i2 = 1.0 / (4.0 * th[5] * th[8]);
        let (d1, d2) = (p1 / m1, p2 * i2);
        let centrifugal = 1.5 * s2 * d1 * d1;
        let rate = [
            d1,
            a1 - k1 * d1,
            12.0 * (input[0] - th[4] * d1),
            d2,
            a2 - 4.0 * th[6] * th[8] * d2 - th[5] * (th[8] * centrifugal + 6.0 * g * c),
            12.0 * (input[1] - th[7] * d2) - th[6] * (th[8] * centrifugal + 6.0 * g * c),
        ];
        // through the states, then the direct effect of θ and u
        let mut out: Rows = [[0.0; COLUMNS]; X];
        let mut v1 = [0.0; COLUMNS];
        let mut v2 = [0.0; COLUMNS];
        for j in 0..COLUMNS {
            v1[j] = (s[1][j] + 3.0 * th[1] * s2 * d1 * s[3][j]) / m1;
            v2[j] = s[4][j] * i2;
        }
        v1[X] -= d1 / m1;
        v1[X + 1] -= 3.0 * c * c * d1 / m1;
        v2[X + 5] -= d2 / th[5];
        v2[X + 8] -= d2 / th[8];
        // ∂/∂q₂ and ∂/∂q̇₁ of centrifugal force and weight, without θ₆ or θ₇
        let by_q2 = th[8] * 3.0 * c2 * d1 * d1 - 6.0 * g * sin;
        let by_d1 = th[8] * 3.0 * s2 * d1;
        for j in 0..COLUMNS {
            let turned = by_q2 * s[3][j] + by_d1 * v1[j];
            out[0][j] = v1[j];
            out[1][j] = s[2][j] - k1 * v1[j] + 3.0 * th[3] * s2 * d1 * s[3][j];
            out[2][j] = -12.0 * th[4] * v1[j];
            out[3][j] = v2[j];
            out[4][j] = s[5][j] - 4.0 * th[6] * th[8] * v2[j] - th[5] * turned;
            out[5][j] = -12.0 * th[7] * v2[j] - th[6] * turned;
        }
        out[1][X + 2] -= d1;
        out[1][X + 3] -= 3.0 * c * c * d1;
        out[2][X + 4] -= 12.0 * d1;
        out[2][X + P] += 12.0;
        out[4][X + 5] -= th[8] * centrifugal + 6.0 * g * c;
        out[4][X + 6] -= 4.0 * th[8] * d2;
        out[4][X + 8] -= 4.0 * th[6] * d2 + th[5] * centrifugal;
        out[5][X + 6] -= th[8] * centrifugal + 6.0 * g * c;
        out[5][X + 7] -= 12.0 * d2;
        out[5][X + 8] -= th[6] * centrifugal;
        out[5][X + P + 1] += 12.0;
        (rate, out)
    }
}

impl StateSpace<X, P, 2> for ArmStates {
    const POSITIONS: [usize; 2] = [0, 3];

    fn advance(
        &self,
        x: &SVector<f64, X>,
        theta: &SVector<f64, P>,
        input: &SVector<f64, 2>,
    ) -> (SVector<f64, X>, Jacobian<X, P, 2>) {
        let steps = (self.sample_period_s * STEPS_PER_S).ceil().max(1.0);
        let h = self.sample_period_s / steps;
        let mut x: [f64; X] = (*x).into();
        let mut rows: Rows = [[0.0; COLUMNS]; X];
        for i in 0..X {
            rows[i][i] = 1.0;
        }
        let shifted = |x: &[f64; X], rows: &Rows, k: &([f64; X], Rows), h: f64| -> ([f64; X], Rows) {
            let mut out = (*x, *rows);
            for i in 0..X {
                out.0[i] += h * k.0[i];
                for j in 0..COLUMNS {
                    out.1[i][j] += h * k.1[i][j];
                }
            }
            out
        };
        for _ in 0..steps as usize {
            let k1 = self.rate(&x, &rows, theta, input);
            let (x2, r2) = shifted(&x, &rows, &k1, 0.5 * h);
            let k2 = self.rate(&x2, &r2, theta, input);
            let (x3, r3) = shifted(&x, &rows, &k2, 0.5 * h);
            let k3 = self.rate(&x3, &r3, theta, input);
            let (x4, r4) = shifted(&x, &rows, &k3, h);
            let k4 = self.rate(&x4, &r4, theta, input);
            for i in 0..X {
                x[i] += h / 6.0 * (k1.0[i] + 2.0 * k2.0[i] + 2.0 * k3.0[i] + k4.0[i]);
                for j in 0..COLUMNS {
                    rows[i][j] += h / 6.0 * (k1.1[i][j] + 2.0 * k2.1[i][j] + 2.0 * k3.1[i][j] + k4.1[i][j]);
                }
            }
        }
        let jacobian = Jacobian {
            state: SMatrix::from_fn(|i, j| rows[i][j]),
            theta: SMatrix::from_fn(|i, j| rows[i][X + j]),
            input: SMatrix::from_fn(|i, j| rows[i][X + P + j]),
        };
        (x.into(), jacobian)
    }
}
