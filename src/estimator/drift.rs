//! Parameters of a group that move: the line that they are followed along from block to block.
//!
//! A drift begins with a line through the block that shows it (`line.rs`). Each next line is
//! expected to go on from the end of the last, with its slope, and may bend a little. The line's
//! end is the estimate. How a group follows it: `drifting_group.rs`. How long a drift is followed:
//! `drift_watch.rs`.

use super::line::LineFit;
use super::persist::Visit;

/// The line that a group follows.
#[derive(Debug, Clone)]
pub struct Drift {
    /// True while the parameters move along a line.
    pub active: bool,
    /// Slope per block of the line that is followed, and the variance of that.
    pub slope: Vec<f64>,
    pub slope_variance: Vec<f64>,
    /// The line that was fitted last.
    pub line: LineFit,
}

impl Drift {
    /// No drift of a group of n of all `params` parameters with so many equations.
    pub fn new(n: usize, params: usize, equations: usize) -> Self {
        Self {
            active: false,
            slope: vec![0.0; n],
            slope_variance: vec![0.0; n],
            line: LineFit::new(n, params, equations),
        }
    }

    /// What goes from block to block but for `active`; see `persist.rs`.
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

    /// True if the line that was fitted moves by more than three standard deviations.
    pub fn moves(&self) -> bool {
        (0..self.slope.len()).any(|i| self.line.slope[i].powi(2) > 9.0 * self.line.slope_variance(i))
    }

    /// Begin of the line that was fitted.
    pub fn start(&self, i: usize) -> f64 {
        self.line.middle[i] - 0.5 * self.line.slope[i]
    }

    /// End of the line that was fitted.
    pub fn end(&self, i: usize) -> f64 {
        self.line.middle[i] + 0.5 * self.line.slope[i]
    }

    /// The line that was fitted is the one that is followed; false if its end is no estimate.
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
