//! The equations of a group, with the sums of its block: at θ, and at a candidate for the next θ.
//!
//! The sums depend on the losses, so these are set before. θ holds all parameters of the plant.

use super::equation::chi_square;
use super::equation::{EquationState, TINY, add_gram, add_grams, add_score, add_scores, evaluate, mean_variance};
use super::error_covariance::{ErrorCovariance, clear_entries};
use super::options::{EstimatorOptions, Outliers};
use super::pass::{Loss, Summable, Sums};
use super::persist::Visit;
use super::robust::Magnitudes;
use super::workspace::Workspace;
use std::ops::Range;

/// The equations of a group of n parameters.
#[derive(Debug, Clone)]
pub struct Equations {
    n: usize,
    states: Vec<EquationState>,
    /// Sums at θ.
    at: Vec<Sums>,
    /// Sums at a candidate.
    trial: Vec<Sums>,
    magnitudes: Magnitudes,
    regressor: Vec<f64>,
}

impl Equations {
    /// Those with the `states`, without sums.
    pub fn new(n: usize, states: Vec<EquationState>) -> Self {
        let sums: Vec<Sums> = states.iter().map(|e| Sums::new(e.parameters.len())).collect();
        Self {
            n,
            states,
            at: sums.clone(),
            trial: sums,
            magnitudes: Magnitudes::new(),
            regressor: vec![0.0; n],
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.states.iter_mut().for_each(|e| e.visit(v));
    }

    /// Forgets the noise levels and the last block.
    pub fn forget(&mut self) {
        self.states.iter_mut().for_each(EquationState::forget);
    }

    /// Parameter i has no error from noise.
    pub fn forget_parameter(&mut self, i: usize) {
        let n = self.n;
        self.noise_covariances()
            .for_each(|noise| clear_entries(n, noise, i, 0.0));
    }

    /// True if no sum or variance is negative.
    pub fn is_sound(&self) -> bool {
        self.states.iter().all(EquationState::is_sound)
    }

    /// Each equation.
    pub fn states(&self) -> &[EquationState] {
        &self.states
    }

    /// The covariances that the equations' noise causes.
    pub fn noise_covariances(&mut self) -> impl Iterator<Item = &mut Vec<f64>> {
        self.states.iter_mut().map(|e| &mut e.noise_covariance)
    }

    /// The sums at θ.
    pub fn at(&self) -> &[Sums] {
        &self.at
    }

    /// The sums at the candidate.
    pub fn trial(&self) -> &[Sums] {
        &self.trial
    }

    /// Each equation with its sums at θ.
    pub fn pairs(&self) -> impl Iterator<Item = (&EquationState, &Sums)> + Clone {
        self.states.iter().zip(&self.at)
    }

    /// Weights every row fully.
    pub fn weight_fully(&mut self) {
        self.states.iter_mut().for_each(|e| e.loss = Loss::Square);
    }

    /// Limits outliers by the noise known so far.
    pub fn limit_by_known_noise(&mut self, options: &EstimatorOptions) {
        for e in &mut self.states {
            e.loss = options.outliers.loss(e.variance.sqrt());
        }
    }

    /// Sets the losses from the residuals at θ and renews the sums there; an open gate is Huber's
    /// function. Does nothing if outliers are not limited.
    pub fn limit_outliers(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &[f64],
        closed: bool,
        options: &EstimatorOptions,
    ) {
        if options.outliers == Outliers::Keep {
            return;
        }
        for (e, sums) in self.states.iter_mut().zip(&self.at) {
            let regressor = &mut self.regressor[..e.parameters.len()];
            let median = self.magnitudes.median(rows, e.index, range.clone(), theta, regressor);
            e.limit_outliers(median / e.divisor, sums, closed, options);
        }
        self.evaluate(rows, range, theta);
    }

    /// Takes the sums of all rows at θ̄, before the block is used. False if they are not finite.
    pub fn take_innovation(&mut self, rows: &dyn Summable, theta: &[f64]) -> bool {
        self.weight_fully();
        let finite = self.evaluate(rows, 0..rows.len(), theta);
        for (e, sums) in self.states.iter_mut().zip(&self.at) {
            e.innovation = (sums.cost, sums.rows);
        }
        finite
    }

    /// Takes the sums over `range` at θ; false if something is not finite.
    pub fn evaluate(&mut self, rows: &dyn Summable, range: Range<usize>, theta: &[f64]) -> bool {
        evaluate(rows, range, theta, &self.states, &mut self.at)
    }

    /// The same at a candidate.
    pub fn evaluate_trial(&mut self, rows: &dyn Summable, range: Range<usize>, theta: &[f64]) -> bool {
        evaluate(rows, range, theta, &self.states, &mut self.trial)
    }

    /// Moves to the candidate, whose sums become those at θ.
    pub fn accept_trial(&mut self) {
        std::mem::swap(&mut self.at, &mut self.trial);
    }

    /// Adds the rows of `range` at θ, as rows whose noise has this `variance`, to the sums in
    /// `total` and `gradient` and to a cost, which is returned. The candidate's sums are lost.
    pub fn add_rows(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &[f64],
        variance: f64,
        mut cost: f64,
        room: &mut Workspace,
    ) -> f64 {
        for (e, sums) in self.states.iter().zip(&mut self.trial) {
            let weight = variance / e.variance.max(TINY);
            rows.sum(&e.pass(range.clone()), theta, sums);
            cost += weight * sums.cost;
            add_score(e, sums, weight, &mut room.gradient);
            add_gram(self.n, e, sums, weight, &mut room.total);
        }
        cost
    }

    /// matrix += Σ_e S_e at θ.
    pub fn add_grams(&self, matrix: &mut [f64]) {
        add_grams(self.n, &self.states, &self.at, matrix);
    }

    /// matrix += Σ_e S_e/σ_e² at θ.
    pub fn add_information(&self, matrix: &mut [f64]) {
        for (e, sums) in self.pairs() {
            add_gram(self.n, e, sums, 1.0 / e.variance.max(TINY), matrix);
        }
    }

    /// gradient += Σ_e g_e at θ.
    pub fn add_scores(&self, gradient: &mut [f64]) {
        add_scores(&self.states, &self.at, gradient);
    }

    /// Number of rows of the sums at θ, over all equations.
    pub fn rows(&self) -> usize {
        self.at.iter().map(|sums| sums.rows).sum()
    }

    /// Degrees of freedom of the noise variances.
    pub fn freedom(&self) -> f64 {
        self.states.iter().map(|e| e.freedom).sum()
    }

    /// Change of the cost at θ by rounding alone: about fifty rounding units per residual.
    pub fn rounding(&self) -> f64 {
        self.at.iter().map(|s| 1e-28 * s.size).sum()
    }

    /// Mean noise variance of the rows at θ.
    pub fn variance(&self) -> f64 {
        mean_variance(&self.states, &self.at)
    }

    /// True if the noise level is not learnt from residuals but equals the floor of the options.
    pub fn noise_is_configured(&self) -> bool {
        self.states.iter().all(|e| e.floor > 0.0)
    }

    /// See [`chi_square`].
    pub fn chi_square(&self) -> (f64, f64, f64) {
        chi_square(&self.states, &self.at, self.noise_is_configured())
    }

    /// The largest noise variance relative to the specified one, at least 1, and the largest
    /// surprise.
    pub fn usual(&self) -> [f64; 2] {
        let levels = self.states.iter().filter(|e| e.floor > 0.0);
        let level = levels.map(|e| e.variance / (e.floor * e.floor)).fold(1.0, f64::max);
        let surprise = self.states.iter().map(|e| e.surprise).fold(0.0, f64::max);
        [level, surprise]
    }

    /// Sets the noise variances for this block's decisions.
    pub fn set_variances(&mut self, options: &EstimatorOptions) {
        for (e, sums) in self.states.iter_mut().zip(&self.at) {
            e.set_variance(sums, options);
        }
    }

    /// Learns the noise from the residuals at θ, or those at the candidate if θ has `stepped`
    /// there, and carries the errors that it causes through the update; `room` holds A as
    /// `transition` and K as `gain`.
    pub fn learn(
        &mut self,
        stepped: bool,
        errors: &mut ErrorCovariance,
        room: &mut Workspace,
        options: &EstimatorOptions,
    ) {
        for ((e, sums), after) in self.states.iter_mut().zip(&self.at).zip(&self.trial) {
            room.total.fill(0.0);
            add_gram(self.n, e, sums, 1.0, &mut room.total);
            errors.carry_noise(room, &mut e.noise_covariance);
            // tr(K S_e): degrees of freedom that the parameters take
            let taken: f64 = room.gain.iter().zip(&room.total).map(|(k, s)| k * s).sum();
            e.learn(sums, if stepped { after.cost } else { sums.cost }, taken, options);
        }
    }

    /// Takes the costs and the outliers of a fitted line as those at θ.
    pub fn take_line(&mut self, costs: &[f64], outliers: &[usize]) {
        for ((sums, cost), outliers) in self.at.iter_mut().zip(costs).zip(outliers) {
            (sums.cost, sums.outliers) = (*cost, *outliers);
        }
    }

    /// Learns the noise from the residuals of a line, whose covariance contains all errors.
    pub fn learn_line(&mut self, options: &EstimatorOptions) {
        let rows = self.rows();
        for (e, sums) in self.states.iter_mut().zip(&self.at) {
            e.noise_covariance.fill(0.0);
            // the line takes 2 n degrees of freedom of all rows of the group
            let taken = 2.0 * self.n as f64 * sums.rows as f64 / rows.max(1) as f64;
            let freedom = (sums.rows - sums.outliers) as f64 - taken;
            e.scale = (sums.cost / freedom.max(1.0)).sqrt();
            e.learn(sums, sums.cost, taken, options);
        }
    }
}
