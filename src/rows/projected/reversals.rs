//! Reversals of a joint at which a term of the model jumps, as Coulomb friction does.
//!
//! ```text
//! q(t₀ + u) = q₀ + v u + a u²/2 + Δ u₊²/2 + j u³/6        v = 0: friction turns round at t₀, and q̈ jumps by Δ
//! b_k = ((t₀ − t_k + h/2) b(q, q̇⁻) + (t_k + h/2 − t₀) b(q, q̇⁺))/h      for the sample k nearest to t₀
//! ```
//!
//! A feature b (`separation.rs`) that jumps with the sign of the velocity takes the value of each
//! sample for the whole period h around it. A joint that reverses somewhere within the period is
//! then on the wrong side for up to h/2, and the velocity filter, which takes q̈ for smooth, moves
//! its zero by another h or so. What that makes of a row can be more than its noise. The instant
//! t₀ follows from the positions on both sides. The sample nearest to it gets the mean of both
//! sides, and samples that the filter has on the wrong side go to the right one.

use super::weak_form::WeakForm;
use crate::model::{MAX_JOINTS, Plant};
use crate::rows::standstill::Standstill;
use crate::rows::trajectory::Trajectory;
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// q₀, v, a, Δ, j.
const UNKNOWNS: usize = 5;
/// Times that the instant is improved.
const ROUNDS: usize = 6;
/// Samples on either side of a reversal that it is told from at least.
const FEWEST: usize = 5;
/// Standard deviation of an instant, in samples, that needs no further ones.
const SHARP: f64 = 0.1;
/// The largest that improves a row.
const BLUNT: f64 = 0.3;

/// A reversal, with times in samples.
#[derive(Debug, Clone, Copy)]
struct Reversal {
    /// Where the velocity passes through zero, from the sample that it was looked for at.
    instant: f64,
    /// Accelerations before and after it, in positions per sample².
    before: f64,
    after: f64,
}

/// Corrects velocities and features where a joint at which terms jump reverses, outside its rests.
/// The positions are known `form.velocity.half` samples beyond either end of `samples`.
pub(super) fn correct<P: Plant>(
    form: &WeakForm<P>,
    standstill: &Standstill,
    signals: &mut Trajectory,
    samples: Range<usize>,
) {
    let half = form.velocity.half;
    for joint in (0..form.plant.joints()).filter(|&joint| standstill.jumps(joint)) {
        let mut rests = standstill.rests(joint).iter().peekable();
        let mut at = samples.start;
        while at + 1 < samples.end {
            if let Some(&(_, end)) = rests.next_if(|(start, _)| *start <= at) {
                at = at.max(end);
                continue;
            }
            let (here, next) = (signals.dq[joint][at], signals.dq[joint][at + 1]);
            if here * next > 0.0 {
                at += 1;
                continue;
            }
            let guess = if here == next { 0.0 } else { here / (here - next) };
            if let Some(reversal) = locate(&signals.q[joint][at - half..=at + half], guess) {
                turn(form, joint, signals, samples.clone(), at, reversal);
            }
            // another zero so near to this one is one of noise
            at += half;
        }
    }
}

/// The reversal about the middle of some positions, by as few of them as tell it sharply, because
/// the motion may have other derivatives; `None` if not even all do.
fn locate(q: &[f64], guess: f64) -> Option<Reversal> {
    let half = q.len() / 2;
    let mut reach = FEWEST.min(half);
    loop {
        let limit = if reach < half { SHARP } else { BLUNT };
        match fit(&q[half - reach..=half + reach], guess) {
            Some((reversal, std)) if std <= limit => return Some(reversal),
            _ if reach == half => return None,
            _ => reach = (reach + reach.div_ceil(3)).min(half),
        }
    }
}

/// The reversal about the middle of some positions, and the standard deviation of its instant.
fn fit(q: &[f64], guess: f64) -> Option<(Reversal, f64)> {
    let half = (q.len() / 2) as f64;
    let reference = q[q.len() / 2];
    let mut instant = guess;
    for round in 0..ROUNDS {
        let turns = half + instant;
        let basis = |k: usize| {
            let u = k as f64 - turns;
            let late = u.max(0.0);
            SVector::from([1.0, u, 0.5 * u * u, 0.5 * late * late, u * u * u / 6.0])
        };
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        for (k, q) in q.iter().enumerate() {
            let row = basis(k);
            normal += row * row.transpose();
            right += row * (q - reference);
        }
        let inverse = normal.cholesky()?.inverse();
        let fit = inverse * right;
        let (before, after) = (fit[2], fit[2] + fit[3]);
        let both = before.abs().min(after.abs());
        if !(before * after > 0.0) {
            return None;
        }
        let step = -fit[1] / (0.5 * (before + after));
        instant += step.clamp(-1.0, 1.0);
        if !(instant.abs() <= 0.5 * half) {
            return None;
        }
        if round + 1 == ROUNDS || step.abs() < 1e-3 {
            let squares: f64 = (q.iter().enumerate())
                .map(|(k, q)| (q - reference - basis(k).dot(&fit)).powi(2))
                .sum();
            let variance = squares / (q.len() - UNKNOWNS - 1) as f64;
            let std = (variance * inverse[(1, 1)]).sqrt() / both;
            return (step.abs() < 0.1).then_some((Reversal { instant, before, after }, std));
        }
    }
    None
}

