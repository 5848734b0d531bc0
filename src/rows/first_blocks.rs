//! The samples of the first blocks, kept so that they can be learnt from again as one block.
//!
//! Rows are weighted, their positions smoothed, and their equations linearised with a θ that the
//! first blocks themselves must give (`projected/first_fit.rs`). A single block may be too short
//! for that, or its motion too smooth. What was learnt with a wrong θ stays in the estimate for
//! long: through encoders of 13 bits, θ₅ and θ₉ of the arm had 2 to 10 times the Cramér–Rao bound
//! after ten blocks. It may also look like knowledge: half a second of slow motion fits best with a
//! length θ₉ of 8 m instead of 1 m, around which θ₆ seems to be known to 10 %, and the next blocks,
//! which correct θ₉, cannot undo that (`tests/numerics/first_blocks.rs`). Four blocks as one are
//! fitted with one θ, which is also that of their weights.

use crate::model::JointSample;

/// Blocks that are learnt from twice.
const BLOCKS: usize = 4;
/// Longer blocks \[samples\] determine θ by themselves, and four of them would take much memory.
const LONGEST: usize = 8_000;

/// Samples of the first blocks that informed on some parameter.
#[derive(Debug, Clone, Default)]
pub struct FirstBlocks {
    /// Stream times \[ns\], and q, input and setpoint of each joint, sample after sample.
    t_ns: Vec<u64>,
    signals: Vec<f64>,
    joints: usize,
    /// Samples up to the end of each complete block.
    ends: Vec<usize>,
    open: bool,
}

impl FirstBlocks {
    /// Samples that are kept of blocks of `block_len`; 0 if these are too long.
    pub fn kept(block_len: usize) -> usize {
        if block_len <= LONGEST { BLOCKS * block_len } else { 0 }
    }

    /// Samples that rows must hold: those of the first blocks as one, or of a single long block.
    pub fn room(block_len: usize) -> usize {
        Self::kept(block_len).max(block_len)
    }

    /// Room for blocks of `block_len` samples of so many joints.
    pub fn new(joints: usize, block_len: usize) -> Self {
        let samples = Self::kept(block_len);
        Self {
            t_ns: Vec::with_capacity(samples),
            signals: Vec::with_capacity(3 * joints * samples),
            joints,
            ends: Vec::with_capacity(BLOCKS),
            open: joints * samples > 0,
        }
    }

    /// Keeps a sample, if the blocks are still of interest.
    pub fn push(&mut self, t_ns: u64, sample: &JointSample) {
        if self.open && self.t_ns.len() < self.t_ns.capacity() {
            self.t_ns.push(t_ns);
            for signal in [&sample.q, &sample.input, &sample.setpoint] {
                self.signals.extend_from_slice(&signal[..self.joints]);
            }
        }
    }

    /// Drops the samples since the last complete block.
    pub fn drop_block(&mut self) {
        let end = self.ends.last().copied().unwrap_or(0);
        self.t_ns.truncate(end);
        self.signals.truncate(3 * self.joints * end);
    }

    /// Ends a block that was learnt from; true if it was the last of those to be learnt again, with
    /// which nothing more is kept. As long as `informed` is false, the blocks do not inform on any
    /// parameter and are dropped.
    #[must_use]
    pub fn close_block(&mut self, informed: bool) -> bool {
        if self.open && informed {
            self.ends.push(self.t_ns.len());
        } else {
            self.drop_block();
        }
        let complete = self.open && self.ends.len() == BLOCKS;
        self.open &= !complete;
        complete
    }

    /// True if nothing has been kept of a complete block.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Begins anew: θ is not known.
    pub fn restart(&mut self) {
        self.end();
        self.open = self.t_ns.capacity() > 0;
    }

    /// Keeps nothing from now on: θ is known from elsewhere, or the samples do not belong together.
    pub fn end(&mut self) {
        self.ends.clear();
        self.drop_block();
        self.open = false;
    }

    /// Blocks that are kept.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Samples of block `k`, with their stream times \[ns\].
    pub fn block(&self, k: usize) -> impl Iterator<Item = (u64, JointSample)> + '_ {
        let from = k.checked_sub(1).map_or(0, |before| self.ends[before]);
        let stride = 3 * self.joints;
        (from..self.ends[k]).map(move |at| {
            let mut sample = JointSample::default();
            let signals = self.signals[at * stride..(at + 1) * stride].chunks_exact(self.joints);
            for (signal, kept) in [&mut sample.q, &mut sample.input, &mut sample.setpoint]
                .into_iter()
                .zip(signals)
            {
                signal[..self.joints].copy_from_slice(kept);
            }
            (self.t_ns[at], sample)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(value: f64) -> JointSample {
        let mut sample = JointSample::default();
        (sample.q[0], sample.input[1], sample.setpoint[1]) = (value, 2.0 * value, 3.0 * value);
        sample
    }

    /// Feeds a block of three samples whose values begin at `first`.
    fn feed(blocks: &mut FirstBlocks, first: u64) {
        (first..first + 3).for_each(|t| blocks.push(t, &sample(t as f64)));
    }

    #[test]
    fn prop_the_first_blocks_that_tell_something_come_back_as_they_were() {
        let mut blocks = FirstBlocks::new(2, 3);
        feed(&mut blocks, 0);
        assert!(!blocks.close_block(false) && blocks.is_empty());
        for k in 0..BLOCKS as u64 {
            // one that was dropped on the way leaves nothing
            feed(&mut blocks, 1000);
            blocks.drop_block();
            feed(&mut blocks, 10 * k);
            assert_eq!(blocks.close_block(true), k + 1 == BLOCKS as u64);
        }
        assert_eq!(blocks.len(), BLOCKS);
        for k in 0..BLOCKS {
            let kept: Vec<_> = blocks.block(k).collect();
            let wanted: Vec<_> = (0..3)
                .map(|i| 10 * k as u64 + i)
                .map(|t| (t, sample(t as f64)))
                .collect();
            assert_eq!(kept, wanted, "block {k}");
        }
        // only once, until θ is not known again
        blocks.end();
        feed(&mut blocks, 50);
        assert!(!blocks.close_block(true) && blocks.is_empty());
        blocks.restart();
        feed(&mut blocks, 60);
        assert!(!blocks.close_block(true) && blocks.len() == 1);
    }
}
