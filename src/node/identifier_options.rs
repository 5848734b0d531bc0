//! What the identifier node needs to know beside its rows and its estimator.

use crate::model::MAX_JOINTS;

/// What the identifier node needs to know beside its rows and its estimator.
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
    /// Time between two samples \[ns\]; 0 if it is not known, and then a clock that was set
    /// forward is not noticed.
    pub sample_period_ns: u64,
    /// Magnitude from which on a measured input is saturated, per joint; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// Patience of the watch for frozen signals \[samples\]; 0 for no watch.
    pub frozen_after: u64,
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
        }
    }
}
