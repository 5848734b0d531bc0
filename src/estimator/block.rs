//! The block recursion (6)–(11) and what goes beyond it: one estimate with its evidence per block
//! of samples.
//!
//! Each independent [`Group`](super::Group) of parameters is a separate least-squares problem; a
//! change of the plant is sought in all of them together. See `group.rs`, `fit.rs` and `change.rs`
//! for the equations.

use super::change_search::ChangeSearch;
use super::drift_watch::DriftWatch;
use super::explained::Explained;
use super::fit::Fit;
use super::fit_statistic::{BlockFit, EquationFit, NoiseLevel};
use super::groups::Groups;
use super::index_set::IndexSet;
use super::options::{ChangeDetection, EstimatorError, EstimatorOptions};
use super::pass::Summable;
use super::persist::{EstimatorState, Load, Save, StateError, Visit};
use super::prior::starts;
use super::relation::Published;
use super::report::{Change, ChangeKind, Held, Report};
use super::score_test::ScoreTest;
use super::{Residuals, StateMachine, Structure};
use std::ops::Range;

/// On-line identification block by block. The update neither allocates nor locks; equal input gives
/// bit-identical output.
#[derive(Debug, Clone)]
pub struct BlockEstimator {
    structure: Structure,
    options: EstimatorOptions,
    groups: Groups,
    theta: Vec<f64>,
    /// θ̂ before the block; while the time of a change is sought, θ̂ of the last fit.
    before: Vec<f64>,
    later: Vec<f64>,
    /// The stream that θ̂ was learnt from, 0 for none.
    stream_id: u64,
    /// Blocks since the last change other than a drift.
    since_change: u32,
    drift: DriftWatch,
    explained: Vec<Explained>,
    score_test: ScoreTest,
    published: Published,
    /// Rows of the block that the estimate uses.
    used: Range<usize>,
    regressor: Vec<f64>,
    report: Report,
}

impl BlockEstimator {
    /// An estimator at its start values.
    ///
    /// # Errors
    /// If the options do not fit the structure or are out of range.
    pub fn new(structure: Structure, options: EstimatorOptions) -> Result<Self, EstimatorError> {
        options.validate(&structure)?;
        let groups = Groups::new(&structure, &options);
        let report = Report::new(&structure, &options);
        let (params, equations) = (structure.params, structure.equations.len());
        let drifts = if options.drift_per_s > 0.0 { params } else { 0 };
        let mut estimator = Self {
            explained: Explained::nothing(&structure).collect(),
            published: Published::new(&options.theta_start(), &groups),
            theta: options.theta_start(),
            before: options.theta_start(),
            later: options.theta_start(),
            structure,
            options,
            score_test: ScoreTest::new(equations, groups.iter().count(), drifts),
            groups,
            stream_id: 0,
            since_change: u32::MAX,
            drift: DriftWatch::default(),
            used: 0..0,
            regressor: vec![0.0; params],
            report,
        };
        estimator.describe();
        Ok(estimator)
    }

    /// The structure of the plant.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The options in force.
    pub fn options(&self) -> &EstimatorOptions {
        &self.options
    }

    /// θ̂ of the recursion, before relations are imposed; the next block begins with it.
    /// [`Report::theta`] is what is published.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// True while the cause of the last change is sought: the next rows should then have columns of
    /// the encoders' scales, too.
    pub fn inquires(&self) -> bool {
        self.groups.cause_search.is_open(&self.groups)
    }

    /// The evidence of the last block.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Resets to the start values, without any data. Allocates nothing.
    pub fn reset(&mut self) {
        starts(&self.options.parameters, &mut self.theta);
        self.forget();
    }

    /// Resets and starts at `theta`, clamped to the bounds; keeps the options. Allocates nothing.
    pub fn restart(&mut self, theta: &[f64]) {
        for ((theta, value), prior) in self.theta.iter_mut().zip(theta).zip(&self.options.parameters) {
            *theta = prior.clamp(*value);
        }
        self.forget();
    }

    /// Forgets all blocks, to learn from their samples again as one block, which gets the number of
    /// the last of them. θ̂ and the stream stay. Allocates nothing.
    pub fn begin_again(&mut self) {
        let (stream_id, before) = (self.stream_id, self.report.blocks.saturating_sub(1));
        self.forget();
        (self.stream_id, self.report.blocks) = (stream_id, before);
    }

