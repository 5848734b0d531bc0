//! Finds what changed in a block that raised an alarm, and fits the rows that remain valid. See
//! `change.rs` for the equations.

use super::change::{JOINS, locate};
use super::fit::Fit;
use super::group::GroupState;
use super::index_set::IndexSet;
use super::options::{ChangeDetection, EstimatorOptions};
use super::pass::Summable;
use super::report::{Change, ChangeKind};
use std::ops::Range;

/// Largest number of changes sought in one block, and of repetitions until the position of one
/// settles.
const CUTS: usize = 3;
const PASSES: usize = 6;
/// Largest share of the residuals' excess over the noise that may remain after a further cut.
const EXPLAINS: f64 = 0.5;

/// Result of the groups' tests on a block.
#[derive(Debug, Clone, Copy)]
pub struct Alarm {
    /// Smallest probability of any group that an unchanged plant gives a block as different as this
    /// one.
    pub probability: f64,
    /// A test raised an alarm.
    pub raised: bool,
    /// The alarm came from a group whose parameters were known by then.
    pub known: bool,
    /// What is not yet confirmed since the last change explains every alarm.
    pub late: bool,
    /// Groups that take part in the change.
    pub joined: IndexSet,
}

/// A cut of a block, see [`ChangeSearch::cut`].
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// First row after it.
    row: usize,
    cost: f64,
    /// The fit of the rows after it leaves only noise.
    consistent: bool,
    /// Residual variance of that fit, in units of the noise variance.
    excess: f64,
}

/// The search in one block, with its data.
pub struct ChangeSearch<'a> {
    pub rows: &'a dyn Summable,
    pub groups: &'a mut [GroupState],
    pub options: &'a EstimatorOptions,
    /// θ̂, updated by the search.
    pub theta: &'a mut [f64],
    /// Points of linearisation before and after a cut.
    pub before: &'a mut [f64],
    pub later: &'a mut [f64],
}

