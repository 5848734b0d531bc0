//! One independent least-squares problem: the parameters of a connected group of equations, with
//! their information and covariance.
//!
//! ```text
//! Λ       from Γ_{m−1}⁻¹ by the forgetting rule                       begin
//! θ̂_m     = argmin Σ w f_n(θ)² + (θ − θ̄)ᵀ Λ (θ − θ̄), θ̄ = θ̂_{m−1}    fit
//! Γ_m⁻¹   = Λ + S, S = Σ w φφᵀ at θ̂_m                                 conclude, (9)
//! ```
//!
//! The covariance of θ̂ is propagated independently of the forgetting rule (`error_covariance.rs`);
//! each equation learns its noise (`equation.rs`).

use super::block_prior::BlockPrior;
use super::clusters::Clusters;
use super::confirmation::Confirmation;
use super::considered::{Considered, LineUpdate, Update, room_for};
use super::constrained::ConstrainedStep;
use super::drift::Drift;
use super::equation::{EquationState, TINY};
use super::equations::Equations;
use super::error_covariance::ErrorCovariance;
use super::forgetting::Excitation;
use super::index_set::IndexSet;
use super::information::Information;
use super::inquiry::Inquiry;
use super::limits::Limits;
use super::linalg::mul;
use super::options::{EstimatorOptions, Forgetting};
use super::pass::Summable;
use super::persist::Visit;
use super::score_sums::GroupEvidence;
use super::sizes::Sizes;
use super::tally::Tally;
use super::widened::Widened;
use super::workspace::Workspace;
use super::{Group, Structure};
use std::ops::Range;

/// The state of a group, with its workspace.
#[derive(Debug, Clone)]
pub struct GroupState {
    pub parameters: Range<usize>,
    pub n: usize,
    /// The equations, with the sums of the block.
    pub equations: Equations,
    /// Γ⁻¹, and the rule that forgets.
    pub information: Information,
    /// Covariance of the error of θ̂.
    pub errors: ErrorCovariance,
    /// The same and W, widened.
    pub widened: Widened,
    /// Probability of the last block if the plant is unchanged.
    pub probability: f64,
    pub clusters: Clusters,
    pub considered: Considered,
    /// A change with all rows since.
    pub inquiry: Inquiry,
    pub drift: Drift,
    pub tally: Tally,
    pub limits: Limits,
    /// What a change of 100 % of each parameter means.
    pub sizes: Sizes,
    /// Directions that the last block informed on.
    pub excitation: Excitation,
    /// Evidence since the last change, and the covariance that may be published.
    pub confirmation: Confirmation,
    /// Λ and θ̄ of the present fit.
    pub prior: BlockPrior,
    pub step: ConstrainedStep,
    pub room: Workspace,
}

impl GroupState {
    /// The start state of validated options.
    pub fn new(group: &Group, structure: &Structure, options: &EstimatorOptions) -> Self {
        let parameters = group.parameters.clone();
        let n = parameters.len();
        let priors = &options.parameters[parameters.clone()];
        let equations = group
            .equations
            .iter()
            .map(|&index| {
                let own = structure.equations[index].clone();
                EquationState::new(index, own, &parameters, options)
            })
            .collect();
        let mut state = Self {
            n,
            information: Information::new(options, n),
            errors: ErrorCovariance::new(n),
            widened: Widened::new(n),
            probability: 1.0,
            clusters: Clusters::new(n),
            considered: Considered::new(
                &parameters,
                structure.params,
                structure.equations.len(),
                options.drift_per_s > 0.0,
            ),
            inquiry: Inquiry::new(n, room_for(structure.equations.len())),
            drift: Drift::new(n, structure.params, group.equations.len()),
            tally: Tally::new(),
            limits: Limits::new(priors),
            sizes: Sizes::new(priors),
            excitation: Excitation::new(n),
            confirmation: Confirmation::new(n),
            prior: BlockPrior::new(n),
            step: ConstrainedStep::new(n),
            room: Workspace::new(n),
            parameters,
            equations: Equations::new(n, equations),
        };
        for i in 0..n {
            state.forget_parameter(i, options.information_floor);
        }
        let start: Vec<f64> = priors.iter().map(|p| p.start).collect();
        state.confirmation.begin(&start);
        state
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.information.visit(v);
        self.errors.visit(v);
        self.drift.visit(v);
        self.confirmation.visit(v);
        self.clusters.visit(v);
        self.considered.visit(v);
        self.inquiry.visit(v);
        self.sizes.visit(v);
        v.flag(&mut self.drift.active);
        self.tally.visit(v);
        self.limits.visit(v);
        self.equations.visit(v);
    }

