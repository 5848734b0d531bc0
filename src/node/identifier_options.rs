//! Options of the identifier node, besides its rows and its estimator.

use crate::messages::nanoseconds;
use crate::model::MAX_JOINTS;

/// A signal that repeats for fewer samples than this is not frozen, however long they take: a slow
/// encoder repeats for some samples at every turning point.
const FEWEST_FROZEN: u64 = 20;

/// Options of the identifier node, besides its rows and its estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifierOptions {
    /// N, samples per block; at least 1.
    pub block_len: u64,
    /// Number of joints that every sample must have.
    pub joints: usize,
    /// [`crate::messages::signals`] that every sample must carry.
    pub signals: u32,
    /// Identifies the model in every estimate.
    pub model_hash: u64,
    /// Identifies the configuration in every estimate.
    pub config_hash: u64,
    /// Time between two samples \[ns\]; 0 if unknown; a clock that was set forward is then not
    /// detected.
    pub sample_period_ns: u64,
    /// Magnitude at which a measured input is saturated, per joint; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// Patience of the detection of frozen signals \[samples\]; 0 turns it off.
    pub frozen_after: u64,
    /// Joints that friction can hold, which need a larger input to be expected to move.
    pub sticking: [bool; MAX_JOINTS],
}

impl IdentifierOptions {
    /// For blocks of `block_len` samples of `joints` joints that carry `signals`; everything else
    /// unknown or off.
    pub fn new(block_len: u64, joints: usize, signals: u32) -> Self {
        Self {
            block_len,
            joints,
            signals,
            model_hash: 0,
            config_hash: 0,
            sample_period_ns: 0,
            input_limit: [f64::INFINITY; MAX_JOINTS],
            frozen_after: 0,
            sticking: [false; MAX_JOINTS],
        }
    }

    /// With samples this far apart \[s\], and signals that count as frozen after a time \[s\], but
    /// not before 20 samples; a time of 0 turns the detection off.
    #[must_use]
    pub fn with_times(self, sample_period_s: f64, frozen_after_s: f64) -> Self {
        let patience = (frozen_after_s / sample_period_s).round() as u64;
        Self {
            sample_period_ns: nanoseconds(sample_period_s),
            frozen_after: if frozen_after_s > 0.0 {
                patience.max(FEWEST_FROZEN)
            } else {
                0
            },
            ..self
        }
    }
}
