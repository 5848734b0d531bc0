//! How a row depends on each position that it is made of.
//!
//! ```text
//! c(k) = −∂f/∂q_k = Σ_d K_d(k) ∂g_d/∂q + Σ_j s_j Σ_d K_d(k − j) ∂g_d/∂q̇ + Σ (velocity terms) θ K_{d+1}(k)
//! ```
//!
//! with K_d the kernels of the window (`kernel.rs`) and s the velocity filter. Terms that are
//! linear in the velocity have been integrated by parts and depend on the position alone.

use super::kernel::Kernels;
use super::separation::{MAX_ORDER, Sensitivity};
use super::theta_polynomial::Polynomial;

/// What the weights of one equation are made of.
pub(super) struct ErrorWeights<'a> {
    pub kernels: &'a Kernels,
    pub velocity_weights: &'a [f64],
    pub polynomial: Option<&'a Polynomial>,
    pub sensitivity: &'a Sensitivity,
    /// Highest derivative of the equation's terms.
    pub order: usize,
}

/// ∂g_d/∂q̇ of the terms that are linear in the velocity of a joint, which enter by way of the
/// position.
pub(super) fn linear_in_velocity(
    polynomial: Option<&Polynomial>,
    joint: usize,
    velocity: bool,
    theta: &[f64],
) -> [f64; MAX_ORDER + 1] {
    let mut linear = [0.0; MAX_ORDER + 1];
    if let (true, Some(polynomial)) = (velocity, polynomial) {
        for term in polynomial.velocity.iter().filter(|term| term.joint == joint) {
            linear[term.derivative] += polynomial.monomials[term.monomial].value(theta) * term.coefficient;
        }
    }
    linear
}

/// The slopes of the nonlinear terms; a kink or a pole of the model must not spoil the weights.
pub(super) fn nonlinear(mut slopes: [f64; MAX_ORDER + 1], linear: &[f64; MAX_ORDER + 1]) -> [f64; MAX_ORDER + 1] {
    for (slope, linear) in slopes.iter_mut().zip(linear) {
        *slope = if slope.is_finite() { *slope - linear } else { 0.0 };
    }
    slopes
}

impl ErrorWeights<'_> {
    /// Positions per joint that a row depends on.
    pub fn support(&self) -> usize {
        2 * (self.kernels.half + self.velocity_weights.len() / 2) + 1
    }

    /// Writes c, joint after joint. `slopes(joint, velocity, k)` are [the nonlinear
    /// ones](nonlinear) at sample k of the window.
    pub fn write(&self, theta: &[f64], slopes: impl Fn(usize, bool, usize) -> [f64; MAX_ORDER + 1], c: &mut [f64]) {
        let (kernels, support) = (self.kernels, self.support());
        let velocity_half = self.velocity_weights.len() / 2;
        c.fill(0.0);
        if let Some(polynomial) = self.polynomial {
            for term in &polynomial.velocity {
                let factor = polynomial.monomials[term.monomial].value(theta) * term.coefficient;
                let own = &mut c[term.joint * support + velocity_half..];
                for (c, weight) in own.iter_mut().zip(&kernels.position[term.derivative + 1]) {
                    *c += factor * weight;
                }
            }
        }
        let sum = |slopes: &[f64; MAX_ORDER + 1], k: usize| -> f64 {
            (0..=self.order).map(|d| kernels.position[d][k] * slopes[d]).sum()
        };
        for &joint in &self.sensitivity.position {
            let own = &mut c[joint * support + velocity_half..];
            for (k, c) in own.iter_mut().take(2 * kernels.half + 1).enumerate() {
                *c += sum(&slopes(joint, false, k), k);
            }
        }
        for &joint in &self.sensitivity.velocity {
            let own = &mut c[joint * support..(joint + 1) * support];
            for k in 0..=2 * kernels.half {
                let at_k = sum(&slopes(joint, true, k), k);
                // the transposed velocity filter
                for (c, weight) in own[k..].iter_mut().zip(self.velocity_weights) {
                    *c += weight * at_k;
                }
            }
        }
    }
}
