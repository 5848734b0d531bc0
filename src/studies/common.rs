//! Items shared by several studies.

use super::contenders::BlockResult;
use super::references::Reference;

/// Noise on the measured voltage in the studies with noise \[V\].
pub const STUDY_NOISE_V: f64 = 0.05;

/// Amount of computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Seeds per scenario.
    pub seeds: u64,
    /// Runs for calibration.
    pub calibration_runs: u64,
}

/// True if the 95 % interval of a parameter holds the truth.
pub(super) fn covers(block: &BlockResult, truth: &[f64], parameter: usize) -> bool {
    (block.theta[parameter] - truth[parameter]).abs() <= 1.96 * block.std[parameter]
}

/// Seeds and references of a study, in order.
pub(super) fn every_run(seeds: u64) -> Vec<(Reference, u64)> {
    Reference::ALL
        .iter()
        .flat_map(|&kind| (0..seeds).map(move |seed| (kind, seed)))
        .collect()
}
