//! Finds terms missing in the model that would explain the misfit, and the error of the estimates
//! without them.
//!
//! Rows have a column for each term of [`friction`](super::friction) that a joint's model leaves
//! out, for the zeros of the encoders, the base's tilt (both as slopes of the links' weight by the
//! URDF) and a delay of the torques. Each is fixed at 0, so Λ and b contain its score and
//! information, and P = Λ_θθ⁻¹ is the covariance of the estimate. For one such term c, and for all
//! of them together:
//!
//! ```text
//! U_c = b_c − Λ_cθ θ̂,    v_c = P Λ_θc,    I_cd = Λ_cd − Λ_cθ v_d                                (1)
//! ĉ = U_c/I_cc,    θ̂ with c = θ̂ − v_c ĉ:    the estimate is off by v_c ĉ                        (2)
//! ĉ_all = I⁻¹ U,    θ_all = θ̂ − Σ v_c ĉ_c                                                       (3)
//! s_j² = (f_j σ_j)² by (2) and (3) of identify.rs over the last blocks, at θ_all                (4)
//! z_c² = U_c²/(I_cc x),    x = s_j²/(f_j σ_j)²                                                  (5)
//! P ← P + Σ (v_c ĉ)(v_c ĉ)ᵀ    over the terms with z > BELIEVED                                 (6)
//! P ← P + Σ (v_c σ_c)(v_c σ_c)ᵀ    over zeros and tilts                                         (7)
//! z_c² ≤ U_c²/(I_cc x),    x = Σ u²/Σ dᵀΛ_block d over the last blocks,
//!     u = dᵀ(b − A θ_all) of a block,  d = e_c − v_c                                            (8)
//! |U_c| less 1.5 |B_c − v_cᵀ B|,    B the bias by errors of the positions                        (9)
//! P ← P + v_c v_cᵀ (s + (s U_c/x)²),  s = 1/(1/σ_c² + I_cc/x)    over terms with a prior       (10)
//! σ_c = β (|f_v| √(Λ_vv/Λ_cc) + |f_c| √(Λ_ff/Λ_cc))    of drag, asymmetry and spring           (11)
//! ```
//!
//! (1) is the efficient score: the part of c that the estimated parameters can imitate is removed.
//! The weights in Λ contain f_j and σ_j, which a missing term itself has raised; x reduces them to
//! what remains with every term included. There f_j is computed with blocks as clusters, so a
//! misfit that keeps its sign through a block raises no alarm. A term is named if z exceeds
//! [`NAMED`] and a usable parameter is off by more than [`HARMFUL`] of its standard deviations and
//! by the share [`LEAST_ERROR`] of itself, or if nothing may be used and the term explains more
//! than [`TELLING`] of the misfit: then the model does not describe the machine. A spring or a
//! delay must explain that much in any case. Drag, friction that differs by direction and another
//! speed of Stribeck friction are named only if nothing may be used: every real gear has a little
//! of them, and (6) allows for it. (8) is the same sandwich along the term itself: with
//! encoders of 13 bits reversals are detected early or late, and the resulting apparent delay
//! scatters from block to block. (9) subtracts the bias of U_c that
//! [`acceleration_noise`](super::acceleration_noise) predicts.
//!
//! Standard deviations include (6) even before that, so that a term that does less harm, or is less
//! certain, does not make an estimate significantly wrong.
//!
//! A zero or a tilt rotates the gravity moments of the links, and a small one leaves almost no
//! residual (on a six-axis arm, z < 1 with 10 mrad at joint 3, which makes hz3 2 % wrong): (7)
//! always allows for it, and it is named only if it exceeds [`NOT_CONSIDERED`] of the standard
//! deviations in (7). This is Schmidt's consider analysis (S. F. Schmidt, Advances in Control
//! Systems 3, 1966).
//!
//! A delay of the torques, or of measured velocities, is almost viscous friction if a motion
//! repeats itself: then z stays below 4 although viscous friction is significantly wrong. (10) is
//! (7) with what the residuals say of the delay.
//!
//! Drag bends the line of friction over speed. Fitted by a straight line, drag of a tenth of the
//! viscous friction hardly shows in the residuals of one joint, but viscous friction is off by that
//! tenth, 5 to 12 standard deviations. Asymmetric friction does the same, and a spring to the
//! moments of the links. So (10) includes them. By (11) their torque over the motion is β of the
//! joint's viscous and Coulomb friction, Λ_ff being the information on Coulomb friction. A larger β
//! changes little, because the residuals limit these terms.
//!
//! Another speed of Stribeck friction has two columns, with a third and with three times the
//! speed, which together approximate any between; without them, Coulomb friction would be
//! significantly wrong. Its σ_c is β of the Coulomb friction.
//!
//! With thirty terms and about a hundred blocks, noise alone names a term in at most one of 1e5
//! runs; the rest of the margin is for friction that (1) of `friction.rs` does not describe.
//! Sources: C. R. Rao, Proc. Cambridge Phil. Soc. 44 (1948); K.-Y. Liang, S. Zeger, Biometrika 73
//! (1986).

