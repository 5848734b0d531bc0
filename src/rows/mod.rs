//! Converts samples to the rows that an estimator uses.

mod advice;
mod auto_window;
mod by_direction;
mod drive_shapes;
mod end_kernel;
mod error_weights;
mod first_blocks;
mod form;
mod input_answer;
mod intake;
mod kernel;
mod mended_signal;
mod neighbours;
mod noise;
mod partials;
mod passes;
mod pointwise;
mod polynomial;
mod present_terms;
mod probes;
mod projected;
mod repair;
mod rounding;
mod separation;
mod smoothed;
mod smoothing;
mod spikes;
mod spread;
mod standstill;
mod start;
mod suspect;
mod suspect_columns;
mod suspect_effects;
mod suspect_places;
mod suspect_sizes;
mod tempo;
mod theta_polynomial;
mod through_drive;
mod trajectory;
mod turned;
mod whitening;

pub use advice::{FEWEST_WINDOW_SAMPLES, WindowAdvice, window_advice, window_advice_at};
pub use auto_window::{AutoWindowBlock, auto_window_first, auto_window_lengths};
pub use first_blocks::FirstBlocks;
pub use form::RowForm;
pub use kernel::InputTiming;
pub use pointwise::{InputSource, PointwiseBlock, priors, structure};
pub use projected::{ProjectedBlock, ProjectedError, ProjectedOptions, SensorNoise};
pub use smoothed::{SmoothedBlock, SmoothedOptions, Smoothing};
pub use smoothing::{one_sided, savitzky_golay};
pub use standstill::sticking_joints;
pub use suspect::{Considered, Suspect, SuspectKind};

use crate::estimator::Residuals;
use crate::model::JointSample;

/// A block of samples that becomes rows: filled sample by sample, then read by an estimator.
pub trait SampleBlock: Residuals {
    /// Adds the sample of stream time `t_ns`; false if the block is full and the sample was not
    /// added.
    #[must_use]
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool;
    /// Computes the rows of the block from θ̂ before the block. The weights of the rows are
    /// computed here, once per block, because they must not depend on the fit. Call it after the
    /// last `push` of a block and before reading rows.
    fn prepare(&mut self, _theta: &[f64]) {}
    /// Chooses whether the next rows have columns of the encoders' scales, which are needed only to
    /// find the cause of a change. Call it before [`prepare`](Self::prepare).
    fn enable_scale_columns(&mut self, _enabled: bool) {}
    /// Number of spikes replaced in the block, counted per signal; valid after
    /// [`prepare`](Self::prepare).
    fn replaced(&self) -> u32 {
        0
    }
    /// Describes error `index` of [`suspect_rows`](Residuals::suspect_rows); higher indices are the
    /// drifts of the parameters.
    fn suspect(&self, _index: usize) -> Option<Suspect<'_>> {
        None
    }
    /// Length of the windows \[s\]; `None` for rows of single samples.
    fn window_s(&self) -> Option<f64> {
        None
    }
    /// Begins the next block: drops the rows, and keeps samples that later rows still need.
    fn clear(&mut self);
    /// Begins a new stream: drops samples and rows, and keeps what was learnt of θ.
    fn reset(&mut self) {
        self.clear();
    }
    /// Forgets θ, as before the first block.
    fn forget_theta(&mut self) {}
    /// Room for the first blocks, which are learnt again as one; none if the weights of the rows do
    /// not depend on θ. There must be room for the samples of all these blocks in this one.
    fn first_blocks(&self) -> FirstBlocks {
        FirstBlocks::default()
    }
    /// θ is known: rows from now on are weighted with what [`prepare`](Self::prepare) is given.
    fn know_theta(&mut self) {}
}
