//! The monitor's memory of the blocks of a stream, and of the changes of the plant that they
//! reported.

/// The monitor's record of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockRecord {
    /// Block number, from 1.
    pub block: u64,
    /// Stream time of the last sample \[s\].
    pub t_s: f64,
    /// Time of a change that this block reported \[s\].
    pub change_s: Option<f64>,
    /// Largest relative error over the judged parameters, if the truth is known.
    ///
    /// The judged parameters are those that the estimate marks usable, or all of them if it marks
    /// none.
    pub worst_relative_error: Option<f64>,
}

/// A change, as reported in the summary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Block that reported the change.
    pub block: u64,
    /// Located time of the change \[s\].
    pub t_s: f64,
    /// Stream time of the last sample of the reporting block \[s\].
    pub detected_t_s: f64,
    /// Number of blocks from the one with the change (0) to the first after which the judged
    /// parameters stay within 1 % of the truth until the next change; `None` if the truth is
    /// unknown or they do not.
    pub blocks_to_1_percent: Option<u64>,
}

/// Smallest number of blocks remembered; even after months the memory stays within twice that.
pub(super) const REMEMBERED: usize = 8192;

/// The last blocks of a stream.
#[derive(Debug, Clone, Default)]
pub(super) struct BlockHistory {
    records: Vec<BlockRecord>,
    /// Changes reported by earlier blocks.
    settled: Vec<Change>,
    /// Number of all blocks of the stream.
    blocks: u64,
}

impl BlockHistory {
    /// Adds a block.
    pub fn push(&mut self, record: BlockRecord) {
        self.records.push(record);
        self.blocks += 1;
        if self.records.len() == 2 * REMEMBERED {
            self.forget();
        }
    }

    /// Drops the older half of the records, after keeping the changes that they reported.
    fn forget(&mut self) {
        let border = self.records[REMEMBERED].block;
        let changes = self.recent_changes();
        self.settled
            .extend(changes.into_iter().filter(|change| change.block < border));
        self.records.drain(..REMEMBERED);
    }

    /// Begins a new stream.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Number of blocks received.
    pub fn blocks(&self) -> u64 {
        self.blocks
    }

    /// The last blocks, some thousands at most.
    pub fn records(&self) -> &[BlockRecord] {
        &self.records
    }

    /// The changes reported so far.
    pub fn changes(&self) -> Vec<Change> {
        let mut changes = self.settled.clone();
        changes.extend(self.recent_changes());
        changes
    }

    fn recent_changes(&self) -> Vec<Change> {
        let announced: Vec<(usize, f64)> = self
            .records
            .iter()
            .enumerate()
            .filter_map(|(i, r)| r.change_s.map(|t| (i, t)))
            .collect();
        announced
            .iter()
            .enumerate()
            .map(|(k, &(index, t_s))| {
                // The block with the change ends at or after it; it can be earlier than the one
                // that reported it.
                let holding = self.records[..=index]
                    .iter()
                    .position(|r| r.t_s >= t_s)
                    .unwrap_or(index);
                let end = announced.get(k + 1).map_or(self.records.len(), |&(next, _)| next);
                Change {
                    block: self.records[index].block,
                    t_s,
                    detected_t_s: self.records[index].t_s,
                    blocks_to_1_percent: blocks_to_settle(&self.records[holding..end], 0.01),
                }
            })
            .collect()
    }
}

/// Index of the first block after which the worst relative error stays within `limit`.
fn blocks_to_settle(records: &[BlockRecord], limit: f64) -> Option<u64> {
    let within = |r: &BlockRecord| r.worst_relative_error.is_some_and(|error| error <= limit);
    let settled = records.iter().rev().take_while(|r| within(r)).count();
    (settled > 0).then(|| (records.len() - settled) as u64)
}
