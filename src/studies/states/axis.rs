//! The servo axis as first-order equations, with its stops and reversals.
//!
//! ```text
//! M dv/dt = k u − F_v v − F_c sign v − b        moving, v ≠ 0
//! v = 0 while |k u − b| ≤ F_c                   stuck
//! ```
//!
//! x = (q, v). A step that would take v through zero is cut there, as in the simulator. The instant
//! of the cut depends on everything before it, so it is also a dual number; after a reversal δv⁺ =
//! δv⁻ a⁺/a⁻, after a stop δv⁺ = 0.

use super::{Jacobian, StateSpace};
use crate::model::{SERVO_PARAMS, Scalar};
use nalgebra::{Const, SMatrix, SVector};
use num_dual::{Derivative, DualSVec64};

/// States of the axis.
pub const AXIS_STATES: usize = 2;
const X: usize = AXIS_STATES;
const P: usize = SERVO_PARAMS;
const COLUMNS: usize = X + P + 1;
/// Largest number of reversals within a sample period.
const CUTS: usize = 4;
/// Newton's iterations for the instant of a cut; the motion is nearly a parabola.
const NEWTON: usize = 4;

type Dual = DualSVec64<COLUMNS>;

/// The axis at a sample period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisStates {
    /// k: force per unit of input.
    pub gain: f64,
    /// Δ \[s\].
    pub sample_period_s: f64,
}

/// q and v after `h` of motion with acceleration `a` now, which fades at `rate` = F_v/M: the series
/// of v(h) = v + a (1 − exp(−rate h))/rate and of its integral, up to rate³ h⁴.
fn moved<D: Scalar>([q, v]: [D; 2], a: D, rate: D, h: D) -> [D; 2] {
    let r = rate * h;
    [
        q + h * (v + a * h * (r * r / 24.0 - r / 6.0 + 0.5)),
        v + a * h * (r * r / 6.0 - r * 0.5 + 1.0),
    ]
}

impl AxisStates {
    /// One sample period, for any number type.
    fn step<D: Scalar>(&self, mut x: [D; 2], theta: [D; P], input: D) -> [D; 2] {
        let [mass, viscous, coulomb, offset] = theta;
        let drive = input * self.gain - offset;
        let rate = viscous / mass;
        let mut left = D::from(self.sample_period_s);
        for _ in 0..CUTS {
            let sign = match x[1].re() {
                v if v > 0.0 => 1.0,
                v if v < 0.0 => -1.0,
                _ if drive.re().abs() <= coulomb.re() => return x,
                _ => drive.re().signum(),
            };
            let a = (drive - viscous * x[1] - coulomb * sign) / mass;
            let end = moved(x, a, rate, left);
            if end[1].re() * sign > 0.0 {
                return end;
            }
            // v(t) = 0
            let mut t = if a.re() == 0.0 { D::zero() } else { -(x[1] / a) };
            for _ in 0..NEWTON {
                let slope = a - a * rate * t;
                t -= moved(x, a, rate, t)[1] / slope;
            }
            x = [moved(x, a, rate, t)[0], D::zero()];
            left -= t;
        }
        x
    }
}

impl StateSpace<X, P, 1> for AxisStates {
    const POSITIONS: [usize; 1] = [0];

    fn advance(
        &self,
        x: &SVector<f64, X>,
        theta: &SVector<f64, P>,
        input: &SVector<f64, 1>,
    ) -> (SVector<f64, X>, Jacobian<X, P, 1>) {
        let variable = |value: f64, place: usize| {
            Dual::new(
                value,
                Derivative::derivative_generic(Const::<COLUMNS>, Const::<1>, place),
            )
        };
        let states = std::array::from_fn(|i| variable(x[i], i));
        let parameters = std::array::from_fn(|i| variable(theta[i], X + i));
        let end = self.step(states, parameters, variable(input[0], X + P));
        let row = |i: usize| -> SVector<f64, COLUMNS> { end[i].eps.unwrap_generic(Const::<COLUMNS>, Const::<1>) };
        let rows = [row(0), row(1)];
        let jacobian = Jacobian {
            state: SMatrix::from_fn(|i, j| rows[i][j]),
            theta: SMatrix::from_fn(|i, j| rows[i][X + j]),
            input: SMatrix::from_fn(|i, _| rows[i][X + P]),
        };
        (SVector::from([end[0].re, end[1].re]), jacobian)
    }
}
