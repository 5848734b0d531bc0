//! Windows that end with the last sample of a block, for what the regular windows do not yet show.
//!
//! ```text
//! f_k(θ) = s ∫ψ_k u − Σ_d (−1)^d ∫ψ_k^(d) g_d(q, q̇; θ)
//! ψ_k of `end_kernel.rs`: 3/2, 1, 1/2 and 1/4 of a regular window, or of 0.1 s if that is wider
//! var f_k = Σ c_k² σ_q² + s² σ_u² Σ w_k² + the variance of jumps and repaired inputs
//! ```
//!
//! A regular window weights its middle, so a plant that changes less than about 80 ms before a
//! block ends shows in none of them. These windows weight the end. The last samples have no later
//! neighbours, so their velocities are those of the polynomial fitted to the last samples; the
//! added noise is part of the variance. The windows are too few for estimation, but a residual of
//! many standard deviations shows that the block's estimate no longer holds at its end. Only the
//! fit statistic uses them (`estimator/fit_statistic.rs`).

use super::measured::MeasuredBlock;
use super::reversal_errors::Placed;
use super::velocity_filter::ORDER;
use super::weak_form::highest_order;
use crate::rows::end_kernel::EndKernels;
use crate::rows::error_weights::{linear_in_velocity, nonlinear};
use crate::rows::kernel::{correlate_odd, dot};
use crate::rows::partials::{LANES, Partials};
use crate::rows::passes::Terms;
use crate::rows::separation::Separation;
use crate::rows::smoothing::beyond;
use crate::rows::standstill::Standstill;
use crate::rows::theta_polynomial::MAX_ORDER;

/// Windows per equation.
const COUNT: usize = 4;
/// Width that they are derived from if the regular windows are narrower \[s\], and the share of the
/// block that it may take.
const LEAST_S: f64 = 0.1;
const LEAST_SHARE: f64 = 0.25;
/// The fewest intervals of a window.
const SHORTEST: usize = 16;
/// Samples at the end that cannot yet be distinguished from spikes, in a block that has some.
const UNSURE: usize = 5;

/// The windows at the end of a block.
#[derive(Debug, Clone)]
pub(super) struct Tail {
    kernels: Vec<EndKernels>,
    /// Samples of the longest window, and of either side of the velocity filter.
    longest: usize,
    velocity_half: usize,
    /// Weights of the last 2 `velocity_half` + 1 positions for the velocity 1, 2, … samples behind
    /// their middle.
    last_velocities: Vec<Vec<f64>>,
    /// Y₀ times the input's scale and the factors of the monomials \[equation\]\[window\].
    input: Vec<[f64; COUNT]>,
    factors: Vec<Vec<[f64; COUNT]>>,
    /// Variance of each residual; 0 if the window is not used.
    variance: Vec<[f64; COUNT]>,
    // velocities and features of the last samples
    dq: Vec<Vec<f64>>,
    features: Vec<Vec<f64>>,
    // scratch
    weights: Vec<f64>,
    filtered: Vec<f64>,
    slopes: Vec<[f64; MAX_ORDER + 1]>,
    jumps: Vec<Terms>,
}

impl Tail {
    /// The windows at the end of a block.
    pub fn new(block: &MeasuredBlock) -> Self {
        let (form, block_len) = (&block.form, block.samples.block_len());
        let (half, velocity_half) = (form.kernels.half, form.velocity.half);
        let (options, separation, joints) = (&form.options, &form.separation, form.plant.joints());
        let (period_s, order) = (options.sample_period_s, highest_order(&*form.plant) + 1);
        let least = (0.5 * (LEAST_S / period_s).min(LEAST_SHARE * block_len as f64)) as usize;
        let half = half.max(least);
        let kernels: Vec<EndKernels> = [3 * half, 2 * half, half, half / 2]
            .map(|intervals| {
                let count = intervals.max(SHORTEST) + 1;
                EndKernels::new(count, period_s, order, options.timing, options.input_delay_s)
            })
            .into();
        let equations = separation.equations.len();
        let longest = kernels[0].count.max(2 * velocity_half + 1);
        let last_velocities = (1..=velocity_half)
            .filter_map(|ahead| beyond(velocity_half, ORDER, 1, ahead))
            .map(|weights| weights.into_iter().map(|w| w / period_s).collect())
            .collect();
        Self {
            input: vec![[0.0; COUNT]; equations],
            factors: (0..equations)
                .map(|e| vec![[0.0; COUNT]; separation.equations[e].as_ref().map_or(0, |p| p.monomials.len())])
                .collect(),
            variance: vec![[0.0; COUNT]; equations],
            dq: vec![vec![0.0; longest]; joints],
            features: vec![vec![0.0; longest]; separation.features],
            weights: vec![0.0; (longest + velocity_half) * joints],
            filtered: vec![0.0; longest + 3 * velocity_half],
            slopes: vec![[0.0; MAX_ORDER + 1]; longest * 2 * joints],
            jumps: Vec::with_capacity(block.reversals.room()),
            kernels,
            longest,
            velocity_half,
            last_velocities,
        }
    }

