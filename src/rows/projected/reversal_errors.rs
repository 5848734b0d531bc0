//! What noise of the positions does to rows through the instants of reversals.
//!
//! ```text
//! (1)  δt₀ = Σ_k w_k δq_k                     w = −(weights of the velocity at t₀)/(acceleration)
//! (2)  c(k) += Σ_d K_d(t₀) (g_d⁻ − g_d⁺) w_k/h        g_d before and after the reversal
//! ```
//!
//! A term that jumps as a joint reverses, as Coulomb friction does, has no slope in the velocity on
//! either side: without (2), R would hold the instant t₀ (`reversals.rs`) for exact. The noise of a
//! position can move t₀ by as much as a sample period, and then the jump at the wrong time is many
//! times what the sensors leave of the rest of a row: a right model would be a misfit.
//!
//! w is that of the fit with different accelerations before and after t₀, whichever found t₀: the
//! velocity filter has less noise, but is late or early by up to a sample. It is scaled down if
//! that sample and the filter's own noise are less.

use super::reversals::{Reversal, velocity_weights};
use super::weak_form::WeakForm;
use crate::model::MAX_JOINTS;
use crate::rows::passes::{Terms, terms};
use crate::rows::theta_polynomial::MAX_ORDER;
use crate::rows::trajectory::Trajectory;

/// Largest standard deviation of an instant, as a share of half the velocity filter's length.
const LARGEST: f64 = 0.5;
/// Largest error of the filtered velocity's zero because of the jump of the acceleration, in
/// samples.
const LATE: f64 = 1.0;
/// Velocities on either side of a reversal, as a share of the change within a sample.
const EITHER_SIDE: f64 = 1e-6;

/// The reversals of a block, and how their instants depend on the positions.
#[derive(Debug, Clone)]
pub(super) struct ReversalErrors {
    found: Vec<Reversal>,
    /// w of each reversal in turn, over the velocity filter around `at`.
    weights: Vec<f64>,
    half: usize,
    /// Most reversals; a cloned vector has no spare capacity.
    room: usize,
}

/// Weights of a window on samples from `first` on, per derivative.
pub(super) struct Placed<'a> {
    pub kernels: &'a [Vec<f64>],
    pub first: usize,
}

impl ReversalErrors {
    /// Room for blocks of at most `capacity` samples.
    pub fn new(form: &WeakForm, capacity: usize) -> Self {
        let half = form.velocity.half;
        let count = form.plant.joints() * (capacity / half.max(1) + 1);
        Self {
            found: Vec::with_capacity(count),
            weights: vec![0.0; count * (2 * half + 1)],
            half,
            room: count,
        }
    }

    /// Number of reversals for which there is room.
    pub fn room(&self) -> usize {
        self.room
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.found.clear();
    }

    /// Takes a reversal of a joint whose positions have the standard deviation `noise`. One within
    /// the velocity filter of the last is the same: the sign of a small velocity is that of noise.
    pub fn note(&mut self, form: &WeakForm, reversal: Reversal, noise: f64) {
        let near = |other: &Reversal| other.joint == reversal.joint && reversal.at < other.at + self.half;
        if self.found.len() == self.room || self.found.last().is_some_and(near) {
            return;
        }
        let (count, acceleration) = (2 * self.half + 1, reversal.slope * form.options.sample_period_s);
        let own = &mut self.weights[self.found.len() * count..][..count];
        own.fill(0.0);
        let late = reversal.instant - reversal.at as f64;
        velocity_weights(self.half, late, |k, weight| own[k] = -weight / acceleration); // (1)
        let std = noise * own.iter().map(|w| w * w).sum::<f64>().sqrt();
        let filtered = noise * form.velocity.gain / acceleration.abs();
        let shrink = (filtered.hypot(LATE).min(LARGEST * self.half as f64) / std).min(1.0);
        own.iter_mut().for_each(|w| *w *= shrink);
        self.found.push(reversal);
    }

    /// g_d⁻ − g_d⁺ of an equation at θ, for each reversal.
    pub fn jumps(&self, form: &WeakForm, signals: &Trajectory, e: usize, theta: &[f64], out: &mut Vec<Terms>) {
        out.clear();
        for reversal in &self.found {
            let (mut q, mut dq) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
            for joint in 0..signals.joints() {
                (q[joint], dq[joint]) = (signals.q[joint][reversal.at], signals.dq[joint][reversal.at]);
            }
            let mut at = |share: f64| {
                dq[reversal.joint] = share * reversal.slope;
                terms(&*form.plant, e, &q, &dq, theta)
            };
            let (before, after): (Terms, Terms) = (at(-EITHER_SIDE), at(EITHER_SIDE));
            out.push(std::array::from_fn(|d| before[d] - after[d]));
        }
    }

