//! Friction that drifts while all of the past counts alike.
//!
//! Before friction is let walk, see [`identify`](super::identify), an estimate is the mean of what
//! friction has been; a cold machine warms fastest then. Of the last blocks of a joint alone, with
//! A_ff and b_f the sums of its friction columns:
//!
//! ```text
//! e = Σ (b_f − A_f θ̂),    δ = (Σ A_ff)⁻¹ e                                                   (1)
//! z_i = δ_i/(f_j σ_j √[(Σ A_ff)⁻¹]_ii)                                                        (2)
//! P_ii ← P_ii + δ_i²    if |z_i| > SEEN                                                        (3)
//! ```
//!
//! δ_i is how far the last blocks are from the mean, which is most of a steady drift unless they
//! are most of all blocks. With `friction_walk = 0` friction does not drift, and nothing is allowed.

use super::identify::RobotIdentifier;
use super::left_out_room::LeftOut;
use crate::estimator::linalg::Cholesky;

/// Blocks that are looked at.
const LAST: usize = 8;
/// Terms of a joint's friction, at most.
const MOST: usize = super::friction::FrictionTerm::NAMES.len();
/// z from which on standard deviations allow for a drift: a slow one is small beside what the last
/// blocks alone say, and no value of friction is of use that may have drifted by as much.
const SEEN: f64 = 1.0;
/// Part of a column's sum of squares that keeps columns apart which depend on each other.
const RIDGE: f64 = 1e-6;

/// How far friction seems to have drifted, and room to find out.
#[derive(Debug, Clone)]
pub(super) struct FrictionDrift {
    /// δ per parameter, 0 for what has not drifted.
    shift: Vec<f64>,
    factor: Cholesky,
}

impl FrictionDrift {
    /// Room for so many parameters.
    pub fn new(parameters: usize) -> Self {
        Self {
            shift: vec![0.0; parameters],
            factor: Cholesky::new(MOST),
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.shift.fill(0.0);
    }

    /// What (3) adds to a variance.
    pub fn variance(&self, parameter: usize) -> f64 {
        self.shift.get(parameter).map_or(0.0, |shift| shift * shift)
    }
}

impl RobotIdentifier {
    /// (1) to (3) after a block was learnt.
    pub(super) fn look_for_drift(&mut self) {
        self.drift.reset();
        if self.options.friction_walk == 0.0 {
            return;
        }
        for joint in 0..self.torque_std.len() {
            self.drift_of(joint);
        }
    }

    fn drift_of(&mut self, joint: usize) {
        let own = self.model.friction_of(joint);
        let n = own.len();
        let behind = |left_out: &LeftOut| left_out.of_joint(joint) + left_out.shared();
        let behind = self.left_out.as_ref().map_or(0, behind);
        let mut sum = [0.0; MOST * MOST];
        let mut delta = [0.0; MOST];
        let (kept, last) = (self.recent.len(), self.recent_blocks.min(LAST));
        for age in 1..=last {
            let sums = &self.recent[(self.recent_blocks - age) % kept][joint];
            let m = sums.columns().len();
            let first = m - behind - n;
            for i in 0..n {
                delta[i] += sums.gradient(first + i, &self.effective); // e of (1)
                for j in 0..n {
                    sum[i * n + j] += sums.gram[(first + i) * m + first + j];
                }
            }
        }
        for i in 0..n {
            sum[i * n + i] *= 1.0 + RIDGE;
        }
        if n == 0 || !self.drift.factor.factor(n, &sum[..n * n]) {
            return;
        }
        self.drift.factor.solve(&mut delta[..n]); // (1)
        let level = self.torque_std[joint] * self.inflation[joint];
        for (i, parameter) in own.enumerate() {
            let mut unit = [0.0; MOST];
            unit[i] = 1.0;
            self.drift.factor.solve(&mut unit[..n]);
            if !self.fixed[parameter] && delta[i].abs() > SEEN * level * unit[i].max(0.0).sqrt() {
                self.drift.shift[parameter] = delta[i]; // (2), (3)
            }
        }
    }
}
