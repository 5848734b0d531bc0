//! Treatment of outliers: the residual above which a row has a reduced weight.
//!
//! ```text
//! limit = k · max(s, floor),   s = median |f| / 0.6745
//! ```
//!
//! The scale s is taken from the block itself at the present θ (median absolute deviation of the
//! residuals, whose mean is zero): it tolerates up to half of the rows being wrong, and it is large
//! while θ is still far off, so a bad start discards nothing. The limit stays constant between the
//! halvings of one step, so that the costs compared are of one function.
//!
//! The median comes from a histogram of log |f|, because a step must not allocate: 16 bins per
//! octave, interpolated.
//!
//! Huber's function (Robust Estimation of a Location Parameter, 1964) bounds a row's pull; a gate
//! drops it. Both count the rows they affect.

use super::options::Outliers;
use super::pass::{Loss, Summable};
use std::ops::Range;

const PER_OCTAVE: f64 = 16.0;
/// Octaves below and above 1 that the histogram resolves.
const OCTAVES: i32 = 64;
const BINS: usize = (2 * OCTAVES as usize + 1) * PER_OCTAVE as usize;

/// Counts of |f| by magnitude.
#[derive(Debug, Clone)]
pub struct Magnitudes {
    bins: Vec<u32>,
}

impl Magnitudes {
    /// An empty histogram.
    pub fn new() -> Self {
        Self { bins: vec![0; BINS] }
    }

    /// The median of |f| over the rows of an equation at θ; `regressor` is workspace for the
    /// equation's regressor.
    pub fn median(
        &mut self,
        rows: &dyn Summable,
        equation: usize,
        range: Range<usize>,
        theta: &[f64],
        regressor: &mut [f64],
    ) -> f64 {
        self.bins.fill(0);
        let mut count = 0u32;
        for index in range.filter(|&index| rows.is_used(equation, index)) {
            count += 1;
            let f = rows.row(equation, index, theta, regressor).abs();
            let at = ((f.log2() + f64::from(OCTAVES)) * PER_OCTAVE).clamp(0.0, (BINS - 1) as f64);
            self.bins[at as usize] += 1;
        }
        let half = f64::from(count) / 2.0;
        let mut below = 0.0;
        for (k, &n) in self.bins.iter().enumerate() {
            let n = f64::from(n);
            if n > 0.0 && below + n >= half {
                // the lowest bin covers everything down to zero
                if k == 0 {
                    return 0.0;
                }
                return ((k as f64 + (half - below) / n) / PER_OCTAVE - f64::from(OCTAVES)).exp2();
            }
            below += n;
        }
        0.0
    }
}

impl Outliers {
    /// The loss for residuals of noise standard deviation `scale`, which must be positive to limit
    /// anything.
    pub(super) fn loss(self, scale: f64) -> Loss {
        match self {
            Self::Huber(k) if scale > 0.0 => Loss::Huber(k * scale),
            Self::Gate(k) if scale > 0.0 => Loss::Gate(k * scale),
            _ => Loss::Square,
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::estimator::Residuals;

    /// Residuals that do not depend on θ.
    pub struct Values(pub Vec<f64>);

    impl Residuals for Values {
        fn len(&self) -> usize {
            self.0.len()
        }
        fn row(&self, _: usize, index: usize, _: &[f64], _: &mut [f64]) -> f64 {
            self.0[index]
        }
    }

    #[test]
    fn val_the_histogram_finds_the_median() {
        for size in [1e-9, 1.0, 3e5] {
            let values = Values((0..1001).map(|k| size * (k as f64 - 500.0) / 500.0).collect());
            let median = Magnitudes::new().median(&values, 0, 0..1001, &[], &mut []);
            // one sixteenth of an octave
            assert!((median / (0.5 * size) - 1.0).abs() < 0.045, "{median}");
        }
        let zeros = Values(vec![0.0; 10]);
        assert_eq!(Magnitudes::new().median(&zeros, 0, 0..10, &[], &mut []), 0.0);
        assert_eq!(Magnitudes::new().median(&zeros, 0, 0..0, &[], &mut []), 0.0);
    }
}