impl ChangeSearch<'_> {
    /// Tests the groups that follow no line; `lines` marks those that do.
    pub fn alarm(&mut self, lines: IndexSet, detection: ChangeDetection) -> Alarm {
        // with one iteration the sums are those at θ̄
        let single = self.options.max_iterations == 1;
        let at = if single { &*self.before } else { &*self.theta };
        let level = detection.false_alarm_rate / self.groups.len() as f64;
        let mut alarm = Alarm {
            probability: 1.0,
            raised: false,
            known: false,
            late: true,
            joined: IndexSet::EMPTY,
        };
        for (k, group) in self.groups.iter_mut().enumerate() {
            if lines.contains(k) {
                continue;
            }
            let probability = group.probability;
            alarm.probability = alarm.probability.min(probability);
            let another = group.is_another_plant(self.options);
            let raised = probability < level || another;
            alarm.raised |= raised;
            alarm.known |= raised && !group.is_open(self.before);
            alarm.late &= !raised || (!another && group.expects_the_block(self.rows, at));
            if raised || probability < JOINS {
                alarm.joined.insert(k);
            }
        }
        alarm
    }

    /// Classifies the change: if one fit explains the block, the plant changed before it; otherwise
    /// the block is cut. Alarms in quick succession are a drift.
    ///
    /// # Errors
    /// No change, if the rows after the cut show none without the others: some rows of the block do
    /// not fit, such as those over a spike at a step, or over friction that changes its sign
    /// between two samples. Then the block is fitted as if there had been no alarm; see
    /// [`refit`](Self::refit) for what this returns.
    pub fn explain(&mut self, joined: IndexSet, margin: u64) -> Result<Change, (Range<usize>, Fit)> {
        let consistent = self.fit_alone(joined);
        let found = (!consistent).then(|| self.find(joined, margin));
        if let Some(Change {
            kind: ChangeKind::Within,
            row,
            ..
        }) = found
        {
            // without the windows that overlap those before the cut
            let clear = self.rows.span(row.saturating_sub(1)).1;
            let margin = margin.max(clear.saturating_sub(self.rows.span(row).0));
            let after = first_after(self.rows, row..self.rows.len(), margin)..self.rows.len();
            if after.start > row && !self.shows_in(joined, &after) {
                return Err(self.withdraw(joined, &after));
            }
        }
        let mut again = false;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined.contains(k) {
                again |= group.tally.alarm();
            }
        }
        let kind = if again { ChangeKind::Drift } else { ChangeKind::Between };
        Ok(found.unwrap_or_else(|| Change::over_the_block(kind, self.rows)))
    }

    /// True if rows whose fit is θ̂ differ from before. Those after a change do so more clearly than
    /// the whole block, whose residuals are large.
    fn shows_in(&mut self, joined: IndexSet, range: &Range<usize>) -> bool {
        let groups = self.groups.iter_mut().enumerate();
        groups.filter(|(k, _)| joined.contains(*k)).any(|(_, group)| {
            group.equations.weight_fully();
            group.suspect(self.rows, range.clone(), self.theta);
            !group.equations.evaluate(self.rows, range.clone(), self.theta)
                || group.change_probability(self.rows, self.theta) < JOINS
        })
    }

    /// Fits the rows of `range` as if there had been no alarm; returns all rows, which the fit is
    /// judged by, and how it ended.
    fn withdraw(&mut self, joined: IndexSet, range: &Range<usize>) -> (Range<usize>, Fit) {
        let mut all = Fit {
            iterations: 0,
            converged: true,
        };
        for (k, group) in self.groups.iter_mut().enumerate() {
            let own = group.parameters.clone();
            self.before[own.clone()].copy_from_slice(group.prior.centre());
            if joined.contains(k) {
                self.theta[own].copy_from_slice(group.prior.centre());
                group.equations.weight_fully();
                group
                    .equations
                    .limit_outliers(self.rows, range.clone(), self.theta, true, self.options);
                group.prior_from_information();
                group.equations.evaluate(self.rows, range.clone(), self.theta);
                all = all.and(group.fit(self.rows, range.clone(), self.theta, self.options));
                group.suspect(self.rows, range.clone(), self.theta);
            }
        }
        (0..self.rows.len(), all)
    }

    /// Fits the block after an alarm of parameters that were not known. They were linearised far
    /// from the truth, so disagreeing with that prior is no evidence of a change. The prior is
    /// widened as after a change between two blocks, but no change is published.
    pub fn widen(&mut self, joined: IndexSet, lines: IndexSet) -> (Range<usize>, Fit) {
        self.fit_alone(joined);
        let between = Change::over_the_block(ChangeKind::Between, self.rows);
        let (used, fit) = self.refit(joined, lines, between, 0);
        // considered errors were summed at the fit before the alarm
        for (_, group) in self.groups.iter_mut().enumerate().filter(|(k, _)| joined.contains(*k)) {
            group.suspect(self.rows, used.clone(), self.theta);
        }
        (used, fit)
    }

    /// Fits the block alone; true if only noise remains in the groups of `joined`.
    pub fn fit_alone(&mut self, joined: IndexSet) -> bool {
        let mut consistent = true;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined.contains(k) {
                group.fit_alone(self.rows, 0..self.rows.len(), self.theta, self.options);
                consistent &= group.is_consistent(self.options);
            }
        }
        consistent
    }

    /// The last cut of the block, or a drift if a line through the block explains it better.
    fn find(&mut self, joined: IndexSet, margin: u64) -> Change {
        let rows = self.rows;
        let end = rows.len();
        let mut line = 0.0;
        let mut straight = true;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined.contains(k) {
                // plus two per parameter: Akaike's penalty for the slopes
                group.equations.limit_by_known_noise(self.options);
                line += group.line_cost(rows, self.theta) + 2.0 * group.n as f64;
                straight &= group.line_is_consistent();
            }
        }
        let mut start = 0;
        let mut excess = f64::INFINITY;
        self.later.copy_from_slice(self.theta);
        for cut in 0..CUTS {
            // after the first cut, the rows before the next one are independent of the past
            let found = self.cut(joined, start..end, cut > 0, margin);
            if cut == 0 && straight && line < found.cost {
                return Change::over_the_block(ChangeKind::Drift, rows);
            }
            if found.excess > EXPLAINS * excess {
                // the noise is larger here than the learnt level; this is no second change
                break;
            }
            (start, excess) = (found.row, found.excess);
            for (k, group) in self.groups.iter().enumerate() {
                if joined.contains(k) {
                    let own = group.parameters.clone();
                    self.theta[own.clone()].copy_from_slice(&self.later[own]);
                }
            }
            if found.consistent || end - start < 4 {
                break;
            }
            self.before.copy_from_slice(self.later);
        }
        Change {
            kind: ChangeKind::Within,
            row: start,
            time: rows.span(start).0,
            is_late: false,
        }
    }

    /// The best single cut of `whole`; `later` becomes the fit of the rows after it.
    ///
    /// That fit excludes rows within `margin` after the cut, because overlapping rows there may
    /// still depend on samples before it.
    fn cut(&mut self, joined: IndexSet, whole: Range<usize>, free: bool, margin: u64) -> Cut {
        let rows = self.rows;
        let (mut row, mut cost) = (whole.start, f64::INFINITY);
        let (mut consistent, mut excess) = (true, 0.0);
        for pass in 0..PASSES {
            for group in self.groups.iter_mut() {
                if pass > 0 {
                    group.equations.limit_by_known_noise(self.options);
                } else {
                    group.equations.weight_fully();
                }
            }
            let (found, least) = locate(self.groups, joined, rows, whole.clone(), self.before, self.later, free);
            let settled = pass > 0 && found == row;
            (row, cost) = (found, least);
            if settled {
                break;
            }
            (consistent, excess) = (true, 0.0);
            let from = first_after(rows, row..whole.end, margin);
            for (k, group) in self.groups.iter_mut().enumerate() {
                if joined.contains(k) {
                    // start from θ̄: a fit to both plants at once may have diverged
                    let own = group.parameters.clone();
                    self.later[own.clone()].copy_from_slice(group.prior.centre());
                    group.fit_alone(rows, from..whole.end, self.later, self.options);
                    consistent &= group.is_consistent(self.options);
                    excess = group.excess().max(excess);
                    if free && row > whole.start {
                        self.before[own.clone()].copy_from_slice(group.prior.centre());
                        // the sums must be those of the later part, so it is fitted last
                        group.fit_alone(rows, whole.start..row, self.before, self.options);
                    }
                }
            }
        }
        Cut {
            row,
            cost,
            consistent,
            excess,
        }
    }

    /// Fits the rows that remain valid, with a prior that allows for the change; returns these rows
    /// and how the fit ended.
    pub fn refit(&mut self, joined: IndexSet, lines: IndexSet, change: Change, margin: u64) -> (Range<usize>, Fit) {
        let rows = self.rows;
        let from = match change.kind {
            ChangeKind::Within => {
                let usable = change.time.saturating_add(margin);
                first_from(rows, change.row..rows.len(), usable).unwrap_or(rows.len())
            }
            ChangeKind::Between | ChangeKind::Drift => 0,
        };
        let mut all = Fit {
            iterations: 0,
            converged: true,
        };
        for (k, group) in self.groups.iter_mut().enumerate() {
            let range = from..rows.len();
            if !joined.contains(k) {
                // the plant may have changed for this group too, even without a sign of it, so
                // earlier rows are dropped
                if change.kind == ChangeKind::Within && !lines.contains(k) {
                    group.equations.evaluate(rows, range.clone(), self.theta);
                    let fit = group.fit(rows, range, self.theta, self.options);
                    all = all.and(fit);
                }
                continue;
            }
            group.equations.weight_fully();
            group.equations.evaluate(rows, range.clone(), self.theta);
            match change.kind {
                ChangeKind::Within => group.widen(self.theta, None),
                ChangeKind::Between | ChangeKind::Drift => {
                    let own = group.parameters.clone();
                    for i in 0..group.n {
                        self.later[i] = self.theta[own.start + i] - group.prior.centre()[i];
                    }
                    group.widen(self.theta, Some(&self.later[..group.n]));
                }
            }
            group.prior_from_covariance();
            let fit = group.fit(rows, range, self.theta, self.options);
            all = all.and(fit);
        }
        (from..rows.len(), all)
    }
}

/// The first row that begins at least `margin` after the first of `range`, or the first of `range`
/// if there is none.
fn first_after(rows: &dyn Summable, range: Range<usize>, margin: u64) -> usize {
    let usable = rows.span(range.start).0.saturating_add(margin);
    first_from(rows, range.clone(), usable).unwrap_or(range.start)
}

/// The first row of `range` that begins at `time` or later.
fn first_from(rows: &dyn Summable, mut range: Range<usize>, time: u64) -> Option<usize> {
    range.find(|&row| rows.span(row).0 >= time)
}
