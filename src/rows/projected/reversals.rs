//! Reversals of a joint at which a term of the model jumps, as Coulomb friction does.
//!
//! ```text
//! (1)  q(t₀ + u) = q₀ + v u + a u²/2 + Δ u₊²/2 + c₃ u³ + c₄ u⁴ + c₅ u⁵        v = 0 at the reversal
//! (2)  b_k = (1/2 − u_k/h) b(q, q̇⁻) + (1/2 + u_k/h) b(q, q̇⁺)        |u_k| ≤ h/2
//! ```
//!
//! A feature b (`separation.rs`) takes the value of each sample for the whole period h around it.
//! If the joint reverses within that period, at t₀, a feature that jumps with the sign of the
//! velocity has the wrong sign for up to h/2, which can exceed the noise of a row. The sample
//! nearest to t₀ therefore gets the weighted mean of both directions, each at its mean velocity.
//!
//! When friction reverses, the acceleration jumps by some Δ, and the velocity filter, which assumes
//! it smooth, is systematically late or early by a fraction of h. If the positions determine (1)
//! sharply, t₀ comes from that fit, otherwise from the zero of the filtered velocity.
//!
//! Either is off by the noise of the positions, which can be most of the noise of a row:
//! `reversal_errors.rs`.

use super::weak_form::WeakForm;
use crate::model::MAX_JOINTS;
use crate::rows::standstill::Standstill;
use crate::rows::trajectory::{Trajectory, Turn};
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// Unknowns of (1): as many derivatives as the velocity filter has, and Δ.
const UNKNOWNS: usize = 7;
/// Largest number of iterations for t₀.
const ROUNDS: usize = 6;
/// Step of t₀, in samples, below which the iteration ends.
const SETTLED: f64 = 0.01;
/// Largest standard deviation of t₀, in samples, with which the fit is preferred to the filter.
const SHARP: f64 = 0.05;

/// A reversal of a joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reversal {
    pub joint: usize,
    /// The last sample at which the filtered velocity has the sign before the reversal.
    pub at: usize,
    /// t₀, in samples.
    pub instant: f64,
    /// Change of the velocity from one sample to the next.
    pub slope: f64,
}

/// Corrects velocities and features at reversals of joints at which terms jump, and passes these to
/// `found`. The velocities of `samples` are known; `noise` is the standard deviation of a joint's
/// positions.
pub(super) fn correct(
    form: &WeakForm,
    standstill: &Standstill,
    signals: &mut Trajectory,
    noise: impl Fn(usize) -> f64,
    samples: Range<usize>,
    mut found: impl FnMut(Reversal),
) {
    let half = form.velocity.half;
    for joint in (0..form.plant.joints()).filter(|&joint| standstill.jumps(joint)) {
        for at in samples.start..samples.end.saturating_sub(1) {
            let (here, next) = (signals.dq[joint][at], signals.dq[joint][at + 1]);
            if !(here * next < 0.0) {
                continue;
            }
            let filtered = here / (here - next);
            let q = &signals.q[joint][at - half..=at + half];
            let instant = at as f64 + locate(q, filtered, noise(joint)).unwrap_or(filtered);
            let slope = next - here;
            found(Reversal {
                joint,
                at,
                instant,
                slope,
            });
            // samples between both instants have the wrong sign
            for k in samples.clone().skip((at - samples.start).saturating_sub(1)).take(4) {
                let u = k as f64 - instant;
                let wrong = signals.dq[joint][k] * slope * u < 0.0;
                if wrong {
                    signals.dq[joint][k] = slope * u;
                }
                if u.abs() < 0.5 {
                    // (2), at the middle of either part of the period
                    let parts = [0.5 * (u - 0.5), 0.5 * (u + 0.5)];
                    let parts = parts.map(|mean| (2.0 * mean.abs(), mean * slope));
                    if signals.turns.len() < signals.q[joint].len() {
                        signals.turns.push(Turn { at: k, joint, parts });
                    }
                    evaluate(form, signals, k, joint, parts);
                } else if wrong {
                    evaluate(form, signals, k, joint, [(1.0, slope * u), (0.0, slope * u)]);
                }
            }
        }
    }
}

