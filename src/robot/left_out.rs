//! Which term of friction that the model leaves out would explain a joint's misfit, and how far off
//! the estimates are without it.
//!
//! Rows have a column for each term of [`friction`](super::friction) that a joint's model leaves
//! out. It is held at 0, so that Λ and b hold its score and information, and P = Λ_θθ⁻¹ is what the
//! estimate has anyway. For one such term c, and for all of them together:
//!
//! ```text
//! U_c = b_c − Λ_cθ θ̂,    v_c = P Λ_θc,    I_cd = Λ_cd − Λ_cθ v_d                                (1)
//! ĉ = U_c/I_cc,    θ̂ with c = θ̂ − v_c ĉ:    the estimate is off by v_c ĉ                        (2)
//! ĉ_all = I⁻¹ U,    θ_all = θ̂ − Σ v_c ĉ_c                                                       (3)
//! s_j² = (f_j σ_j)² by (2) and (3) of identify.rs over the last blocks, at θ_all                (4)
//! z_c² = U_c²/(I_cc x),    x = s_j²/(f_j σ_j)²                                                  (5)
//! P ← P + Σ (v_c ĉ)(v_c ĉ)ᵀ    over the terms with z > BELIEVED                                 (6)
//! ```
//!
//! (1) is the efficient score: what the estimated parameters can imitate of c is taken out. The
//! weights in Λ hold f_j and σ_j, which a missing term has raised itself; x brings them to what
//! remains once every term is there. f_j there is of blocks as clusters, so that a misfit that
//! keeps its sign through a block raises no alarm. A term is named if z exceeds [`NAMED`] and a
//! usable parameter is off by more than [`HARMFUL`] of its standard deviations: then the model does
//! not describe the machine. Standard deviations hold (6) before that, too.
//!
//! With thirty terms and some minutes a right model names one in 1e7 runs by chance; the rest of
//! the margin is for friction that is none of (1) there. Sources: C. R. Rao, Proc. Cambridge Phil.
//! Soc. 44 (1948); K.-Y. Liang, S. Zeger, Biometrika 73 (1986).

use super::friction::FrictionTerm;
use super::identify::RobotIdentifier;
use super::information::Information;
use super::learning::friction_misfit;
use super::model::LeftOutTerm;
use super::sums::JointSums;
use crate::estimator::linalg::{Cholesky, dot};
use crate::model::MAX_JOINTS;

/// z from which on a term is named, and below which it no longer is.
const NAMED: (f64, f64) = (6.0, 4.0);
/// Standard deviations by which a usable parameter must be off for that, and no longer.
const HARMFUL: (f64, f64) = (1.0, 0.5);
/// z from which on standard deviations allow for a term.
const BELIEVED: f64 = 4.0;
/// Three standard deviations below this part of a parameter make its error matter.
const USABLE: f64 = 0.05;
/// Part of a term's information that must be left beside the parameters: less is rounding.
const TOLD_APART: f64 = 1e-9;

/// A term that the model leaves out although it would explain the misfit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOutFriction {
    /// The joint, counted from 0.
    pub joint: usize,
    /// The term.
    pub term: FrictionTerm,
    /// Its parameter, were it the only one that is missing.
    pub amplitude: f64,
    /// z: standard deviations that it is from 0.
    pub deviations: f64,
    /// Standard deviations by which the usable parameter that suffers most is off.
    pub harm: f64,
    /// Share of the joint's squared residuals that it would explain, 0 to 1.
    pub share: f64,
}

impl std::fmt::Display for LeftOutFriction {
    /// Rounded, so that the words change only with the matter.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let share = (10.0 * (10.0 * self.share).round()).max(10.0);
        write!(
            f,
            "{} at joint {}, which the model leaves out, would explain {share:.0} % of the misfit",
            self.term.phrase(),
            self.joint + 1
        )
    }
}