    /// Resets in place to a state without data; `theta` holds all parameters of the plant.
    pub fn forget(&mut self, theta: &[f64], options: &EstimatorOptions) {
        for i in 0..self.n {
            let prior = &options.parameters[self.parameters.start + i];
            self.limits.set_fixed(i, prior.fixed);
            self.forget_parameter(i, options.information_floor);
        }
        self.equations.forget();
        self.drift.forget();
        self.considered.forget();
        self.tally = Tally::new();
        self.information.forget_condition();
        self.excitation.clear();
        self.confirmation.begin(&theta[self.parameters.clone()]);
    }

    /// Adopts the options that may change at run time: λ and ε of the rule.
    pub fn retune(&mut self, options: &EstimatorOptions) {
        self.information.retune(options);
    }

    /// True for a valid state: positive information, no negative variance.
    pub fn is_sound(&mut self) -> bool {
        self.errors.is_sound() && self.equations.is_sound() && self.information.is_sound(&mut self.room)
    }

    /// Resets parameter i to its state at the start: information ε, no correlation.
    pub fn forget_parameter(&mut self, i: usize, floor: f64) {
        self.information.forget_parameter(i, floor);
        let variance = if self.limits.is_free(i) {
            self.sizes.stated(i).powi(2)
        } else {
            0.0
        };
        self.errors.forget_parameter(i, variance);
        self.equations.forget_parameter(i);
        self.clusters.forget_parameter(i);
        self.considered.forget_parameter(i);
    }

    /// Noise level, excitation, and the prior Λ, θ̄; after [`Equations::take_innovation`].
    pub fn begin(&mut self, rows: &dyn Summable, theta: &[f64], options: &EstimatorOptions) {
        self.tally.begin_block();
        let fixed = self.limits.fixed();
        self.considered.begin(rows, self.parameters.clone(), fixed);
        self.equations.set_variances(options);
        self.equations.limit_outliers(rows, 0..rows.len(), theta, true, options);
        self.prior.centre_at(&theta[self.parameters.clone()]);
        self.adopt_products(rows, theta, options);
        self.walk(options);
        if options.forgetting == Forgetting::Directional {
            self.excite(theta);
        }
        self.prior_from_information();
    }

    /// The prior of the block, as forgetting makes it.
    pub fn prior_from_information(&mut self) {
        self.prior.forget(&mut self.information, &self.excitation);
    }

    /// Γ_m⁻¹ and the covariance from the prior and the sums; learns the noise from the residuals
    /// at θ, or those at the candidate if θ has `stepped` there since. The block ends at `end_ns`.
    pub fn conclude(&mut self, theta: &[f64], stepped: bool, end_ns: u64, options: &EstimatorOptions) {
        let n = self.n;
        self.turn(theta);
        let room = &mut self.room;
        self.information.update(self.prior.information(), &self.equations, room);
        room.invert_free(self.information.matrix(), self.limits.fixed());
        room.total.fill(0.0);
        self.equations.add_grams(&mut room.total);
        // A = I − K S; if Γ⁻¹ is exactly Λ + S, this is K Λ, which avoids cancellation
        if options.forgetting.is_bounded() || self.information.was_repaired() {
            mul(n, &room.gain, &room.total, &mut room.transition);
            for (k, v) in room.transition.iter_mut().enumerate() {
                *v = if k % (n + 1) == 0 { 1.0 - *v } else { -*v };
            }
        } else {
            mul(n, &room.gain, self.prior.information(), &mut room.transition);
        }
        let own = &theta[self.parameters.clone()];
        self.prior.moved(own, &mut room.offset);
        let update = Update {
            gain: &room.gain,
            transition: &room.transition,
            total: &room.total,
            equations: self.equations.states(),
            sums: self.equations.at(),
            moved: &room.offset,
        };
        self.considered.step(end_ns, &update);
        self.errors.carry(room);
        self.equations.learn(stepped, &mut self.errors, room, options);
        self.tally.end_block();
        self.equations.set_variances(options);
        self.excite(theta);
        self.total_covariance();
    }

    /// Concludes a block with a fitted line: the covariance is the line's.
    pub fn conclude_line(&mut self, theta: &[f64], options: &EstimatorOptions) {
        self.errors.end_guess();
        self.equations.learn_line(options);
        self.total_covariance();
        self.equations.set_variances(options);
        self.prior_from_covariance();
        self.information.replace(self.prior.information(), &mut self.room);
        self.tally.end_block();
        self.excite(theta);
    }

