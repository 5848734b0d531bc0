//! Levels of the torques' misfit, σ_j and f_j of (2) and (3) of [`identify`](super::identify).
//!
//! A change of the machine found after its block has raised them, because that block was compared
//! with the old machine. [`watch`](super::watch) then returns to the levels before it. So those
//! before each of the last blocks are kept.

use super::model::RobotModel;
use super::recent_blocks::RecentBlocks;
use super::sums::JointSums;
use crate::estimator::persist::Visit;
use crate::model::MAX_JOINTS;
use std::ops::Range;

/// Prior value of f_j², and its weight in blocks.
const ASSUMED_INFLATION: (f64, f64) = (9.0, 2.0);
/// Weight, in blocks, of f_j² from before a change.
const KEPT_INFLATION: f64 = 8.0;
/// Averaging time of σ_j² after settling, in blocks.
const FOLLOWED_BLOCKS: f64 = 20.0;
/// Smallest σ_j relative to the joint's mean torque, because a perfect simulation has no residual.
pub(super) const SMALLEST_STD: f64 = 1e-9;
/// The same while a joint has hardly more rows than its share of the parameters, so that almost any
/// data fit.
const UNTRIED_STD: f64 = 0.02;

/// σ_j and f_j of each joint.
#[derive(Debug, Clone)]
pub(super) struct MisfitLevels {
    std: Vec<f64>,
    inflation: Vec<f64>,
    /// Prior values of f_j², and their weight in blocks.
    assumed: Vec<f64>,
    assumed_blocks: f64,
    before: LevelRing,
}

impl MisfitLevels {
    /// For this many joints; the levels before the last `blocks` blocks are kept.
    pub fn new(joints: usize, blocks: usize) -> Self {
        let mut levels = Self {
            std: vec![0.0; joints],
            inflation: vec![0.0; joints],
            assumed: vec![0.0; joints],
            assumed_blocks: 0.0,
            before: LevelRing::new(blocks),
        };
        levels.reset();
        levels
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.std.fill(0.0);
        self.inflation.fill(ASSUMED_INFLATION.0.sqrt());
        self.assumed.fill(ASSUMED_INFLATION.0);
        self.assumed_blocks = ASSUMED_INFLATION.1;
        self.before.clear();
    }

    /// σ_j of all joints.
    pub fn std(&self) -> &[f64] {
        &self.std
    }

    /// f_j of a joint.
    pub fn inflation(&self, joint: usize) -> f64 {
        self.inflation[joint]
    }

    /// f_j σ_j.
    pub fn level(&self, joint: usize) -> f64 {
        self.std[joint] * self.inflation[joint]
    }

    /// 1/(f_j σ_j)² of (1).
    pub fn weight(&self, joint: usize) -> f64 {
        (self.inflation[joint] * self.std[joint]).powi(-2)
    }

    /// (2) of a joint with `friction` columns of friction. `untried` is 1 if it has hardly more
    /// rows than parameters, and 0 if it has many more.
    pub fn learn_std(&mut self, joint: usize, sums: &JointSums, effective: &[f64], friction: usize, untried: f64) {
        let rows = sums.rows as f64;
        let variance = sums.residual_square(effective) / (rows - friction.max(1) as f64).max(1.0); // (2)
        let floor = (sums.square / rows).sqrt() * (SMALLEST_STD + UNTRIED_STD * untried);
        self.std[joint] = variance.sqrt().max(floor).max(f64::MIN_POSITIVE.sqrt());
    }

    /// Lets σ_j follow the residuals of a block.
    pub fn follow_std(&mut self, block: &[JointSums], effective: &[f64]) {
        for (joint, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let variance = sums.residual_square(effective) / sums.rows as f64;
            let kept = self.std[joint].powi(2);
            let floor = (sums.square / sums.rows as f64).sqrt() * SMALLEST_STD;
            self.std[joint] = (kept + (variance - kept) / FOLLOWED_BLOCKS).sqrt().max(floor);
        }
    }

    /// (3) over the recent blocks.
    pub fn learn_inflation(&mut self, model: &RobotModel, recent: &RecentBlocks, effective: &[f64]) {
        for joint in 0..self.std.len() {
            let friction = model.friction_columns(joint);
            let (mut sum, mut count) = (self.assumed[joint] * self.assumed_blocks, self.assumed_blocks);
            for sums in recent.of_joint(joint).filter(|_| !friction.is_empty()) {
                if let Some((square, directions)) = sums.friction_misfit(friction.clone(), effective) {
                    sum += square / (directions * self.std[joint].powi(2)); // (3)
                    count += 1.0;
                }
            }
            self.inflation[joint] = (sum / count).sqrt().max(1.0);
        }
    }