/// Puts the samples about a reversal, which was looked for at sample `at`, on its right side.
fn turn<P: Plant>(
    form: &WeakForm<P>,
    joint: usize,
    signals: &mut Trajectory,
    samples: Range<usize>,
    at: usize,
    reversal: Reversal,
) {
    let half = form.velocity.half;
    let per_second = 1.0 / form.options.sample_period_s;
    let around = at.saturating_sub(half).max(samples.start)..(at + half + 1).min(samples.end);
    for k in around {
        // from the reversal to the sample
        let u = k as f64 - at as f64 - reversal.instant;
        let side = |u: f64| per_second * u * if u < 0.0 { reversal.before } else { reversal.after };
        let wrong = signals.dq[joint][k] * side(u) <= 0.0;
        if wrong {
            signals.dq[joint][k] = side(u);
        }
        if u.abs() < 0.5 {
            // mean velocities of both parts of the period
            let parts = [(0.5 - u, 0.5 * (u - 0.5)), (0.5 + u, 0.5 * (u + 0.5))];
            evaluate(form, signals, k, joint, parts.map(|(share, mean)| (share, side(mean))));
        } else if wrong {
            evaluate(form, signals, k, joint, [(1.0, side(u)), (0.0, side(u))]);
        }
    }
}

/// Writes the features of a sample: the mean of those at two velocities of a joint, with these
/// shares.
fn evaluate<P: Plant>(form: &WeakForm<P>, signals: &mut Trajectory, at: usize, joint: usize, parts: [(f64, f64); 2]) {
    let Trajectory { q, dq, features, .. } = signals;
    let mut velocities = [0.0; MAX_JOINTS];
    velocities.iter_mut().zip(dq.iter()).for_each(|(own, dq)| *own = dq[at]);
    features.iter_mut().for_each(|feature| feature[at] = 0.0);
    for (share, velocity) in parts {
        velocities[joint] = velocity;
        let motion = |joint: usize, _: usize| (q[joint][at], velocities[joint]);
        let put = |feature: usize, at: usize, value: f64| features[feature][at] += share * value;
        form.separation.extract(&form.plant, at..at + 1, motion, put);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions about a reversal at `instant` with accelerations that differ, and a jerk.
    fn positions(half: usize, instant: f64, noise: f64) -> Vec<f64> {
        let position = |k: usize| {
            let u = k as f64 - half as f64 - instant;
            let acceleration = if u < 0.0 { 3e-7 } else { 8e-7 };
            let rough = noise * (12.9898 * k as f64).sin();
            0.3 + 0.5 * acceleration * u * u + 2e-9 * u.powi(3) + rough
        };
        (0..=2 * half).map(position).collect()
    }

    #[test]
    fn val_a_reversal_between_samples_is_found_where_it_is() {
        for instant in [-2.4, -0.5, 0.0, 0.31, 1.7] {
            // the velocity filter may be a sample off
            let found = locate(&positions(10, instant, 0.0), instant + 0.8).unwrap();
            assert!((found.instant - instant).abs() < 1e-3, "{instant}: {found:?}");
            assert!((found.before / 3e-7 - 1.0).abs() < 1e-2 && (found.after / 8e-7 - 1.0).abs() < 1e-2);
            // a sixth of the first sample's way
            let found = locate(&positions(10, instant, 5e-8), instant).unwrap();
            assert!((found.instant - instant).abs() < 3.0 * BLUNT, "{instant}: {found:?}");
        }
    }

    #[test]
    fn prop_what_is_no_sharp_reversal_is_left_alone() {
        // noise alone, a passage, and a joint that stops
        let noise: Vec<f64> = (0..21).map(|k| (12.9898 * f64::from(k)).sin()).collect();
        let passage: Vec<f64> = (0..21).map(|k| f64::from(k).powi(3)).collect();
        let stop: Vec<f64> = (0..21).map(|k| f64::from(10 - k).max(0.0).powi(2)).collect();
        for q in [noise, passage, stop] {
            assert!(locate(&q, 0.0).is_none());
        }
    }
}
