//! One independent least squares problem: the parameters of a connected group of equations, and what is known about them.
//!
//! ```text
//! Λ       from Γ_{m−1}⁻¹ by the forgetting rule                       begin
//! θ̂_m     = argmin Σ w f_n(θ)² + (θ − θ̄)ᵀ Λ (θ − θ̄), θ̄ = θ̂_{m−1}    fit
//! Γ_m⁻¹   = Λ + S, S = Σ w φφᵀ at θ̂_m                                 conclude, (9)
//! ```
//!
//! # Covariance
//! θ̂ is a linear function of what came before: with K = Γ_m and A = I − K S the error obeys e_m = A e_{m−1} + K Σ φ n, whatever
//! the forgetting rule. So its covariance is carried along as it is (Joseph's form):
//!
//! ```text
//! P ← A P Aᵀ + K (Σ_e σ_e² S_e) K
//! ```
//!
//! For exponential forgetting this is the sandwich Γ M Γ with M ← λ² M + S. It is kept per equation for noise of unit variance, so
//! that the noise level may still be learnt, and apart for what the start value (or a change since) leaves unknown.
//!
//! # Noise
//! σ_e² is the residuals' sum of squares over their degrees of freedom, rows less tr(K S_e), both forgotten with λ: a block that a
//! strong prior holds is charged less than one parameter per parameter. It never goes below the floor of the options.

use super::clusters::Clusters;
use super::conditioning::{LARGEST_CONDITION, invert, repair};
use super::confirmation::Confirmation;
use super::considered::Considered;
use super::constrained::ConstrainedStep;
use super::equation::{EquationState, TINY, add_gram, add_grams, evaluate, floor_variance};
use super::forgetting::{Excitation, Rule};
use super::linalg::{Cholesky, Congruence, Eigen, gather, mul, scatter};
use super::line::LineFit;
use super::options::{EstimatorOptions, Forgetting, Outliers};
use super::pass::{Loss, Sums};
use super::persist::Visit;
use super::robust::Magnitudes;
use super::workspace::Workspace;
use super::{Group, Residuals, Structure};
use std::ops::Range;

/// The state of a group, with room for every step.
#[derive(Debug, Clone)]
pub struct GroupState {
    pub parameters: Range<usize>,
    pub n: usize,
    pub equations: Vec<EquationState>,
    /// Γ⁻¹, n × n.
    pub information: Vec<f64>,
    /// Covariance of the error that the start value left, n × n.
    pub guess_covariance: Vec<f64>,
    /// Covariance of the error that changes of the plant since then brought, n × n.
    pub change_covariance: Vec<f64>,
    /// Total, weighted with the noise variances, n × n.
    pub covariance: Vec<f64>,
    /// What is published: the total, widened by repeats that disagree and by considered errors, n × n.
    pub honest: Vec<f64>,
    /// The covariance that may be published, without what drifts widen it by: what relations are imposed with. Empty if no drifts are considered, n × n.
    pub undrifted: Vec<f64>,
    /// Probability of the last block, were the plant unchanged.
    pub probability: f64,
    pub clusters: Clusters,
    pub considered: Considered,
    /// True while the parameters move along a line, with its slope per block and the variance of that.
    pub drifting: bool,
    pub slope: Vec<f64>,
    pub slope_variance: Vec<f64>,
    pub line: LineFit,
    /// Blocks that this group was updated with, and how many since its last alarm.
    pub blocks: u64,
    pub since_alarm: u32,
    /// Blocks since the last one that did not fit in one of its equations.
    pub since_misfit: u32,
    pub fixed: Vec<bool>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    pub start_std: Vec<f64>,
    /// What the last block informed on.
    pub excitation: Excitation,
    /// What the data since the last change say, and the covariance that may be published.
    pub confirmation: Confirmation,
    /// Condition number of the column-scaled information.
    pub condition: f64,
    /// Λ and θ̄ of the present fit.
    pub prior: Vec<f64>,
    pub centre: Vec<f64>,
    /// Sums at the present θ, and at a candidate.
    pub at: Vec<Sums>,
    pub trial: Vec<Sums>,
    pub rule: Rule,
    pub step: ConstrainedStep,
    pub cholesky: Cholesky,
    pub eigen: Eigen,
    congruence: Congruence,
    pub magnitudes: Magnitudes,
    pub room: Workspace,
}

