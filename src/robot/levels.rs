//! Levels of the torques' misfit, σ_j and f_j, before each of the last blocks.
//!
//! A change of the machine found after its block has raised them, because that block was compared
//! with the old machine. [`watch`](super::watch) then returns to the levels before it.

use crate::model::MAX_JOINTS;

/// σ_j and f_j before a block that ends at `end_s`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Levels {
    end_s: f64,
    pub torque_std: [f64; MAX_JOINTS],
    pub inflation: [f64; MAX_JOINTS],
}

/// The levels of the last blocks; allocates nothing after construction.
#[derive(Debug, Clone)]
pub(super) struct LevelRing {
    kept: Vec<Levels>,
    next: usize,
    len: usize,
}

impl LevelRing {
    /// Workspace for `blocks` blocks, at least one.
    pub fn new(blocks: usize) -> Self {
        Self {
            kept: vec![Levels::default(); blocks.max(1)],
            next: 0,
            len: 0,
        }
    }

    /// Stores the levels before a block, in place of the oldest if the ring is full.
    pub fn keep(&mut self, end_s: f64, torque_std: &[f64], inflation: &[f64]) {
        let levels = &mut self.kept[self.next];
        levels.end_s = end_s;
        levels.torque_std[..torque_std.len()].copy_from_slice(torque_std);
        levels.inflation[..inflation.len()].copy_from_slice(inflation);
        self.next = (self.next + 1) % self.kept.len();
        self.len = (self.len + 1).min(self.kept.len());
    }

    /// The levels before the first block that ends after `t_s`; `None` if none of those kept does.
    pub fn before(&self, t_s: f64) -> Option<&Levels> {
        let oldest = self.next + self.kept.len() - self.len;
        let mut kept = (0..self.len).map(|age| &self.kept[(oldest + age) % self.kept.len()]);
        kept.find(|levels| levels.end_s > t_s)
    }

    /// Forgets them.
    pub fn clear(&mut self) {
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
