//! The velocity inside nonlinear terms: q̇_k = Σ_j s_j q_{k+j}, −n ≤ j ≤ n, from a zero-phase
//! Savitzky-Golay filter of order 5.

use crate::rows::kernel::{correlate_odd, dot};
use crate::rows::smoothing::savitzky_golay;
use std::ops::Range;

/// Order of the polynomial fitted to the neighbours of a sample.
pub(super) const ORDER: usize = 5;

/// Number of samples from which a stretch is filtered faster as a whole.
const STRETCH: usize = 8;

/// The filter.
#[derive(Debug, Clone)]
pub(super) struct VelocityFilter {
    /// n: samples on either side.
    pub half: usize,
    /// s \[1/s\], 2 n + 1 of them, with s_{−j} = −s_j.
    pub weights: Vec<f64>,
    /// The first n weights of the transposed filter, which has the reverse order.
    pub transposed: Vec<f64>,
    /// Standard deviation of the velocity per sample, for white noise of 1 on the positions.
    pub gain: f64,
}

impl VelocityFilter {
    /// The filter over `half` samples on either side; `None` if they are too few.
    pub fn new(half: usize, period_s: f64) -> Option<Self> {
        let mut weights = savitzky_golay(half, ORDER, 1)?;
        let gain = dot(&weights, &weights).sqrt();
        // odd to the last bit
        for j in 0..=half {
            let odd = 0.5 * (weights[j] - weights[2 * half - j]) / period_s;
            (weights[j], weights[2 * half - j]) = (odd, -odd);
        }
        let transposed = weights.iter().rev().take(half).copied().collect();
        Some(Self {
            half,
            weights,
            transposed,
            gain,
        })
    }

    /// Writes the velocities at samples with neighbours on both sides.
    #[inline]
    pub fn write(&self, q: &[f64], samples: Range<usize>, dq: &mut [f64]) {
        if samples.len() >= STRETCH {
            return self.write_stretch(q, samples, dq);
        }
        for at in samples {
            dq[at] = dot(&self.weights, &q[at - self.half..=at + self.half]);
        }
    }

    #[inline(never)]
    fn write_stretch(&self, q: &[f64], samples: Range<usize>, dq: &mut [f64]) {
        let (q, dq) = (&q[samples.start - self.half..samples.end + self.half], &mut dq[samples]);
        dq.fill(0.0);
        correlate_odd(&self.weights[..self.half], q, dq);
    }
}
