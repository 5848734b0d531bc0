//! A group that follows a drift: its lines are fitted with the prior of the block.

use super::change::{CONSISTENT, GATED, MANY};
use super::equation::TINY;
use super::group::GroupState;
use super::line::LinePrior;
use super::pass::Summable;
use super::stats::f_tail;

/// Share of a parameter's size by which a line may always bend.
const BEND: f64 = 1e-3;

impl GroupState {
    /// Fits a line to the whole block, see `line.rs`; returns its cost in units of the noise,
    /// infinite if the fit fails.
    pub fn line_cost(&mut self, rows: &dyn Summable, theta: &[f64]) -> f64 {
        let own = self.parameters.clone();
        self.drift
            .line
            .fit(rows, self.equations.states(), theta, own, self.limits.fixed(), None)
            .unwrap_or(f64::INFINITY)
    }

    /// True if the line's residuals are no larger than the noise known so far.
    pub fn line_is_consistent(&self) -> bool {
        let rows = self.equations.rows();
        let outliers: usize = self.drift.line.outliers.iter().sum();
        let freedom = (rows - outliers.min(rows)) as f64 - 2.0 * self.n as f64;
        let known = self.equations.freedom();
        let cost: f64 = self
            .equations
            .states()
            .iter()
            .zip(&self.drift.line.costs)
            .map(|(e, cost)| cost / e.variance.max(TINY))
            .sum();
        let noise = freedom < 1.0 || f_tail(cost / freedom, freedom, known.max(1.0)) > CONSISTENT;
        noise && outliers as f64 <= GATED * rows as f64
    }

    /// After [`line_cost`](Self::line_cost): the relative amounts by which the parameters move
    /// within the block, and by which the line's start differs from the prior; only what exceeds
    /// three standard deviations counts.
    pub fn line_rates(&self, theta: &[f64]) -> (f64, f64) {
        let (mut rate, mut off) = (0.0f64, 0.0f64);
        let sure = |value: f64, variance: f64| {
            if value * value > 9.0 * variance {
                value.abs()
            } else {
                0.0
            }
        };
        for i in self.limits.free() {
            let size = self.size(theta, i);
            let start = self.drift.start(i) - self.prior.centre()[i];
            rate = rate.max(sure(self.drift.line.slope[i], self.drift.line.slope_variance(i)) / size);
            off = off.max(sure(start, self.drift.line.start_variance(i)) / size);
        }
        (rate, off)
    }

    /// Begins to follow a drift: fits the line again with the prior, in which every parameter may
    /// be off by the share `off` of its size and move by the share `rate`, and adopts its end.
    pub fn start_line(&mut self, rows: &dyn Summable, theta: &mut [f64], rate: f64, off: f64) -> bool {
        for i in 0..self.n {
            let size = self.size(theta, i);
            self.drift.slope[i] = 0.0;
            self.drift.slope_variance[i] = (rate * size).powi(2);
            if self.limits.is_free(i) {
                self.errors.add_change(i, (off.min(1.0) * size).powi(2));
            }
        }
        self.total_covariance();
        self.drift.active = self.fit_line(rows, theta) && self.end_line(theta);
        self.drift.active
    }

    /// Share of its size by which the fastest parameter moves per block.
    pub fn slope_rate(&self, theta: &[f64]) -> f64 {
        (0..self.n)
            .map(|i| self.drift.slope[i].abs() / self.size(theta, i))
            .fold(0.0, f64::max)
    }

    /// Fits the continuation of the last line; true if it leaves only noise and is close to what
    /// was expected. `change` is the share of their sizes by which slopes may have changed.
    pub fn follow_line(&mut self, rows: &dyn Summable, theta: &[f64], change: f64) -> bool {
        for i in 0..self.n {
            self.drift.slope_variance[i] += (change * self.size(theta, i)).powi(2);
        }
        let directions = 2.0 * self.n as f64;
        if !(self.fit_line(rows, theta) && self.line_is_consistent()) {
            return false;
        }
        !self.line_bends(theta) || f_tail(self.drift.line.surprise / directions, directions, MANY) > CONSISTENT
    }

    /// True if the fitted line differs from the previous one by more than `BEND` (0.1 %) of a
    /// parameter's size, however exact the signals are.
    pub fn line_bends(&self, theta: &[f64]) -> bool {
        (0..self.n).any(|i| {
            let start = self.drift.start(i) - self.prior.centre()[i];
            let turned = self.drift.line.slope[i] - self.drift.slope[i];
            start.abs().max(turned.abs()) > BEND * self.size(theta, i)
        })
    }

    fn fit_line(&mut self, rows: &dyn Summable, theta: &[f64]) -> bool {
        self.prior_from_covariance();
        let variance = self.equations.variance().max(TINY);
        self.prior.divide(variance);
        let prior = LinePrior {
            start: self.prior.centre(),
            start_information: self.prior.information(),
            slope: &self.drift.slope,
            slope_variance: &self.drift.slope_variance,
        };
        let own = self.parameters.clone();
        self.drift
            .line
            .fit(
                rows,
                self.equations.states(),
                theta,
                own,
                self.limits.fixed(),
                Some(prior),
            )
            .is_some()
    }

    /// Adopts the line's end as the estimate, with its covariance and information.
    pub fn end_line(&mut self, theta: &mut [f64]) -> bool {
        let n = self.n;
        if !self.drift.take() {
            return false;
        }
        for i in 0..n {
            theta[self.parameters.start + i] = self.limits.clamp(i, self.drift.end(i));
        }
        let (line, limits) = (&self.drift.line, &self.limits);
        self.errors.take_line(|i, j| {
            let free = limits.is_free(i) && limits.is_free(j);
            if free { line.end_covariance(i, j) } else { 0.0 }
        });
        self.equations.take_line(&line.costs, &line.outliers);
        true
    }
}
