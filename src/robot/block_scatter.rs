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
use super::learning::Learner;

impl BlockScatter {
    /// (1) to (4) after a block.
    pub fn look_at_block(&mut self, learner: &Learner) {
        let (estimate, levels) = (&learner.estimate, &learner.levels);
        self.begin();
        for (age, block) in learner.recent.newest_first().enumerate() {
            for (joint, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                self.add(age, (joint, sums), levels.weight(joint), estimate.effective()); // (1)
            }
        }
        for i in estimate.free() {
            let direction = &mut self.direction;
            learner.flange.effective(estimate.row(i), direction);
            learner.past.follow_slopes(levels, estimate.fixed(), direction);
            self.compare(i, learner.recent.len()); // (2), (3), (4)
        }
    }
}
