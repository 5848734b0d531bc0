//! The dependence of a row on each position that it uses.
//!
//! ```text
//! c(k) = −∂f/∂q_k = Σ_d K_d(k) ∂g_d/∂q + Σ_j s_j Σ_d K_d(k − j) ∂g_d/∂q̇ + Σ (velocity terms) θ K_{d+1}(k)
//! ```
//!
//! with K_d the kernels of the window (`kernel.rs`) and s the velocity filter. Terms that are
//! linear in the velocity have been integrated by parts and depend on the position alone.

use super::kernel::{Kernels, correlate_odd};
use super::partials::Kind;
use super::passes::Terms;
use super::separation::Sensitivity;
use super::theta_polynomial::{MAX_ORDER, Polynomial};

/// The data for the weights of one equation.
pub(super) struct ErrorWeights<'a> {
    pub kernels: &'a Kernels,
    /// First half of the weights of the transposed velocity filter.
    pub transposed: &'a [f64],
    pub polynomial: Option<&'a Polynomial>,
    pub sensitivity: &'a Sensitivity,
}

/// ∂g_d/∂q̇ of the terms that are linear in the velocity of a joint; these depend on the position
/// after integration by parts.
pub(super) fn linear_in_velocity(polynomial: Option<&Polynomial>, kind: Kind, theta: &[f64]) -> Terms {
    let mut linear = [0.0; MAX_ORDER + 1];
    if let (true, Some(polynomial)) = (kind.velocity, polynomial) {
        for term in polynomial.velocity.iter().filter(|term| term.joint == kind.joint) {
            linear[term.derivative] += polynomial.monomials[term.monomial].value(theta) * term.coefficient;
        }
    }
    linear
}

/// The slopes of the nonlinear terms, 0 if not finite, so that a kink or a pole of the model cannot
/// spoil the weights.
#[inline]
pub(super) fn nonlinear(mut slopes: Terms, linear: &Terms) -> Terms {
    for (slope, linear) in slopes.iter_mut().zip(linear) {
        *slope = if slope.is_finite() { *slope - linear } else { 0.0 };
    }
    slopes
}

impl ErrorWeights<'_> {
    /// Positions per joint that a row depends on.
    pub fn support(&self) -> usize {
        2 * (self.kernels.half + self.transposed.len()) + 1
    }

    /// Size of the workspace of [`write`](Self::write): a window between two filters.
    pub fn room(kernels: &Kernels, velocity_half: usize) -> usize {
        2 * kernels.half + 1 + 4 * velocity_half
    }

    /// Writes the part of c that is the same in every row, joint after joint: that of the terms
    /// linear in the velocity.
    pub fn write_linear(&self, theta: &[f64], c: &mut [f64]) {
        let (support, velocity_half) = (self.support(), self.transposed.len());
        c.fill(0.0);
        let Some(polynomial) = self.polynomial else { return };
        for term in &polynomial.velocity {
            let factor = polynomial.monomials[term.monomial].value(theta) * term.coefficient;
            let own = &mut c[term.joint * support + velocity_half..];
            for (c, weight) in own.iter_mut().zip(&self.kernels.position[term.derivative + 1]) {
                *c += factor * weight;
            }
        }
    }

    /// Writes c, joint after joint; `linear` is [the part](Self::write_linear) that is the same in
    /// every row, `slopes(kind, d)` are [the nonlinear slopes](nonlinear) at the samples of the
    /// window, and `scratch` has the size [`room`](Self::room), with zeros on either side of the
    /// window.
    pub fn write<'s>(
        &self,
        linear: &[f64],
        slopes: impl Fn(Kind, usize) -> &'s [f64],
        scratch: &mut [f64],
        c: &mut [f64],
    ) {
        let (kernels, support) = (self.kernels, self.support());
        let velocity_half = self.transposed.len();
        c.copy_from_slice(linear);
        for (&kind, derivatives) in self.sensitivity.kinds.iter().zip(&self.sensitivity.derivatives) {
            let own = &mut c[kind.joint * support..(kind.joint + 1) * support];
            // Σ_d K_d ∂g_d/∂x
            let add = |sums: &mut [f64]| {
                for d in derivatives.clone() {
                    let slopes = slopes(kind, d).iter().zip(&kernels.position[d]);
                    for (sum, (slope, weight)) in sums.iter_mut().zip(slopes) {
                        *sum += weight * slope;
                    }
                }
            };
            if kind.velocity {
                let within = &mut scratch[2 * velocity_half..2 * velocity_half + 2 * kernels.half + 1];
                within.fill(0.0);
                add(within);
                correlate_odd(self.transposed, scratch, own);
            } else {
                add(&mut own[velocity_half..]);
            }
        }
    }
}
