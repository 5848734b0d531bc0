//! Covariance of the rows of one equation, from the noise of the samples that they share.
//!
//! ```text
//! R_ij = Σ_k c_i(k) c_j(k) σ_q²(k) + s² σ_u² Σ_k w_i(k) w_j(k) + jumps        c_i(k) = −∂f_i/∂q_k
//! ```
//!
//! w are the weights of the input (`kernel.rs`), c those of the positions (`error_weights.rs`) at
//! θ̂ before the block. A jump of the input is known to 5 σ_u² and a thousandth of its size; an
//! input that was mended, or that jumped between two samples, has a surplus of its own.

use super::input_jumps::within;
use super::measured::MeasuredBlock;
use super::sample_noise::EXACT;
use super::windows::Window;
use crate::model::Plant;
use crate::rows::error_weights::{ErrorWeights, linear_in_velocity, nonlinear};
use crate::rows::kernel::dot;
use crate::rows::partials::{Kind, LANES, Partials};
use crate::rows::rounding;
use crate::rows::theta_polynomial::MAX_ORDER;
use crate::rows::whitening::Whitening;

/// Stands for the standard deviation of a position that is exact, so that its c can be had back;
/// its square adds nothing to R.
const EXACT_STD: f64 = 1e-150;
/// Evaluations of the slopes on either side of a window's centre.
const SLOPES_PER_HALF: usize = 16;

/// R of each equation in turn, and the sensitivities that it is made of.
#[derive(Debug, Clone)]
pub(super) struct RowCovariance {
    /// ∂g_d/∂q and ∂g_d/∂q̇ of the nonlinear terms
    /// \[2 joint + (0 position, 1 velocity)\]\[d\]\[sample\].
    slopes: Vec<[Vec<f64>; MAX_ORDER + 1]>,
    /// c_i of every row \[equation\]\[row\], times the standard deviation of each position.
    sensitivity: Vec<Vec<Vec<f64>>>,
    /// Variance of the rounding of each equation's input within each window \[equation\]\[row\].
    rounding: Vec<Vec<f64>>,
    /// Σ_k w_i(k) w_j(k) for windows a number of strides apart.
    input_overlap: Vec<f64>,
    /// Positions of each joint that a row depends on.
    support: usize,
    /// Scratch: c of one row, and what it is made of.
    unscaled: Vec<f64>,
    scratch: Vec<f64>,
}

impl RowCovariance {
    /// Room for `rows` rows of each equation of a block.
    pub fn new<P: Plant>(block: &MeasuredBlock<P>, rows: usize) -> Self {
        let (form, joints) = (&block.form, block.form.plant.joints());
        let (support, stride) = (form.support(), block.samples.windows.stride);
        let weights = &form.kernels.input[0];
        // strides over which windows overlap
        let bandwidth = (support.max(2 * form.kernels.input_half + 1) - 1) / stride;
        Self {
            slopes: vec![std::array::from_fn(|_| vec![0.0; block.samples.capacity()]); 2 * joints],
            sensitivity: vec![vec![vec![0.0; support * joints]; rows]; form.equations()],
            rounding: vec![vec![0.0; rows]; form.equations()],
            input_overlap: (0..=bandwidth)
                .map(|lag| weights.get(lag * stride..).map_or(0.0, |shifted| dot(weights, shifted)))
                .collect(),
            support,
            unscaled: vec![0.0; support * joints],
            scratch: vec![0.0; ErrorWeights::room(&form.kernels, form.velocity.half)],
        }
    }

    /// Neighbours that a row correlates with.
    pub fn bandwidth(&self) -> usize {
        self.input_overlap.len() - 1
    }

    /// c of a row with respect to a joint's positions, times their standard deviations.
    #[inline]
    pub fn sensitivity(&self, equation: usize, row: usize, joint: usize) -> &[f64] {
        &self.sensitivity[equation][row][joint * self.support..(joint + 1) * self.support]
    }

    /// Variance of the rounding of an equation's input within a window.
    pub fn rounding(&self, equation: usize, row: usize) -> f64 {
        self.rounding[equation][row]
    }