    /// Clears the windows.
    pub fn clear(&mut self) {
        self.variance.fill([0.0; COUNT]);
    }

    /// Projects the end of a block, except windows over a rest at which the equation does not hold;
    /// `theta` is that of the weights.
    pub fn project(&mut self, end: &MeasuredBlock, standstill: &Standstill, theta: &[f64]) {
        self.clear();
        let spare = if end.samples.repair.touched() { UNSURE } else { 0 };
        let late = self.kernels.iter().map(|k| k.after).max().unwrap_or(0);
        // the windows end before this buffer position
        let stop = end.samples.len.saturating_sub(spare + late);
        let reach = self.longest + self.velocity_half + self.kernels[0].before;
        if stop < end.samples.segment + reach {
            return;
        }
        self.sense(end, stop);
        for e in 0..self.input.len() {
            if end.form.separation.equations[e].is_some() {
                self.differentiate(end, e, stop, theta);
                let signals = &end.samples.signals;
                end.reversals.jumps(&end.form, signals, e, theta, &mut self.jumps);
                for k in 0..COUNT {
                    if !standstill.is_within(e, &(stop - self.kernels[k].count..stop)) {
                        self.project_window(end, e, k, stop, theta);
                    }
                }
            }
        }
    }

    /// Velocities and features of the samples before `stop`.
    fn sense(&mut self, end: &MeasuredBlock, stop: usize) {
        let first = stop - self.longest;
        let known = self.longest - self.velocity_half;
        for (own, all) in self.dq.iter_mut().zip(&end.samples.signals.dq) {
            own[..known].copy_from_slice(&all[first..first + known]);
        }
        for (own, all) in self.features.iter_mut().zip(&end.samples.signals.features) {
            own[..known].copy_from_slice(&all[first..first + known]);
        }
        let around = stop - 2 * self.velocity_half - 1..stop;
        let (q, dq, features) = (&end.samples.signals.q, &mut self.dq, &mut self.features);
        for (q, dq) in q.iter().zip(dq.iter_mut()) {
            for (dq, weights) in dq[known..].iter_mut().zip(&self.last_velocities) {
                *dq = dot(weights, &q[around.clone()]);
            }
        }
        let motion = |joint: usize, i: usize| (q[joint][first + i], dq[joint][i]);
        let put = |feature: usize, i: usize, value: f64| features[feature][i] = value;
        let (form, last) = (&end.form, known..self.longest);
        form.separation.extract(&*form.plant, last, motion, put);
    }

    /// ∂g/∂q and ∂g/∂q̇ of an equation's nonlinear part at the samples before `stop`.
    fn differentiate(&mut self, end: &MeasuredBlock, e: usize, stop: usize, theta: &[f64]) {
        let (first, form) = (stop - self.longest, &end.form);
        let (q, dq) = (&end.samples.signals.q, &self.dq);
        for kinds in form.separation.sensitivities[e].kinds.chunks(LANES) {
            let mut linear = [[0.0; MAX_ORDER + 1]; LANES];
            for (linear, &kind) in linear.iter_mut().zip(kinds) {
                *linear = linear_in_velocity(form.separation.equations[e].as_ref(), kind, theta);
            }
            let mut partials = Partials::new(&*form.plant, e, theta, kinds);
            for i in 0..self.longest {
                let slopes = partials.at(|joint| (q[joint][first + i], dq[joint][i]));
                for ((kind, slopes), linear) in kinds.iter().zip(slopes).zip(&linear) {
                    let place = (2 * kind.joint + usize::from(kind.velocity)) * self.longest + i;
                    self.slopes[place] = nonlinear(slopes, linear);
                }
            }
        }
    }

