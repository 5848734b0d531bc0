//! Workspace of the scatter of the blocks, allocated at the start; (1) to (4) are those of
//! [`block_scatter`](super::block_scatter).

use super::sums::JointSums;
use crate::estimator::linalg::dot;
use crate::estimator::persist::Visit;

/// L of (3) \[blocks\].
const LENGTHS: [usize; 3] = [1, 2, 4];
/// w of (3) at the start, with x₀ = 1, in clusters.
const ASSUMED: f64 = 1.0;
/// The same after a change or a restart, with x₀ from before it.
const KEPT: f64 = 8.0;

/// A column of a joint's rows that estimates affect.
#[derive(Debug, Clone, Copy)]
struct Kept {
    column: usize,
    /// Its index in the effective parameters.
    index: usize,
    /// Its place among all such columns.
    place: usize,
}

/// x_i of each parameter, and the workspace.
#[derive(Debug, Clone)]
pub(super) struct BlockScatter {
    /// √x_i.
    pub factor: Vec<f64>,
    /// x₀ and w.
    assumed: Vec<f64>,
    weight: f64,
    /// The columns of each joint. Those of terms that the model leaves out are not among them.
    kept: Vec<Vec<Kept>>,
    /// Σ Λ_B, its lower triangle.
    information: Vec<f64>,
    /// g_B of the recent blocks, the newest first.
    scores: Vec<f64>,
    /// d_i, as effective parameters and over the places.
    pub direction: Vec<f64>,
    placed: Vec<f64>,
    /// d_iᵀ g_B.
    along: Vec<f64>,
    /// The entries of θ̂ of a joint's columns.
    own: Vec<f64>,
}

impl BlockScatter {
    /// For `parameters` estimates and up to `blocks` blocks of sums such as `empty`. Their rows
    /// depend on `acting` effective parameters; those from `parameters` to `terms` are left out of
    /// the model.
    pub fn new(parameters: usize, terms: usize, acting: usize, blocks: usize, empty: &[JointSums]) -> Self {
        let keep = |(column, &index): (usize, &usize)| {
            let place = match index {
                _ if index < parameters => index,
                _ if index < terms => return None,
                _ => index - terms + parameters,
            };
            Some(Kept { column, index, place })
        };
        let of_joint = |sums: &JointSums| {
            let mut kept: Vec<Kept> = sums.columns().iter().enumerate().filter_map(keep).collect();
            kept.sort_by_key(|kept| kept.place); // `add` fills a lower triangle
            kept
        };
        let places = parameters + acting - terms;
        Self {
            factor: vec![1.0; parameters],
            assumed: vec![1.0; parameters],
            weight: ASSUMED,
            kept: empty.iter().map(of_joint).collect(),
            information: vec![0.0; places * places],
            scores: vec![0.0; blocks * places],
            direction: vec![0.0; acting],
            placed: vec![0.0; places],
            along: vec![0.0; blocks],
            own: Vec::with_capacity(places),
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

    /// Begins (1) anew.
    pub fn begin(&mut self) {
        self.information.fill(0.0);
        self.scores.fill(0.0);
    }

    /// Adds the rows of a joint to (1) of the block of this age, with their weight.
    pub fn add(&mut self, age: usize, (joint, sums): (usize, &JointSums), weight: f64, effective: &[f64]) {
        let (kept, places) = (&self.kept[joint], self.placed.len());
        self.own.clear();
        self.own.extend(kept.iter().map(|kept| effective[kept.index]));
        let score = &mut self.scores[age * places..(age + 1) * places];
        for (k, of) in kept.iter().enumerate() {
            let row = &sums.gram[of.column * sums.moment.len()..(of.column + 1) * sums.moment.len()];
            let predicted: f64 = kept.iter().zip(&self.own).map(|(kept, x)| row[kept.column] * x).sum();
            score[of.place] += weight * (sums.moment[of.column] - predicted); // (1)
            let information = &mut self.information[of.place * places..(of.place + 1) * places];
            for kept in &kept[..=k] {
                information[kept.place] += weight * row[kept.column];
            }
        }
    }

    /// (2) to (4) of an estimate, whose `direction` is set.
    pub fn compare(&mut self, i: usize, blocks: usize) {
        let parameters = self.factor.len();
        let (own, slopes) = self.placed.split_at_mut(parameters);
        own.copy_from_slice(&self.direction[..parameters]);
        let first = self.direction.len() - slopes.len();
        slopes.copy_from_slice(&self.direction[first..]);
        let d = &self.placed;
        let mut square = 0.0;
        for (a, row) in self.information.chunks_exact(d.len()).enumerate() {
            square += d[a] * (2.0 * dot(&row[..a], &d[..a]) + row[a] * d[a]);
        }
        let mean = square / blocks.max(1) as f64; // (2)
        for (along, score) in self
            .along
            .iter_mut()
            .zip(self.scores.chunks_exact(d.len()))
            .take(blocks)
        {
            *along = dot(score, d);
        }
        // without information on an estimate its standard deviation is that of its prior
        let ratio = if mean > 0.0 { self.ratio(i, mean, blocks) } else { 1.0 };
        self.factor[i] = ratio.sqrt(); // (4)
    }

    /// x_i of an estimate, from `along` over these blocks.
    fn ratio(&self, i: usize, mean: f64, blocks: usize) -> f64 {
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
        let mut scatter = BlockScatter::new(1, 1, 1, 8, &[]);
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
        let mut scatter = BlockScatter::new(1, 1, 1, 8, &[]);
        scatter
            .along
            .copy_from_slice(&[1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0]);
        assert_eq!(scatter.ratio(0, 0.25, 8), 33.0 / 3.0);
    }

    #[test]
    fn prop_what_was_measured_before_a_change_counts_after_it() {
        let mut scatter = BlockScatter::new(1, 1, 1, 8, &[]);
        scatter.factor[0] = 3.0;
        scatter.carry_over();
        assert_eq!(scatter.ratio(0, 1.0, 0), 9.0);
        scatter.reset();
        assert_eq!(scatter.ratio(0, 1.0, 0), 1.0);
    }
}
