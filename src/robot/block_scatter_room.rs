//! Workspace of the scatter of the blocks, allocated at the start; (1) to (4) are those of
//! [`block_scatter`](super::block_scatter).

use super::sums::JointSums;
use crate::estimator::persist::Visit;

/// L of (3) \[blocks\].
const LENGTHS: [usize; 3] = [1, 2, 4];
/// w of (3) at the start, with x₀ = 1, in clusters.
const ASSUMED: f64 = 1.0;
/// The same after a change or a restart, with x₀ from before it.
const KEPT: f64 = 8.0;

/// x_i of each parameter, and the workspace.
#[derive(Debug, Clone, Default)]
pub(super) struct BlockScatter {
    /// √x_i.
    pub factor: Vec<f64>,
    /// x₀ and w.
    assumed: Vec<f64>,
    weight: f64,
    /// Sums of the recent blocks.
    pub sums: Vec<JointSums>,
    /// g_B of the recent blocks, the newest first.
    pub scores: Vec<f64>,
    /// d_i as effective parameters.
    pub direction: Vec<f64>,
    /// d_iᵀ g_B.
    pub along: Vec<f64>,
}

impl BlockScatter {
    /// For `parameters` estimates, rows that depend on `acting` effective parameters, and up to
    /// `blocks` blocks of sums such as `empty`.
    pub fn new(parameters: usize, acting: usize, blocks: usize, empty: &[JointSums]) -> Self {
        Self {
            factor: vec![1.0; parameters],
            assumed: vec![1.0; parameters],
            weight: ASSUMED,
            sums: empty.to_vec(),
            scores: vec![0.0; blocks * acting],
            direction: vec![0.0; acting],
            along: vec![0.0; blocks],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.factor.fill(1.0);
        self.assumed.fill(1.0);
        self.weight = ASSUMED;
    }

    /// Keeps x_i for blocks after a change.
    pub fn carry_over(&mut self) {
        let kept = self.assumed.iter_mut().zip(&self.factor);
        kept.for_each(|(assumed, factor)| *assumed = factor * factor);
        self.weight = KEPT;
    }

    /// x_i of an estimate, from `along` over these blocks.
    pub fn ratio(&self, i: usize, mean: f64, blocks: usize) -> f64 {
        let of_length = |length: usize| {
            let clusters = self.along[..blocks].chunks(length);
            let count = blocks as f64 / length as f64;
            let squares: f64 = clusters.map(|cluster| cluster.iter().sum::<f64>().powi(2)).sum();
            (self.weight * self.assumed[i] + squares / (length as f64 * mean)) / (self.weight + count) // (3)
        };
        LENGTHS.map(of_length).into_iter().fold(1.0, f64::max)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks pull by ±1 and should pull by √m = 1/2: (3) is (1 + 8·4)/(1 + 8) for single blocks.
    /// Clusters of two and four cancel.
    #[test]
    fn val_blocks_that_pull_to_both_sides_enlarge_by_their_scatter() {
        let mut scatter = BlockScatter::new(1, 1, 8, &[]);
        scatter
            .along
            .copy_from_slice(&[1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]);
        assert_eq!(scatter.ratio(0, 0.25, 8), 33.0 / 9.0);
        // as much as they should, or less: nothing becomes narrower
        assert_eq!((scatter.ratio(0, 1.0, 8), scatter.ratio(0, 9.0, 8)), (1.0, 1.0));
    }

    /// The same to one side for four blocks at a time: clusters of four pull by 4 and should pull
    /// by √(4 m) = 1, so (3) is (1 + 2·16)/(1 + 2).
    #[test]
    fn val_a_misfit_that_lasts_longer_than_a_block_shows_in_clusters() {
        let mut scatter = BlockScatter::new(1, 1, 8, &[]);
        scatter
            .along
            .copy_from_slice(&[1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0]);
        assert_eq!(scatter.ratio(0, 0.25, 8), 33.0 / 3.0);
    }

    #[test]
    fn prop_what_was_measured_before_a_change_counts_after_it() {
        let mut scatter = BlockScatter::new(1, 1, 8, &[]);
        scatter.factor[0] = 3.0;
        scatter.carry_over();
        assert_eq!(scatter.ratio(0, 1.0, 0), 9.0);
        scatter.reset();
        assert_eq!(scatter.ratio(0, 1.0, 0), 1.0);
    }
}
