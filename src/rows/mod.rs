//! From samples to the rows that an estimator sees.

mod advice;
mod auto_window;
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
mod standstill;
mod start;
mod suspect;
mod suspect_columns;
mod tempo;
mod theta_polynomial;
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
pub use suspect::{Considered, Suspect, SuspectKind};

use crate::estimator::Residuals;
use crate::model::JointSample;

/// A block of samples on its way to being rows: filled sample by sample, then read by an estimator.
pub trait SampleBlock: Residuals {
    /// Takes the sample of stream time `t_ns` in; false if the block is full and the sample was
    /// not taken.
    #[must_use]
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool;
    /// Gets the rows of the block ready, with θ̂ as it is before the block: whatever weighs rows is
    /// computed here, once per block, because it must not follow the fit. To be called after the
    /// last `push` of a block and before the rows are read.
    fn prepare(&mut self, _theta: &[f64]) {}
    /// Whether the next rows know columns of all errors that may come up while a machine runs; some
    /// are needed only to find out what has changed. Before [`prepare`](Self::prepare).
    fn look_closely(&mut self, _closely: bool) {}
    /// Samples of the block that were replaced because they were spikes, each signal counted; known
    /// after [`prepare`](Self::prepare).
    fn replaced(&self) -> u32 {
        0
    }
    /// What the error `index` of [`suspects`](Residuals::suspects) is, for words; from there on,
    /// the drifts of the parameters.
    fn suspect(&self, _index: usize) -> Option<Suspect<'_>> {
        None
    }
    /// Length of the windows that rows are made over \[s\]; `None` for rows of single samples.
    fn window_s(&self) -> Option<f64> {
        None
    }
    /// Begins the next block: forgets the rows. Samples that later rows still reach back to are
    /// kept.
    fn clear(&mut self);
    /// Begins a new stream: drops samples and rows. What was learnt of θ stays.
    fn reset(&mut self) {
        self.clear();
    }
    /// Begins with θ anew, as before the first block.
    fn forget_theta(&mut self) {}
    /// Room for the first blocks, which are learnt again once θ is known; none if the rows do not
    /// depend on θ.
    fn first_blocks(&self) -> FirstBlocks {
        FirstBlocks::default()
    }
    /// θ is known: blocks from now on are weighed with what [`prepare`](Self::prepare) is given.
    fn know_theta(&mut self) {}
}
