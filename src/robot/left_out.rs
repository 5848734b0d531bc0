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
//! P ← P + v_c v_cᵀ (s + (s U_c/x)²),  s = 1/(1/σ_c² + I_cc/x)    over delay and Stribeck speeds   (10)
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
//! Another speed of Stribeck friction has two columns, with a third and with three times the
//! speed, which together approximate any between; without them, Coulomb friction would be
//! significantly wrong. Its σ_c is [`BENT`] of the Coulomb friction.
//!
//! With thirty terms and about a hundred blocks, noise alone names a term in at most one of 1e5
//! runs; the rest of the margin is for friction that (1) of `friction.rs` does not describe.
//! Sources: C. R. Rao, Proc. Cambridge Phil. Soc. 44 (1948); K.-Y. Liang, S. Zeger, Biometrika 73
//! (1986).

use super::friction::FrictionTerm;
use super::identify::RobotIdentifier;
use super::learning::friction_misfit;
use super::left_out_room::{LeftOut, LeftOutCause, ROUNDING};
use super::sums::JointSums;
use super::unmodelled::{LeftOutTerm, Unmodelled};
use crate::model::MAX_JOINTS;
use std::ops::Range;

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
/// Standard deviation of the amplitude of another Stribeck speed, as a share of Coulomb friction.
const BENT: f64 = 0.02;
/// Standard deviations of a zero or a tilt above which it is named.
const NOT_CONSIDERED: f64 = 3.0;
/// Standard deviations allow only for terms whose information is well above rounding.
const TOLD_APART: f64 = 2.0 * ROUNDING;

impl RobotIdentifier {
    /// The missing term that makes estimates wrong, if the residuals show one: the model then does
    /// not describe the machine. Zeros so wrong that they contradict the URDF are reported only by
    /// [`contradiction`](Self::contradiction), because a slope does not give their size.
    pub fn left_out_cause(&self) -> Option<LeftOutCause> {
        let found = self.left_out.as_ref()?.found?;
        let is_contradiction = found.what.is_considered() && self.contradiction().is_some();
        (!is_contradiction).then_some(found)
    }

    /// Searches for missing terms after a block.
    pub(super) fn look_for_left_out(&mut self) {
        if self.recent_blocks == 0 {
            return;
        }
        let Some(mut left_out) = self.left_out.take() else {
            return;
        };
        left_out.believed = 0;
        if left_out.solve(&self.system, &self.covariance, &self.theta) {
            self.judge_left_out(&mut left_out);
        }
        self.left_out = Some(left_out);
    }

