//! Goodness of fit of a block: χ² of its whitened residuals, as a whole and over its last parts.
//!
//! ```text
//! χ²_k = Σ_{last k rows} f_n(θ̂)²/σ²        k = 1, 2, 4, … rows and all N of them
//! χ²_k/k ~ F(k, ν)                         if the model and θ̂ are right
//! p    = min(1, tests · min_k P(F > χ²_k/(k (1 + slack))))                          over all equations: Bonferroni
//! ```
//!
//! A plant that changes near the end of a block leaves residuals in the last rows only, which
//! vanish in the mean over the block and are too few for the test of `change.rs`. A change in the
//! last tenth of a second shows only in the windows that end with the block ([`Residuals::tail`]),
//! each of which is one more test. Because the rows are whitened backwards, a sum over the last k
//! of them is the cost of these windows alone.
//!
//! σ² is the variance that the user has specified (`noise_floor`, 1 for rows that are whitened by
//! the sensors' noise), ν = ∞. If none was specified, it is the level that the blocks before have
//! learnt, ν their degrees of freedom: a block must not raise the level that it is compared with. A
//! learnt level also includes what the model leaves out, which is not white noise, so the slack is
//! larger there, and residuals within [`SHARE`] of the equation's signal are never a misfit.

use super::index_set::IndexSet;
use super::pass::{Pass, Summable, Sums};
use super::stats::f_tail;

/// A block whose p is below this does not fit: with a right model and the specified noise this
/// happens once in five thousand blocks. It costs two blocks; an overlooked change costs wrong
/// values.
pub const MISFIT: f64 = 2e-4;
/// Share by which the variance may exceed the specified one: sensors are never known better.
const SLACK: f64 = 0.25;
/// The same for a variance that was learnt.
const LEARNT_SLACK: f64 = 3.0;
/// Root mean square of residuals, relative to the equation's signal, that a learnt noise level
/// never calls a misfit.
const SHARE: f64 = 2e-3;
/// Degrees of freedom of a known variance.
const MANY: f64 = 1e5;
/// Rows at the end of a block that are left out of the explained share, because backward whitening
/// begins there.
const EDGE: usize = 16;
/// Lengths of the last parts are powers of two below this.
const LONGEST: usize = 1 << 20;

/// The noise that residuals are compared with.
#[derive(Debug, Clone, Copy)]
pub struct NoiseLevel {
    /// σ² of the divided rows.
    pub variance: f64,
    /// Degrees of freedom behind it; infinite for a variance that the user has specified.
    pub freedom: f64,
}

/// The combined result of the equations of a block.
#[derive(Debug, Clone)]
pub struct BlockFit {
    tests: usize,
    /// Smallest tail probability of each equation.
    tails: [f64; 64],
}

impl Default for BlockFit {
    fn default() -> Self {
        Self {
            tests: 0,
            tails: [1.0; 64],
        }
    }
}

impl BlockFit {
    /// Adds an equation.
    pub fn take(&mut self, equation: usize, fit: &EquationFit) {
        self.tests += fit.tests;
        self.tails[equation % 64] = fit.tail;
    }

    /// Probability of residuals as large as these if the model is right, and the equations that do
    /// not fit.
    pub fn judge(&self, equations: usize) -> (f64, IndexSet) {
        let (mut least, mut misfit) = (1.0f64, IndexSet::EMPTY);
        for (e, tail) in self.tails.iter().enumerate().take(equations) {
            let probability = (tail * self.tests.max(1) as f64).min(1.0);
            least = least.min(probability);
            if probability < MISFIT {
                misfit.insert(e);
            }
        }
        (least, misfit)
    }
}

/// How well one equation fits a block.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EquationFit {
    /// χ²/n over the block: 1 on average if the model is right.
    pub ratio: f64,
    /// Smallest tail probability of the block or of one of its last parts.
    pub tail: f64,
    /// Number of parts tested.
    pub tests: usize,
    /// Σ f² over the rows that show what the model explains: all except the last few, whose
    /// whitening has not settled.
    pub residual: f64,
    /// Σ (v − v̄)² over the same rows, v = f + φᵀθ̂ the signal of the linear form (1): for a model
    /// that is linear in θ, the input. The mean is left out, because a constant explains it.
    pub signal: f64,
    /// Number of these rows, without outliers.
    pub rows: usize,
}

