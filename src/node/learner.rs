//! The learner of an [`IdentifierNode`](super::identifier::IdentifierNode), which handles streams,
//! blocks and commands.

use super::command::Change;
use crate::estimator::{EstimatorOptions, EstimatorState, Report, StateError};
use crate::messages::{Estimate, LastError, Sample, Status};
use std::any::Any;

/// The end of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockEnd {
    /// Share of its samples that is missing: 0 for none, 1 if a signal was frozen and the block is
    /// not used.
    pub lost: f64,
    /// N.
    pub len: u64,
    /// Joints of a sample.
    pub joints: usize,
    /// The last sample received.
    pub last_seq: u64,
}

/// The result of a block.
#[derive(Debug)]
pub struct Learnt {
    /// The estimate; fields of the stream are zero.
    pub estimate: Estimate,
    /// Time of the change found in this block \[ns of stream time\].
    pub change_ns: Option<u64>,
    /// Error for the status.
    pub error: Option<LastError>,
}

/// Rows and estimator of a node: samples in, an estimate per block out. It knows neither streams
/// nor commands.
///
/// No method allocates, except [`into_rows`](Self::into_rows), and [`save`](Self::save) if its
/// target is too small.
pub trait Learner: Send + 'static {
    /// Adds a valid sample to the rows. False if it cannot be evaluated.
    fn take(&mut self, sample: &Sample) -> bool;
    /// A stream begins, or continues after [`begin_anew`](Self::begin_anew). Estimates from another
    /// stream may no longer be right.
    fn enter_stream(&mut self, _stream_id: u64) {}
    /// Drops the rows of the open block.
    fn drop_block(&mut self);
    /// Drops the rows of the open block after lost time, so that no window extends back.
    fn restart_rows(&mut self);
    /// Updates the estimate with the block and prepares for the next one.
    fn learn(&mut self, end: &BlockEnd) -> Learnt;
    /// Writes the derived values of the present estimate.
    fn derive(&self, estimate: &mut Estimate);
    /// The report after the last block.
    fn report(&self) -> &Report;
    /// Writes the status's figures about the information.
    fn describe(&self, status: &mut Status);
    /// See [`SampleBlock::window_s`](crate::rows::SampleBlock::window_s).
    fn window_s(&self) -> Option<f64>;

    /// The value at which a parameter is fixed; `None` if it is estimated.
    fn held_at(&self, index: usize) -> Option<f64>;
    /// Fixes a parameter, at its estimate if no value is given.
    fn fix(&mut self, index: usize, value: Option<f64>);
    /// Frees a fixed parameter; no effect if it is already free.
    fn free(&mut self, index: usize);

    /// Declares a robot's payload: nothing, or ten parameters about the flange.
    fn declare_payload(&mut self, _body: Option<&[f64; 10]>) {}

    /// True if [`begin_anew`](Self::begin_anew), [`tune`](Self::tune) or
    /// [`declare_payload`](Self::declare_payload) can carry out this change.
    fn accepts(&self, change: &Change) -> bool;
    /// Carries out [`Change::Replace`] or [`Change::Restart`]. Returns whether it continues from a
    /// saved state.
    ///
    /// # Errors
    /// If the state does not fit; the learner is then unchanged or at its start.
    fn begin_anew(&mut self, change: &mut Change) -> Result<bool, StateError>;
    /// Exchanges the tunables, and the rows if new ones are given. Returns whether the rows were
    /// exchanged.
    fn tune(&mut self, options: &mut EstimatorOptions, rows: Option<&mut Box<dyn Any + Send>>) -> bool;

    /// Saves the state that another process needs to continue; returns the number of blocks used.
    fn save(&mut self, into: &mut EstimatorState) -> u64;
    /// Continues from a [saved](Self::save) state.
    ///
    /// # Errors
    /// If the state is of another model or is invalid.
    fn load(&mut self, state: &EstimatorState) -> Result<(), StateError>;
    /// The same after a replay: a parameter fixed or freed meanwhile stays so.
    ///
    /// # Errors
    /// As for [`load`](Self::load).
    fn load_kept(&mut self, state: &EstimatorState) -> Result<(), StateError>;
    /// The rows of a learner that is no longer needed.
    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send>;
}