use super::estimate::Estimate;
use super::friction::FrictionTerm;
use super::learning::Learner;
use super::left_out_room::{LeftOut, LeftOutCause, ROUNDING};
use super::unmodelled::{LeftOutTerm, Unmodelled};
use crate::model::MAX_JOINTS;

/// z above which a term is named, and below which it no longer is.
const NAMED: (f64, f64) = (6.0, 4.0);
/// Standard deviations by which a usable parameter must be off for that, and below which the naming
/// ends.
const HARMFUL: (f64, f64) = (3.0, 2.0);
/// z above which standard deviations allow for a term.
const BELIEVED: f64 = 4.0;
/// The error of a parameter matters if three standard deviations are below this share of it,
const USABLE: f64 = 0.05;
/// and if the error is larger than this share of it.
const LEAST_ERROR: f64 = 0.0025;
/// Share of the misfit above which a term is named if nothing may be used anyway; a spring or a
/// delay always needs it.
const TELLING: f64 = 0.2;
/// Factor on the bias by errors of the positions that is subtracted from a score.
const ALLOWED: f64 = 1.5;
/// Standard deviations of a zero or a tilt above which it is named.
const NOT_CONSIDERED: f64 = 3.0;
/// Standard deviations allow only for terms whose information is well above rounding.
const TOLD_APART: f64 = 2.0 * ROUNDING;

impl LeftOut {
    /// Searches for missing terms after a block.
    pub fn look_at_block(&mut self, learner: &Learner) {
        if learner.recent.count() == 0 {
            return;
        }
        self.forget_shifts();
        let estimate = &learner.estimate;
        if self.solve(&learner.system, estimate.covariance(), estimate.theta()) {
            self.judge(learner);
        }
    }

