//! The windows of the weak form: shape and length.

use super::error::IdentifyError;
use std::fmt;

/// Largest number of overlapping windows.
const MAX_OVERLAP: usize = 32;
/// Shortest stride \[s\]: the rows of three seconds are kept.
const LEAST_STRIDE_S: f64 = 1e-4;

/// ψ(s) = (1 − s²)⁴, 0 outside of (−1, 1).
pub(super) fn psi(s: f64) -> f64 {
    if s.abs() < 1.0 { (1.0 - s * s).powi(4) } else { 0.0 }
}

/// ψ and dψ/ds.
pub(super) fn psi_and_slope(s: f64) -> (f64, f64) {
    if s.abs() >= 1.0 {
        return (0.0, 0.0);
    }
    let base = 1.0 - s * s;
    let cube = base * base * base;
    (base * cube, -8.0 * s * cube)
}

/// Windows of the weak form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowOptions {
    /// T: length of a window \[s\].
    pub length_s: f64,
    /// Time from one window to the next \[s\].
    pub stride_s: f64,
    /// Longest time between two samples that a window may span \[s\].
    pub max_gap_s: f64,
    /// A joint's row is left out if the joint rests for more than this share of the window's
    /// weight, 0 to 1.
    pub max_rest: f64,
}

impl Default for WindowOptions {
    /// 0.25 s every 0.05 s: suitable for logs around 100 Hz.
    fn default() -> Self {
        Self {
            length_s: 0.25,
            stride_s: 0.05,
            max_gap_s: 0.05,
            max_rest: 0.3,
        }
    }
}

impl WindowOptions {
    /// For this sample period \[s\]: 25 samples per window, within 0.1 to 0.25 s. A longer window
    /// blurs reversals, a shorter one averages less noise.
    pub fn for_period(period_s: f64) -> Self {
        Self::of_length((25.0 * period_s).clamp(0.1, 0.25))
    }

    /// Windows of this length \[s\]; stride and gap are a fifth of it.
    pub fn of_length(length_s: f64) -> Self {
        Self {
            length_s,
            stride_s: length_s / 5.0,
            max_gap_s: length_s / 5.0,
            ..Self::default()
        }
    }

    /// Why samples with this period \[s\] give no rows, if they give none; tolerant to rounding of
    /// times.
    pub fn too_far_apart(&self, period_s: f64) -> Option<TooFarApart> {
        (period_s > (1.0 - 1e-6) * self.max_gap_s).then(|| TooFarApart::new(period_s, self.max_gap_s))
    }

    /// Checks the lengths.
    ///
    /// # Errors
    /// The first rule that is violated.
    pub fn validate(&self) -> Result<(), IdentifyError> {
        let positive = |name: &'static str, got: f64| match got > 0.0 && got.is_finite() {
            true => Ok(()),
            false => Err(IdentifyError::Time { name, got }),
        };
        positive("window length", self.length_s)?;
        positive("window stride", self.stride_s)?;
        positive("longest gap", self.max_gap_s)?;
        let overlaps = self.length_s / self.stride_s > (MAX_OVERLAP - 1) as f64;
        if overlaps || self.stride_s < LEAST_STRIDE_S {
            return Err(IdentifyError::Stride {
                least_s: LEAST_STRIDE_S.max(self.length_s / (MAX_OVERLAP - 1) as f64),
                part: MAX_OVERLAP - 1,
                got_s: self.stride_s,
            });
        }
        if !(0.0..=1.0).contains(&self.max_rest) {
            return Err(IdentifyError::Rest(self.max_rest));
        }
        Ok(())
    }
}

/// Samples too far apart for any window, so there are no rows; its message says what to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TooFarApart {
    period_s: f64,
    max_gap_s: f64,
}

impl TooFarApart {
    /// Samples every `period_s`, with windows that bridge `max_gap_s` \[s\].
    pub fn new(period_s: f64, max_gap_s: f64) -> Self {
        Self { period_s, max_gap_s }
    }
}

impl fmt::Display for TooFarApart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { period_s, max_gap_s } = self;
        // the shortest window with a few samples on either side of its middle
        let (window_s, gap_s) = (10.0 * period_s, 2.0 * period_s);
        write!(
            f,
            "samples come every {period_s:.3} s, rows bridge {max_gap_s:.3} s: \
             expected window_s {window_s:.3}, max_gap_s {gap_s:.3}, or a faster rate"
        )
    }
}
