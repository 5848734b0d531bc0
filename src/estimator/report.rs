//! The result of a block: the estimate with its evidence.

use super::Structure;
use super::cause_search::Cause;
use super::fit::Fit;
use super::group::GroupState;
use super::groups::Groups;
use super::index_set::IndexSet;
use super::options::EstimatorOptions;
use super::pass::Summable;
use super::relation::Published;
use super::suspicion::Suspicion;

/// Three relative standard deviations below which a parameter counts as usable.
const USABLE: f64 = 0.05;
/// Share of variance removed above which a parameter counts as excited: the block alone determines
/// it to within 10 %, so some dozens of such blocks make it usable.
const EXCITED: f64 = 0.99;
/// Share of the variance above which considered errors are reported as the limit, and number of
/// blocks before which they are not.
const LEADING: f64 = 0.5;
const SETTLED: u64 = 10;

/// Why a block gave no new estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Held {
    /// The block holds no rows.
    Empty,
    /// A residual or regressor is not finite at the present estimate.
    NotFinite,
}

/// Kinds of changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChangeKind {
    /// The plant changed before the block; all rows are of the new plant.
    Between,
    /// The plant changed at [`Change::row`]; only rows from there on were used.
    Within,
    /// The parameters move along a line; the estimate is its value at the end of the block.
    Drift,
}

/// A change of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Change {
    /// What kind of change.
    pub kind: ChangeKind,
    /// First row of the block that belongs to the present plant.
    pub row: usize,
    /// First instant of that row, in the unit of [`span`](super::Residuals::span).
    pub time: u64,
    /// True if this is the last change again: a joint shows it only now, because it rested.
    pub is_late: bool,
}

impl Change {
    /// A change before the first row of a block.
    pub(super) fn over_the_block(kind: ChangeKind, rows: &dyn Summable) -> Self {
        Self {
            kind,
            row: 0,
            time: rows.span(0).0,
            is_late: false,
        }
    }
}

