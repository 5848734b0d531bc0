//! The line along which the moving parameters of a group are followed from block to block.
//!
//! A drift begins with a line through the block that shows it (`line.rs`). Each further line is
//! expected to continue from the end of the last with the same slope, and may bend slightly. The
//! line's end is the estimate. `drifting_group.rs` follows the line; `drift_watch.rs` decides for
//! how long.

use super::line::LineFit;
use super::persist::Visit;

/// The line that a group follows.
#[derive(Debug, Clone)]
pub struct Drift {
    /// True while the parameters move along a line.
    pub active: bool,
    /// Slope per block of the line that is followed, and its variance.
    pub slope: Vec<f64>,
    pub slope_variance: Vec<f64>,
    /// The line that was fitted last.
    pub line: LineFit,
}

impl Drift {
    /// No drift, for a group of n of all `params` parameters with `equations` equations.
    pub fn new(n: usize, params: usize, equations: usize) -> Self {
        Self {
            active: false,
            slope: vec![0.0; n],
            slope_variance: vec![0.0; n],
            line: LineFit::new(n, params, equations),
        }
    }

    /// State kept from block to block, except `active`; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.slope);
        v.reals(&mut self.slope_variance);
        self.line.visit(v);
    }

    /// Back to knowing nothing.
    pub fn forget(&mut self) {
        self.active = false;
        self.slope.fill(0.0);
        self.slope_variance.fill(0.0);
    }

    /// True if the fitted line moves by more than three standard deviations.
    pub fn moves(&self) -> bool {
        (0..self.slope.len()).any(|i| self.line.slope[i].powi(2) > 9.0 * self.line.slope_variance(i))
    }

    /// Start of the fitted line.
    pub fn start(&self, i: usize) -> f64 {
        self.line.middle[i] - 0.5 * self.line.slope[i]
    }

    /// End of the fitted line.
    pub fn end(&self, i: usize) -> f64 {
        self.line.middle[i] + 0.5 * self.line.slope[i]
    }

    /// Adopts the fitted line as the one to follow; false if its end is not a valid estimate.
    pub fn take(&mut self) -> bool {
        let n = self.slope.len();
        if (0..n).any(|i| !(self.end(i).is_finite() && self.line.end_covariance(i, i) >= 0.0)) {
            return false;
        }
        for i in 0..n {
            self.slope[i] = self.line.slope[i];
            self.slope_variance[i] = self.line.slope_variance(i);
        }
        true
    }
}