/// The terms that are left out, and room for the test.
#[derive(Debug, Clone)]
pub(super) struct LeftOut {
    pub terms: Vec<LeftOutTerm>,
    /// The term that was named last, if it still is.
    pub found: Option<LeftOutFriction>,
    /// v_c by rows, then v_c ĉ of those that are believed.
    shifts: Vec<f64>,
    believed: usize,
    /// U, I and ĉ_all.
    score: Vec<f64>,
    information: Vec<f64>,
    all: Vec<f64>,
    factor: Cholesky,
    theta: Vec<f64>,
    effective: Vec<f64>,
}

impl LeftOut {
    /// Room for these, beside so many parameters and terms together.
    pub fn new(terms: Vec<LeftOutTerm>, n: usize) -> Self {
        let k = terms.len();
        let room = if k > 0 { n } else { 0 };
        Self {
            terms,
            found: None,
            shifts: vec![0.0; k * n],
            believed: 0,
            score: vec![0.0; k],
            information: vec![0.0; k * k],
            all: vec![0.0; k],
            factor: Cholesky::new(k),
            theta: vec![0.0; room],
            effective: vec![0.0; room],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        (self.found, self.believed) = (None, 0);
    }

    /// Parameters are held or free that were not: the errors (2) are those of another estimate.
    pub fn forget_shifts(&mut self) {
        self.believed = 0;
    }

    /// Number of terms of a joint.
    pub fn of_joint(&self, joint: usize) -> usize {
        self.terms.iter().filter(|term| term.joint == joint).count()
    }

    /// The terms' priors.
    pub fn set_priors(&self, into: &mut Information) {
        for term in &self.terms {
            into.set_prior(term.index, 0.0, term.scale);
        }
    }

    /// What (6) adds to an entry of P.
    pub fn covariance(&self, i: usize, j: usize, n: usize) -> f64 {
        let shifts = self.shifts.chunks_exact(n.max(1)).take(self.believed);
        shifts.map(|shift| shift[i] * shift[j]).sum() // (6)
    }

    /// (1) and (3); false if rounding has spoilt I.
    fn solve(&mut self, known: &Information, covariance: &[f64], theta: &[f64]) -> bool {
        let (n, k) = (known.n, self.terms.len());
        for (c, term) in self.terms.iter().enumerate() {
            let row = &known.matrix[term.index * n..(term.index + 1) * n];
            self.score[c] = known.vector[term.index] - dot(row, theta); // (1)
            for (i, v) in self.shifts[c * n..(c + 1) * n].iter_mut().enumerate() {
                *v = dot(&covariance[i * n..(i + 1) * n], row); // (1)
            }
        }
        for (c, term) in self.terms.iter().enumerate() {
            let row = &known.matrix[term.index * n..(term.index + 1) * n];
            for d in 0..k {
                let v = &self.shifts[d * n..(d + 1) * n];
                self.information[c * k + d] = row[self.terms[d].index] - dot(row, v); // (1)
            }
        }
        if !self.factor.factor(k, &self.information) {
            return false;
        }
        self.all.copy_from_slice(&self.score);
        self.factor.solve(&mut self.all);
        self.theta.copy_from_slice(theta);
        (0..k).for_each(|c| self.step(c, self.all[c])); // (3)
        true
    }

    /// Gives θ a term with this amplitude.
    fn step(&mut self, c: usize, amplitude: f64) {
        let n = self.theta.len();
        for (theta, v) in self.theta.iter_mut().zip(&self.shifts[c * n..(c + 1) * n]) {
            *theta -= v * amplitude; // (2), (3)
        }
        self.theta[self.terms[c].index] += amplitude;
    }

    /// Keeps the error (2) that a term makes; errors of those before it may be kept already.
    fn believe(&mut self, c: usize, amplitude: f64) {
        let n = self.theta.len();
        self.shifts.copy_within(c * n..(c + 1) * n, self.believed * n);
        let shift = &mut self.shifts[self.believed * n..(self.believed + 1) * n];
        shift.iter_mut().for_each(|v| *v *= amplitude); // (2)
        self.believed += 1;
    }
}

impl RobotIdentifier {
    /// The term of friction that the model leaves out and that makes what is known wrong, if the
    /// residuals speak for one: the model does not describe the machine then.
    pub fn left_out_friction(&self) -> Option<LeftOutFriction> {
        self.left_out.as_ref()?.found
    }

