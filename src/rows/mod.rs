//! From samples to the rows that an estimator sees.

mod pointwise;

pub use pointwise::{InputSource, PointwiseBlock, structure};

use crate::estimator::Residuals;
use crate::model::JointSample;

/// A block of samples on its way to being rows: filled sample by sample, then read by an estimator.
pub trait SampleBlock: Residuals {
    /// Takes the sample of stream time `t_ns` in; false where the block is full and the sample was not taken.
    #[must_use]
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool;
    /// Forgets all samples and keeps the room.
    fn clear(&mut self);
}
