//! Share of a joint's torque that the model explains, with noise separated from what the model
//! lacks.
//!
//! ```text
//! S ← S e^(−T_b/T) + S_block    for S = n, Σ τ, Σ τ², Σ r r′ over rows                          (1)
//! lacking = max(0, Σ r r′ − z σ_j² n/√(n l))                                                   (2)
//! explained = 1 − lacking/(Σ τ² − (Σ τ)²/n)                                                    (3)
//! ```
//!
//! r is the residual of a row at θ̂ and r′ that of the row one window earlier, so the two have no
//! sample in common: noise leaves Σ r r′ at 0, to within σ_j² n/√(n l), l being the share of the
//! rows that do not overlap. Missing terms keep their sign during a movement and contribute r². A
//! level learnt from the residuals could not separate the two: a joint that is not explained at all
//! has a large σ_j, little weight, and would pass for a noisy one.
//!
//! The torque hardly changes within a short block, so (3) covers several: T is 20 s. Time at rest
//! does not count. A torque that does not change at all while the joint moves has a share of 0. A
//! wrong model stays wrong after the part of the motion that showed it, so a joint needs a larger
//! share to count as explained again.

use super::recent::RowRing;
use super::rows::WeakRow;
use super::sums::JointSums;
use super::windows::WindowOptions;
use crate::estimator::persist::Visit;
use crate::model::MAX_JOINTS;

/// Share of the power of each joint's torque, beyond noise, that a model of a robot must explain.
/// Simulated arms with other forms of friction (asymmetric, Stribeck, dependent on position or
/// load, warming up), elastic joints, cogging and backlash have 0.98 and more, with a spring at
/// each joint 0.92; a reversed axis or sign, or exchanged columns, give 0.84 or less at some joint.
pub const LEAST_EXPLAINED: f64 = 0.9;
/// Share above which an unexplained joint counts as explained again.
const EXPLAINED_AGAIN: f64 = 0.97;
/// T \[s\].
const MEMORY_S: f64 = 20.0;
/// z: for a joint whose torque is only noise, the share falls below [`LEAST_EXPLAINED`] by chance
/// once in 3000 stretches of T.
const SURE: f64 = 2.5;
/// Smallest number of pairs of rows.
const PAIRS: f64 = 10.0;
/// Variance of the torque, relative to its mean square, below which it is rounding.
const ROUNDING: f64 = 1e-9;

/// Sums (1) over the last seconds of a joint's rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct RecentTorque {
    pairs: f64,
    torque: f64,
    torque_square: f64,
    product: f64,
}

impl RecentTorque {
    /// Advances by one block.
    fn fade(&mut self, kept: f64) {
        for sum in [
            &mut self.pairs,
            &mut self.torque,
            &mut self.torque_square,
            &mut self.product,
        ] {
            *sum *= kept;
        }
    }

    fn add(&mut self, torque: f64, product: f64) {
        self.pairs += 1.0;
        self.torque += torque;
        self.torque_square += torque * torque;
        self.product += product; // (1)
    }

    /// (3), for a joint with residuals of this level; `None` while there are too few rows.
    pub fn explained(&self, level: f64, independent: f64) -> Option<f64> {
        if self.pairs < PAIRS {
            return None;
        }
        let spread = self.torque_square - self.torque * self.torque / self.pairs;
        if spread <= ROUNDING * self.torque_square {
            // an offset imitates a sensor that hangs, whatever the machine is
            return Some(0.0);
        }
        let chance = SURE * level * level * (self.pairs / independent).sqrt();
        let lacking = (self.product - chance).max(0.0); // (2)
        Some(1.0 - lacking / spread) // (3)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        for sum in [
            &mut self.pairs,
            &mut self.torque,
            &mut self.torque_square,
            &mut self.product,
        ] {
            v.real(sum);
        }
    }
}

/// The rows of the open block, with those of one window before it.
#[derive(Debug, Clone)]
pub(super) struct RecentRows {
    rows: RowRing,
    /// Residuals of one joint.
    residuals: Vec<f64>,
    /// Number of rows from one to the next that shares no sample with it.
    lag: usize,
    lag_s: f64,
    /// Share of the rows that do not overlap.
    independent: f64,
    kept: f64,
    /// Middle of the last window processed \[s\].
    seen_s: f64,
    /// Joints that are not explained.
    pub lacking: [bool; MAX_JOINTS],
}

impl RecentRows {
    /// Workspace for a block of joints with these numbers of columns.
    pub fn new(windows: &WindowOptions, block_s: f64, columns: &[usize]) -> Self {
        let lag = (windows.length_s / windows.stride_s).ceil().max(1.0) as usize;
        let room = (block_s / windows.stride_s).ceil() as usize + lag + 2;
        Self {
            rows: RowRing::new(room, columns),
            residuals: vec![f64::NAN; room],
            lag,
            lag_s: lag as f64 * windows.stride_s,
            independent: (windows.stride_s / windows.length_s).min(1.0),
            kept: (-block_s / MEMORY_S).exp(),
            seen_s: f64::NEG_INFINITY,
            lacking: [false; MAX_JOINTS],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.clear();
        self.lacking.fill(false);
    }

    /// Changes the length of the windows, with as many strides per window; drops the rows so far.
    pub fn set_windows(&mut self, windows: &WindowOptions) {
        self.lag_s = self.lag as f64 * windows.stride_s;
        self.clear();
    }

    /// Adds a row.
    pub fn add(&mut self, row: &WeakRow<'_>) {
        self.rows.add(row);
    }

    /// Drops the rows so far: they are of another stretch of time, or of another machine.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.seen_s = f64::NEG_INFINITY;
    }

    /// (1) for a block, and the shares (3) into `explained`; `std` are the σ_j.
    pub fn explain(
        &mut self,
        (block, theta): (&[JointSums], &[f64]),
        std: &[f64],
        recent: &mut [RecentTorque],
        explained: &mut [f64],
    ) {
        let len = self.rows.len();
        for (j, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            for age in 0..len {
                let (at, instant) = self.rows.get(age);
                let columns = sums.columns();
                let row = self.rows.regressor(at, j, columns.len());
                let predicted: f64 = row.iter().zip(columns).map(|(x, &k)| x * theta[k]).sum();
                self.residuals[age] = instant.torque[j] - predicted;
            }
            recent[j].fade(self.kept);
            for age in self.lag..len {
                let (now, before) = (self.rows.get(age).1, self.rows.get(age - self.lag).1);
                let product = self.residuals[age] * self.residuals[age - self.lag];
                let is_apart = ((now.t_s - before.t_s) / self.lag_s - 1.0).abs() < 0.1;
                if now.t_s > self.seen_s && is_apart && product.is_finite() {
                    recent[j].add(now.torque[j], product);
                }
            }
            if let Some(share) = recent[j].explained(std[j], self.independent) {
                explained[j] = share;
                let least = if self.lacking[j] {
                    EXPLAINED_AGAIN
                } else {
                    LEAST_EXPLAINED
                };
                self.lacking[j] = share < least;
            }
        }
        self.seen_s = len.checked_sub(1).map_or(self.seen_s, |last| self.rows.get(last).1.t_s);
    }
}