/// The result of a block with its evidence. Parameters are in the plant's units and order,
/// equations in the structure's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// θ̂, with [`EstimatorOptions::relations`](super::EstimatorOptions::relations) imposed.
    pub theta: Vec<f64>,
    /// Standard deviation of θ̂; 0 for a fixed parameter.
    pub theta_std: Vec<f64>,
    /// Root mean square of f(θ̂ before the update) per equation, in the equation's unit.
    pub innovation_rms: Vec<f64>,
    /// Root mean square of f(θ̂ after the update) over the rows used, per equation, in the
    /// equation's unit.
    pub residual_rms: Vec<f64>,
    /// Estimated noise standard deviation per equation, in the equation's unit.
    pub noise_std: Vec<f64>,
    /// Root mean square of √Σ(φ_i θ_i)² per equation, in the equation's unit: the size of the terms
    /// that the equation balances.
    pub signal_rms: Vec<f64>,
    /// Per parameter: the share of the variance that this block alone would remove from a parameter
    /// known to within 100 %, 0 to 1.
    pub excitation: Vec<f64>,
    /// Parameters that this block alone finds to within 10 % of their size (`excitation` above
    /// 0.99).
    pub excited: IndexSet,
    /// Parameters that are known from data. For each, three standard deviations are below 5 % of
    /// its size (`sizes.rs`), according to the data since the last change; the data have informed
    /// on more than half of the directions of its group of equations; this group showed no change
    /// in this block or the one before, and both fit in each of its equations; it is not withheld
    /// until the cause of the last change is clear; the data push no parameter of the group against
    /// a bound. A fixed parameter is not estimated and never usable.
    pub usable: IndexSet,
    /// χ² of the whitened residuals over their number, per equation, see `fit_statistic.rs`: 1 on
    /// average if the block fits. Relative to the configured noise, otherwise to the level that
    /// was learnt before the block.
    pub fit: Vec<f64>,
    /// Probability of residuals this large, in the block or in its last part, if the model is
    /// right; below `MISFIT` of `fit_statistic.rs` the block does not fit.
    pub fit_probability: f64,
    /// Equations in which the block does not fit, or for whose group the estimate contradicts a
    /// relation between parameters.
    pub misfit: IndexSet,
    /// Share of the power of the equation's signal that the model explains, in the last block in
    /// which it exceeded the noise; 0 before.
    pub explained: Vec<f64>,
    /// Parameters that the data push against a bound, or whose group has such a parameter.
    pub pressed: IndexSet,
    /// True once the data have informed on more than half of the directions of the free parameters
    /// of some group of equations.
    pub informed: bool,
    /// Equations in whose group they have not yet. Its parameters are not usable, and the share of
    /// such an equation is not judged.
    pub uninformed: IndexSet,
    /// Parameters that are fixed.
    pub fixed: IndexSet,
    /// Blocks taken so far, this one included.
    pub blocks: u64,
    /// Rows per equation in this block.
    pub rows: usize,
    /// Number of independent directions that the block informed on, at most the number of
    /// parameters.
    pub rank: usize,
    /// Gauss–Newton iterations of the estimate, the largest number of any group.
    pub iterations: u32,
    /// False if the iterations ran out.
    pub converged: bool,
    /// Rows treated as outliers, over all equations.
    pub outliers: u32,
    /// Condition number of the column-scaled information, the largest of any group, `inf` if
    /// singular.
    pub condition: f64,
    /// Probability of a block this different from the past if the plant is unchanged; the smallest
    /// of any group.
    pub change_probability: f64,
    /// The change found in this block.
    pub change: Option<Change>,
    /// The likeliest term that the model lacks, if the residuals indicate one.
    pub suspicion: Option<Suspicion>,
    /// A parameter that the data inform on but that is not usable, because most of its variance
    /// comes from considered errors that the motion does not show; and the largest of these errors,
    /// an index of [`SuspectRows`](super::SuspectRows).
    pub limited: Option<(usize, usize)>,
    /// True if no parameter of some group is usable until the cause of the last change is clear
    /// (`cause_search.rs`).
    pub unclear: bool,
    /// The error of a drive or a sensor that explains the last change.
    pub fault: Option<Cause>,
    /// Why there is no new estimate.
    pub held: Option<Held>,
}

impl Report {
    /// Before the first block only the start values are known.
    pub(super) fn new(structure: &Structure, options: &EstimatorOptions) -> Self {
        let (params, equations) = (structure.params, structure.equations.len());
        Self {
            theta: options.theta_start(),
            theta_std: options.parameters.iter().map(|p| p.std).collect(),
            innovation_rms: vec![0.0; equations],
            residual_rms: vec![0.0; equations],
            noise_std: vec![0.0; equations],
            signal_rms: vec![0.0; equations],
            excitation: vec![0.0; params],
            fit: vec![1.0; equations],
            fit_probability: 1.0,
            explained: vec![0.0; equations],
            uninformed: (0..equations).collect(),
            converged: true,
            condition: 1.0,
            change_probability: 1.0,
            ..Self::default()
        }
    }

    /// Resets to a state without data.
    pub(super) fn forget(&mut self) {
        (self.blocks, self.change, self.change_probability) = (0, None, 1.0);
        (self.misfit, self.pressed, self.fit_probability) = (IndexSet::EMPTY, IndexSet::EMPTY, 1.0);
        (self.held, self.rows, self.iterations, self.converged) = (None, 0, 0, true);
        self.fit.fill(1.0);
        (self.suspicion, self.limited) = (None, None);
    }

    /// Begins with a block of `rows` rows per equation.
    pub(super) fn begin(&mut self, rows: usize) {
        self.rows = rows;
        self.blocks += 1;
        (self.held, self.change, self.change_probability) = (None, None, 1.0);
        (self.iterations, self.converged, self.outliers) = (0, true, 0);
        (self.misfit, self.pressed, self.fit_probability) = (IndexSet::EMPTY, IndexSet::EMPTY, 1.0);
    }

