//! The velocity inside nonlinear terms: q̇_k = Σ_j s_j q_{k+j}, −n ≤ j ≤ n, from a zero-phase
//! Savitzky-Golay filter of order 5.

use crate::rows::kernel::dot;
use crate::rows::smoothing::savitzky_golay;

/// Order of the polynomial that is fitted to the neighbours of a sample.
pub(super) const ORDER: usize = 5;

/// The filter.
#[derive(Debug, Clone)]
pub(super) struct VelocityFilter {
    /// n: samples on either side.
    pub half: usize,
    /// s \[1/s\], 2 n + 1 of them.
    pub weights: Vec<f64>,
    /// The same in the reverse order: the transposed filter.
    pub transposed: Vec<f64>,
    /// Standard deviation of the velocity per sample, for white noise of 1 on the positions.
    pub gain: f64,
}

impl VelocityFilter {
    /// The filter over `half` samples on either side; `None` if they are too few.
    pub fn new(half: usize, period_s: f64) -> Option<Self> {
        let mut weights = savitzky_golay(half, ORDER, 1)?;
        let gain = dot(&weights, &weights).sqrt();
        weights.iter_mut().for_each(|w| *w /= period_s);
        let transposed = weights.iter().rev().copied().collect();
        Some(Self {
            half,
            weights,
            transposed,
            gain,
        })
    }

    /// Velocity at sample `at`, which has its neighbours.
    #[inline]
    pub fn at(&self, q: &[f64], at: usize) -> f64 {
        dot(&self.weights, &q[at - self.half..=at + self.half])
    }
}
