//! Evidence required before θ̂ as a whole may be used, besides having predicted the last blocks.
//!
//! ```text
//! informed     rows so far inform on more than half of the directions of a group       confirmation.rs
//! explained_e  the share of its signal's power that an equation explains               explained.rs
//! fits         the whitened residuals are noise, in the whole block and at its end      fit_statistic.rs
//! at ease      no parameter sits on a bound that the data push it against               here
//! ```
//!
//! A bound is at odds with the data if the optimum without bounds lies more than [`PRESSED`]
//! standard deviations beyond it:
//!
//! ```text
//! θ* = θ̂ + H⁻¹ g,   g = −½ ∂J/∂θ,   H = Λ + S        beyond by more than 4 σ √(H⁻¹)_ii
//! ```
//!
//! Because a step of a fit is limited to a factor, a parameter that the data push below 0 only
//! approaches its bound at 0 and need not sit on it.

use super::equation::TINY;
use super::group::GroupState;
use super::linalg::{gather, mul_vec};

/// Standard deviations by which the optimum may lie beyond a bound: by chance once in 30 000
/// blocks.
const PRESSED: f64 = 4.0;
/// Distance to a bound, as a share of the parameter's size, within which a parameter is checked.
const NEAR: f64 = 0.1;

impl GroupState {
    /// True if the data push a free parameter beyond its bound. The sums are those at
    /// `linearised`, and Λ, θ̄ those of the fit.
    pub fn is_pressed(&mut self, theta: &[f64], linearised: &[f64]) -> bool {
        let n = self.n;
        let start = self.parameters.start;
        let near = |i: usize| {
            let margin = NEAR * self.size(theta, i);
            self.limits.is_near_bound(i, theta[start + i], margin)
        };
        if !self.limits.free().any(near) {
            return false;
        }
        let variance = self.equations.variance().max(TINY);
        // −½ ∂J/∂θ = g − S (θ − θ_l), less the slope of the prior
        let room = &mut self.room;
        self.prior.expand(&theta[self.parameters.clone()], room);
        self.equations.add_scores(&mut room.gradient);
        room.a.fill(0.0);
        self.equations.add_grams(&mut room.a);
        for i in 0..n {
            room.offset[i] = theta[start + i] - linearised[start + i];
        }
        mul_vec(n, &room.a, &room.offset, &mut room.scale);
        room.gradient.iter_mut().zip(&room.scale).for_each(|(g, v)| *g -= v);
        room.total.iter_mut().zip(&room.a).for_each(|(s, v)| *s += v);
        let count = gather(n, &room.total, self.limits.fixed(), &mut room.a);
        if !room.cholesky.factor(count, &room.a[..count * count]) {
            return false;
        }
        room.cholesky.inverse(&mut room.b[..count * count]);
        self.limits.free().enumerate().any(|(k, i)| {
            let row = &room.b[k * count..(k + 1) * count];
            let step: f64 = row
                .iter()
                .zip(self.limits.free())
                .map(|(h, j)| h * room.gradient[j])
                .sum();
            let room_for_chance = PRESSED * (variance * row[k]).sqrt();
            self.limits.is_beyond_bound(i, theta[start + i] + step, room_for_chance)
        })
    }

    /// The same for a block that a line was fitted to, without bounds: true if it ends beyond one.
    pub fn line_is_pressed(&self) -> bool {
        self.limits.free().any(|i| {
            let room_for_chance = PRESSED * self.drift.line.end_covariance(i, i).max(0.0).sqrt();
            self.limits.is_beyond_bound(i, self.drift.end(i), room_for_chance)
        })
    }
}
