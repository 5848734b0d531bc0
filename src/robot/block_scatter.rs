//! Scatter of the blocks' scores along each estimate: standard deviations that hold although the
//! model lacks something.
//!
//! With Λ_B the information of block B, P the covariance of the estimate and c clusters of L
//! blocks in succession:
//!
//! ```text
//! g_B = Σ_j (b_j − A_j θ̂)/(f_j σ_j)²          over the rows of block B                          (1)
//! m_i = mean of d_iᵀ Λ_B d_i over the blocks,    d_i = P e_i                                    (2)
//! x_i = (w x₀ + Σ_c (Σ_B∈c d_iᵀ g_B)²/(L m_i))/(w + number of clusters),   the largest of all L  (3)
//! P_ij ← P_ij √(x_i x_j),    x_i ≥ 1                                                            (4)
//! ```
//!
//! d_iᵀ g_B is what block B alone would change estimate i by. If the model describes the machine,
//! its variance is d_iᵀ Λ_B d_i and x_i is 1. A misfit that depends on the position or the load,
//! such as a cogging torque or friction that grows with the load, pulls in every block in another
//! direction. f_j of [`identify`](super::identify) allows for what looks like friction; (4) allows
//! for the rest. It cannot allow for what pulls all blocks in the same direction. Clusters of
//! several blocks are for a misfit that lasts longer than a block.
//!
//! Sources: H. White, Econometrica 48 (1980); K.-Y. Liang, S. Zeger, Biometrika 73 (1986), the
//! sandwich estimator, along single estimates so that a few blocks suffice.

use super::block_scatter_room::BlockScatter;
use super::identify::RobotIdentifier;
use super::sums::JointSums;
use crate::estimator::linalg::dot;

impl RobotIdentifier {
    /// (1) to (4) after a block.
    pub(super) fn look_at_scatter(&mut self) {
        let mut scatter = std::mem::take(&mut self.block_scatter);
        self.measure_scatter(&mut scatter);
        self.block_scatter = scatter;
    }

    fn measure_scatter(&self, scatter: &mut BlockScatter) {
        let (n, acting) = (self.theta.len(), self.effective.len());
        let blocks = self.recent_blocks.min(self.recent.len());
        scatter.sums.iter_mut().for_each(JointSums::clear);
        scatter.scores.fill(0.0);
        for (age, score) in scatter.scores.chunks_exact_mut(acting).enumerate().take(blocks) {
            let block = &self.recent[(self.recent_blocks - 1 - age) % self.recent.len()];
            for (joint, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let weight = self.weight(joint);
                for (column, &i) in sums.columns().iter().enumerate() {
                    score[i] += weight * sums.gradient(column, &self.effective); // (1)
                }
                scatter.sums[joint].add(sums);
            }
        }
        for i in (0..scatter.factor.len()).filter(|i| !self.fixed[*i]) {
            let direction = &mut scatter.direction;
            self.effective_if(self.is_loaded, &self.covariance[i * n..(i + 1) * n], direction);
            if !self.condensed {
                let weight = |joint: usize| self.weight(joint);
                self.offset_drift.follow(&self.all, weight, &self.fixed, direction);
            }
            let mut information = 0.0;
            for (joint, sums) in scatter.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                information += self.weight(joint) * sums.information(direction);
            }
            for (along, score) in scatter.along.iter_mut().zip(scatter.scores.chunks_exact(acting)) {
                *along = dot(score, direction);
            }
            let mean = information / blocks.max(1) as f64; // (2)
            // without information on an estimate its standard deviation is that of its prior
            let ratio = if mean > 0.0 {
                scatter.ratio(i, mean, blocks)
            } else {
                1.0
            };
            scatter.factor[i] = ratio.sqrt(); // (4)
        }
    }
}
