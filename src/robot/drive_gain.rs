//! Finds a joint whose drive, or torque sensor, has had a wrong gain from the start.
//!
//! Base parameters occur in the rows of several joints, so a joint that reports s times its torque
//! contradicts the others. With X_i the rows of joint i, A_i, b_i, c_i and β_i their sums and the
//! bias of b_i by errors of the velocities, W_i their weight and P = (Λ₀ + Σ W_i s_i² A_i)⁻¹:
//!
//! ```text
//! τ_i = s_i X_i θ,    s_i = 1 but for one joint j                                               (1)
//! A ← k A + A_block,   b, c and β alike,   k = e^(−T_b/T)                                       (2)
//! θ̂(s) = argmin Σ_i W_i Σ (τ_i − s_i X_i θ)²                                                    (3)
//! s ← s + U/I,   U = W_j s θ̂·(b_j/s − A_j θ̂),   I = W_j θ̂ᵀA_j θ̂ − v·d,
//!     v = W_j s A_j θ̂,   d = P v                                                                (4)
//! W_i = 1/(f_i σ_i)² by (4) of left_out.rs at θ̂ and s                                           (5)
//! L = ½ Σ_i n_i ln(R_i(1)/R_i(s)),   R_i(s) = Σ (τ_i − s_i X_i θ̂)²                               (6)
//! z = (|s − 1| − 1.5 |B|/I) √(I/x),   B = W_j s θ̂·β_j − d·Σ W_i s_i² β_i,
//!     x = Σ u²/Σ_i W_i e_iᵀA_i e_i over the last blocks, at least 1,
//!     u = Σ_i W_i e_i·(b_i − A_i s_i θ̂) of a block,   e_i = −s_i d, and + θ̂ for joint j          (7)
//! harm = max |θ̂(1) − θ̂(s)|/σ over the usable parameters                                         (8)
//! ```
//!
//! (4) is the method of Gauss and Newton with θ eliminated. The slopes of the offsets are
//! eliminated from the sums by (2) of [`offset_drift`](super::offset_drift), so a drift is not
//! taken for a gain. n_i are rows that do not overlap. L chooses the joint, because a gain at one
//! joint leaves misfit at its neighbours, too: a second joint is named with it if L differs by less
//! than [`ALIKE`]. At a wrist s has hardly any information, because no other joint's rows share its
//! parameters.
//!
//! A joint is named if z, harm and |s − 1| are large, and s explains the share [`TELLING`] of some
//! joint's misfit. It stays named on weaker evidence, without harm, because standard deviations
//! grow with the misfit.
//! Gains off by less than 10 % are not named: an error of 4 % cannot be told from what the model
//! lacks on a real robot. Rows with a payload are not used, and a result is kept until there are
//! enough rows without one.

use super::drive_gain_room::{DriveGains, WrongGain};
use super::learning::{Learner, ROWS_PER_PARAMETER, TRIED};
use super::left_out::harm;
use super::levels::SMALLEST_STD;
use crate::model::MAX_JOINTS;

/// T \[s\].
const MEMORY_S: f64 = 600.0;
/// z above which a joint is named, and z with x = 1 below which it no longer is.
const NAMED: f64 = 6.0;
const KEPT: f64 = 4.0;
/// Harm above which a joint is named.
const HARMFUL: f64 = 3.0;
/// |s − 1| above which a joint is named, and below which it no longer is.
const LEAST: f64 = 0.1;
const LEAST_KEPT: f64 = 0.08;
/// Formal z at s = 1, and |s − 1| after one step of (4), above which a joint is suspected.
const SUSPECTED: (f64, f64) = (2.0, 0.04);
/// Range of s: beyond it another unit or sign is likelier.
const CREDIBLE: std::ops::Range<f64> = 0.3..3.0;
/// Share of the misfit of some joint that s must explain to be named, and to stay so.
const TELLING: f64 = 0.2;
const TELLING_KEPT: f64 = 0.1;
/// Difference of L below which two joints are not told apart: 10 for independent rows, and the
/// misfit of a real robot is correlated over three or four of them.
const ALIKE: f64 = 30.0;
/// Factor on the bias by errors of the velocities.
const ALLOWED: f64 = 1.5;
/// Steps of (4), and the step below which they end.
const STEPS: usize = 6;
const CONVERGED: f64 = 1e-3;
/// Smallest mean square of the misfit, relative to the joint's torque.
const SMALLEST: f64 = SMALLEST_STD * SMALLEST_STD;

/// A suspected joint.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    joint: usize,
    factor: f64,
    likelihood: f64,
    /// z, and z with x = 1.
    deviations: f64,
    formal: f64,
    harm: f64,
    share: f64,
}

impl DriveGains {
    /// Tests the gains after a block without a payload.
    pub fn look_at_block(&mut self, learner: &Learner) {
        let kept = (-learner.options.block_s / MEMORY_S).exp();
        self.take(learner.open.sums(), kept); // (2)
        self.judge(learner);
    }