    /// (4) of [`left_out`](super::left_out) with these columns of friction, at these effective
    /// parameters; `None` if the joint has no rows.
    pub fn mean_square(
        &self,
        (joint, friction): (usize, Range<usize>),
        recent: &RecentBlocks,
        effective: &[f64],
    ) -> Option<f64> {
        let (mut square, mut rows) = (0.0, 0);
        let (mut clusters, mut count) = (0.0, 0.0);
        for sums in recent.of_joint(joint) {
            square += sums.residual_square(effective);
            rows += sums.rows;
            if let Some((misfit, directions)) = sums.friction_misfit(friction.clone(), effective) {
                clusters += misfit / directions;
                count += 1.0;
            }
        }
        let variance = square / rows.saturating_sub(friction.len()).max(1) as f64;
        let (assumed, weight) = (self.assumed[joint], self.assumed_blocks);
        let level = (clusters + assumed * weight * variance) / (count + weight); // (4)
        (rows > 0).then_some(level.max(variance))
    }

    /// Keeps f_j as the prior value for another machine.
    pub fn carry_over(&mut self) {
        for (assumed, inflation) in self.assumed.iter_mut().zip(&self.inflation) {
            *assumed = inflation * inflation;
        }
        self.assumed_blocks = KEPT_INFLATION;
    }

    /// Stores the levels before a block that ends at `end_s`.
    pub fn keep(&mut self, end_s: f64) {
        self.before.keep(end_s, &self.std, &self.inflation);
    }

    /// Returns to the levels before the first block that ends after `t_s`, if they are kept.
    pub fn restore(&mut self, t_s: f64) {
        if let Some(levels) = self.before.before(t_s) {
            let joints = self.std.len();
            self.std.copy_from_slice(&levels.torque_std[..joints]);
            self.inflation.copy_from_slice(&levels.inflation[..joints]);
        }
    }

    /// Forgets the levels before the last blocks.
    pub fn forget_kept(&mut self) {
        self.before.clear();
    }

    /// True if no level is negative or not a number.
    pub fn is_sound(&self) -> bool {
        self.std.iter().chain(&self.inflation).all(|x| *x >= 0.0)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.std);
        v.reals(&mut self.inflation);
    }
}

/// σ_j and f_j before a block that ends at `end_s`.
#[derive(Debug, Clone, Copy, Default)]
struct Levels {
    end_s: f64,
    torque_std: [f64; MAX_JOINTS],
    inflation: [f64; MAX_JOINTS],
}

/// The levels of the last blocks; allocates nothing after construction.
#[derive(Debug, Clone)]
struct LevelRing {
    kept: Vec<Levels>,
    next: usize,
    len: usize,
}

impl LevelRing {
    /// Workspace for `blocks` blocks, at least one.
    fn new(blocks: usize) -> Self {
        Self {
            kept: vec![Levels::default(); blocks.max(1)],
            next: 0,
            len: 0,
        }
    }

    /// Stores the levels before a block, in place of the oldest if the ring is full.
    fn keep(&mut self, end_s: f64, torque_std: &[f64], inflation: &[f64]) {
        let levels = &mut self.kept[self.next];
        levels.end_s = end_s;
        levels.torque_std[..torque_std.len()].copy_from_slice(torque_std);
        levels.inflation[..inflation.len()].copy_from_slice(inflation);
        self.next = (self.next + 1) % self.kept.len();
        self.len = (self.len + 1).min(self.kept.len());
    }

    /// The levels before the first block that ends after `t_s`; `None` if none of those kept does.
    fn before(&self, t_s: f64) -> Option<&Levels> {
        let oldest = self.next + self.kept.len() - self.len;
        let mut kept = (0..self.len).map(|age| &self.kept[(oldest + age) % self.kept.len()]);
        kept.find(|levels| levels.end_s > t_s)
    }

    /// Forgets them.
    fn clear(&mut self) {
        self.len = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_levels_before_the_first_block_that_ends_later_are_given() {
        let mut ring = LevelRing::new(3);
        assert!(ring.before(0.0).is_none());
        for block in 1..=5 {
            let end_s = f64::from(block);
            ring.keep(end_s, &[10.0 * end_s], &[end_s]);
        }
        let found = |t_s: f64| ring.before(t_s).map(|levels| levels.torque_std[0]);
        // Blocks 3, 4 and 5 are kept.
        assert_eq!(found(0.5), Some(30.0));
        assert_eq!(
            (found(3.0), found(3.9), found(4.5)),
            (Some(40.0), Some(40.0), Some(50.0))
        );
        assert_eq!(found(5.0), None);
        ring.clear();
        assert!(ring.before(0.0).is_none());
    }
}