    /// The parameters' random walk since the last block: Γ ← Γ + Q/σ², P ← P + Q.
    fn walk(&mut self, options: &EstimatorOptions) {
        let n = self.n;
        let priors = &options.parameters[self.parameters.clone()];
        if priors.iter().all(|p| p.random_walk == 0.0) {
            return;
        }
        let variance = self.equations.variance().max(f64::MIN_POSITIVE);
        let room = &mut self.room;
        room.invert_free(self.information.matrix(), self.limits.fixed());
        for i in self.limits.free() {
            let q = (priors[i].random_walk * self.prior.centre()[i]).powi(2);
            self.errors.add_change(i, q);
            room.gain[i * n + i] += q / variance;
        }
        room.invert_gain(self.limits.fixed());
        self.information.replace_free(&room.gain, &self.limits);
        self.total_covariance();
    }

    /// Size of parameter i: a change of 100 %.
    pub fn size(&self, theta: &[f64], i: usize) -> f64 {
        self.sizes.of(i, theta[self.parameters.start + i])
    }

    /// Writes the size of each free parameter to `scale`, and 0 for each fixed one.
    fn size_free(&mut self, theta: &[f64]) {
        self.room.scale.fill(0.0);
        for i in self.limits.free() {
            self.room.scale[i] = self.size(theta, i);
        }
    }

    /// True if a free parameter has a standard deviation above half its size, which is evaluated at
    /// `theta`.
    pub fn is_open(&self, theta: &[f64]) -> bool {
        let wide = |i: usize| self.errors.variance(i) > (0.5 * self.size(theta, i)).powi(2);
        self.limits.free().any(wide)
    }

    /// Computes the covariance that may be published: P widened by considered errors, and by what
    /// the data since the last change have not confirmed.
    pub fn publish(&mut self, theta: &[f64]) {
        self.widened
            .take(self.errors.total(), &self.clusters, &mut self.considered);
        self.size_free(theta);
        let own = &theta[self.parameters.clone()];
        let (recursion, widened) = (self.errors.total(), self.widened.total());
        self.confirmation.publish(own, &self.room.scale, recursion, widened);
        self.widened.add_unconfirmed(&self.confirmation.covariance);
    }

    /// Directions that the block informs on.
    pub fn excite(&mut self, theta: &[f64]) {
        let n = self.n;
        self.sizes.learn(
            self.equations.states(),
            self.equations.at(),
            &theta[self.parameters.clone()],
        );
        self.room.total.fill(0.0);
        self.equations.add_information(&mut self.room.total);
        for i in 0..n {
            self.room.scale[i] = self.size(theta, i);
            self.room.free[i] = self.limits.is_free(i);
        }
        self.excitation
            .analyse(&self.room.total, &self.room.scale, &self.room.free);
    }

    /// The total covariance from its parts.
    pub fn total_covariance(&mut self) {
        self.errors.add_up(self.equations.states());
    }

    /// Sums over the columns of considered errors, at `theta` and over the rows of the fit.
    pub fn suspect(&mut self, rows: &dyn Summable, range: Range<usize>, theta: &[f64]) {
        self.size_free(theta);
        self.considered.set_sizes(&self.room.scale);
        let changed = self.inquiry.is_open();
        self.considered
            .accumulate(rows, range, theta, self.equations.states(), changed);
    }

    /// The same for a fitted line; `theta` is workspace for all parameters.
    pub fn suspect_line(&mut self, rows: &dyn Summable, theta: &mut [f64]) {
        let update = LineUpdate {
            equations: self.equations.states(),
            line: &self.drift.line,
            start_information: self.prior.information(),
            fixed: self.limits.fixed(),
            first: self.parameters.start,
        };
        self.considered.step_line(rows, &update, theta);
    }

    /// Records whether the block fits, which it does if none of the group's equations is in
    /// `misfit`; returns that.
    pub fn judge(&mut self, misfit: IndexSet) -> bool {
        let fits = self.equations.states().iter().all(|e| !misfit.contains(e.index));
        self.tally.judge(fits);
        fits
    }

    /// Adds the block to the clusters; see [`Clusters::end`].
    pub fn end_clusters(&mut self, changed: bool) {
        let (noise_is_configured, excitation) = (self.equations.noise_is_configured(), &self.excitation);
        self.clusters.end(changed, noise_is_configured, |i| excitation.share(i));
    }

    /// The evidence of the block for terms that the model may lack.
    pub fn evidence(&self) -> GroupEvidence<'_> {
        let (misfit, freedom, variance) = self.equations.chi_square();
        GroupEvidence {
            scores: self.considered.evidence(),
            variance,
            misfit,
            freedom,
            noise_is_configured: self.equations.noise_is_configured(),
        }
    }

    /// Λ = σ² P⁻¹ from the present covariance, for a fit with the true prior.
    pub fn prior_from_covariance(&mut self) {
        let variance = self.equations.variance().max(TINY);
        let (fixed, room) = (self.limits.fixed(), &mut self.room);
        self.prior
            .trust(self.errors.total(), variance, fixed, self.information.matrix(), room);
    }
}