    /// Looks for it after a block was learnt.
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
        self.effective_of(&left_out.theta, &mut left_out.effective);
        let mut excess = [f64::INFINITY; MAX_JOINTS];
        for (joint, excess) in excess.iter_mut().enumerate().take(self.torque_std.len()) {
            if let Some(level) = self.level(joint, left_out) {
                *excess = level * self.weight(joint); // (4), (5)
            }
        }
        let (named, harmful) = match left_out.found.take() {
            None => (NAMED.0, HARMFUL.0),
            Some(_) => (NAMED.1, HARMFUL.1),
        };
        let (n, k) = (self.theta.len(), left_out.terms.len());
        for c in 0..k {
            let LeftOutTerm { joint, term, index, .. } = left_out.terms[c];
            let (score, information) = (left_out.score[c], left_out.information[c * k + c]);
            if !(information > TOLD_APART * self.system.matrix[index * n + index]) {
                continue;
            }
            let amplitude = score / information; // (2)
            let deviations = (score * amplitude / excess[joint]).sqrt(); // (5)
            if !(deviations > BELIEVED) {
                continue;
            }
            let harm = self.harm(&left_out.shifts[c * n..(c + 1) * n], amplitude);
            let is_likelier = left_out.found.is_none_or(|found| deviations > found.deviations);
            if deviations > named && harm > harmful && is_likelier {
                left_out.theta.copy_from_slice(&self.theta);
                left_out.step(c, amplitude);
                self.effective_of(&left_out.theta, &mut left_out.effective);
                left_out.found = Some(LeftOutFriction {
                    joint,
                    term,
                    amplitude,
                    deviations,
                    harm,
                    share: self.share(joint, &left_out.effective),
                });
            }
            left_out.believe(c, amplitude);
        }
    }

    /// Standard deviations by which the parameter that may be used and suffers most is off.
    fn harm(&self, direction: &[f64], amplitude: f64) -> f64 {
        let n = self.theta.len();
        let payload = self.payload.as_ref().filter(|_| self.is_loaded);
        let is_carried = |i: &usize| payload.is_some_and(|payload| payload.indices().contains(i));
        let std = |i: &usize| self.covariance[i * n + i].max(0.0).sqrt();
        (0..self.parameters.len())
            .filter(|i| std(i) > 0.0 && (3.0 * std(i) < USABLE * self.theta[*i].abs() || is_carried(i)))
            .map(|i| (direction[i] * amplitude).abs() / std(&i))
            .fold(0.0, f64::max)
    }

    /// The last blocks of a joint, those without rows left out.
    fn recent_of(&self, joint: usize) -> impl Iterator<Item = &JointSums> {
        let recent = self.recent.iter().take(self.recent_blocks);
        recent.map(move |block| &block[joint]).filter(|sums| sums.rows > 0)
    }

    /// Share of a joint's squared residuals that these effective parameters explain.
    fn share(&self, joint: usize, effective: &[f64]) -> f64 {
        let square = |theta: &[f64]| -> f64 { self.recent_of(joint).map(|sums| sums.residual_square(theta)).sum() };
        (1.0 - square(effective) / square(&self.effective)).clamp(0.0, 1.0)
    }

    /// (4) of a joint; `None` without rows of it.
    fn level(&self, joint: usize, left_out: &LeftOut) -> Option<f64> {
        let terms = self.model.friction_of(joint).len() + left_out.of_joint(joint);
        let (mut square, mut rows) = (0.0, 0);
        let (mut clusters, mut count) = (0.0, 0.0);
        for sums in self.recent_of(joint) {
            square += sums.residual_square(&left_out.effective);
            rows += sums.rows;
            let columns = sums.columns().len();
            if let Some((misfit, directions)) = friction_misfit(sums, columns - terms..columns, &left_out.effective) {
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