    fn forget(&mut self) {
        self.groups.forget(&self.theta, &self.options);
        (self.since_change, self.drift) = (u32::MAX, DriftWatch::default());
        self.stream_id = 0;
        self.report.forget();
        self.score_test.reset();
        self.explained.clear();
        self.explained.extend(Explained::nothing(&self.structure));
        self.describe();
    }

    /// Following rows belong to this stream; its id is not 0. If θ̂ was learnt from another one,
    /// the machine may have changed between them: nothing is usable until rows of this stream
    /// confirm it.
    pub fn enter_stream(&mut self, stream_id: u64) {
        let before = std::mem::replace(&mut self.stream_id, stream_id);
        if before != 0 && before != stream_id {
            self.groups.doubt(&self.theta);
            self.describe();
        }
    }

    /// State kept from block to block; see `persist.rs`.
    fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.theta);
        v.count(&mut self.stream_id);
        v.small(&mut self.since_change);
        self.drift.visit(v);
        v.count(&mut self.report.blocks);
        self.options.parameters.iter_mut().for_each(|p| v.flag(&mut p.fixed));
        self.groups.visit(v);
        self.explained.iter_mut().for_each(|explained| explained.visit(v));
        self.score_test.visit(v);
    }

    /// Saves the state of the estimator and its state machine, so that both can continue bit for
    /// bit; allocates only if `into` is too small.
    pub fn save(&mut self, judge: &mut StateMachine, into: &mut EstimatorState) {
        self.remember(into);
        judge.visit(&mut Save(into));
    }

    /// Saves the state for [`go_back`](Self::go_back); allocates only if `into` is too small.
    pub(crate) fn remember(&mut self, into: &mut EstimatorState) {
        into.reals.clear();
        into.counts.clear();
        self.visit(&mut Save(into));
    }

    /// Returns to a state that this estimator has [remembered](Self::remember).
    pub(crate) fn go_back(&mut self, state: &EstimatorState) {
        self.visit(&mut Load::new(state));
        self.describe();
    }

    /// Continues from a [saved](Self::save) state.
    ///
    /// # Errors
    /// If the state is of another estimator or is invalid. Estimator and state machine are then as
    /// at their start.
    pub fn load(&mut self, judge: &mut StateMachine, state: &EstimatorState) -> Result<(), StateError> {
        let loaded = self.try_load(judge, state);
        if loaded.is_err() {
            self.reset();
            judge.reset(&self.theta);
        }
        loaded
    }

    fn try_load(&mut self, judge: &mut StateMachine, state: &EstimatorState) -> Result<(), StateError> {
        if let Some(index) = state.reals.iter().position(|v| !v.is_finite()) {
            return Err(StateError::NotFinite { index });
        }
        let fixed = self.options.fixed();
        let mut load = Load::new(state);
        self.visit(&mut load);
        judge.visit(&mut load);
        let outcome = load.finish(state).and_then(|()| {
            let mut pairs = self.options.parameters.iter().zip(&self.theta);
            match pairs.position(|(prior, theta)| !prior.allows(*theta)) {
                Some(index) => Err(StateError::OutOfBounds { index }),
                None if self.groups.iter_mut().all(|group| group.is_sound()) => Ok(()),
                None => Err(StateError::NotPositive),
            }
        });
        match outcome {
            Ok(()) => self.describe(),
            Err(_) => self.options.set_fixed(fixed),
        }
        outcome
    }

    /// Adopts the [options that may change at run time](EstimatorOptions::exchange_tunables), and
    /// returns the previous ones in `options`. Allocates nothing.
    pub fn exchange_tunables(&mut self, options: &mut EstimatorOptions) {
        self.options.exchange_tunables(options);
        for group in self.groups.iter_mut() {
            group.retune(&self.options);
        }
    }

    /// Σ ln Γ⁻¹ᵢᵢ over the free parameters, and the largest |Γ⁻¹ᵢⱼ − Γ⁻¹ⱼᵢ| relative to √(Γ⁻¹ᵢᵢ
    /// Γ⁻¹ⱼⱼ).
    pub fn information_figures(&self) -> (f64, f64) {
        self.groups.information_figures()
    }

    /// Holds parameter `index` at `value`, clamped to its bounds, or frees it with the standard
    /// deviation of its start value; false if there is no such parameter or the value is not
    /// finite. The information on the other parameters stays.
    pub fn fix(&mut self, index: usize, value: Option<f64>) -> bool {
        if index >= self.structure.params || value.is_some_and(|v| !v.is_finite()) {
            return false;
        }
        let prior = &mut self.options.parameters[index];
        prior.fixed = value.is_some();
        if let Some(value) = value {
            self.theta[index] = prior.clamp(value);
        }
        let floor = self.options.information_floor;
        self.groups.fix(index, value.is_some(), &self.theta, floor);
        self.describe();
        true
    }

    /// Information Γ⁻¹ of the group that holds `parameter`, in (parameters, row-major matrix);
    /// `None` if no equation has it.
    pub fn information(&self, parameter: usize) -> Option<(Range<usize>, &[f64])> {
        let group = self.groups.holding(parameter)?;
        Some((group.parameters.clone(), group.information.matrix()))
    }

    /// Covariance of the errors of two parameters as they are published, see [`Report::theta`]; 0
    /// between independent groups.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.published.covariance(&self.groups, i, j)
    }

    /// Writes the correlation matrix, P × P and row-major; 1 on the diagonal, 0 for parameters
    /// whose standard deviation is 0.
    pub fn correlation(&self, out: &mut [f64]) {
        self.published.correlation(&self.groups, out);
    }

    /// How well θ_a θ_b = θ_c θ_d holds: θ_a θ_b/(θ_c θ_d) − 1 and its standard deviation to first
    /// order.
    ///
    /// The arm has θ₁θ₄ = θ₂θ₃, because both are products with the same winding: nine parameters,
    /// eight degrees of freedom. Uses θ̂ before [`EstimatorOptions::relations`] are imposed, so it
    /// shows whether the data agree. `NaN` if the right side is 0.
    pub fn product_ratio(&self, [a, b]: [usize; 2], [c, d]: [usize; 2]) -> (f64, f64) {
        self.groups.product_ratio(&self.theta, [a, b], [c, d])
    }

    /// Takes a block and returns the estimate with its evidence.
    ///
    /// An empty block, or one whose rows are not finite, changes nothing and is reported in
    /// [`Report::held`].
    pub fn update<R: Residuals>(&mut self, rows: &R) -> &Report {
        self.learn(rows)
    }

    fn learn(&mut self, rows: &dyn Summable) -> &Report {
        self.begin(rows);
        // all groups or none: the estimates of all groups must be of the same block
        if rows.is_empty() || !self.groups.compute_innovation(rows, &self.theta) {
            let held = if rows.is_empty() { Held::Empty } else { Held::NotFinite };
            self.report.hold(held);
            return &self.report;
        }
        self.begin_groups(rows);
        let (mut lines, broken) = self
            .drift
            .follow(rows, &mut self.groups, &mut self.theta, &self.options);
        if !lines.is_empty() {
            self.report.change = Some(Change::over_the_block(ChangeKind::Drift, rows));
        }
        self.fit(rows, lines);
        if let Some(detection) = self.options.change_detection {
            lines = lines.union(self.watch(rows, lines, detection));
            if broken {
                self.give_up_the_line();
            }
        }
        // the sums of a single step are taken at θ̄
        let single = self.options.max_iterations == 1 && self.report.change.is_none();
        self.judge_fit(rows, lines, single);
        self.conclude(rows, lines, single);
        self.describe();
        &self.report
    }

    /// Begins a block.
    fn begin(&mut self, rows: &dyn Summable) {
        // the start point stays to be chosen until a block with rows has been used
        let unseen = !rows.is_empty() && self.groups.iter().all(|group| group.tally.is_empty());
        if let (true, Some(start), 2..) = (unseen, rows.start(), self.options.max_iterations) {
            self.begin_at(start);
        }
        self.report.begin(rows.len());
        self.used = 0..rows.len();
        self.since_change = self.since_change.saturating_add(1);
        self.before.copy_from_slice(&self.theta);
    }

    /// Makes the prior of each group from its state before the block.
    fn begin_groups(&mut self, rows: &dyn Summable) {
        let (priors, suspects) = (&self.options.parameters, rows.suspect_rows());
        let drift = |i: usize| if priors[i].fixed { 0.0 } else { self.options.drift_per_s };
        let moments = self.score_test.prepare(suspects.count(), |s| suspects.std(s), drift);
        self.groups.allow_for(moments);
        for group in self.groups.iter_mut() {
            group.begin(rows, &self.theta, &self.options);
        }
    }

    /// Fits the groups that follow no line, and compares the results with their priors.
    fn fit(&mut self, rows: &dyn Summable, lines: IndexSet) {
        let single = self.options.max_iterations == 1; // one step from θ̄ per block
        for (k, group) in self.groups.iter_mut().enumerate() {
            if lines.contains(k) {
                continue;
            }
            if single {
                group.single_step(&mut self.theta);
                self.report.iterations = 1;
            } else {
                let fit = group.fit(rows, 0..rows.len(), &mut self.theta, &self.options);
                self.report.note(fit);
            }
        }
        // with one iteration the sums are those at θ̄
        let at = if single { &self.before } else { &self.theta };
        for (k, group) in self.groups.iter_mut().enumerate() {
            if !lines.contains(k) {
                group.suspect(rows, 0..rows.len(), at);
                group.probability = group.change_probability(rows, at);
            }
        }
    }

    /// The line has bent, or the plant has changed: neither a line nor a constant describes this
    /// block.
    fn give_up_the_line(&mut self) {
        if let Some(change) = &mut self.report.change {
            change.kind = ChangeKind::Between;
        }
        self.since_change = 0;
        self.groups.doubt(&self.theta);
    }

    /// Updates information, noise and evidence of each group; `single`: the sums were taken at θ̄.
    fn conclude(&mut self, rows: &dyn Summable, lines: IndexSet, single: bool) {
        let end_ns = rows.span(rows.len() - 1).1;
        let changed = self.report.change.is_some();
        self.score_test.begin();
        for (k, group) in self.groups.iter_mut().enumerate() {
            let own = group.parameters.clone();
            let fits = group.judge(self.report.misfit);
            if lines.contains(k) {
                group.suspect_line(rows, &mut self.later);
                group.conclude_line(&self.theta, &self.options);
                // only this block informs on a moving parameter
                group.confirmation.restart(&self.theta[own]);
                if fits {
                    group.confirmation.take_line(&group.equations);
                }
                group.clusters.end(true, group.equations.noise_is_configured(), |_| 0.0);
                continue;
            }
            if changed {
                group.suspect(rows, self.used.clone(), &self.theta);
            }
            // the sums of a single step are at θ̄ (9), but the evidence needs the residual after it
            let stepped = single && group.equations.evaluate_trial(rows, 0..rows.len(), &self.theta);
            group.conclude(&self.theta, stepped, end_ns, &self.options);
            if fits {
                let at = if single { &self.before[own] } else { &self.theta[own] };
                let (equations, lambda) = (&group.equations, self.options.forgetting_factor);
                group.confirmation.take(equations, at, lambda);
            }
            if stepped {
                group.equations.accept_trial();
            }
            group.end_clusters(changed);
            self.score_test.take(k, &group.evidence());
        }
        self.later.copy_from_slice(&self.theta);
        let used = (self.used.clone(), &self.report.fit[..]);
        self.groups.inquire(rows, used, &mut self.later, &self.options);
        self.score_test.end();
        let (test, suspects) = (&self.score_test, rows.suspect_rows());
        self.report.suspicion = test.likeliest(|s| suspects.lags_as(s), |s| suspects.is_named(s));
        self.groups.allow_for(self.score_test.moments());
    }

    /// Moves the free parameters of an estimator without data to a better start point.
    fn begin_at(&mut self, start: &[f64]) {
        for ((theta, value), prior) in self.theta.iter_mut().zip(start).zip(&self.options.parameters) {
            if !prior.fixed {
                *theta = prior.clamp(*value);
            }
        }
        self.groups.begin(&self.theta);
    }

    /// Judges how well the block fits at θ̂, see `fit_statistic.rs` and `evidence.rs`; `single`:
    /// the sums were taken at θ̄.
    fn judge_fit(&mut self, rows: &dyn Summable, lines: IndexSet, single: bool) {
        let mut whole = BlockFit::default();
        for (k, group) in self.groups.iter_mut().enumerate() {
            let line = lines.contains(k);
            for (e, sums) in group.equations.pairs() {
                let noise_is_configured = e.floor > 0.0;
                let level = NoiseLevel {
                    variance: if noise_is_configured {
                        e.floor * e.floor
                    } else {
                        e.variance
                    },
                    freedom: if noise_is_configured { f64::INFINITY } else { e.freedom },
                };
                let fit = if line {
                    EquationFit::of_line(sums, level)
                } else {
                    let room = &mut self.regressor[..e.parameters.len()];
                    EquationFit::of_rows(rows, &e.pass(self.used.clone()), &self.theta, level, room)
                };
                whole.take(e.index, &fit);
                self.report.fit[e.index] = fit.ratio;
                let sensors = rows.sensor_variance(e.index).map(|v| v / (e.divisor * e.divisor));
                self.explained[e.index].take(&fit, level, sensors);
            }
            let linearised = if single { &self.before } else { &self.theta };
            let pressed = match line {
                true => group.line_is_pressed(),
                false => group.is_pressed(&self.theta, linearised),
            };
            if pressed {
                self.report.pressed = self.report.pressed.union(group.parameters.clone().collect());
            }
        }
        let equations = self.structure.equations.len();
        (self.report.fit_probability, self.report.misfit) = whole.judge(equations);
    }

    /// Tests the groups that follow no line. If one raises an alarm, finds what changed and fits
    /// again. Returns the groups that now follow a line.
    fn watch(&mut self, rows: &dyn Summable, lines: IndexSet, detection: ChangeDetection) -> IndexSet {
        let alarm = self.search(rows).alarm(lines, detection);
        let joined = alarm.joined;
        self.report.change_probability = alarm.probability;
        if !alarm.raised {
            return IndexSet::EMPTY;
        }
        if !alarm.known {
            let refit = self.search(rows).widen(joined, lines);
            self.take_refit(refit);
            return IndexSet::EMPTY;
        }
        let mut change = match self.search(rows).explain(joined, detection.margin) {
            Ok(change) => change,
            Err(refit) => {
                self.take_refit(refit);
                return IndexSet::EMPTY;
            }
        };
        // The whole block came after a change that shows late, so one fit explains it.
        change.is_late = alarm.late && self.since_change < u32::MAX && change.kind == ChangeKind::Between;
        if change.kind != ChangeKind::Drift {
            self.since_change = 0;
            self.groups.begin_cause_search(rows);
        }
        self.groups.doubt(&self.theta);
        self.report.change = Some(change);
        let mut started = IndexSet::EMPTY;
        if change.kind == ChangeKind::Drift {
            started = self.drift.start(rows, &mut self.groups, &mut self.theta, &self.options);
        }
        let (joined, lines) = (joined.difference(started), lines.union(started));
        let refit = self.search(rows).refit(joined, lines, change, detection.margin);
        self.take_refit(refit);
        started
    }

    /// The search for a change in this block.
    fn search<'a>(&'a mut self, rows: &'a dyn Summable) -> ChangeSearch<'a> {
        ChangeSearch {
            rows,
            groups: &mut self.groups,
            options: &self.options,
            theta: &mut self.theta,
            before: &mut self.before,
            later: &mut self.later,
        }
    }

    fn take_refit(&mut self, (used, fit): (Range<usize>, Fit)) {
        self.used = used;
        (self.report.iterations, self.report.converged) = (fit.iterations, fit.converged);
    }

    /// Fills the report.
    fn describe(&mut self) {
        for group in self.groups.iter_mut() {
            group.publish(&self.theta);
        }
        let contradicting = self.published.take(&self.theta, &self.groups, &self.options.relations);
        self.report.misfit = self.report.misfit.union(contradicting);
        self.report.explained.clear();
        self.report.explained.extend(self.explained.iter().map(|e| e.share));
        self.report
            .take_parameters(&self.groups, &self.published, self.since_change, &self.options);
        self.report.take_groups(&self.groups, &self.options);
    }
}