    fn project_window(&mut self, end: &MeasuredBlock, e: usize, k: usize, stop: usize, theta: &[f64]) {
        let Some(polynomial) = &end.form.separation.equations[e] else {
            return;
        };
        let kernels = &self.kernels[k];
        let form = &end.form.plant.equations()[e];
        let (input, scale) = (form.input, form.input_scale);
        let first = stop - kernels.count;
        let from = first - kernels.before;
        let u = &end.samples.signals.u[input][from..stop + kernels.after];
        let within = |jumps: &[(usize, f64)], weights: &[f64], add: &mut dyn FnMut(f64, f64)| {
            for &(at, value) in jumps {
                if let Some(weight) = at.checked_sub(from).and_then(|i| weights.get(i)) {
                    add(*weight, value);
                }
            }
        };
        let own = end.noise.input_std(input).powi(2);
        let mut moment = dot(&kernels.input, u);
        let mut variance = own * dot(&kernels.input, &kernels.input);
        within(&end.jumps.all()[input], &kernels.jump, &mut |weight, size| {
            moment += weight * size;
            variance += weight * weight * (5.0 * own + 1e-6 * size * size);
        });
        within(&end.noise.surplus[input], &kernels.input, &mut |weight, more| {
            variance += weight * weight * more;
        });
        self.input[e][k] = scale * moment;
        let factors = &mut self.factors[e];
        factors.iter_mut().for_each(|factor| factor[k] = 0.0);
        for term in &polynomial.velocity {
            let q = &end.samples.signals.q[term.joint][first..stop];
            factors[term.monomial][k] += term.coefficient * dot(&kernels.position[term.derivative + 1], q);
        }
        for term in &polynomial.features {
            let feature = &self.features[term.feature][self.longest - kernels.count..];
            factors[term.monomial][k] += dot(&kernels.position[term.derivative], feature);
        }
        let variance = scale * scale * variance + self.position_variance(end, e, k, stop, theta);
        self.variance[e][k] = variance;
    }

    /// Σ c² σ_q² of one window, c = −∂f/∂q as in `error_weights.rs`.
    fn position_variance(&mut self, end: &MeasuredBlock, e: usize, k: usize, stop: usize, theta: &[f64]) -> f64 {
        let (kernels, half, longest) = (&self.kernels[k], self.velocity_half, self.longest);
        let order = end.form.plant.equations()[e].order;
        let support = longest + half;
        let skipped = longest - kernels.count;
        let c = &mut self.weights;
        c.fill(0.0);
        if let Some(polynomial) = &end.form.separation.equations[e] {
            for term in &polynomial.velocity {
                let factor = polynomial.monomials[term.monomial].value(theta) * term.coefficient;
                let own = &mut c[term.joint * support + half + skipped..(term.joint + 1) * support];
                for (c, weight) in own.iter_mut().zip(&kernels.position[term.derivative + 1]) {
                    *c += factor * weight;
                }
            }
        }
        for kind in &end.form.separation.sensitivities[e].kinds {
            let own = &mut c[kind.joint * support..(kind.joint + 1) * support];
            let slopes = &self.slopes[(2 * kind.joint + usize::from(kind.velocity)) * longest..];
            let at = |i: usize| -> f64 {
                let terms = (0..=order).map(|d| kernels.position[d][i - skipped] * slopes[i][d]);
                terms.sum()
            };
            if !kind.velocity {
                (skipped..longest).for_each(|i| own[half + i] += at(i));
                continue;
            }
            // the transposed velocity filter, and the polynomial's velocities of the last samples
            self.filtered.fill(0.0);
            for i in skipped..longest - half {
                self.filtered[2 * half + i] = at(i);
            }
            correlate_odd(&end.form.velocity.transposed, &self.filtered, own);
            for i in skipped.max(longest - half)..longest {
                let (at, weights) = (at(i), &self.last_velocities[i + half - longest]);
                for (c, weight) in own[support - 2 * half - 1..].iter_mut().zip(weights) {
                    *c += weight * at;
                }
            }
        }
        let placed = Placed {
            kernels: &kernels.position,
            first: stop - kernels.count,
        };
        end.reversals.add(&self.jumps, &placed, c, (support, stop - support));
        let mut variance = 0.0;
        for (joint, c) in c.chunks_exact(support).enumerate() {
            let std = &end.noise.q_std[joint][stop - support..stop];
            variance += c.iter().zip(std).map(|(c, s)| (c * s).powi(2)).sum::<f64>();
        }
        variance
    }

    /// Residual of window k at θ in its standard deviations; `None` if the window is not used.
    pub fn residual(&self, separation: &Separation, e: usize, k: usize, theta: &[f64]) -> Option<f64> {
        let variance = *self.variance.get(e)?.get(k)?;
        let polynomial = separation.equations[e].as_ref()?;
        if !(variance > 0.0 && variance.is_finite()) {
            return None;
        }
        let explained: f64 = polynomial
            .monomials
            .iter()
            .zip(&self.factors[e])
            .map(|(monomial, factor)| monomial.value(theta) * factor[k])
            .sum();
        Some((self.input[e][k] - explained) / variance.sqrt())
    }
}
