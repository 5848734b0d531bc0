//! Sizes of signals.

use super::kernel::dot;

/// Standard deviation about the mean; 0 without values.
pub(super) fn standard_deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let sum: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (sum / values.len().max(1) as f64).sqrt()
}

/// Root mean square; 0 without values.
pub(super) fn root_mean_square(values: &[f64]) -> f64 {
    (dot(values, values) / values.len().max(1) as f64).sqrt()
}
