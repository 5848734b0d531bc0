//! Commands to an identifier: prepared elsewhere, in force from a border between two blocks.
//!
//! Everything that needs memory (a new estimator, new rows, new options) is allocated before an
//! order is offered. At the border it is exchanged for the old, and the order is returned with the
//! old inside, so the node neither allocates nor frees.

use crate::estimator::{BlockEstimator, EstimatorOptions, EstimatorState, StateMachine};
use std::any::Any;
use std::fmt;

/// Largest number of orders that wait for a sample or a stream.
pub const MAX_ORDERS: usize = 64;
/// Number of further orders that a node holds if they wait only for the next border, so that orders
/// for distant samples cannot keep an operator from pausing.
pub const RESERVED_ORDERS: usize = 16;

/// The change made by a command.
pub enum Change {
    /// Take no more samples; θ̂ stays.
    Pause,
    /// Continue with the next block.
    Resume,
    /// Replace the estimator and its state machine: by new ones, or by those of a checkpoint.
    Replace {
        /// The estimator.
        estimator: Box<BlockEstimator>,
        /// Its state machine.
        judge: Box<StateMachine>,
        /// It continues from a checkpoint.
        warm: bool,
    },
    /// Restart, or continue from a state, for a node that does so in its own memory.
    Restart {
        /// The state; `None` for the start.
        state: Option<Box<NodeState>>,
    },
    /// Change the tunables; see [`BlockEstimator::exchange_tunables`].
    Tune {
        /// With the new tunables.
        options: Box<EstimatorOptions>,
        /// Of the new configuration.
        config_hash: u64,
        /// N.
        block_len: u64,
        /// Rows for blocks of the new length, of the same type as the present ones; needed if
        /// `block_len` changes.
        rows: Option<Box<dyn Any + Send>>,
    },
    /// Fix a parameter, at this value or at its estimate.
    Fix {
        /// Index of the parameter.
        index: usize,
        /// The value; within the parameter's bounds.
        value: Option<f64>,
    },
    /// Free a fixed parameter.
    Free {
        /// Index of the parameter.
        index: usize,
    },
    /// Declare a robot's payload: nothing, or ten parameters about the flange.
    Payload {
        /// The parameters.
        body: Option<Box<[f64; 10]>>,
    },
    /// Placeholder for a change whose contents the node keeps to undo it.
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

/// Outcome of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fate {
    /// It waits for its border.
    #[default]
    Waits,
    /// It took effect.
    Done,
    /// Its stream is over, or a newer order replaced it; it never took effect.
    Dropped,
    /// It took effect, and its stream is over: the exchange was reversed.
    Undone,
}

/// A change with its border and outcome.
#[derive(Debug)]
pub struct Order {
    /// Identifies it for the sender.
    pub id: u64,
    /// Not before this sample of the stream, and not after its end; 0: at the next border.
    pub from_seq: u64,
    /// [`stream_tag`](crate::messages::stream_tag) of the only stream that the order is for; 0 for
    /// whichever is open.
    pub tag: u32,
    /// The change; once it took effect, the exchanged parts.
    pub change: Change,
    /// The border at which it took effect.
    pub border: Border,
    /// Its outcome.
    pub fate: Fate,
    /// The number of the stream that `from_seq` belongs to; set by the node.
    pub(super) stream: u64,
}

impl Order {
    /// A change for the next border or, if `from_seq` is not 0, for the first border from that
    /// sample on, in the open stream, or in the next one if none is open.
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

    /// The same for one stream only: the order waits for it and ends with it, and its effect is
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
    /// First sample after the border.
    pub from_seq: u64,
    /// Number of the block that begins there, or of the next one if the border lies within a
    /// skipped block.
    pub block: u64,
}

/// The state that another process needs to continue an identifier.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodeState {
    /// Estimator and state machine.
    pub estimator: EstimatorState,
    /// The stream, 0 for none.
    pub stream_id: u64,
    /// The last block with an estimate, 0 for none.
    pub block: u64,
    /// Stream time of the last sample \[ns\].
    pub t_ns: u64,
    /// Blocks that the estimator has used in all, over its warm starts; 0 for one without data.
    /// Part of the estimator's state.
    pub blocks: u64,
}

impl NodeState {
    /// Copies another state; allocates only if the lists are too small.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.estimator.reals.clone_from(&other.estimator.reals);
        self.estimator.counts.clone_from(&other.estimator.counts);
        (self.stream_id, self.block) = (other.stream_id, other.block);
        (self.t_ns, self.blocks) = (other.t_ns, other.blocks);
    }
}