    fn judge_left_out(&self, left_out: &mut LeftOut) {
        self.effective_with(&left_out.theta, &mut left_out.effective);
        let mut excess = [f64::INFINITY; MAX_JOINTS];
        for (joint, excess) in excess.iter_mut().enumerate().take(self.torque_std.len()) {
            if let Some(level) = self.level(joint, left_out) {
                *excess = level * self.weight(joint); // (4), (5)
            }
        }
        let limits = match left_out.found.take() {
            None => (NAMED.0, HARMFUL.0),
            Some(_) => (NAMED.1, HARMFUL.1),
        };
        let (n, k, mut place) = (self.theta.len(), left_out.terms.len(), 0);
        for c in 0..k {
            let LeftOutTerm { what, index, .. } = left_out.terms[c];
            // a term in the rows of several joints is judged by the worst of them
            let excess = match what.only_joint() {
                Some(joint) => excess[joint],
                None => excess.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max),
            };
            let (score, information) = (left_out.score[c], left_out.information[c * k + c]);
            let score = score.signum() * (score.abs() - ALLOWED * left_out.doubtful[c]).max(0.0); // (9)
            let is_told_apart = information > TOLD_APART * self.system.matrix[index * n + index];
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
                left_out.consider_with_prior(place, c, self.std_of(what, left_out), evidence);
                place += 1;
            }
            if is_believed {
                if let Some(cause) = self.cause(left_out, c, (amplitude, square, deviations), limits) {
                    left_out.found = Some(cause);
                }
                left_out.believe(c, amplitude);
            }
        }
    }

    /// Term `c` as the cause of wrong estimates, if it is one, and likelier than the one found so
    /// far. `limits` are those of the standard deviations of the term and of a parameter's error.
    fn cause(
        &self,
        left_out: &mut LeftOut,
        c: usize,
        (amplitude, square, deviations): (f64, f64, f64),
        limits: (f64, f64),
    ) -> Option<LeftOutCause> {
        let (n, what) = (self.theta.len(), left_out.terms[c].what);
        let least = left_out.found.map_or(limits.0, |found| found.deviations);
        let is_large = !what.is_considered() || amplitude.abs() > NOT_CONSIDERED * left_out.zero_rad; // (7)
        let harm = self.harm(&left_out.shifts[c * n..(c + 1) * n], amplitude);
        let (is_harmful, is_useless) = (harm > limits.1, !self.knows_any());
        if !(is_large && deviations > least && (is_harmful || is_useless)) {
            return None;
        }
        let deviations = deviations.min((square / self.scatter(c, left_out)).sqrt()); // (8)
        if !(deviations > least) {
            return None;
        }
        left_out.theta.copy_from_slice(&self.theta);
        left_out.step(c, amplitude);
        self.effective_with(&left_out.theta, &mut left_out.alone);
        let share = self.share(what.only_joint(), &left_out.alone);
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

    /// σ_c of (10).
    fn std_of(&self, what: Unmodelled, left_out: &LeftOut) -> f64 {
        let Unmodelled::StribeckSpeed { joint, .. } = what else {
            return left_out.delay_s;
        };
        let mut terms = self.model.friction()[joint]
            .terms
            .iter()
            .zip(self.model.friction_of(joint));
        let coulomb = terms.find(|(term, _)| **term == FrictionTerm::Coulomb);
        coulomb.map_or(0.0, |(_, i)| BENT * self.theta[i].abs())
    }

    /// The effective parameters of θ with terms, and the slopes of the offsets with these.
    fn effective_with(&self, theta: &[f64], out: &mut [f64]) {
        self.effective_if(self.is_loaded, theta, out);
        if !self.condensed {
            let weight = |joint: usize| self.weight(joint);
            self.offset_drift.refit(&self.all, weight, &self.fixed, out);
        }
    }

    /// x of (8).
    fn scatter(&self, c: usize, left_out: &mut LeftOut) -> f64 {
        let n = self.theta.len();
        let shift = &left_out.shifts[c * n..(c + 1) * n];
        let direction = &mut left_out.direction;
        direction.iter_mut().zip(shift).for_each(|(d, v)| *d = -v);
        direction[n..].fill(0.0);
        direction[left_out.terms[c].index] = 1.0;
        if !self.condensed {
            let weight = |joint: usize| self.weight(joint);
            self.offset_drift.follow(&self.all, weight, &self.fixed, direction);
        }
        let (mut squares, mut information) = (0.0, 0.0);
        for block in self.recent.iter().take(self.recent_blocks) {
            let mut score = 0.0;
            for (joint, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let (along, square) = sums.along(direction, &left_out.effective);
                score += self.weight(joint) * along; // (8)
                information += self.weight(joint) * square; // (8)
            }
            squares += score * score;
        }
        squares / information
    }

    /// True if any parameter is known well enough to be used.
    fn knows_any(&self) -> bool {
        let n = self.theta.len();
        let is_known = |i: usize| 3.0 * self.covariance[i * n + i].max(0.0).sqrt() < USABLE * self.theta[i].abs();
        (0..self.parameters.len()).any(|i| !self.fixed[i] && is_known(i))
    }

    /// Error of the most affected usable parameter, in its standard deviations.
    pub(super) fn harm(&self, direction: &[f64], amplitude: f64) -> f64 {
        let n = self.theta.len();
        let payload = self.payload.as_ref().filter(|_| self.is_loaded);
        let mut harm = 0.0_f64;
        for i in (0..self.parameters.len()).filter(|i| !self.fixed[*i]) {
            let (std, size) = (self.covariance[i * n + i].max(0.0).sqrt(), self.theta[i].abs());
            let error = (direction[i] * amplitude).abs();
            // the payload values for a controller depend on all of its parameters
            let is_payload = payload.is_some_and(|payload| payload.indices().contains(&i));
            if (is_payload || 3.0 * std < USABLE * size) && error > LEAST_ERROR * size {
                harm = harm.max(error / std);
            }
        }
        harm
    }

    /// The last blocks of a joint, those without rows left out.
    fn recent_of(&self, joint: usize) -> impl Iterator<Item = &JointSums> {
        let recent = self.recent.iter().take(self.recent_blocks);
        recent.map(move |block| &block[joint]).filter(|sums| sums.rows > 0)
    }

    /// Share of the squared residuals that these effective parameters explain: of one joint, or of
    /// all joints, weighted.
    fn share(&self, joint: Option<usize>, effective: &[f64]) -> f64 {
        let of_joint = |joint: usize, theta: &[f64]| -> f64 {
            let square: f64 = self.recent_of(joint).map(|sums| sums.residual_square(theta)).sum();
            self.weight(joint) * square
        };
        let joints = joint.map_or(0..self.torque_std.len(), |joint| joint..joint + 1);
        let square = |theta: &[f64]| -> f64 { joints.clone().map(|joint| of_joint(joint, theta)).sum() };
        (1.0 - square(effective) / square(&self.effective)).clamp(0.0, 1.0)
    }

    /// (4) of a joint; `None` if it has no rows.
    fn level(&self, joint: usize, left_out: &LeftOut) -> Option<f64> {
        let terms = self.model.friction_of(joint).len() + left_out.of_joint(joint);
        let end = self.block[joint].columns_below(self.theta.len()).len() - left_out.shared();
        self.level_at(joint, end - terms..end, &left_out.effective)
    }

    /// (4) with these columns of friction, at these effective parameters.
    pub(super) fn level_at(&self, joint: usize, friction: Range<usize>, effective: &[f64]) -> Option<f64> {
        let terms = friction.len();
        let (mut square, mut rows) = (0.0, 0);
        let (mut clusters, mut count) = (0.0, 0.0);
        for sums in self.recent_of(joint) {
            square += sums.residual_square(effective);
            rows += sums.rows;
            if let Some((misfit, directions)) = friction_misfit(sums, friction.clone(), effective) {
                clusters += misfit / directions;
                count += 1.0;
            }
        }
        let variance = square / rows.saturating_sub(terms).max(1) as f64;
        let (assumed, weight) = (self.assumed.0[joint], self.assumed.1);
        let level = (clusters + assumed * weight * variance) / (count + weight); // (4)
        (rows > 0).then_some(level.max(variance))
    }
}
