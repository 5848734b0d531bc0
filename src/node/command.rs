//! Commands to an identifier: prepared elsewhere, in force from a border between two blocks on.
//!
//! Whatever needs memory is made before an order is offered: a new estimator, new rows, new
//! options. At the border it is exchanged for the old, and the order goes back with the old inside,
//! so that the node neither allocates nor frees.

use crate::estimator::{BlockEstimator, EstimatorOptions, EstimatorState, StateMachine};
use std::any::Any;
use std::fmt;

/// Orders that a node can hold at a time.
pub const MAX_ORDERS: usize = 64;
/// Places among them for orders that wait for nothing but the next border: those that wait for a
/// far sample must not keep an operator from pausing.
pub const RESERVED_ORDERS: usize = 16;

/// What a command changes.
pub enum Change {
    /// Take no more samples in; θ̂ stays.
    Pause,
    /// Go on with the next block.
    Resume,
    /// Another estimator with its judge in the place of the present one: as at the start, or out of
    /// a checkpoint.
    Replace {
        /// The estimator.
        estimator: Box<BlockEstimator>,
        /// Its judge.
        judge: Box<StateMachine>,
        /// It continues from a checkpoint.
        warm: bool,
    },
    /// Begin anew, or go on from a state: for a node that does so in its own memory.
    Restart {
        /// The state; `None` for the start.
        state: Option<Box<NodeState>>,
    },
    /// Other tunables; see [`BlockEstimator::retune`].
    Tune {
        /// With the new tunables.
        options: Box<EstimatorOptions>,
        /// Of the new configuration.
        config_hash: u64,
        /// N.
        block_len: u64,
        /// Rows for blocks of the new length, of the type of the present ones; needed if
        /// `block_len` is another.
        rows: Option<Box<dyn Any + Send>>,
    },
    /// Hold a parameter, at this value or at its estimate.
    Fix {
        /// Index of the parameter.
        index: usize,
        /// The value; within the parameter's bounds.
        value: Option<f64>,
    },
    /// Estimate a parameter that was held.
    Free {
        /// Index of the parameter.
        index: usize,
    },
    /// Say what a robot's flange carries: nothing, or ten parameters about the flange.
    Payload {
        /// The parameters.
        body: Option<Box<[f64; 10]>>,
    },
    /// What is left of a change whose contents the node keeps, to undo it.
    Kept,
}

impl Change {
    /// True if the whole estimator is exchanged.
    pub(super) fn replaces(&self) -> bool {
        matches!(self, Self::Replace { .. } | Self::Restart { .. })
    }
}

impl fmt::Debug for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pause => "Pause",
            Self::Resume => "Resume",
            Self::Replace { .. } => "Replace",
            Self::Restart { .. } => "Restart",
            Self::Tune { .. } => "Tune",
            Self::Fix { .. } => "Fix",
            Self::Free { .. } => "Free",
            Self::Payload { .. } => "Payload",
            Self::Kept => "Kept",
        })
    }
}

/// What became of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fate {
    /// It waits for its border.
    #[default]
    Waits,
    /// It took effect.
    Done,
    /// Its stream is over, or another one came in its place; it never took effect.
    Dropped,
    /// It took effect earlier, and its stream is over: what it had exchanged was exchanged back.
    Undone,
}

/// A change on its way to a border and back.
#[derive(Debug)]
pub struct Order {
    /// Whoever offered it knows it by this.
    pub id: u64,
    /// Not before this sample of the stream, and not after its end; 0: at the next border.
    pub from_seq: u64,
    /// [`stream_tag`](crate::messages::stream_tag) of the only stream that the order is for; 0 for
    /// whichever is open.
    pub tag: u32,
    /// The change; what was exchanged, once it took effect.
    pub change: Change,
    /// Where it took effect.
    pub border: Border,
    /// What became of it.
    pub fate: Fate,
    /// The number of the stream that `from_seq` belongs to; set by the node.
    pub(super) stream: u64,
}

impl Order {
    /// A change for the next border, or if `from_seq` is not 0, for the first one from that
    /// sample on: of the stream that is open, or of the next one if none is.
    pub fn new(id: u64, from_seq: u64, change: Change) -> Self {
        Self {
            id,
            from_seq,
            tag: 0,
            change,
            border: Border::default(),
            fate: Fate::Waits,
            stream: 0,
        }
    }

    /// The same for one stream alone: the order waits for it, goes with it, and what it did is
    /// undone at the stream's end.
    #[must_use]
    pub fn for_stream(mut self, tag: u32) -> Self {
        self.tag = tag;
        self
    }
}

/// A place between two blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Border {
    /// The stream; 0 before the first one.
    pub stream_id: u64,
    /// First sample behind the border.
    pub from_seq: u64,
    /// Number of the block that begins there; of the one after it if the border lies within a
    /// block that is skipped.
    pub block: u64,
}

/// What an identifier must keep to be continued by another process.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodeState {
    /// Estimator and judge.
    pub estimator: EstimatorState,
    /// The stream, 0 for none.
    pub stream_id: u64,
    /// The last block with an estimate, 0 for none.
    pub block: u64,
    /// Stream time of the last sample \[ns\].
    pub t_ns: u64,
    /// Blocks that the estimator has taken in all, over its warm starts; 0 for one that knows
    /// nothing yet. Part of the estimator's own state.
    pub blocks: u64,
}

impl NodeState {
    /// Becomes a copy of another state; allocates only if there is no room.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.estimator.reals.clone_from(&other.estimator.reals);
        self.estimator.counts.clone_from(&other.estimator.counts);
        (self.stream_id, self.block) = (other.stream_id, other.block);
        (self.t_ns, self.blocks) = (other.t_ns, other.blocks);
    }
}