impl GroupState {
    /// The start state of validated options.
    pub fn new(group: &Group, structure: &Structure, options: &EstimatorOptions) -> Self {
        let parameters = group.parameters.clone();
        let n = parameters.len();
        let equations: Vec<EquationState> = group
            .equations
            .iter()
            .map(|&index| {
                let own = structure.equations[index].clone();
                EquationState::new(index, own, &parameters, options)
            })
            .collect();
        let sums: Vec<Sums> = equations.iter().map(|e| Sums::new(e.own.len())).collect();
        let mut state = Self {
            n,
            information: vec![0.0; n * n],
            guess_covariance: vec![0.0; n * n],
            change_covariance: vec![0.0; n * n],
            covariance: vec![0.0; n * n],
            honest: vec![0.0; n * n],
            undrifted: vec![0.0; if options.drift_per_s > 0.0 { n * n } else { 0 }],
            probability: 1.0,
            clusters: Clusters::new(n),
            considered: Considered::new(
                &parameters,
                structure.params,
                structure.equations.len(),
                options.drift_per_s > 0.0,
            ),
            drifting: false,
            slope: vec![0.0; n],
            slope_variance: vec![0.0; n],
            line: LineFit::new(n, structure.params, equations.len()),
            blocks: 0,
            since_alarm: u32::MAX,
            since_misfit: u32::MAX,
            fixed: options.fixed[parameters.clone()].to_vec(),
            lower: options.lower[parameters.clone()].to_vec(),
            upper: options.upper[parameters.clone()].to_vec(),
            start_std: options.start_std[parameters.clone()].to_vec(),
            excitation: Excitation::new(n),
            confirmation: Confirmation::new(n),
            condition: 1.0,
            prior: vec![0.0; n * n],
            centre: vec![0.0; n],
            at: sums.clone(),
            trial: sums,
            rule: Rule::new(options, n),
            step: ConstrainedStep::new(n),
            cholesky: Cholesky::new(n),
            eigen: Eigen::new(n),
            congruence: Congruence::new(n),
            magnitudes: Magnitudes::new(),
            room: Workspace::new(n),
            parameters,
            equations,
        };
        for i in 0..n {
            state.forget_parameter(i, options.information_floor);
        }
        let start = &options.theta_start[state.parameters.clone()];
        state.confirmation.begin(start);
        state
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        for matrix in [
            &mut self.information,
            &mut self.guess_covariance,
            &mut self.change_covariance,
            &mut self.covariance,
            &mut self.slope,
            &mut self.slope_variance,
        ] {
            v.reals(matrix);
        }
        self.line.visit(v);
        self.confirmation.visit(v);
        self.clusters.visit(v);
        self.considered.visit(v);
        v.flag(&mut self.drifting);
        v.count(&mut self.blocks);
        v.small(&mut self.since_alarm);
        v.small(&mut self.since_misfit);
        self.fixed.iter_mut().for_each(|fixed| v.flag(fixed));
        for e in &mut self.equations {
            for number in [&mut e.spread, &mut e.freedom, &mut e.variance, &mut e.scale] {
                v.real(number);
            }
            v.reals(&mut e.noise_covariance);
        }
    }

    /// Back to knowing nothing, in place; `theta` holds all parameters of the plant.
    pub fn forget(&mut self, theta: &[f64], options: &EstimatorOptions) {
        for i in 0..self.n {
            self.fixed[i] = options.fixed[self.parameters.start + i];
            self.forget_parameter(i, options.information_floor);
        }
        for e in &mut self.equations {
            (e.spread, e.freedom, e.variance, e.scale) = (0.0, 0.0, 0.0, 0.0);
        }
        self.drifting = false;
        self.slope.fill(0.0);
        self.slope_variance.fill(0.0);
        (self.blocks, self.since_alarm, self.since_misfit) = (0, u32::MAX, u32::MAX);
        self.condition = 1.0;
        self.excitation.clear();
        self.confirmation.begin(&theta[self.parameters.clone()]);
    }

