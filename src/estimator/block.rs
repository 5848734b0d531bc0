//! The block recursion (6)–(11) and what goes beyond it: one estimate with its evidence per block of samples.
//!
//! Each independent [`Group`](super::Group) of parameters is a least squares problem of its own; a change of the plant is looked for in all of them
//! together. See `group.rs`, `fit.rs` and `change.rs` for the equations.

use super::change::locate;
use super::evidence::explained;
use super::fit::Fit;
use super::fit_statistic::{self, EquationFit, MISFIT, NoiseLevel};
use super::group::GroupState;
use super::options::{ChangeDetection, EstimatorError, EstimatorOptions};
use super::persist::{EstimatorState, Load, Save, StateError, Visit};
use super::relation::Published;
use super::report::{Change, ChangeKind, Held, Report};
use super::score_test::ScoreTest;
use super::{Residuals, StateMachine, Structure};
use std::ops::Range;

/// A cut of a block, see [`BlockEstimator::cut`].
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// First row after it.
    row: usize,
    cost: f64,
    /// What follows it leaves no more than noise …
    consistent: bool,
    /// … and this much of it, in units of the noise's variance.
    excess: f64,
}

/// On-line identification block by block. The update neither allocates nor locks; equal input gives bit-identical output.
#[derive(Debug, Clone)]
pub struct BlockEstimator {
    structure: Structure,
    options: EstimatorOptions,
    groups: Vec<GroupState>,
    theta: Vec<f64>,
    /// θ̂ before the block, and of the last fit while the time of a change is sought.
    before: Vec<f64>,
    later: Vec<f64>,
    /// Blocks since the last change that was no drift.
    since_change: u32,
    /// Blocks in a row in which a line that is followed did not move for sure.
    still: u32,
    score_test: ScoreTest,
    published: Published,
    /// Rows of the block that the estimate is of.
    used: Range<usize>,
    regressor: Vec<f64>,
    report: Report,
}

impl BlockEstimator {
    /// Three relative standard deviations below which a parameter counts as usable.
    const USABLE: f64 = 0.05;
    /// Share of variance removed from which a parameter counts as excited: the block alone knows it to within 32 %.
    const EXCITED: f64 = 0.9;
    /// A group that gave no alarm follows one that did where its own test is below this.
    const JOINS: f64 = 1e-2;
    /// Changes looked for in one block, and repetitions until the place of one settles.
    const CUTS: usize = 3;
    const PASSES: usize = 6;
    /// Share of the residuals' excess over the noise that a further cut may at most leave.
    const EXPLAINS: f64 = 0.5;
    /// Share of its size by which a drifting parameter may always move per block.
    const DRIFT_RATE: f64 = 0.01;
    /// Alarms at most this many blocks apart are a drift.
    const DRIFT_BLOCKS: u32 = 8;
    /// Blocks in a row without movement after which a drift has ended.
    const STILL_BLOCKS: u32 = 4;

    /// An estimator at its start values.
    ///
    /// # Errors
    /// Where the options do not fit the structure or are out of range.
    pub fn new(structure: Structure, options: EstimatorOptions) -> Result<Self, EstimatorError> {
        options.validate(&structure)?;
        let groups: Vec<GroupState> = structure
            .groups()
            .iter()
            .map(|group| GroupState::new(group, &structure, &options))
            .collect();
        let (params, equations) = (structure.params, structure.equations.len());
        let report = Report {
            theta: options.theta_start.clone(),
            theta_std: options.start_std.clone(),
            innovation_rms: vec![0.0; equations],
            residual_rms: vec![0.0; equations],
            noise_std: vec![0.0; equations],
            signal_rms: vec![0.0; equations],
            excitation: vec![0.0; params],
            excited: 0,
            usable: 0,
            fit: vec![1.0; equations],
            fit_probability: 1.0,
            misfit: 0,
            explained: vec![0.0; equations],
            pressed: 0,
            informed: false,
            fixed: 0,
            blocks: 0,
            rows: 0,
            rank: 0,
            iterations: 0,
            converged: true,
            outliers: 0,
            condition: 1.0,
            change_probability: 1.0,
            change: None,
            suspicion: None,
            held: None,
        };
        let drifts = if options.drift_per_s > 0.0 { params } else { 0 };
        let mut estimator = Self {
            published: Published::new(&options.theta_start, &groups),
            theta: options.theta_start.clone(),
            before: options.theta_start.clone(),
            later: options.theta_start.clone(),
            structure,
            options,
            groups,
            since_change: u32::MAX,
            still: 0,
            used: 0..0,
            regressor: vec![0.0; params],
            score_test: ScoreTest::new(equations, drifts),
            report,
        };
        estimator.explain_nothing();
        estimator.describe();
        Ok(estimator)
    }

