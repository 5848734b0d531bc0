//! How well a block was predicted and is fitted, per joint, and its information on each parameter.
//!
//! ```text
//! innovation² = Σ r(θ̂ before)²/rows,   residual² = Σ r(θ̂)²/rows                              (1)
//! fit = residual²/σ_j²                                                                        (2)
//! ```
//!
//! Rows overlap, so only stride/length of them count as independent in the probability of (2). σ_j
//! is learnt from the same machine and includes the misfit of friction, so three times its square
//! is allowed, as for every learnt noise level.

use super::explained::RecentTorque;
use super::sums::JointSums;
use super::windows::WindowOptions;
use crate::estimator::stats::f_tail;
use crate::model::MAX_JOINTS;

/// Slack of a learnt variance.
const SLACK: f64 = 3.0;

/// Figures of the last block; arrays are per joint.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockFigures {
    /// Rows of the joint.
    pub rows: [usize; MAX_JOINTS],
    /// Root mean square of measured minus predicted torque, before the estimate uses the block \[N
    /// m or N\].
    pub innovation_rms: [f64; MAX_JOINTS],
    /// The same afterwards.
    pub residual_rms: [f64; MAX_JOINTS],
    /// Root mean square of the torque \[N m or N\].
    pub signal_rms: [f64; MAX_JOINTS],
    /// σ_j with which the block is compared \[N m or N\]; 0 in the first block.
    pub level: [f64; MAX_JOINTS],
    /// (3) of `explained.rs` after the last block in which the joint moved; 1 before there is
    /// enough to tell.
    pub explained: [f64; MAX_JOINTS],
    /// (1) of `explained.rs`.
    pub(super) recent: [RecentTorque; MAX_JOINTS],
    /// (2); 1 on average.
    pub fit: [f64; MAX_JOINTS],
    /// Probability of residuals this large, for the joint that fits worst.
    pub fit_probability: f64,
    /// Share of the variance of a parameter known to within its size that this block alone would
    /// remove, 0 to 1.
    pub excitation: Vec<f64>,
    independent: f64,
}

impl BlockFigures {
    /// For this many parameters.
    pub(super) fn new(parameters: usize) -> Self {
        Self {
            rows: [0; MAX_JOINTS],
            innovation_rms: [0.0; MAX_JOINTS],
            residual_rms: [0.0; MAX_JOINTS],
            signal_rms: [0.0; MAX_JOINTS],
            level: [0.0; MAX_JOINTS],
            explained: [1.0; MAX_JOINTS],
            recent: [RecentTorque::default(); MAX_JOINTS],
            fit: [0.0; MAX_JOINTS],
            fit_probability: 1.0,
            excitation: vec![0.0; parameters],
            independent: 1.0,
        }
    }

    pub(super) fn clear(&mut self) {
        let excitation = std::mem::take(&mut self.excitation);
        *self = Self {
            excitation,
            ..Self::new(0)
        };
        self.excitation.fill(0.0);
    }

    /// Innovation and signal of a block, before the estimate uses it, (1).
    pub(super) fn of_innovation(&mut self, block: &[JointSums], theta: &[f64], std: &[f64], windows: &WindowOptions) {
        self.independent = (windows.stride_s / windows.length_s).min(1.0);
        for (j, sums) in block.iter().enumerate() {
            let rows = sums.rows.max(1) as f64;
            self.rows[j] = sums.rows;
            self.level[j] = std[j];
            self.innovation_rms[j] = (sums.residual_square(theta) / rows).sqrt(); // (1)
            self.signal_rms[j] = (sums.square / rows).sqrt();
        }
    }

    /// Residuals and fit after the estimate has used the block, (1) and (2).
    pub(super) fn of_residual(&mut self, block: &[JointSums], theta: &[f64]) {
        let joints = block.len() as f64;
        self.fit_probability = 1.0;
        for (j, sums) in block.iter().enumerate() {
            let rows = sums.rows.max(1) as f64;
            let square = sums.residual_square(theta);
            self.residual_rms[j] = (square / rows).sqrt(); // (1)
            self.fit[j] = 1.0;
            if sums.rows > 0 && self.level[j] > 0.0 {
                self.fit[j] = square / (rows * self.level[j].powi(2)); // (2)
                let tail = f_tail(self.fit[j] / (1.0 + SLACK), (rows * self.independent).max(1.0), 1e5);
                self.fit_probability = self.fit_probability.min((joints * tail).min(1.0));
            }
        }
    }
}