    /// Adds (2) to c of a window: per joint, that of `support` positions from `first` on.
    pub fn add(&self, jumps: &[Terms], window: &Placed<'_>, c: &mut [f64], (support, first): (usize, usize)) {
        let end = window.first + window.kernels[0].len();
        for (n, (reversal, jump)) in self.found.iter().zip(jumps).enumerate() {
            let before = reversal.instant.floor();
            let late = reversal.instant - before;
            let before = before as usize;
            if before < window.first || before + 1 >= end {
                continue;
            }
            let moved: f64 = (0..=MAX_ORDER.min(window.kernels.len() - 1))
                .map(|d| {
                    let around = &window.kernels[d][before - window.first..];
                    jump[d] * ((1.0 - late) * around[0] + late * around[1])
                })
                .sum();
            if !(moved.is_finite() && moved != 0.0) {
                continue;
            }
            let weights = self.weights.chunks_exact(2 * self.half + 1).nth(n).unwrap_or_default();
            let own = &mut c[reversal.joint * support..(reversal.joint + 1) * support];
            for (weight, at) in weights.iter().zip(reversal.at - self.half..) {
                if let Some(c) = at.checked_sub(first).and_then(|at| own.get_mut(at)) {
                    *c += moved * weight;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::MeasuredBlock;
    use super::super::options::ProjectedOptions;
    use super::super::projection::Projection;
    use super::super::sensor_noise::SensorNoise;
    use crate::estimator::Residuals;
    use crate::model::{Equation, JointSample, MAX_JOINTS, Parameter, Plant, Scalar};
    use crate::random::Random;
    use std::f64::consts::TAU;
    use std::sync::Arc;

    const BLOCK: usize = 1000;
    const BLOCKS: usize = 12;
    const THETA: [f64; 2] = [8.0, 12.0];
    const COUNT: f64 = 1e-5;
    const INPUT_NOISE: f64 = 0.2;

    /// m q̈ + F sign q̇ = u, also written as no polynomial in θ, which is then evaluated at each θ.
    struct Slide {
        parameters: [Parameter; 2],
        equation: [Equation; 1],
        is_polynomial: bool,
    }

    impl Plant for Slide {
        fn name(&self) -> &str {
            "slide"
        }

        fn joints(&self) -> usize {
            1
        }

        fn input_unit(&self) -> &str {
            "N"
        }

        fn parameters(&self) -> &[Parameter] {
            &self.parameters
        }

        fn equations(&self) -> &[Equation] {
            &self.equation
        }

        fn terms<D: Scalar>(&self, _: usize, _: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
            let friction = match self.is_polynomial {
                true => theta[1],
                false => theta[1] * theta[1] / theta[1],
            };
            g[0] = friction * dq[0].signum();
            g[1] = theta[0] * dq[0];
        }
    }

    /// A period of the slide under a force that is held: exact position and velocity at its end.
    fn advance([q, v]: [f64; 2], force: f64, h: f64) -> [f64; 2] {
        let [mass, friction] = THETA;
        let against = if v == 0.0 { force } else { v };
        if v == 0.0 && force.abs() <= friction {
            return [q, 0.0];
        }
        let a = (force - friction * against.signum()) / mass;
        match -v / a {
            stop if stop > 0.0 && stop < h => advance([q + 0.5 * v * stop, 0.0], force, h - stop),
            _ => [q + (v + 0.5 * a * h) * h, v + a * h],
        }
    }

    /// Mean square of the whitened residuals at the true θ of a slide that swings under a force of
    /// this amplitude, and the largest residual at the end of a block.
    fn residuals(amplitude: f64, is_polynomial: bool) -> (f64, f64) {
        let mut noise = SensorNoise::NONE;
        noise.position_resolution = [COUNT; MAX_JOINTS];
        noise.input_noise = [INPUT_NOISE; MAX_JOINTS];
        let parameters = [("m", 1.0), ("F", 1.0)].map(|(name, start)| Parameter::positive(name, "1", "", start));
        let plant = Slide {
            parameters,
            equation: [Equation::new("slide", 0, 1.0, 1, 0..2)],
            is_polynomial,
        };
        let options = ProjectedOptions {
            noise,
            ..ProjectedOptions::recommended()
        };
        let mut rows = Projection::new(MeasuredBlock::new(Arc::new(plant), options, BLOCK).unwrap());
        let (mut random, h, w) = (Random(3), options.sample_period_s, TAU * 0.71);
        let mut state = [0.0, -amplitude / (THETA[0] * w)];
        let (mut sum, mut end) = (0.0, 0.0f64);
        for k in 0..BLOCKS * BLOCK {
            let force = amplitude * (w * k as f64 * h).sin();
            let gauss = (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
            let mut sample = JointSample::default();
            sample.q[0] = (state[0] / COUNT).round() * COUNT;
            sample.input[0] = force + INPUT_NOISE * gauss;
            state = advance(state, force, h);
            assert!(rows.block.push(k as u64 * 1_000_000, &sample));
            if (k + 1) % BLOCK == 0 {
                rows.project();
                rows.weigh(&THETA);
                sum += rows.mean_square(&THETA) / BLOCKS as f64;
                let tail = (0..4).filter_map(|k| rows.tail(0, k, &THETA));
                end = tail.fold(end, |end, residual| end.max(residual.abs()));
                rows.clear();
            }
        }
        (sum, end)
    }

    /// 5.4 and 1.5, and 10 and 6 standard deviations at the ends of blocks, if R holds the instants
    /// for exact.
    #[test]
    fn prop_residuals_about_reversals_whose_instants_are_uncertain_have_variance_one() {
        for amplitude in [30.0, 60.0] {
            let (rows, end) = residuals(amplitude, true);
            assert!((0.7..1.2).contains(&rows) && end < 4.0, "{amplitude}: {rows} {end}");
        }
    }

    /// 0.0125 if friction has the sign of each sample's velocity; 5e-5 is left because q̇ comes from
    /// the velocity filter.
    #[test]
    fn prop_a_model_that_is_no_polynomial_counts_both_directions_of_a_reversal_too() {
        let [polynomial, other] = [true, false].map(|is_polynomial| residuals(60.0, is_polynomial).0);
        assert!((polynomial - other).abs() < 1e-3, "{polynomial} {other}");
    }
}