    fn judge(&mut self, learner: &Learner) {
        let (n, joints) = (self.known.n, self.sums.len());
        let rows: f64 = self.rows.iter().sum();
        if learner.recent.count() < TRIED || rows * learner.independent_share() < ROWS_PER_PARAMETER * n as f64 {
            return;
        }
        let fixed = learner.estimate.fixed();
        self.theta[..n].copy_from_slice(&learner.estimate.theta()[..n]);
        self.weigh(learner);
        if !self.solve(&learner.arm.model, None, fixed) {
            return;
        }
        self.plain.copy_from_slice(&self.theta[..n]);
        let was = self.found.take();
        let mut best: [Option<Suspect>; 2] = [None; 2];
        // the first step of each suspect, 0 for the others
        let mut first = [0.0; MAX_JOINTS];
        for joint in 0..joints {
            self.misfits[joint] = self.misfit(joint, 1.0);
            let (score, information) = self.slope(joint, 1.0);
            let step = score / information;
            let is_significant = information > 0.0 && score.abs() > SUSPECTED.0 * information.sqrt();
            let is_suspect = is_significant && step.abs() > SUSPECTED.1;
            let was_named = was.is_some_and(|was| was.names(joint)) && step.is_finite();
            if self.sums[joint].rows > 0 && (is_suspect || was_named) {
                first[joint] = step;
            }
        }
        for joint in (0..joints).filter(|joint| first[*joint] != 0.0) {
            let Some(suspect) = self.fit(learner, joint, 1.0 + first[joint]) else {
                continue;
            };
            let over = |other: &Option<Suspect>| other.is_none_or(|other| suspect.likelihood > other.likelihood);
            if over(&best[0]) {
                best = [Some(suspect), best[0]]; // (6)
            } else if over(&best[1]) {
                best[1] = Some(suspect);
            }
        }
        let Some(likeliest) = best[0] else { return };
        let off = (likeliest.factor - 1.0).abs();
        let is_credible = CREDIBLE.start < likeliest.factor && likeliest.factor < CREDIBLE.end;
        let is_named = if was.is_some_and(|was| was.names(likeliest.joint)) {
            likeliest.formal > KEPT && off >= LEAST_KEPT && likeliest.share > TELLING_KEPT
        } else {
            likeliest.deviations > NAMED && likeliest.harm > HARMFUL && off >= LEAST && likeliest.share > TELLING
        };
        let alike = best[1].filter(|other| likeliest.likelihood - other.likelihood < ALIKE);
        self.found = (is_named && is_credible).then_some(WrongGain {
            joint: likeliest.joint,
            factor: likeliest.factor,
            other: alike.map(|other| (other.joint, other.factor)),
        });
    }

    /// W of the estimate.
    fn weigh(&mut self, learner: &Learner) {
        for joint in 0..self.sums.len() {
            self.weights[joint] = learner.levels.weight(joint);
        }
    }

    /// (3) to (8) of a joint, from this first factor.
    fn fit(&mut self, learner: &Learner, joint: usize, first: f64) -> Option<Suspect> {
        let fixed = learner.estimate.fixed();
        let mut factor = first.clamp(CREDIBLE.start, CREDIBLE.end);
        self.weigh(learner);
        let mut information = 0.0;
        for step in 0..=STEPS {
            if !self.solve(&learner.arm.model, Some((joint, factor)), fixed) {
                return None;
            }
            let (score, own) = self.slope(joint, factor);
            information = own;
            self.scale(factor, fixed);
            if step == STEPS || !(information > 0.0) || (score / information).abs() < CONVERGED {
                break;
            }
            factor = (factor + score / information).clamp(CREDIBLE.start, CREDIBLE.end); // (4)
            for (other, sums) in self.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let effective = &self.effective[usize::from(other == joint)];
                let own = (other, learner.arm.model.friction_columns(other));
                let least = SMALLEST * sums.square / sums.rows as f64;
                if let Some(level) = learner.levels.mean_square(own, &learner.recent, effective) {
                    self.weights[other] = 1.0 / level.max(least).max(f64::MIN_POSITIVE); // (5)
                }
            }
        }
        if !(information > 0.0) {
            return None;
        }
        let independent = learner.independent_share();
        let (mut likelihood, mut share) = (0.0, 0.0_f64);
        for (other, sums) in self.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let least = (SMALLEST * sums.square).max(f64::MIN_POSITIVE);
            let left = self.misfit(other, if other == joint { factor } else { 1.0 }).max(least);
            let ratio = self.misfits[other].max(least) / left;
            likelihood += 0.5 * independent * self.rows[other] * ratio.ln(); // (6)
            share = share.max(1.0 - 1.0 / ratio);
        }
        let biased = ALLOWED * self.bias(joint, factor).abs() / information;
        let off = ((factor - 1.0).abs() - biased).max(0.0);
        let formal = off * information.sqrt();
        let deviations = formal / self.scatter(learner, joint, factor).sqrt(); // (7)
        for ((change, plain), theta) in self.change.iter_mut().zip(&self.plain).zip(&self.theta) {
            *change = plain - theta;
        }
        let harm = harm(learner, &self.change, 1.0); // (8)
        Some(Suspect {
            joint,
            factor,
            likelihood,
            deviations,
            formal,
            harm,
            share,
        })
    }

    /// x of (7).
    fn scatter(&mut self, learner: &Learner, joint: usize, factor: f64) -> f64 {
        self.point(factor, learner.estimate.fixed());
        let (mut squares, mut information) = (0.0, 0.0);
        for block in learner.recent.iter() {
            let mut score = 0.0;
            for (other, sums) in block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let own = usize::from(other == joint);
                let (along, square) = sums.along(&self.along[own], &self.effective[own]);
                score += self.weights[other] * along; // (7)
                information += self.weights[other] * square; // (7)
            }
            squares += score * score;
        }
        (squares / information).max(1.0) // NaN counts as 1
    }
}