    /// The structure that the estimator was made for.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The options in force.
    pub fn options(&self) -> &EstimatorOptions {
        &self.options
    }

    /// θ̂ as the recursion carries it, before relations are imposed: what the next block begins with. What is published is [`Report::theta`].
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The evidence of the last block.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Back to the start values and to knowing nothing. Allocates nothing.
    pub fn reset(&mut self) {
        self.theta.copy_from_slice(&self.options.theta_start);
        self.forget();
    }

    /// Forgets everything and starts at θ, clamped to the bounds; options stay. Allocates nothing.
    pub fn restart(&mut self, theta: &[f64]) {
        for (i, (own, value)) in self.theta.iter_mut().zip(theta).enumerate() {
            *own = value.clamp(self.options.lower[i], self.options.upper[i]);
        }
        self.forget();
    }

    fn forget(&mut self) {
        for group in &mut self.groups {
            group.forget(&self.theta, &self.options);
        }
        (self.since_change, self.still) = (u32::MAX, 0);
        let report = &mut self.report;
        (report.blocks, report.change, report.change_probability) = (0, None, 1.0);
        (report.misfit, report.pressed, report.fit_probability) = (0, 0, 1.0);
        report.fit.fill(1.0);
        report.suspicion = None;
        self.score_test.reset();
        self.explain_nothing();
        self.describe();
    }

    // an equation without parameters has nothing to explain
    fn explain_nothing(&mut self) {
        for (explained, own) in self.report.explained.iter_mut().zip(&self.structure.equations) {
            *explained = if own.is_empty() { 1.0 } else { 0.0 };
        }
    }