impl EquationFit {
    /// For a block with a fitted line: from its residuals over the whole block.
    pub fn of_line(sums: &Sums, level: NoiseLevel) -> Self {
        let rows = sums.rows - sums.outliers.min(sums.rows);
        let (slack, freedom) = slack_and_freedom(level);
        let ratio = sums.cost / (rows.max(1) as f64 * level.variance.max(f64::MIN_POSITIVE));
        let judged = rows > 0 && freedom >= 1.0;
        Self {
            ratio: if judged { ratio } else { 1.0 },
            tail: if judged {
                f_tail(ratio / (1.0 + slack), rows as f64, freedom)
            } else {
                1.0
            },
            tests: usize::from(judged),
            ..Self::default()
        }
    }
}

fn slack_and_freedom(level: NoiseLevel) -> (f64, f64) {
    match level.freedom.is_infinite() {
        true => (SLACK, MANY),
        false => (LEARNT_SLACK, level.freedom.min(MANY)),
    }
}

/// Σ f² over the last rows of a block, row by row from its end.
struct LastRows {
    rows: usize,
    sum: f64,
    /// Σ v² of the signal.
    power: f64,
    mean: f64,
    /// Numbers of rows (powers of two, and all), each with Σ f² over the last that many rows.
    parts: [(usize, f64); 21],
    count: usize,
}

impl LastRows {
    fn new() -> Self {
        Self {
            rows: 0,
            sum: 0.0,
            power: 0.0,
            mean: 0.0,
            parts: [(0, 0.0); 21],
            count: 0,
        }
    }

    /// Adds the next row towards the start of the block, with residual f and signal v; `shows`: the
    /// row also counts in `fit`.
    fn take(&mut self, f: f64, v: f64, shows: bool, fit: &mut EquationFit) {
        self.sum += f * f;
        self.power += v * v;
        self.rows += 1;
        if shows {
            // Welford's update
            fit.rows += 1;
            let off = v - self.mean;
            self.mean += off / fit.rows as f64;
            fit.signal += off * (v - self.mean);
            fit.residual += f * f;
        }
        if self.rows.is_power_of_two() && self.rows < LONGEST {
            self.keep();
        }
    }

    fn keep(&mut self) {
        self.parts[self.count] = (self.rows, self.sum);
        self.count += 1;
    }

    /// Ends the rows.
    fn end(&mut self) {
        if !self.rows.is_power_of_two() {
            self.keep();
        }
    }
}

impl EquationFit {
    /// Tests the rows of an equation at θ, last row first; `regressor` is workspace for one row.
    pub fn of_rows(
        rows: &dyn Summable,
        pass: &Pass,
        theta: &[f64],
        level: NoiseLevel,
        regressor: &mut [f64],
    ) -> EquationFit {
        let (equation, divisor) = (pass.equation, pass.divisor);
        let mut fit = EquationFit {
            tail: 1.0,
            ..EquationFit::default()
        };
        let settled = if pass.range.len() >= 4 * EDGE { EDGE } else { 0 };
        let mut last = LastRows::new();
        for index in pass.range.clone().filter(|&index| rows.is_used(equation, index)).rev() {
            let f = rows.row(equation, index, theta, regressor) / divisor;
            let (_, _, outlier) = pass.loss.at(f);
            if outlier {
                continue;
            }
            let predicted: f64 = regressor
                .iter()
                .zip(&theta[pass.parameters.clone()])
                .map(|(x, t)| x * t)
                .sum();
            last.take(f, f + predicted / divisor, last.rows >= settled, &mut fit);
        }
        if last.rows > 0 {
            last.end();
            // rows weight the middle of their windows, so they inform little on the end of the
            // block
            let short = (0..).map_while(|k| rows.tail(equation, k, theta));
            fit.compare(&last, level, short);
        }
        fit
    }

    /// Compares the sums over the last rows, and the residuals of `short` windows at the block's
    /// end, with the noise.
    fn compare(&mut self, last: &LastRows, level: NoiseLevel, short: impl Iterator<Item = f64>) {
        let known = level.freedom.is_infinite();
        let (slack, freedom) = slack_and_freedom(level);
        if freedom < 1.0 {
            // the first block: nothing to compare with
            self.ratio = 1.0;
            return;
        }
        let signal = last.power / last.rows as f64;
        let variance = level.variance.max(f64::MIN_POSITIVE);
        self.ratio = last.sum / (last.rows as f64 * variance);
        let variance = (1.0 + slack) * variance;
        let allowed = if known {
            variance
        } else {
            variance.max(SHARE * SHARE * signal)
        };
        for &(length, sum) in &last.parts[..last.count] {
            let x = sum / (length as f64 * allowed);
            self.tail = self.tail.min(f_tail(x, length as f64, freedom));
        }
        self.tests = last.count;
        for residual in short.take(if known { last.parts.len() } else { 0 }) {
            self.tail = self.tail.min(f_tail(residual * residual / (1.0 + slack), 1.0, freedom));
            self.tests += 1;
        }
    }
}