    fn judge(&mut self, learner: &Learner) {
        learner.effective_with(&self.theta, &mut self.effective);
        let mut excess = [f64::INFINITY; MAX_JOINTS];
        for (joint, excess) in excess.iter_mut().enumerate().take(learner.arm.joints()) {
            if let Some(level) = self.level(joint, learner) {
                *excess = level * learner.levels.weight(joint); // (4), (5)
            }
        }
        let limits = match self.found.take() {
            None => (NAMED.0, HARMFUL.0),
            Some(_) => (NAMED.1, HARMFUL.1),
        };
        let (n, k, mut place) = (learner.estimate.n(), self.terms.len(), 0);
        for c in 0..k {
            let LeftOutTerm { what, index, .. } = self.terms[c];
            // a term in the rows of several joints is judged by the worst of them
            let excess = match what.only_joint() {
                Some(joint) => excess[joint],
                None => excess.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max),
            };
            let (score, information) = (self.score[c], self.information[c * k + c]);
            let score = score.signum() * (score.abs() - ALLOWED * self.doubtful[c]).max(0.0); // (9)
            let is_told_apart = information > TOLD_APART * learner.system.matrix[index * n + index];
            let amplitude = score / information; // (2)
            let square = score * amplitude;
            let deviations = (square / excess).sqrt(); // (5)
            let is_believed = is_told_apart && deviations > BELIEVED;
            if what.has_prior() {
                let evidence = if !(is_told_apart && excess > 0.0) {
                    (0.0, 0.0)
                } else if is_believed {
                    (information / excess, 0.0) // (6) has the amplitude itself
                } else {
                    (information / excess, score / excess)
                };
                self.consider_with_prior(place, c, self.std_of(what, index, learner), evidence);
                place += 1;
            }
            if is_believed {
                if let Some(cause) = self.cause(learner, c, (amplitude, square, deviations), limits) {
                    self.found = Some(cause);
                }
                self.believe(c, amplitude);
            }
        }
    }

    /// Term `c` as the cause of wrong estimates, if it is one, and likelier than the one found so
    /// far. `limits` are those of the standard deviations of the term and of a parameter's error.
    fn cause(
        &mut self,
        learner: &Learner,
        c: usize,
        (amplitude, square, deviations): (f64, f64, f64),
        limits: (f64, f64),
    ) -> Option<LeftOutCause> {
        let (n, what) = (learner.estimate.n(), self.terms[c].what);
        let least = self.found.map_or(limits.0, |found| found.deviations);
        let is_large = !what.is_considered() || amplitude.abs() > NOT_CONSIDERED * self.priors.zero_rad; // (7)
        let harm = harm(learner, &self.shifts[c * n..(c + 1) * n], amplitude);
        let (is_harmful, is_useless) = (harm > limits.1, !knows_any(&learner.estimate));
        if !(is_large && deviations > least && (is_harmful || is_useless)) {
            return None;
        }
        let deviations = deviations.min((square / self.scatter(c, learner)).sqrt()); // (8)
        if !(deviations > least) {
            return None;
        }
        self.theta.copy_from_slice(learner.estimate.theta());
        self.step(c, amplitude);
        learner.effective_with(&self.theta, &mut self.alone);
        let share = share(learner, what.only_joint(), &self.alone);
        // many effects vary with the position, or look like a delay at a reversal
        let is_specific = !what.bends_friction() && (!what.is_one_of_many() || share > TELLING);
        (is_harmful && is_specific || is_useless && share > TELLING).then_some(LeftOutCause {
            what,
            amplitude,
            deviations,
            harm,
            share,
        })
    }

    /// σ_c of (10) of the term with this index.
    fn std_of(&self, what: Unmodelled, index: usize, learner: &Learner) -> f64 {
        let (model, priors) = (&learner.arm.model, &self.priors);
        let information = |i: usize| learner.system.matrix[i * learner.estimate.n() + i];
        let size = |i: usize| learner.estimate.theta()[i].abs();
        match what {
            Unmodelled::StribeckSpeed { joint, .. } => {
                let coulomb = model.friction_term(joint, FrictionTerm::Coulomb);
                priors.friction_shape * coulomb.map_or(0.0, size)
            }
            // without motion the term has no information, and no effect
            Unmodelled::Friction { .. } if !(information(index) > 0.0) => 0.0,
            Unmodelled::Friction { joint, term } => {
                let share = match term {
                    FrictionTerm::Spring => priors.spring_share,
                    _ => priors.friction_shape,
                };
                let over = |i: usize| size(i) * (information(i) / information(index)).sqrt();
                let of = |term| model.friction_term(joint, term).map_or(0.0, over);
                share * (of(FrictionTerm::Viscous) + of(FrictionTerm::Coulomb)) // (11)
            }
            Unmodelled::Zero { .. } | Unmodelled::Tilt => priors.zero_rad,
            Unmodelled::Delay => priors.delay_s,
        }
    }

    /// x of (8).
    fn scatter(&mut self, c: usize, learner: &Learner) -> f64 {
        let n = learner.estimate.n();
        let shift = &self.shifts[c * n..(c + 1) * n];
        let direction = &mut self.direction;
        direction.iter_mut().zip(shift).for_each(|(d, v)| *d = -v);
        direction[n..].fill(0.0);
        direction[self.terms[c].index] = 1.0;
        let levels = &learner.levels;
        learner.past.follow_slopes(levels, learner.estimate.fixed(), direction);
        let (mut squares, mut information) = (0.0, 0.0);
        for block in learner.recent.iter() {
            let mut score = 0.0;
            for (joint, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let (along, square) = sums.along(direction, &self.effective);
                score += levels.weight(joint) * along; // (8)
                information += levels.weight(joint) * square; // (8)
            }
            squares += score * score;
        }
        squares / information
    }

    /// (4) of a joint; `None` if it has no rows.
    fn level(&self, joint: usize, learner: &Learner) -> Option<f64> {
        let terms = learner.arm.model.friction_of(joint).len() + self.of_joint(joint);
        let columns = learner.open.sums()[joint].columns_below(learner.estimate.n());
        let end = columns.len() - self.shared();
        learner
            .levels
            .mean_square((joint, end - terms..end), &learner.recent, &self.effective)
    }
}

/// True if any parameter is known well enough to be used.
fn knows_any(estimate: &Estimate) -> bool {
    let is_known = |i: usize| 3.0 * estimate.std(i) < USABLE * estimate.theta()[i].abs();
    estimate.free().any(is_known)
}

/// Error of the most affected usable parameter, in its standard deviations.
pub(super) fn harm(learner: &Learner, direction: &[f64], amplitude: f64) -> f64 {
    let (estimate, flange) = (&learner.estimate, &learner.flange);
    let mut harm = 0.0_f64;
    for i in estimate.free() {
        let (std, size) = (estimate.std(i), estimate.theta()[i].abs());
        let error = (direction[i] * amplitude).abs();
        // the payload values for a controller depend on all of its parameters
        let is_payload = flange.is_loaded() && flange.owns(i);
        if (is_payload || 3.0 * std < USABLE * size) && error > LEAST_ERROR * size {
            harm = harm.max(error / std);
        }
    }
    harm
}

/// Share of the squared residuals that these effective parameters explain: of one joint, or of all
/// joints, weighted.
fn share(learner: &Learner, joint: Option<usize>, effective: &[f64]) -> f64 {
    let of_joint = |joint: usize, theta: &[f64]| -> f64 {
        let rows = learner.recent.of_joint(joint);
        let square: f64 = rows.map(|sums| sums.residual_square(theta)).sum();
        learner.levels.weight(joint) * square
    };
    let joints = joint.map_or(0..learner.arm.joints(), |joint| joint..joint + 1);
    let square = |theta: &[f64]| -> f64 { joints.clone().map(|joint| of_joint(joint, theta)).sum() };
    (1.0 - square(effective) / square(learner.estimate.effective())).clamp(0.0, 1.0)
}
