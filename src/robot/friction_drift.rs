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
//! are most of all blocks. With `friction_walk = 0` friction does not drift, and nothing is
//! allowed.

use super::sums::JointSums;
use crate::estimator::linalg::Cholesky;
use std::ops::Range;

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

    /// (1) to (3) of a joint: `last` are the sums of its last blocks, `columns` those of its
    /// friction there, `parameters` the indices of the same in θ, and `level` is f_j σ_j.
    pub fn look_at<'a>(
        &mut self,
        last: impl Iterator<Item = &'a JointSums>,
        (columns, parameters): (Range<usize>, Range<usize>),
        theta: &[f64],
        level: f64,
    ) {
        let (first, n) = (columns.start, columns.len());
        let mut sum = [0.0; MOST * MOST];
        let mut delta = [0.0; MOST];
        for sums in last.take(LAST) {
            let m = sums.columns().len();
            for i in 0..n {
                delta[i] += sums.gradient(first + i, theta); // e of (1)
                for j in 0..n {
                    sum[i * n + j] += sums.gram[(first + i) * m + first + j];
                }
            }
        }
        for i in 0..n {
            sum[i * n + i] *= 1.0 + RIDGE;
        }
        if n == 0 || !self.factor.factor(n, &sum[..n * n]) {
            return;
        }
        self.factor.solve(&mut delta[..n]); // (1)
        for (i, parameter) in parameters.enumerate() {
            let mut unit = [0.0; MOST];
            unit[i] = 1.0;
            self.factor.solve(&mut unit[..n]);
            if delta[i].abs() > SEEN * level * unit[i].max(0.0).sqrt() {
                self.shift[parameter] = delta[i]; // (2), (3)
            }
        }
    }

    /// What (3) adds to a variance.
    pub fn variance(&self, parameter: usize) -> f64 {
        self.shift.get(parameter).map_or(0.0, |shift| shift * shift)
    }
}
