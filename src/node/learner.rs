//! What learns behind the streams, blocks and commands of an
//! [`IdentifierNode`](super::identifier::IdentifierNode).

use super::command::Change;
use crate::estimator::{EstimatorOptions, EstimatorState, Report, StateError};
use crate::messages::{Estimate, LastError, Sample, Status};
use std::any::Any;

/// A block that ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockEnd {
    /// Share of its samples that is not there: 0 for none, 1 if a signal was frozen and nothing of
    /// it counts.
    pub lost: f64,
    /// N.
    pub len: u64,
    /// Joints of a sample.
    pub joints: usize,
    /// The last sample that came.
    pub last_seq: u64,
}

/// What a block has taught.
#[derive(Debug)]
pub struct Learnt {
    /// The estimate; what only the stream knows is zero.
    pub estimate: Estimate,
    /// Time of the change found in this block \[ns of stream time\].
    pub change_ns: Option<u64>,
    /// What the status should say.
    pub error: Option<LastError>,
}

/// Rows and estimator of a node: samples in, an estimate per block out. It knows neither streams
/// nor commands.
///
/// No method allocates, except [`into_rows`](Self::into_rows), and [`save`](Self::save) if there is
/// no room.
pub trait Learner: Send + 'static {
    /// Makes rows of a sample that may be used. False if it cannot be evaluated.
    fn take(&mut self, sample: &Sample) -> bool;
    /// A stream begins, or goes on after [`begin_anew`](Self::begin_anew). What was learnt from
    /// another one may no longer be true of the machine.
    fn enter_stream(&mut self, _stream_id: u64) {}
    /// Drops the rows of the open block.
    fn drop_block(&mut self);
    /// Time has been lost: the rows of the open block go, and no window reaches back.
    fn restart_rows(&mut self);
    /// Learns from the block and makes room for the next one.
    fn learn(&mut self, end: &BlockEnd) -> Learnt;
    /// Writes the derived values of what is known now.
    fn derive(&self, estimate: &mut Estimate);
    /// What is known now, as the last block left it.
    fn report(&self) -> &Report;
    /// Writes the figures of the information that a status has.
    fn describe(&self, status: &mut Status);
    /// See [`SampleBlock::window_s`](crate::rows::SampleBlock::window_s).
    fn window_s(&self) -> Option<f64>;

    /// The value at which a parameter is held; `None` if it is estimated.
    fn held_at(&self, index: usize) -> Option<f64>;
    /// Holds a parameter, at its estimate if no value is given.
    fn fix(&mut self, index: usize, value: Option<f64>);
    /// Estimates a parameter that was held; no effect on one that is free already.
    fn free(&mut self, index: usize);

    /// Takes what a robot's flange carries as said: nothing, or ten parameters about the flange.
    fn declare_payload(&mut self, _body: Option<&[f64; 10]>) {}

    /// True if [`begin_anew`](Self::begin_anew), [`tune`](Self::tune) or
    /// [`declare_payload`](Self::declare_payload) can carry this change out.
    fn accepts(&self, change: &Change) -> bool;
    /// Carries out [`Change::Replace`] or [`Change::Restart`]. Returns whether it goes on from a
    /// saved state.
    ///
    /// # Errors
    /// A state that does not belong here; the learner is then as before or at its start.
    fn begin_anew(&mut self, change: &mut Change) -> Result<bool, StateError>;
    /// Exchanges its tunables, and its rows if others are given. Returns whether the rows were
    /// exchanged.
    fn tune(&mut self, options: &mut EstimatorOptions, rows: Option<&mut Box<dyn Any + Send>>) -> bool;

    /// Copies out what another process needs to go on; returns the number of blocks learnt.
    fn save(&mut self, into: &mut EstimatorState) -> u64;
    /// Goes on from a state that was [saved](Self::save).
    ///
    /// # Errors
    /// A state of another model, or one that no estimator can be in.
    fn load(&mut self, state: &EstimatorState) -> Result<(), StateError>;
    /// The same after a replay: a parameter that was held or freed meanwhile stays so.
    ///
    /// # Errors
    /// As for [`load`](Self::load).
    fn load_kept(&mut self, state: &EstimatorState) -> Result<(), StateError>;
    /// The rows of a learner that has no other use.
    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send>;
}