    /// c of a row, joint after joint.
    pub fn unscaled<P: Plant>(&mut self, block: &MeasuredBlock<P>, equation: usize, row: usize) -> &[f64] {
        let first = first_position(block, &block.samples.windows.all()[row]);
        let joints = self.unscaled.chunks_exact_mut(self.support).zip(&block.noise.q_std);
        for ((own, std), scaled) in joints.zip(self.sensitivity[equation][row].chunks_exact(self.support)) {
            for ((slope, c), std) in own.iter_mut().zip(scaled).zip(&std[first..]) {
                *slope = c / std.max(EXACT_STD);
            }
        }
        &self.unscaled
    }

    /// Makes R of an equation at θ.
    pub fn make<P: Plant>(&mut self, block: &MeasuredBlock<P>, e: usize, theta: &[f64], whitening: &mut Whitening) {
        self.differentiate(block, e, theta);
        whitening.begin(block.samples.windows.len());
        let input = InputNoise::new(block, e);
        for i in 0..block.samples.windows.len() {
            self.weigh_positions(block, e, i, theta);
            self.rounding[e][i] = input_rounding(block, e, i);
            for lag in 0..=self.bandwidth().min(i) {
                // the geometric mean of both windows' rounding; 0 if the input is not rounded
                let rounding = (self.rounding[e][i] * self.rounding[e][i - lag]).sqrt();
                let covariance = self.covariance(block, e, (i, i - lag), &input, rounding);
                whitening.add(i, lag, covariance);
            }
        }
    }

    /// ∂g/∂q and ∂g/∂q̇ of an equation's nonlinear part at every sample that a window holds:
    /// differentiated at some, and on straight lines between these, since c are weights only.
    fn differentiate<P: Plant>(&mut self, block: &MeasuredBlock<P>, e: usize, theta: &[f64]) {
        let (form, signals) = (&block.form, &block.samples.signals);
        let (polynomial, sensitivity) = (form.separation.equations[e].as_ref(), &form.separation.sensitivities[e]);
        let covered = block.samples.windows.covered();
        let step = (form.kernels.half / SLOPES_PER_HALF).max(1);
        let all = sensitivity
            .kinds
            .chunks(LANES)
            .zip(sensitivity.derivatives.chunks(LANES));
        for (kinds, derivatives) in all {
            let mut linear = [[0.0; MAX_ORDER + 1]; LANES];
            for (linear, &kind) in linear.iter_mut().zip(kinds) {
                *linear = linear_in_velocity(polynomial, kind, theta);
            }
            let mut partials = Partials::new(&form.plant, e, theta, kinds);
            let last = covered.clone().next_back();
            let mut before = covered.start;
            for at in covered.clone().step_by(step).chain(last) {
                let slopes = partials.at(|joint| (signals.q[joint][at], signals.dq[joint][at]));
                for (lane, (&kind, slopes)) in kinds.iter().zip(slopes).enumerate() {
                    let slopes = nonlinear(slopes, &linear[lane]);
                    for d in derivatives[lane].clone() {
                        draw_line(&mut self.slopes[place(kind)][d][before..=at], slopes[d]);
                    }
                }
                before = at;
            }
        }
    }

    /// c of row i, times the standard deviation of each position.
    fn weigh_positions<P: Plant>(&mut self, block: &MeasuredBlock<P>, e: usize, i: usize, theta: &[f64]) {
        let form = &block.form;
        let weights = ErrorWeights {
            kernels: &form.kernels,
            transposed: &form.velocity.transposed,
            polynomial: form.separation.equations[e].as_ref(),
            sensitivity: &form.separation.sensitivities[e],
        };
        let window = &block.samples.windows.all()[i];
        let (c, all) = (&mut self.sensitivity[e][i], &self.slopes);
        let span = window.centre - form.kernels.half..=window.centre + form.kernels.half;
        let slopes = |kind: Kind, d: usize| &all[place(kind)][d][span.clone()];
        weights.write(theta, slopes, &mut self.scratch, c);
        let first = first_position(block, window);
        for (own, std) in c.chunks_exact_mut(self.support).zip(&block.noise.q_std) {
            let own = own.iter_mut().zip(&std[first..]);
            own.for_each(|(c, std)| *c *= std.max(EXACT_STD));
        }
    }

