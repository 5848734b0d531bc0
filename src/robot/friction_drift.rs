//! Drift of friction while all past data have equal weight.
//!
//! Until friction has a random walk, see [`identify`](super::identify), its estimate is a mean over
//! the past, but a cold machine warms fastest then. From the last blocks of a joint alone, with
//! A_ff and b_f the sums of its friction columns:
//!
//! ```text
//! e = Σ (b_f − A_f θ̂),    δ = (Σ A_ff)⁻¹ e                                                   (1)
//! z_i = δ_i/(f_j σ_j √[(Σ A_ff)⁻¹]_ii)                                                        (2)
//! P_ii ← P_ii + δ_i²    if |z_i| > SEEN                                                        (3)
//! ```
//!
//! δ_i is the distance of the last blocks from the mean: most of a steady drift, unless they are
//! most of all blocks. With `friction_walk = 0` friction is assumed constant, and nothing is added.

use super::sums::JointSums;
use crate::estimator::linalg::Cholesky;
use std::ops::Range;

/// Number of last blocks.
const LAST: usize = 8;
/// Largest number of friction terms of a joint.
const MOST: usize = super::friction::FrictionTerm::NAMES.len();
/// z above which standard deviations allow for a drift. It is low because a slow drift is small
/// relative to the uncertainty of the last blocks alone.
const SEEN: f64 = 1.0;
/// Share of a column's sum of squares that regularises linearly dependent columns.
const RIDGE: f64 = 1e-6;

/// Estimated drift of friction, with its workspace.
#[derive(Debug, Clone)]
pub(super) struct FrictionDrift {
    /// δ per parameter, 0 for parameters without drift.
    shift: Vec<f64>,
    factor: Cholesky,
}

impl FrictionDrift {
    /// Workspace for `parameters` parameters.
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

    /// (1) to (3) of a joint: `last` are the sums of its last blocks, `columns` its friction
    /// columns in these, `parameters` their indices in θ, and `level` is f_j σ_j.
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