    /// Records that the block gives no new estimate.
    pub(super) fn hold(&mut self, held: Held) {
        self.held = Some(held);
        (self.excited, self.rank) = (IndexSet::EMPTY, 0);
        self.excitation.fill(0.0);
    }

    /// Adds the fit of a group.
    pub(super) fn note(&mut self, fit: Fit) {
        self.iterations = self.iterations.max(fit.iterations);
        self.converged &= fit.converged;
    }

    /// Fills in the published estimate and the usable parameters; `since_change` counts the blocks
    /// since the last change.
    pub(super) fn take_parameters(
        &mut self,
        groups: &Groups,
        published: &Published,
        since_change: u32,
        options: &EstimatorOptions,
    ) {
        let mut most = LEADING;
        (self.usable, self.limited) = (IndexSet::EMPTY, None);
        for i in 0..self.theta.len() {
            let variance = published.covariance(groups, i, i);
            let group = groups.holding(i);
            let known = group.is_some();
            // a group without a part in a change needs no further block to confirm it
            let quiet = since_change > 1 || since_change == 1 && group.is_some_and(|g| g.tally.is_quiet());
            // the estimate contains rows that did not fit: the next block must show that they did
            // no harm
            let fits = group.is_none_or(|g| g.tally.fits());
            let clear = !groups.withholds(i);
            let informed = group.is_none_or(|g| g.confirmation.is_informed());
            let free = !self.pressed.contains(i) && !options.parameters[i].fixed;
            // a parameter of no equation keeps its value
            let std = if known {
                variance.max(0.0).sqrt()
            } else {
                options.parameters[i].std
            };
            self.theta_std[i] = std;
            let value = published.theta[i];
            let size = group.map_or(value.abs(), |g| g.sizes.own(i - g.parameters.start, value));
            let small = 3.0 * std < USABLE * size;
            if small && informed && quiet && fits && clear && free {
                self.usable.insert(i);
            }
            if let Some(group) = group.filter(|_| !small && quiet && fits && clear && free && self.blocks > SETTLED)
                && let place = i - group.parameters.start
                && group.excitation.share(place) > EXCITED
                && let Some((error, widening)) = group.considered.leading(place)
                && widening > most * variance
            {
                (most, self.limited) = (widening / variance, Some((i, error)));
            }
        }
        self.unclear = groups.cause_search.is_unclear();
        self.fault = groups.cause_search.cause();
        self.theta.copy_from_slice(&published.theta);
    }

    /// Fills in the groups' results: excitation, condition and residuals.
    pub(super) fn take_groups(&mut self, groups: &[GroupState], options: &EstimatorOptions) {
        (self.rank, self.condition, self.outliers, self.informed) = (0, 1.0, 0, false);
        (self.excited, self.uninformed) = (IndexSet::EMPTY, IndexSet::EMPTY);
        self.fixed = options.fixed();
        for group in groups {
            let informed = group.confirmation.is_informed();
            self.informed |= informed;
            let start = group.parameters.start;
            for i in 0..group.n {
                let share = group.excitation.share(i);
                self.excitation[start + i] = share;
                if share > EXCITED {
                    self.excited.insert(start + i);
                }
            }
            self.rank += group.excitation.rank;
            self.condition = self.condition.max(group.information.condition());
            for (e, sums) in group.equations.pairs() {
                if !informed {
                    self.uninformed.insert(e.index);
                }
                let rms = |(sum, rows): (f64, usize)| {
                    if rows > 0 {
                        (sum / rows as f64).sqrt() * e.divisor
                    } else {
                        0.0
                    }
                };
                self.innovation_rms[e.index] = rms(e.innovation);
                self.residual_rms[e.index] = rms((sums.cost, sums.rows));
                self.signal_rms[e.index] = rms((sums.size, sums.rows));
                self.noise_std[e.index] = e.variance.sqrt() * e.divisor;
                self.outliers = self.outliers.saturating_add(sums.outliers as u32);
            }
        }
    }
}