    /// R of two rows, the later one first; `rounding` is that of their inputs.
    fn covariance<P: Plant>(
        &self,
        block: &MeasuredBlock<P>,
        e: usize,
        (i, j): (usize, usize),
        input: &InputNoise,
        rounding: f64,
    ) -> f64 {
        let (kernels, gain) = (&block.form.kernels, input.scale * input.scale);
        let (window, earlier) = (&block.samples.windows.all()[i], &block.samples.windows.all()[j]);
        let distance = (window.number - earlier.number) as usize;
        let strides = distance / block.samples.windows.stride;
        let mut sum =
            self.input_overlap.get(strides).unwrap_or(&0.0) * input.scale * input.scale * (input.variance + rounding);
        if distance < self.support {
            for joint in 0..block.samples.signals.joints() {
                let (c_i, c_j) = (self.sensitivity(e, i, joint), self.sensitivity(e, j, joint));
                sum += dot(&c_i[..self.support - distance], &c_j[distance..]);
            }
        }
        if strides > self.bandwidth() {
            return sum;
        }
        let (from, earlier_from) = (window.centre - kernels.input_half, earlier.centre - kernels.input_half);
        let len = 2 * kernels.input_half + 1;
        for &(at, size) in block.jumps.within(input.number, from, len) {
            if let Some(weight) = kernels.jump[0].get(at - earlier_from) {
                let error = input.jump_error * size;
                let variance = 5.0 * input.std * input.std + error * error;
                sum += gain * kernels.jump[0][at - from] * weight * variance;
            }
        }
        for &(at, variance) in within(&block.noise.surplus[input.number], from, len) {
            if let Some(weight) = kernels.input[0].get(at - earlier_from) {
                sum += gain * kernels.input[0][at - from] * weight * variance;
            }
        }
        sum
    }
}

/// What is known of an equation's input in a block.
struct InputNoise {
    number: usize,
    /// s.
    scale: f64,
    /// σ_u², and what is put in its place for exact signals.
    variance: f64,
    std: f64,
    /// What a jump's size is known to, relative to it.
    jump_error: f64,
}

impl InputNoise {
    fn new<P: Plant>(block: &MeasuredBlock<P>, e: usize) -> Self {
        let (number, scale) = block.form.input(e);
        let std = block.noise.input_std(number);
        Self {
            number,
            scale,
            variance: input_variance(block, e),
            std,
            jump_error: if std > 0.0 { 1e-3 } else { 1e-5 },
        }
    }
}

/// A straight line from the first of some values, as it stands, to their last one.
#[inline]
fn draw_line(values: &mut [f64], last: f64) {
    let (first, steps) = (values[0], values.len() - 1);
    let rise = (last - first) / steps.max(1) as f64;
    for (k, value) in values[..steps].iter_mut().enumerate() {
        *value = first + rise * k as f64;
    }
    values[steps] = last;
}

/// Place of a signal among the slopes.
fn place(kind: Kind) -> usize {
    2 * kind.joint + usize::from(kind.velocity)
}

/// Buffer position of the first sample that a row depends on.
pub(super) fn first_position<P: Plant>(block: &MeasuredBlock<P>, window: &Window) -> usize {
    window.centre - block.form.kernels.half - block.form.velocity.half
}

/// Variance of an equation's input; exact signals are exact to rounding and quadrature only.
fn input_variance<P: Plant>(block: &MeasuredBlock<P>, e: usize) -> f64 {
    let (input, len) = (block.form.input(e).0, block.samples.len);
    let u = &block.samples.signals.u[input][..len];
    let mean_square = dot(u, u) / len.max(1) as f64;
    block.noise.sensors.input_noise[input].powi(2) + EXACT * EXACT * mean_square.max(EXACT)
}

/// Variance of the rounding of an equation's input to counts over a window, 0 without: white if
/// it crosses counts, and correlated if it creeps, as for positions.
fn input_rounding<P: Plant>(block: &MeasuredBlock<P>, e: usize, row: usize) -> f64 {
    let (input, half) = (block.form.input(e).0, block.form.kernels.input_half);
    let count = block.noise.sensors.input_resolution[input];
    if !(count > 0.0) {
        return 0.0;
    }
    let centre = block.samples.windows.all()[row].centre;
    let u = &block.samples.signals.u[input][centre - half..=centre + half];
    let steps: f64 = u.windows(2).map(|pair| (pair[1] - pair[0]).abs().min(count)).sum();
    let rate = steps / (u.len() as f64 * count);
    count * count / 12.0 * (rounding::BEAT / rate).clamp(1.0, rounding::limit(block.form.kernels.half))
}
