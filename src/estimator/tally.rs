//! Counts the blocks of a group: all, and those since its last alarm and its last misfit.

use super::persist::Visit;

/// Alarms at most this many blocks apart are a drift.
const DRIFT_BLOCKS: u32 = 8;

/// The counts of a group.
#[derive(Debug, Clone)]
pub struct Tally {
    blocks: u64,
    since_alarm: u32,
    /// Blocks since the last one that one of the group's equations did not fit.
    since_misfit: u32,
}

impl Tally {
    /// A group without blocks.
    pub fn new() -> Self {
        Self {
            blocks: 0,
            since_alarm: u32::MAX,
            since_misfit: u32::MAX,
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.count(&mut self.blocks);
        v.small(&mut self.since_alarm);
        v.small(&mut self.since_misfit);
    }

    /// True until the first block has been concluded.
    pub fn is_empty(&self) -> bool {
        self.blocks == 0
    }

    /// Counts a block that begins.
    pub fn begin_block(&mut self) {
        self.since_alarm = self.since_alarm.saturating_add(1);
    }

    /// Records that the present block raised an alarm. True if the one before was so recent that
    /// the plant drifts.
    pub fn alarm(&mut self) -> bool {
        let recent = self.since_alarm <= DRIFT_BLOCKS;
        self.since_alarm = 0;
        recent
    }

    /// Records whether all equations fit the present block.
    pub fn judge(&mut self, fits: bool) {
        self.since_misfit = if fits { self.since_misfit.saturating_add(1) } else { 0 };
    }

    /// Counts a block whose information has been taken.
    pub fn end_block(&mut self) {
        self.blocks += 1;
    }

    /// True if neither this block nor the one before raised an alarm.
    pub fn is_quiet(&self) -> bool {
        self.since_alarm > 1
    }

    /// True if this block and the one before fit.
    pub fn fits(&self) -> bool {
        self.since_misfit > 1
    }
}