    /// Takes over what may be chosen anew at run time: λ and ε of the rule.
    pub fn retune(&mut self, options: &EstimatorOptions) {
        self.rule.retune(options);
    }

    /// True for a state that this could be in: positive information, no negative variance.
    pub fn is_sound(&mut self) -> bool {
        let n = self.n;
        let covariances = [&self.guess_covariance, &self.change_covariance, &self.covariance];
        let own = self.equations.iter().map(|e| &e.noise_covariance);
        let variances_hold = covariances
            .into_iter()
            .chain(own)
            .all(|matrix| (0..n).all(|i| matrix[i * n + i] >= 0.0));
        let numbers_hold = self
            .equations
            .iter()
            .all(|e| e.spread >= 0.0 && e.freedom >= 0.0 && e.variance >= 0.0 && e.scale >= 0.0);
        let symmetric = (0..n).all(|i| (0..i).all(|j| self.information[i * n + j] == self.information[j * n + i]));
        variances_hold && numbers_hold && symmetric && self.cholesky.factor(n, &self.information)
    }

    /// Puts parameter i back to what is known at the start: information ε, no correlation.
    pub fn forget_parameter(&mut self, i: usize, floor: f64) {
        let n = self.n;
        let clear = |m: &mut [f64], diagonal: f64| {
            for k in 0..n {
                m[i * n + k] = 0.0;
                m[k * n + i] = 0.0;
            }
            m[i * n + i] = diagonal;
        };
        clear(&mut self.information, floor);
        let variance = if self.fixed[i] {
            0.0
        } else {
            self.start_std[i] * self.start_std[i]
        };
        clear(&mut self.guess_covariance, variance);
        clear(&mut self.change_covariance, 0.0);
        clear(&mut self.covariance, variance);
        for e in &mut self.equations {
            clear(&mut e.noise_covariance, 0.0);
        }
        self.clusters.forget_parameter(i);
        self.considered.forget_parameter(i);
    }

