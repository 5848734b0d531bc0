//! Derivatives of a plant's terms in the positions and velocities of its joints, by automatic
//! differentiation.
//!
//! ```text
//! ∂g_d/∂x at q, q̇, θ        x ∈ {q_j, q̇_j}, two of them in one evaluation
//! ```

use super::passes::{Shape, Terms};
use super::theta_polynomial::MAX_ORDER;
use crate::model::{AnyPlant, MAX_JOINTS, MAX_PARAMS, Number as _};
use num_dual::HyperDual64;

/// Number of signals in which one evaluation differentiates.
pub(super) const LANES: usize = 2;
/// The second derivative, which is not used, costs less than the branches of a vector of slopes
/// that may be absent.
type Number = HyperDual64;

/// A position or a velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind {
    pub joint: usize,
    pub velocity: bool,
}

/// The terms of an equation at θ, to be differentiated in up to [`LANES`] signals.
pub(super) struct Partials<'a> {
    plant: &'a dyn AnyPlant,
    shape: Shape,
    params: usize,
    theta: [Number; MAX_PARAMS],
    q: [Number; MAX_JOINTS],
    dq: [Number; MAX_JOINTS],
}

impl<'a> Partials<'a> {
    /// The terms of `equation`, to be differentiated in `kinds`.
    pub fn new(plant: &'a dyn AnyPlant, equation: usize, theta: &[f64], kinds: &[Kind]) -> Self {
        let zero = Number::from_re(0.0);
        let mut own = Self {
            plant,
            shape: Shape::of(plant, equation),
            params: theta.len(),
            theta: [zero; MAX_PARAMS],
            q: [zero; MAX_JOINTS],
            dq: [zero; MAX_JOINTS],
        };
        for (dual, &value) in own.theta.iter_mut().zip(theta) {
            dual.re = value;
        }
        for (lane, kind) in kinds.iter().enumerate() {
            let signals = if kind.velocity { &mut own.dq } else { &mut own.q };
            let signal = &mut signals[kind.joint];
            *(if lane == 0 { &mut signal.eps1 } else { &mut signal.eps2 }) = 1.0;
        }
        own
    }

    /// ∂g/∂x for each d, at (q, q̇) of each joint.
    #[inline]
    pub fn at(&mut self, signals: impl Fn(usize) -> (f64, f64)) -> [Terms; LANES] {
        let Shape {
            equation,
            joints,
            order,
        } = self.shape;
        for joint in 0..joints {
            (self.q[joint].re, self.dq[joint].re) = signals(joint);
        }
        let mut g = [Number::from_re(0.0); MAX_ORDER + 1];
        let (q, dq, theta) = (&self.q[..joints], &self.dq[..joints], &self.theta[..self.params]);
        Number::terms(self.plant, equation, q, dq, theta, &mut g[..=order]);
        [g.map(|g| g.eps1), g.map(|g| g.eps2)]
    }
}