/// The instant of reversal by (1), in samples from the middle of these positions; `filtered` is
/// that of the velocity filter. `None` if the positions do not determine it sharply.
fn locate(q: &[f64], filtered: f64, noise: f64) -> Option<f64> {
    let half = (q.len() / 2) as f64;
    let reference = q[q.len() / 2];
    let mut instant = filtered;
    for _ in 0..ROUNDS {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        for (k, q) in q.iter().enumerate() {
            let row = row((k as f64 - half - instant) / half);
            normal += row * row.transpose();
            right += row * (q - reference);
        }
        let inverse = normal.cholesky()?.inverse();
        let fit = inverse * right;
        let (before, after) = (2.0 * fit[2], 2.0 * (fit[2] + fit[3]));
        if !(before * after > 0.0) {
            return None;
        }
        let step = -half * fit[1] / (0.5 * (before + after));
        instant += step;
        if !((instant - filtered).abs() < 1.0) {
            return None;
        }
        if step.abs() < SETTLED {
            let std = half * noise * inverse[(1, 1)].sqrt() / before.abs().min(after.abs());
            return (std <= SHARP).then_some(instant);
        }
    }
    None
}

/// The unknowns' factors in (1) at a time u, in half lengths of the filter.
fn row(u: f64) -> SVector<f64, UNKNOWNS> {
    let late = u.max(0.0);
    SVector::from([1.0, u, u * u, late * late, u.powi(3), u.powi(4), u.powi(5)])
}

/// The velocity at the reversal per unit of each of the 2 `half` + 1 positions around it, by (1)
/// with t₀ this many samples from their middle; none if they are too few.
pub(super) fn velocity_weights(half: usize, instant: f64, mut put: impl FnMut(usize, f64)) {
    let length = half as f64;
    let row = |k: usize| row((k as f64 - length - instant) / length);
    let normal = (0..=2 * half)
        .map(row)
        .fold(SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros(), |sum, row| {
            sum + row * row.transpose()
        });
    let Some(cholesky) = normal.cholesky() else { return };
    let mut own = SVector::<f64, UNKNOWNS>::zeros();
    own[1] = 1.0 / length;
    let own = cholesky.solve(&own);
    (0..=2 * half).for_each(|k| put(k, own.dot(&row(k))));
}

/// Writes the features of a sample: those at two velocities of a joint, weighted.
fn evaluate(form: &WeakForm, signals: &mut Trajectory, at: usize, joint: usize, parts: [(f64, f64); 2]) {
    let Trajectory { q, dq, features, .. } = signals;
    let mut velocities = [0.0; MAX_JOINTS];
    velocities.iter_mut().zip(dq.iter()).for_each(|(own, dq)| *own = dq[at]);
    features.iter_mut().for_each(|feature| feature[at] = 0.0);
    for (share, velocity) in parts {
        velocities[joint] = velocity;
        let motion = |joint: usize, _: usize| (q[joint][at], velocities[joint]);
        let put = |feature: usize, at: usize, value: f64| features[feature][at] += share * value;
        form.separation.extract(&*form.plant, at..at + 1, motion, put);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions about a reversal at `instant` at which the acceleration jumps from 3e-7 to 8e-7.
    fn positions(instant: f64, noise: f64) -> Vec<f64> {
        let position = |k: i32| {
            let u = f64::from(k) - 10.0 - instant;
            let acceleration = if u < 0.0 { 3e-7 } else { 8e-7 };
            let rough = noise * (12.9898 * f64::from(k)).sin();
            0.3 + 0.5 * acceleration * u * u + 2e-9 * u.powi(3) + rough
        };
        (0..21).map(position).collect()
    }

    #[test]
    fn val_a_reversal_between_samples_is_found_where_it_is() {
        for instant in [-2.4, -0.5, 0.0, 0.31, 1.7] {
            let found = locate(&positions(instant, 0.0), instant + 0.4, 0.0).unwrap();
            assert!((found - instant).abs() < SETTLED, "{instant}: {found}");
            let noise = 2e-9;
            let found = locate(&positions(instant, noise), instant + 0.2, noise).unwrap();
            assert!((found - instant).abs() < 3.0 * SHARP, "{instant}: {found}");
        }
    }

    #[test]
    fn prop_what_is_no_sharp_reversal_is_left_to_the_filter() {
        let noise: Vec<f64> = (0..21).map(|k| (12.9898 * f64::from(k)).sin()).collect();
        let passage: Vec<f64> = (0..21).map(|k| f64::from(k).powi(3)).collect();
        for (q, std) in [(noise, 0.7), (passage, 0.0), (positions(0.2, 1e-6), 7e-7)] {
            assert_eq!(locate(&q, 0.0, std), None);
        }
    }
}
