//! The last blocks, kept apart so that weights and tests can compare them.

use super::sums::JointSums;

/// Number of blocks kept.
const KEPT: usize = 32;

/// The sums of the last blocks of one machine, in a ring of fixed size.
#[derive(Debug, Clone)]
pub(super) struct RecentBlocks {
    kept: Vec<Vec<JointSums>>,
    /// Blocks since the machine changed.
    count: usize,
}

impl RecentBlocks {
    /// Largest number of blocks kept.
    pub const CAPACITY: usize = KEPT;

    /// Workspace for blocks of sums such as `empty`.
    pub fn new(empty: &[JointSums]) -> Self {
        Self {
            kept: vec![empty.to_vec(); KEPT],
            count: 0,
        }
    }

    /// Drops all blocks: they are of another machine.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a block, in place of the oldest if the ring is full.
    pub fn push(&mut self, block: &[JointSums]) {
        let kept = &mut self.kept[self.count % KEPT];
        for (kept, sums) in kept.iter_mut().zip(block) {
            kept.copy_from(sums);
        }
        self.count += 1;
    }

    /// Blocks since the machine changed, those no longer kept included.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of blocks kept.
    pub fn len(&self) -> usize {
        self.count.min(KEPT)
    }

    /// The blocks, in no order.
    pub fn iter(&self) -> impl Iterator<Item = &[JointSums]> + Clone {
        self.kept[..self.len()].iter().map(Vec::as_slice)
    }

    /// The blocks, in no order.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut [JointSums]> {
        let len = self.len();
        self.kept[..len].iter_mut().map(Vec::as_mut_slice)
    }

    /// The blocks, the newest first.
    pub fn newest_first(&self) -> impl Iterator<Item = &[JointSums]> {
        (1..=self.len()).map(|age| self.kept[(self.count - age) % KEPT].as_slice())
    }

    /// The blocks of a joint that have rows, in no order.
    pub fn of_joint(&self, joint: usize) -> impl Iterator<Item = &JointSums> {
        self.iter().map(move |block| &block[joint]).filter(|sums| sums.rows > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_newest_block_comes_first_and_replaces_the_oldest() {
        let mut sums = JointSums::new(&[0]);
        let mut recent = RecentBlocks::new(std::slice::from_ref(&sums));
        for rows in 1..=KEPT + 2 {
            sums.add_row(&[1.0], 0.0);
            recent.push(std::slice::from_ref(&sums));
            assert_eq!(recent.newest_first().next().unwrap()[0].rows, rows);
        }
        assert_eq!((recent.count(), recent.len()), (KEPT + 2, KEPT));
        assert_eq!(recent.newest_first().last().unwrap()[0].rows, 3);
        recent.clear();
        assert_eq!(recent.of_joint(0).count(), 0);
    }
}