    /// What goes from block to block; see `persist.rs`.
    fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.theta);
        v.small(&mut self.since_change);
        v.small(&mut self.still);
        v.count(&mut self.report.blocks);
        self.options.fixed.iter_mut().for_each(|fixed| v.flag(fixed));
        for group in &mut self.groups {
            group.visit(v);
        }
        v.reals(&mut self.report.explained);
        self.score_test.visit(v);
    }

    /// Copies out what the estimator and its judge need to go on exactly as they would have; allocates only where `into` has no room.
    pub fn save(&mut self, judge: &mut StateMachine, into: &mut EstimatorState) {
        into.reals.clear();
        into.counts.clear();
        let mut save = Save(into);
        self.visit(&mut save);
        judge.visit(&mut save);
    }

    /// Goes on from a state that was [saved](Self::save).
    ///
    /// # Errors
    /// A state of another estimator, or one that no estimator can be in. Estimator and judge are as at their start then.
    pub fn load(&mut self, judge: &mut StateMachine, state: &EstimatorState) -> Result<(), StateError> {
        let loaded = self.try_load(judge, state);
        if loaded.is_err() {
            self.reset();
            judge.reset(&self.options.theta_start);
        }
        loaded
    }

    fn try_load(&mut self, judge: &mut StateMachine, state: &EstimatorState) -> Result<(), StateError> {
        if let Some(index) = state.reals.iter().position(|v| !v.is_finite()) {
            return Err(StateError::NotFinite { index });
        }
        // Without a list of its own, because a running identifier loads, too. There are at most 128 parameters.
        let fixed = (0..self.options.fixed.len()).fold(0u128, |bits, i| bits | u128::from(self.options.fixed[i]) << i);
        let mut load = Load::new(state);
        self.visit(&mut load);
        judge.visit(&mut load);
        let outcome = load.finish(state).and_then(|()| {
            let within = |i: &usize| (self.options.lower[*i]..=self.options.upper[*i]).contains(&self.theta[*i]);
            match (0..self.theta.len()).find(|i| !within(i)) {
                Some(index) => Err(StateError::OutOfBounds { index }),
                None if self.groups.iter_mut().all(GroupState::is_sound) => Ok(()),
                None => Err(StateError::NotPositive),
            }
        });
        match outcome {
            Ok(()) => self.describe(),
            Err(_) => (0..self.options.fixed.len()).for_each(|i| self.options.fixed[i] = fixed >> i & 1 != 0),
        }
        outcome
    }

    /// Takes over what may be chosen anew while it runs: λ, ε, iterations, step limit, limits of outliers, rate of false alarms and margin.
    /// Everything else of `options` is left aside. Allocates nothing.
    pub fn retune(&mut self, options: &EstimatorOptions) {
        let own = &mut self.options;
        own.forgetting_factor = options.forgetting_factor;
        own.information_floor = options.information_floor;
        own.max_iterations = options.max_iterations;
        own.step_factor = options.step_factor;
        own.outliers = options.outliers;
        own.change_detection = options.change_detection;
        for group in &mut self.groups {
            group.retune(&self.options);
        }
    }

    /// Σ ln Γ⁻¹ᵢᵢ over the free parameters, and the largest |Γ⁻¹ᵢⱼ − Γ⁻¹ⱼᵢ| relative to √(Γ⁻¹ᵢᵢ Γ⁻¹ⱼⱼ).
    pub fn information_figures(&self) -> (f64, f64) {
        let (mut sum, mut asymmetry) = (0.0, 0.0f64);
        for group in &self.groups {
            let (n, m) = (group.n, &group.information);
            for i in 0..n {
                if !group.fixed[i] {
                    sum += m[i * n + i].max(f64::MIN_POSITIVE).ln();
                }
                for j in 0..i {
                    let scale = (m[i * n + i] * m[j * n + j]).sqrt();
                    if scale > 0.0 {
                        asymmetry = asymmetry.max((m[i * n + j] - m[j * n + i]).abs() / scale);
                    }
                }
            }
        }
        (sum, asymmetry)
    }

    /// Holds parameter `index` at `value`, clamped to its bounds, or sets it free with the deviation of the start; false where there is no such
    /// parameter or the value is not finite. What the others know of each other stays.
    pub fn fix(&mut self, index: usize, value: Option<f64>) -> bool {
        if index >= self.structure.params || value.is_some_and(|v| !v.is_finite()) {
            return false;
        }
        self.options.fixed[index] = value.is_some();
        if let Some(value) = value {
            self.theta[index] = value.clamp(self.options.lower[index], self.options.upper[index]);
        }
        for group in self.groups.iter_mut().filter(|g| g.parameters.contains(&index)) {
            let i = index - group.parameters.start;
            group.fixed[i] = value.is_some();
            group.forget_parameter(i, self.options.information_floor);
            group.confirmation.begin(&self.theta[group.parameters.clone()]);
        }
        self.describe();
        true
    }

    /// Information Γ⁻¹ of the group that holds `parameter`, in (parameters, row-major matrix); `None` where no equation has it.
    pub fn information(&self, parameter: usize) -> Option<(Range<usize>, &[f64])> {
        let group = self.groups.iter().find(|g| g.parameters.contains(&parameter))?;
        Some((group.parameters.clone(), &group.information))
    }

    /// Covariance of the errors of two parameters as they are published, see [`Report::theta`]; 0 between independent groups.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.entry(i, j, |k| &self.published.covariance[k])
    }

    /// Entry of the matrix that `of` gives for a group, of two parameters of all.
    fn entry<'a>(&'a self, i: usize, j: usize, of: impl Fn(usize) -> &'a Vec<f64>) -> f64 {
        let holds = |g: &GroupState| g.parameters.contains(&i) && g.parameters.contains(&j);
        self.groups.iter().position(holds).map_or(0.0, |k| {
            let group = &self.groups[k];
            let (i, j) = (i - group.parameters.start, j - group.parameters.start);
            of(k)[i * group.n + j]
        })
    }

    /// Writes the correlation matrix, P × P and row-major; 1 on the diagonal, 0 for what has no deviation.
    pub fn correlation(&self, out: &mut [f64]) {
        let params = self.structure.params;
        for i in 0..params {
            for j in 0..params {
                let scale = (self.covariance(i, i) * self.covariance(j, j)).sqrt();
                let value = if scale > 0.0 {
                    self.covariance(i, j) / scale
                } else {
                    0.0
                };
                out[i * params + j] = if i == j { 1.0 } else { value.clamp(-1.0, 1.0) };
            }
        }
    }

    /// How well θ_a θ_b = θ_c θ_d holds: θ_a θ_b/(θ_c θ_d) − 1 and its standard deviation to first order.
    ///
    /// The arm has θ₁θ₄ = θ₂θ₃, for both are products with the same winding: nine parameters, eight degrees of freedom. This is of θ̂ before
    /// [`EstimatorOptions::relations`] are imposed, so that it tells whether the data agree. `NaN` where the right side is 0.
    pub fn product_ratio(&self, [a, b]: [usize; 2], [c, d]: [usize; 2]) -> (f64, f64) {
        let theta = &self.theta;
        let ratio = theta[a] * theta[b] / (theta[c] * theta[d]);
        // d ln ratio = dθ_a/θ_a + dθ_b/θ_b − dθ_c/θ_c − dθ_d/θ_d
        let terms = [(a, 1.0), (b, 1.0), (c, -1.0), (d, -1.0)];
        let mut variance = 0.0;
        for (i, s) in terms {
            for (j, t) in terms {
                let covariance = self.entry(i, j, |k| &self.groups[k].honest);
                variance += s * t * covariance / (theta[i] * theta[j]);
            }
        }
        (ratio - 1.0, ratio.abs() * variance.max(0.0).sqrt())
    }

    /// Takes a block and returns the estimate with its evidence.
    ///
    /// An empty block, and one whose rows are not finite, leaves everything as it is and says so in [`Report::held`].
    pub fn update<R: Residuals>(&mut self, rows: &R) -> &Report {
        if let (0, Some(start), 2..) = (self.report.blocks, rows.start(), self.options.max_iterations) {
            self.begin_at(start);
        }
        let report = &mut self.report;
        report.rows = rows.len();
        report.blocks += 1;
        (report.held, report.change, report.change_probability) = (None, None, 1.0);
        (report.iterations, report.converged, report.outliers) = (0, true, 0);
        (report.misfit, report.pressed, report.fit_probability) = (0, 0, 1.0);
        self.used = 0..rows.len();
        self.since_change = self.since_change.saturating_add(1);
        self.before.copy_from_slice(&self.theta);
        // all groups or none: half a block would be no estimate of the plant
        let held = if rows.is_empty() {
            Some(Held::Empty)
        } else {
            let theta = &self.theta;
            let finite = self
                .groups
                .iter_mut()
                .map(|g| g.look(rows, theta))
                .fold(true, |a, b| a & b);
            (!finite).then_some(Held::NotFinite)
        };
        if held.is_some() {
            report.held = held;
            (report.excited, report.rank) = (0, 0);
            report.excitation.fill(0.0);
            return &self.report;
        }
        let single = self.options.max_iterations == 1;
        let suspects = rows.suspects();
        let end_ns = rows.span(rows.len() - 1).1;
        let fixed = &self.options.fixed;
        let drift = |i: usize| if fixed[i] { 0.0 } else { self.options.drift_per_s };
        let moments = self.score_test.prepare(suspects, |s| rows.suspect_std(s), drift);
        for group in &mut self.groups {
            group.since_alarm = group.since_alarm.saturating_add(1);
            group.considered.begin(rows);
            group.considered.moments.copy_from_slice(moments);
            group.begin(rows, &self.theta, &self.options);
        }
        let (mut lines, broken) = self.follow(rows);
        for (k, group) in self.groups.iter_mut().enumerate() {
            if lines >> k & 1 == 1 {
                continue;
            }
            if single {
                group.single_step(&mut self.theta);
                self.report.iterations = 1;
            } else {
                // a line that was tried and refused may have left other priors
                let fit = group.fit(rows, 0..rows.len(), &mut self.theta, &self.options);
                note(&mut self.report, fit);
            }
        }
        // with one iteration the sums are those at θ̄
        let at = if single { &self.before } else { &self.theta };
        for (k, group) in self.groups.iter_mut().enumerate() {
            if lines >> k & 1 == 0 {
                group.suspect(rows, 0..rows.len(), at);
                group.look_for_change(at);
            }
        }
        if let Some(detection) = self.options.change_detection {
            lines |= self.watch(rows, lines, detection);
            if broken {
                // a bend, or worse: nothing is right that takes this block for a straight line or for none
                self.report.change = self.report.change.map(|change| Change {
                    kind: ChangeKind::Between,
                    ..change
                });
                self.since_change = 0;
                self.doubt_everything();
            }
        }
        // the sums of a single step belong to θ̄
        let before = single && self.report.change.is_none();
        self.judge_fit(rows, lines, before);
        self.score_test.begin();
        let changed = self.report.change.is_some();
        for (k, group) in self.groups.iter_mut().enumerate() {
            let own = group.parameters.clone();
            let fits = group.equations.iter().all(|e| self.report.misfit >> e.index & 1 == 0);
            group.since_misfit = if fits { group.since_misfit.saturating_add(1) } else { 0 };
            if lines >> k & 1 == 1 {
                group.suspect_line(rows, &mut self.later);
                group.conclude_line(&self.theta, &self.options);
                // what moves is known only by the block itself
                group.confirmation.restart(&self.theta[own]);
                if fits {
                    group.confirmation.take(&group.equations, &group.at, None, 1.0);
                }
                group.clusters.end(true, group.noise_is_told(), |_| 0.0);
                continue;
            }
            if changed {
                group.suspect(rows, self.used.clone(), &self.theta);
            }
            // the sums of a single step belong to θ̄, as (9) has them; the residual after the step is evidence
            let stepped = single && self.report.change.is_none() && group.try_at(rows, 0..rows.len(), &self.theta);
            group.conclude(&self.theta, stepped, end_ns, &self.options);
            if fits {
                let linearised = if before { &self.before[own] } else { &self.theta[own] };
                let lambda = self.options.forgetting_factor;
                group
                    .confirmation
                    .take(&group.equations, &group.at, Some(linearised), lambda);
            }
            if stepped {
                std::mem::swap(&mut group.at, &mut group.trial);
            }
            let (misfit, freedom, unit) = group.misfit();
            let told = group.noise_is_told();
            let excitation = &group.excitation;
            group.clusters.end(changed, told, |i| excitation.share(i));
            let (scores, information) = (&group.considered.scores, &group.considered.information);
            self.score_test.take((scores, information), unit, misfit, freedom, told);
        }
        self.score_test.end();
        self.report.suspicion = self.score_test.likeliest();
        for group in &mut self.groups {
            group.considered.moments.copy_from_slice(self.score_test.moments());
        }
        self.describe();
        &self.report
    }

    /// Moves the free parameters of an estimator that has seen nothing.
    fn begin_at(&mut self, start: &[f64]) {
        for (i, (theta, value)) in self.theta.iter_mut().zip(start).enumerate() {
            if !self.options.fixed[i] {
                *theta = value.clamp(self.options.lower[i], self.options.upper[i]);
            }
        }
        for group in &mut self.groups {
            group.confirmation.begin(&self.theta[group.parameters.clone()]);
        }
    }

    /// The plant has changed: nothing is confirmed any more, in no group.
    fn doubt_everything(&mut self) {
        for group in &mut self.groups {
            let own = group.parameters.clone();
            group.confirmation.restart(&self.theta[own]);
        }
    }

    /// Judges how well the block fits at θ̂, see `fit_statistic.rs` and `evidence.rs`; `before`: the sums were taken at θ̄.
    fn judge_fit<R: Residuals>(&mut self, rows: &R, lines: u64, before: bool) {
        let mut tests = 0;
        let mut tails = [1.0f64; 64];
        for (k, group) in self.groups.iter_mut().enumerate() {
            let line = lines >> k & 1 == 1;
            for (e, sums) in group.equations.iter().zip(&group.at) {
                let told = e.floor > 0.0;
                let level = NoiseLevel {
                    variance: if told { e.floor * e.floor } else { e.variance },
                    freedom: if told { f64::INFINITY } else { e.freedom },
                };
                let fit = if line {
                    EquationFit::of_line(sums, level)
                } else {
                    fit_statistic::judge(
                        rows,
                        e.index,
                        self.used.clone(),
                        &self.theta,
                        e.own.clone(),
                        e.divisor,
                        e.loss,
                        level,
                        &mut self.regressor[..e.own.len()],
                    )
                };
                tests += fit.tests;
                tails[e.index % 64] = fit.tail;
                self.report.fit[e.index] = fit.ratio;
                if let Some(share) = explained(&fit, level) {
                    self.report.explained[e.index] = share;
                }
            }
            let linearised = if before { &self.before } else { &self.theta };
            let pressed = match line {
                true => group.line_is_pressed(),
                false => group.is_pressed(&self.theta, linearised),
            };
            if pressed {
                self.report.pressed |= group.parameters.clone().fold(0, |mask, i| mask | 1 << i);
            }
        }
        for (e, tail) in tails.into_iter().enumerate().take(self.structure.equations.len()) {
            let probability = (tail * tests.max(1) as f64).min(1.0);
            self.report.fit_probability = self.report.fit_probability.min(probability);
            self.report.misfit |= u64::from(probability < MISFIT) << e;
        }
    }

    /// Tests the groups that follow no line, and where one raises an alarm finds out what happened and fits anew. Returns the
    /// groups that now follow a line.
    fn watch<R: Residuals>(&mut self, rows: &R, lines: u64, detection: ChangeDetection) -> u64 {
        let level = detection.false_alarm_rate / self.groups.len() as f64;
        let (mut joined, mut smallest) = (0u64, 1.0f64);
        let (mut alarm, mut known) = (false, false);
        for (k, group) in self.groups.iter_mut().enumerate() {
            if lines >> k & 1 == 1 {
                continue;
            }
            let probability = group.probability;
            smallest = smallest.min(probability);
            let another = group.is_another_plant(&self.options);
            let raised = probability < level || another;
            alarm |= raised;
            known |= raised && !group.is_open(&self.before);
            if probability < Self::JOINS || another {
                joined |= 1 << k;
            }
        }
        self.report.change_probability = smallest;
        if !alarm {
            return 0;
        }
        if !known {
            self.doubt(rows, joined, lines);
            return 0;
        }
        let whole = 0..rows.len();
        let mut consistent = true;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined >> k & 1 == 1 {
                group.fit_alone(rows, whole.clone(), &mut self.theta, &self.options);
                consistent &= group.is_consistent(&self.options);
            }
        }
        let mut again = false;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined >> k & 1 == 1 {
                again |= group.since_alarm <= Self::DRIFT_BLOCKS;
                group.since_alarm = 0;
            }
        }
        let change = if consistent {
            let kind = if again { ChangeKind::Drift } else { ChangeKind::Between };
            Change {
                kind,
                row: 0,
                time: rows.span(0).0,
            }
        } else {
            self.find(rows, joined, detection.margin)
        };
        if change.kind != ChangeKind::Drift {
            self.since_change = 0;
        }
        self.doubt_everything();
        self.report.change = Some(change);
        let mut started = 0;
        if change.kind == ChangeKind::Drift {
            started = self.start_lines(rows);
        }
        self.refit(rows, joined & !started, lines | started, change, detection.margin);
        started
    }

    /// Believes what was known less where it had left something wide open: there it was linearised far from the truth, and to find that out is no change of the
    /// plant. The same as after a change between two blocks, but for the announcement.
    fn doubt<R: Residuals>(&mut self, rows: &R, joined: u64, lines: u64) {
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined >> k & 1 == 1 {
                group.fit_alone(rows, 0..rows.len(), &mut self.theta, &self.options);
            }
        }
        let between = Change {
            kind: ChangeKind::Between,
            row: 0,
            time: rows.span(0).0,
        };
        self.refit(rows, joined, lines, between, 0);
    }

    /// Goes on with the lines of a drift while they explain the block and any of them moves; returns the groups that do, all or none,
    /// and whether a line ended because it does not explain the block.
    fn follow<R: Residuals>(&mut self, rows: &R) -> (u64, bool) {
        let drifting = |groups: &[GroupState]| {
            groups
                .iter()
                .enumerate()
                .fold(0u64, |mask, (k, g)| mask | u64::from(g.drifting) << k)
        };
        let lines = drifting(&self.groups);
        if lines == 0 {
            return (0, false);
        }
        let theta = &self.theta;
        // the speed of a drift may change by a third from block to block
        let change = 0.3
            * self
                .groups
                .iter()
                .map(|g| g.slope_rate(theta))
                .fold(Self::DRIFT_RATE, f64::max);
        let (mut explained, mut moves, mut bends) = (true, false, false);
        for group in self.groups.iter_mut().filter(|g| g.drifting) {
            group.set_losses(true, &self.options);
            explained &= group.follow_line(rows, theta, change);
            moves |= group.line_moves();
            bends |= group.line_bends(theta);
        }
        self.still = if moves { 0 } else { self.still.saturating_add(1) };
        for group in self.groups.iter_mut().filter(|g| g.drifting) {
            group.drifting = explained && self.still < Self::STILL_BLOCKS && group.end_line(&mut self.theta);
        }
        let lines = drifting(&self.groups);
        if lines != 0 {
            self.report.change = Some(Change {
                kind: ChangeKind::Drift,
                row: 0,
                time: rows.span(0).0,
            });
        }
        (lines, !explained && bends)
    }

    /// Begins to follow a drift in every group, for one that shows no sign of it alone would turn it into errors of weak parameters. Returns the
    /// groups that could.
    fn start_lines<R: Residuals>(&mut self, rows: &R) -> u64 {
        let (mut rate, mut off) = (Self::DRIFT_RATE, Self::DRIFT_RATE);
        for group in &mut self.groups {
            group.set_losses(true, &self.options);
            group.line_cost(rows, &self.theta);
            let (own_rate, own_off) = group.line_rates(&self.theta);
            (rate, off) = (rate.max(own_rate), off.max(own_off));
        }
        self.still = 0;
        let mut started = 0;
        for (k, group) in self.groups.iter_mut().enumerate() {
            started |= u64::from(group.start_line(rows, &mut self.theta, rate, off)) << k;
        }
        started
    }

    /// The cut of the block, the last one where there are several, or a drift where a line through the block explains it better.
    fn find<R: Residuals>(&mut self, rows: &R, joined: u64, margin: u64) -> Change {
        let end = rows.len();
        let mut line = 0.0;
        let mut straight = true;
        for (k, group) in self.groups.iter_mut().enumerate() {
            if joined >> k & 1 == 1 {
                // two more per parameter: Akaike's price of the slopes
                group.set_losses(true, &self.options);
                line += group.line_cost(rows, &self.theta) + 2.0 * group.n as f64;
                straight &= group.line_is_consistent();
            }
        }
        let mut start = 0;
        let mut excess = f64::INFINITY;
        self.later.copy_from_slice(&self.theta);
        for cut in 0..Self::CUTS {
            // after the first cut, what lies before the next is free of the past
            let found = self.cut(rows, joined, start..end, cut > 0, margin);
            if cut == 0 && straight && line < found.cost {
                return Change {
                    kind: ChangeKind::Drift,
                    row: 0,
                    time: rows.span(0).0,
                };
            }
            if found.excess > Self::EXPLAINS * excess {
                // noise that is larger here than it was learnt to be, and no second change
                break;
            }
            (start, excess) = (found.row, found.excess);
            for (k, group) in self.groups.iter().enumerate() {
                if joined >> k & 1 == 1 {
                    let own = group.parameters.clone();
                    self.theta[own.clone()].copy_from_slice(&self.later[own]);
                }
            }
            if found.consistent || end - start < 4 {
                break;
            }
            self.before.copy_from_slice(&self.later);
        }
        Change {
            kind: ChangeKind::Within,
            row: start,
            time: rows.span(start).0,
        }
    }

    /// The best single cut of `whole`; `later` becomes the fit of what follows it.
    ///
    /// Rows within `margin` after the cut have no say in that fit: where rows overlap, the first of them may still touch what was before.
    fn cut<R: Residuals>(&mut self, rows: &R, joined: u64, whole: Range<usize>, free: bool, margin: u64) -> Cut {
        let (mut row, mut cost) = (whole.start, f64::INFINITY);
        let (mut consistent, mut excess) = (true, 0.0);
        for pass in 0..Self::PASSES {
            for group in &mut self.groups {
                group.set_losses(pass > 0, &self.options);
            }
            let (found, least) = locate(
                &mut self.groups,
                joined,
                rows,
                whole.clone(),
                &self.before,
                &self.later,
                free,
            );
            let settled = pass > 0 && found == row;
            (row, cost) = (found, least);
            if settled {
                break;
            }
            (consistent, excess) = (true, 0.0);
            let from = first_after(rows, row..whole.end, margin);
            for (k, group) in self.groups.iter_mut().enumerate() {
                if joined >> k & 1 == 1 {
                    // from θ̄: a fit to both plants at once may have gone astray
                    let own = group.parameters.clone();
                    self.later[own.clone()].copy_from_slice(&group.centre);
                    group.fit_alone(rows, from..whole.end, &mut self.later, &self.options);
                    consistent &= group.is_consistent(&self.options);
                    excess = group.excess().max(excess);
                    if free && row > whole.start {
                        self.before[own.clone()].copy_from_slice(&group.centre);
                        // the sums that count are those of the later part
                        group.fit_alone(rows, whole.start..row, &mut self.before, &self.options);
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

    /// Fits the rows that may still be believed with a prior that allows for the change.
    fn refit<R: Residuals>(&mut self, rows: &R, joined: u64, lines: u64, change: Change, margin: u64) {
        let from = match change.kind {
            ChangeKind::Within => {
                let usable = change.time.saturating_add(margin);
                (change.row..rows.len())
                    .find(|&row| rows.span(row).0 >= usable)
                    .unwrap_or(rows.len())
            }
            ChangeKind::Between | ChangeKind::Drift => 0,
        };
        (self.report.iterations, self.report.converged) = (0, true);
        self.used = from..rows.len();
        for (k, group) in self.groups.iter_mut().enumerate() {
            let range = from..rows.len();
            if joined >> k & 1 == 0 {
                // the plant changed for this group, too, though it shows no sign of it: what came before says nothing any more
                if change.kind == ChangeKind::Within && lines >> k & 1 == 0 {
                    group.evaluate_at(rows, range.clone(), &self.theta);
                    let fit = group.fit(rows, range, &mut self.theta, &self.options);
                    note(&mut self.report, fit);
                }
                continue;
            }
            group.set_losses(false, &self.options);
            group.evaluate_at(rows, range.clone(), &self.theta);
            match change.kind {
                ChangeKind::Within => group.widen(&self.theta, None),
                ChangeKind::Between | ChangeKind::Drift => {
                    let own = group.parameters.clone();
                    for i in 0..group.n {
                        self.later[i] = self.theta[own.start + i] - group.centre[i];
                    }
                    group.widen(&self.theta, Some(&self.later[..group.n]));
                }
            }
            group.prior_from_covariance();
            let fit = group.fit(rows, range, &mut self.theta, &self.options);
            note(&mut self.report, fit);
        }
    }

    fn describe(&mut self) {
        for group in &mut self.groups {
            group.publish(&self.theta);
        }
        self.published.take(&self.theta, &self.groups, &self.options.relations);
        self.report.informed = self.groups.iter().all(|g| g.confirmation.is_informed());
        let since_change = self.since_change;
        let mut usable = 0;
        for i in 0..self.structure.params {
            let variance = self.covariance(i, i);
            let group = self.groups.iter().find(|g| g.parameters.contains(&i));
            let known = group.is_some();
            // who had no part in a change is confirmed by the data since then alone
            let quiet = since_change > 1 || since_change == 1 && group.is_some_and(|g| g.since_alarm > 1);
            // rows that did not fit are in the estimate: the next block has to show that they did no harm
            let fits = group.is_none_or(|g| g.since_misfit > 1);
            let free = self.report.pressed >> i & 1 == 0 && !self.options.fixed[i];
            // a parameter of no equation stays what it was
            let std = if known {
                variance.max(0.0).sqrt()
            } else {
                self.options.start_std[i]
            };
            self.report.theta_std[i] = std;
            let small = 3.0 * std < Self::USABLE * self.published.theta[i].abs();
            usable |= u128::from(small && quiet && fits && free) << i;
        }
        let report = &mut self.report;
        report.theta.copy_from_slice(&self.published.theta);
        report.usable = usable;
        (
            report.excited,
            report.fixed,
            report.rank,
            report.condition,
            report.outliers,
        ) = (0, 0, 0, 1.0, 0);
        for (i, fixed) in self.options.fixed.iter().enumerate() {
            report.fixed |= u128::from(*fixed) << i;
        }
        for group in &self.groups {
            let start = group.parameters.start;
            for i in 0..group.n {
                let share = group.excitation.share(i);
                report.excitation[start + i] = share;
                report.excited |= u128::from(share > Self::EXCITED) << (start + i);
            }
            report.rank += group.excitation.rank;
            report.condition = report.condition.max(group.condition);
            for (e, sums) in group.equations.iter().zip(&group.at) {
                let rms = |(sum, rows): (f64, usize)| {
                    if rows > 0 {
                        (sum / rows as f64).sqrt() * e.divisor
                    } else {
                        0.0
                    }
                };
                report.innovation_rms[e.index] = rms(e.innovation);
                report.residual_rms[e.index] = rms((sums.cost, sums.rows));
                report.signal_rms[e.index] = rms((sums.size, sums.rows));
                report.noise_std[e.index] = e.variance.sqrt() * e.divisor;
                report.outliers = report.outliers.saturating_add(sums.outliers as u32);
            }
        }
    }
}

/// The first row that begins `margin` after the first of `range` does, or the first where none is left then.
fn first_after<R: Residuals>(rows: &R, range: Range<usize>, margin: u64) -> usize {
    let usable = rows.span(range.start).0.saturating_add(margin);
    range
        .clone()
        .find(|&row| rows.span(row).0 >= usable)
        .unwrap_or(range.start)
}

fn note(report: &mut Report, fit: Fit) {
    report.iterations = report.iterations.max(fit.iterations);
    report.converged &= fit.converged;
}
