//! Blocks cut by `seq`: block = seq div N + 1, the paper's α(m), independent of losses.

/// The division of `seq` into blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockGrid {
    /// First sample of the grid, and the block that it begins.
    pub seq: u64,
    pub block: u64,
    /// N.
    pub len: u64,
}

impl BlockGrid {
    /// The plain grid: block 1 begins with sample 0.
    pub fn new(len: u64) -> Self {
        Self { seq: 0, block: 1, len }
    }

    /// Block of a sample and its first sample; `None` before the grid begins.
    pub fn block(&self, seq: u64) -> Option<(u64, u64)> {
        let index = seq.checked_sub(self.seq)? / self.len;
        Some((self.block.saturating_add(index), self.seq + index * self.len))
    }

    /// True for the last sample of a block.
    pub fn ends_with(&self, seq: u64) -> bool {
        seq.checked_sub(self.seq)
            .is_some_and(|behind| behind % self.len == self.len - 1)
    }

    /// First border at or after `seq`, and the block that begins there.
    pub fn border(&self, seq: u64) -> (u64, u64) {
        match self.block(seq) {
            None => (self.seq, self.block),
            Some((block, first)) if first == seq => (seq, block),
            Some((block, first)) => (first.saturating_add(self.len), block.saturating_add(1)),
        }
    }
}

/// The block being filled.
#[derive(Debug, Clone, Copy)]
pub(super) struct OpenBlock {
    pub block: u64,
    pub t_first_ns: u64,
    /// Samples received; rows may be fewer.
    pub samples: u64,
    /// A signal was frozen.
    pub spoilt: bool,
}