    /// Looks at the block from the present estimate: innovation and sums at θ̄. False where the rows are not finite there.
    pub fn look<R: Residuals>(&mut self, rows: &R, theta: &[f64]) -> bool {
        self.equations.iter_mut().for_each(|e| e.loss = Loss::Square);
        let finite = self.evaluate_at(rows, 0..rows.len(), theta);
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            e.innovation = (sums.cost, sums.rows);
        }
        finite
    }

    /// After [`look`](Self::look): noise level, excitation, and the prior Λ, θ̄.
    pub fn begin<R: Residuals>(&mut self, rows: &R, theta: &[f64], options: &EstimatorOptions) {
        self.set_variances(options);
        self.limit_outliers(rows, 0..rows.len(), theta, true, options);
        self.centre.copy_from_slice(&theta[self.parameters.clone()]);
        self.walk(options);
        if options.forgetting == Forgetting::Directional {
            self.excite(theta);
        }
        self.rule
            .prior(self.n, &self.information, &self.excitation, &mut self.prior);
    }

    /// Sums at θ over `range` into `trial`, with the losses as they are.
    pub fn try_at<R: Residuals>(&mut self, rows: &R, range: Range<usize>, theta: &[f64]) -> bool {
        evaluate(rows, range, theta, &self.equations, &mut self.trial)
    }

    /// Sums at θ over `range` into `at`, with the losses as they are.
    pub fn evaluate_at<R: Residuals>(&mut self, rows: &R, range: Range<usize>, theta: &[f64]) -> bool {
        evaluate(rows, range, theta, &self.equations, &mut self.at)
    }

    /// Sets the losses from the residuals at θ and renews the sums there; an open gate is Huber's function. Does nothing where every row
    /// counts in full.
    pub fn limit_outliers<R: Residuals>(
        &mut self,
        rows: &R,
        range: Range<usize>,
        theta: &[f64],
        closed: bool,
        options: &EstimatorOptions,
    ) {
        if options.outliers == Outliers::Keep {
            return;
        }
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            let regressor = &mut self.room.regressor[..e.own.len()];
            let median = self.magnitudes.median(rows, e.index, range.clone(), theta, regressor) / e.divisor;
            // the median of |f| of a normal distribution is 0.6745 σ
            e.scale = (median / 0.6745).max(floor_variance(e, sums, options).sqrt());
            e.loss = match options.outliers {
                Outliers::Gate(k) if !closed => Outliers::Huber(k).loss(e.scale),
                outliers => outliers.loss(e.scale),
            };
        }
        self.evaluate_at(rows, range, theta);
    }

    /// Γ_m⁻¹ and the covariance from the prior and the sums in `at`; learns the noise from the residuals in `at`, or those in `trial`
    /// where the sums in `at` were taken before the step.
    /// The block ends at `end_ns`.
    pub fn conclude(&mut self, theta: &[f64], stepped: bool, end_ns: u64, options: &EstimatorOptions) {
        let n = self.n;
        self.information.copy_from_slice(&self.prior);
        add_grams(n, &self.equations, &self.at, &mut self.information); // (9), first line of (10)
        self.rule.posterior(n, &mut self.information); // second line of (10)
        self.condition = repair(
            n,
            &mut self.information,
            &mut self.eigen,
            &mut self.room.a,
            &mut self.room.scale,
        );
        self.invert_free();
        let room = &mut self.room;
        // A = I − K S, which is K Λ, and without cancellation, where Γ⁻¹ is Λ + S as it stands
        if options.forgetting.is_bounded() || self.condition > LARGEST_CONDITION {
            room.total.fill(0.0);
            add_grams(n, &self.equations, &self.at, &mut room.total);
            mul(n, &room.gain, &room.total, &mut room.transition);
            for (k, v) in room.transition.iter_mut().enumerate() {
                *v = if k % (n + 1) == 0 { 1.0 - *v } else { -*v };
            }
        } else {
            mul(n, &room.gain, &self.prior, &mut room.transition);
        }
        room.total.fill(0.0);
        add_grams(n, &self.equations, &self.at, &mut room.total);
        for i in 0..n {
            room.offset[i] = theta[self.parameters.start + i] - self.centre[i];
        }
        self.considered.step(
            end_ns,
            &room.gain,
            &room.transition,
            &room.total,
            &self.equations,
            &self.at,
            &room.offset,
        );
        for covariance in [&mut self.guess_covariance, &mut self.change_covariance] {
            self.congruence.apply(n, &room.transition, covariance, &mut room.b);
            covariance.copy_from_slice(&room.b);
        }
        for ((e, sums), after) in self.equations.iter_mut().zip(&self.at).zip(&self.trial) {
            self.congruence
                .apply(n, &room.transition, &e.noise_covariance, &mut room.b);
            e.noise_covariance.copy_from_slice(&room.b);
            room.total.fill(0.0);
            add_gram(n, e, sums, &mut room.total);
            self.congruence.apply(n, &room.gain, &room.total, &mut room.b);
            e.noise_covariance.iter_mut().zip(&room.b).for_each(|(p, v)| *p += v);
            // tr(K S_e): what the parameters take of the rows
            let taken: f64 = room.gain.iter().zip(&room.total).map(|(k, s)| k * s).sum();
            e.learn(sums, if stepped { after.cost } else { sums.cost }, taken, options);
        }
        self.blocks += 1;
        self.set_variances(options);
        self.excite(theta);
        self.total_covariance();
    }

    /// Concludes a block that a line was fitted to: the covariance is the line's.
    pub fn conclude_line(&mut self, theta: &[f64], options: &EstimatorOptions) {
        let n = self.n as f64;
        self.guess_covariance.fill(0.0);
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            e.noise_covariance.fill(0.0);
            let freedom = (sums.rows - sums.outliers) as f64 - 2.0 * n;
            e.scale = (sums.cost / freedom.max(1.0)).sqrt();
            e.learn(sums, sums.cost, 2.0 * n, options);
        }
        self.total_covariance();
        self.set_variances(options);
        self.prior_from_covariance();
        self.information.copy_from_slice(&self.prior);
        self.condition = repair(
            self.n,
            &mut self.information,
            &mut self.eigen,
            &mut self.room.a,
            &mut self.room.scale,
        );
        self.blocks += 1;
        self.excite(theta);
    }

    // K: the inverse of the information over the parameters that are not fixed
    fn invert_free(&mut self) {
        let n = self.n;
        let room = &mut self.room;
        let count = gather(n, &self.information, &self.fixed, &mut room.a);
        room.gain.fill(0.0);
        // `repair` made the information positive definite, and so is every principal part of it
        if count > 0 && self.cholesky.factor(count, &room.a[..count * count]) {
            self.cholesky.inverse(&mut room.b[..count * count], &mut room.offset);
            scatter(n, &room.b, &self.fixed, &mut room.gain);
        }
    }

    /// The parameters' random walk since the last block: Γ ← Γ + Q/σ², P ← P + Q.
    fn walk(&mut self, options: &EstimatorOptions) {
        let n = self.n;
        let walks = &options.random_walk[self.parameters.clone()];
        if walks.iter().all(|&w| w == 0.0) {
            return;
        }
        let variance = self.variance().max(f64::MIN_POSITIVE);
        self.invert_free();
        let room = &mut self.room;
        for i in (0..n).filter(|&i| !self.fixed[i]) {
            let q = (walks[i] * self.centre[i]).powi(2);
            self.change_covariance[i * n + i] += q;
            room.gain[i * n + i] += q / variance;
        }
        invert(
            n,
            &mut room.gain,
            &self.fixed,
            &mut self.eigen,
            &mut room.a,
            &mut room.scale,
        );
        for i in 0..n {
            for j in 0..n {
                // a fixed parameter keeps its own information and has none in common with the others
                if !self.fixed[i] && !self.fixed[j] {
                    self.information[i * n + j] = room.gain[i * n + j];
                }
            }
        }
        self.total_covariance();
    }

    // noise variances for this block's decisions
    fn set_variances(&mut self, options: &EstimatorOptions) {
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            let learnt = if e.freedom > 0.0 { e.spread / e.freedom } else { 0.0 };
            e.variance = learnt.max(floor_variance(e, sums, options));
        }
    }

    /// Mean noise variance of the rows in `at`.
    pub fn variance(&self) -> f64 {
        let rows: f64 = self.at.iter().map(|s| s.rows as f64).sum();
        let sum: f64 = self
            .equations
            .iter()
            .zip(&self.at)
            .map(|(e, s)| e.variance * s.rows as f64)
            .sum();
        if rows > 0.0 { sum / rows } else { 0.0 }
    }

    /// Size of parameter i: what a change of 100 % means.
    pub fn size(&self, theta: &[f64], i: usize) -> f64 {
        let size = theta[self.parameters.start + i].abs().max(self.start_std[i]);
        if size > 0.0 { size } else { 1.0 }
    }

    /// True where a free parameter is known to no better than half its size, which `theta` is close to.
    pub fn is_open(&self, theta: &[f64]) -> bool {
        let wide = |i: usize| self.covariance[i * self.n + i] > (0.5 * self.size(theta, i)).powi(2);
        (0..self.n).any(|i| !self.fixed[i] && wide(i))
    }

    /// Makes the covariance that may be published: P, widened by what the model may lack, of what the data since the last change confirm.
    pub fn publish(&mut self, theta: &[f64]) {
        self.honest.copy_from_slice(&self.covariance);
        self.clusters.widen(&mut self.honest);
        if self.considered.has_drifts() {
            self.undrifted.copy_from_slice(&self.honest);
            self.considered.widen_by_errors(&mut self.undrifted);
        }
        self.considered.widen(&mut self.honest);
        for i in 0..self.n {
            self.room.scale[i] = if self.fixed[i] { 0.0 } else { self.size(theta, i) };
        }
        let own = &theta[self.parameters.clone()];
        self.confirmation.publish(own, &self.room.scale, &self.honest);
        let widened = self.confirmation.covariance.iter().zip(&self.honest);
        for (v, (after, before)) in self.undrifted.iter_mut().zip(widened) {
            *v += after - before;
        }
    }

    /// Directions that the sums in `at` inform on.
    pub fn excite(&mut self, theta: &[f64]) {
        let n = self.n;
        self.room.total.fill(0.0);
        for (e, sums) in self.equations.iter().zip(&self.at) {
            let weight = 1.0 / e.variance.max(TINY);
            let p = sums.params;
            for i in 0..p {
                for j in 0..p {
                    self.room.total[(e.offset + i) * n + e.offset + j] += weight * sums.gram[i * p + j];
                }
            }
        }
        for i in 0..n {
            self.room.scale[i] = self.size(theta, i);
            self.room.free[i] = !self.fixed[i];
        }
        self.excitation
            .analyse(&self.room.total, &self.room.scale, &self.room.free);
    }

    /// The total covariance from its parts.
    pub fn total_covariance(&mut self) {
        for (k, c) in self.covariance.iter_mut().enumerate() {
            *c = self.guess_covariance[k] + self.change_covariance[k];
        }
        for e in &self.equations {
            for (c, p) in self.covariance.iter_mut().zip(&e.noise_covariance) {
                *c += e.variance * p;
            }
        }
    }

    /// Sums over the columns of considered errors, at `theta` and over the rows that the fit used.
    pub fn suspect<R: Residuals>(&mut self, rows: &R, range: Range<usize>, theta: &[f64]) {
        for i in 0..self.n {
            self.room.scale[i] = if self.fixed[i] { 0.0 } else { self.size(theta, i) };
        }
        self.considered.set_sizes(&self.room.scale);
        self.considered.accumulate(rows, range, theta, &self.equations);
    }

    /// The same where a line was fitted; `theta` is room for all parameters.
    pub fn suspect_line<R: Residuals>(&mut self, rows: &R, theta: &mut [f64]) {
        self.considered.step_line(
            rows,
            &self.equations,
            &self.line,
            &self.prior,
            &self.fixed,
            theta,
            self.parameters.start,
        );
    }

    /// True where no residual taught the noise level: it stands at the floor that the options tell.
    pub fn noise_is_told(&self) -> bool {
        self.equations.iter().all(|e| e.floor > 0.0)
    }

    /// χ² of the residuals in `at` and its degrees of freedom, in units of the noise that was told, or else of the learnt one; and that unit.
    pub fn misfit(&self) -> (f64, f64, f64) {
        let (mut misfit, mut freedom, mut unit, mut rows) = (0.0, 0.0, 0.0, 0.0);
        let told = self.noise_is_told();
        for (e, sums) in self.equations.iter().zip(&self.at) {
            let variance = if told { e.floor * e.floor } else { e.variance.max(TINY) };
            let own = (sums.rows - sums.outliers) as f64;
            misfit += sums.cost / variance;
            freedom += own - sums.params as f64;
            unit += own * variance;
            rows += own;
        }
        (misfit, freedom.max(0.0), if rows > 0.0 { unit / rows } else { 1.0 })
    }

    /// Λ = σ² P⁻¹ from the covariance as it is, for a fit whose prior is the honest one.
    pub fn prior_from_covariance(&mut self) {
        let n = self.n;
        let variance = self.variance().max(TINY);
        self.prior.copy_from_slice(&self.covariance);
        let room = &mut self.room;
        invert(
            n,
            &mut self.prior,
            &self.fixed,
            &mut self.eigen,
            &mut room.a,
            &mut room.scale,
        );
        self.prior.iter_mut().for_each(|v| *v *= variance);
        for i in (0..n).filter(|&i| self.fixed[i]) {
            self.prior[i * n + i] = self.information[i * n + i];
        }
    }
}
