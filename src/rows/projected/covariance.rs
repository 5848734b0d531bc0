//! Covariance of the rows of one equation, from the noise of the samples that they share.
//!
//! ```text
//! R_ij = Σ_k c_i(k) c_j(k) σ_q²(k) + s² σ_u² Σ_k w_i(k) w_j(k) + jumps        c_i(k) = −∂f_i/∂q_k
//! ```
//!
//! w are the weights of the input (`kernel.rs`), c those of the positions (`error_weights.rs`) at
//! θ̂ before the block, and through the instants of reversals (`reversal_errors.rs`). A jump
//! of the input is known to 5 σ_u² and a thousandth of its size; an input that was replaced, or
//! that jumped between two samples, has additional variance.

use super::input_jumps::within;
use super::measured::MeasuredBlock;
use super::reversal_errors::Placed;
use super::sample_noise::EXACT;
use super::windows::Window;
use crate::rows::error_weights::{ErrorWeights, linear_in_velocity, nonlinear};
use crate::rows::kernel::dot;
use crate::rows::partials::{Kind, LANES, Partials};
use crate::rows::passes::Terms;
use crate::rows::rounding;
use crate::rows::standstill::motion_needed;
use crate::rows::theta_polynomial::MAX_ORDER;
use crate::rows::whitening::Whitening;
use std::ops::Range;

/// Evaluations of the slopes on either side of a window's centre.
const SLOPES_PER_HALF: usize = 16;

/// R of each equation in turn, and the sensitivities from which it is computed.
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
    /// Number of positions per joint in the list of a row.
    support: usize,
    /// Those positions that the row depends on \[equation\]\[joint\].
    spans: Vec<Vec<Range<usize>>>,
    /// Scratch: c of the terms that are the same in every row, and the data of the others.
    linear: Vec<f64>,
    scratch: Vec<f64>,
    /// Scratch: the jumps of an equation's terms at the reversals.
    jumps: Vec<Terms>,
}

impl RowCovariance {
    /// Workspace for `rows` rows of each equation of a block.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
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
            spans: (0..)
                .zip(motion_needed(&*form.plant))
                .map(|(e, moving)| {
                    // the instant of a reversal depends on a filter's length of positions
                    let span = |joint: usize| match moving >> joint & 1 {
                        1 => 0..support,
                        _ => form.span(e, joint),
                    };
                    (0..joints).map(span).collect()
                })
                .collect(),
            linear: vec![0.0; support * joints],
            scratch: vec![0.0; ErrorWeights::room(&form.kernels, form.velocity.half)],
            jumps: Vec::with_capacity(block.reversals.room()),
        }
    }

    /// Number of neighbours with which a row correlates.
    pub fn bandwidth(&self) -> usize {
        self.input_overlap.len() - 1
    }

    /// c of a row with respect to a joint's positions, times their standard deviations, and the
    /// buffer position of the first of them.
    #[inline]
    pub fn sensitivity(&self, block: &MeasuredBlock, equation: usize, row: usize, joint: usize) -> (&[f64], usize) {
        let window = &block.samples.windows.all()[row];
        let first = window.centre - block.form.kernels.half - block.form.velocity.half;
        let span = &self.spans[equation][joint];
        let c = &self.sensitivity[equation][row][joint * self.support..];
        (&c[span.clone()], first + span.start)
    }

    /// Variance of an equation's input within a window.
    pub fn input_variance(&self, block: &MeasuredBlock, equation: usize, row: usize) -> f64 {
        let input = block.form.input(equation).0;
        block.noise.sensors.input_noise[input].powi(2) + self.rounding[equation][row]
    }

    /// Residual of a row that errors of the positions cause, Σ_k c(k) error(k); `errors` are in
    /// standard deviations \[joint\]\[sample\].
    pub fn residual(&self, block: &MeasuredBlock, equation: usize, row: usize, errors: &[Vec<f64>]) -> f64 {
        let of_joint = |(joint, errors): (usize, &Vec<f64>)| {
            let (c, first) = self.sensitivity(block, equation, row, joint);
            dot(c, &errors[first..first + c.len()])
        };
        errors.iter().enumerate().map(of_joint).sum()
    }

    /// Errors += `factor` Cᵀ R⁻¹ f from the rows of an equation, in standard deviations
    /// \[joint\]\[sample\]; `weighted` is R⁻¹ f.
    pub fn add_errors(
        &self,
        block: &MeasuredBlock,
        equation: usize,
        weighted: &[f64],
        factor: f64,
        errors: &mut [Vec<f64>],
    ) {
        for (i, weighted) in weighted.iter().enumerate() {
            for (joint, errors) in errors.iter_mut().enumerate() {
                let (c, first) = self.sensitivity(block, equation, i, joint);
                for (error, c) in errors[first..].iter_mut().zip(c) {
                    *error += factor * weighted * c;
                }
            }
        }
    }

    /// The same for errors of the inputs, whose jumps are left out.
    pub fn input_residual(&self, block: &MeasuredBlock, equation: usize, row: usize, errors: &[Vec<f64>]) -> f64 {
        let (input, scale) = block.form.input(equation);
        let from = block.samples.windows.all()[row].centre - block.form.kernels.input_half;
        let kernel = &block.form.kernels.input[0];
        let std = self.input_variance(block, equation, row).sqrt();
        scale * std * dot(kernel, &errors[input][from..from + kernel.len()])
    }

    /// As [`add_errors`](Self::add_errors) for those of the inputs.
    pub fn add_input_errors(
        &self,
        block: &MeasuredBlock,
        equation: usize,
        weighted: &[f64],
        factor: f64,
        errors: &mut [Vec<f64>],
    ) {
        let (input, scale) = block.form.input(equation);
        let kernel = &block.form.kernels.input[0];
        for (i, weighted) in weighted.iter().enumerate() {
            let from = block.samples.windows.all()[i].centre - block.form.kernels.input_half;
            let moved = factor * scale * self.input_variance(block, equation, i).sqrt() * weighted;
            let errors = errors[input][from..].iter_mut().zip(kernel);
            errors.for_each(|(error, weight)| *error += moved * weight);
        }
    }

    /// Covariance of rows of two equations, (equation, row) each: that of the positions, and of the
    /// input if it is the same.
    pub fn shared(&self, block: &MeasuredBlock, (e, i): (usize, usize), (other, j): (usize, usize)) -> f64 {
        let of_joint = |joint: usize| {
            let (c_i, from_i) = self.sensitivity(block, e, i, joint);
            let (c_j, from_j) = self.sensitivity(block, other, j, joint);
            let from = from_i.max(from_j);
            let (c_i, c_j) = (c_i.get(from - from_i..), c_j.get(from - from_j..));
            let both = c_i.unwrap_or_default().iter().zip(c_j.unwrap_or_default());
            both.map(|(a, b)| a * b).sum::<f64>()
        };
        let positions: f64 = (0..block.form.plant.joints()).map(of_joint).sum();
        let ((input, scale), (other_input, other_scale)) = (block.form.input(e), block.form.input(other));
        if input != other_input {
            return positions;
        }
        let windows = block.samples.windows.all();
        let strides = windows[i].number.abs_diff(windows[j].number) as usize / block.samples.windows.stride;
        let overlap = self.input_overlap.get(strides).unwrap_or(&0.0);
        let variances = self.input_variance(block, e, i) * self.input_variance(block, other, j);
        positions + scale * other_scale * overlap * variances.sqrt()
    }

    /// Computes R of an equation at θ.
    pub fn make(&mut self, block: &MeasuredBlock, e: usize, theta: &[f64], whitening: &mut Whitening) {
        self.differentiate(block, e, theta);
        error_weights(block, e).write_linear(theta, &mut self.linear);
        let signals = &block.samples.signals;
        block.reversals.jumps(&block.form, signals, e, theta, &mut self.jumps);
        whitening.begin(block.samples.windows.len());
        let input = InputNoise::new(block, e);
        for i in 0..block.samples.windows.len() {
            self.weigh_positions(block, e, i);
            self.rounding[e][i] = input_rounding(block, e, i);
            let odd = input.odd_within(block, &block.samples.windows.all()[i]);
            for lag in 0..=self.bandwidth().min(i) {
                // the geometric mean of both windows' rounding; 0 if the input is not rounded
                let rounding = (self.rounding[e][i] * self.rounding[e][i - lag]).sqrt();
                let covariance = self.covariance(block, e, (i, i - lag), &input, &odd, rounding);
                whitening.add(i, lag, covariance);
            }
        }
    }

    /// ∂g/∂q and ∂g/∂q̇ of an equation's nonlinear part at every sample of a window: differentiated
    /// at some, and interpolated linearly between these, because c serves only as weights.
    fn differentiate(&mut self, block: &MeasuredBlock, e: usize, theta: &[f64]) {
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
            let mut partials = Partials::new(&*form.plant, e, theta, kinds);
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
    fn weigh_positions(&mut self, block: &MeasuredBlock, e: usize, i: usize) {
        let form = &block.form;
        let window = &block.samples.windows.all()[i];
        let (c, all) = (&mut self.sensitivity[e][i], &self.slopes);
        let span = window.centre - form.kernels.half..=window.centre + form.kernels.half;
        let slopes = |kind: Kind, d: usize| &all[place(kind)][d][span.clone()];
        error_weights(block, e).write(&self.linear, slopes, &mut self.scratch, c);
        let first = window.centre - form.kernels.half - form.velocity.half;
        let placed = Placed {
            kernels: &form.kernels.position,
            first: *span.start(),
        };
        block.reversals.add(&self.jumps, &placed, c, (self.support, first));
        let joints = c.chunks_exact_mut(self.support).zip(&self.spans[e]);
        for ((own, span), std) in joints.zip(&block.noise.q_std) {
            let own = own[span.clone()].iter_mut().zip(&std[first + span.start..]);
            own.for_each(|(c, std)| *c *= std);
        }
    }

    /// R of two rows, the later one first, which has these `odd` inputs; `rounding` is the rounding
    /// variance of their inputs.
    fn covariance(
        &self,
        block: &MeasuredBlock,
        e: usize,
        (i, j): (usize, usize),
        input: &InputNoise,
        odd: &OddInputs<'_>,
        rounding: f64,
    ) -> f64 {
        let kernels = &block.form.kernels;
        let (window, earlier) = (&block.samples.windows.all()[i], &block.samples.windows.all()[j]);
        let distance = (window.number - earlier.number) as usize;
        let strides = distance / block.samples.windows.stride;
        let mut sum =
            self.input_overlap.get(strides).unwrap_or(&0.0) * input.scale * input.scale * (input.variance + rounding);
        let both = self.sensitivity[e][i]
            .chunks_exact(self.support)
            .zip(self.sensitivity[e][j].chunks_exact(self.support));
        for ((c_i, c_j), span) in both.zip(&self.spans[e]) {
            if distance < span.len() {
                sum += dot(
                    &c_i[span.start..span.end - distance],
                    &c_j[span.start + distance..span.end],
                );
            }
        }
        if strides > self.bandwidth() {
            return sum;
        }
        let gain = input.scale * input.scale;
        let (from, earlier_from) = (window.centre - kernels.input_half, earlier.centre - kernels.input_half);
        for &(at, size) in odd.jumps {
            if let Some(weight) = kernels.jump[0].get(at - earlier_from) {
                let error = input.jump_error * size;
                let variance = 5.0 * input.std * input.std + error * error;
                sum += gain * kernels.jump[0][at - from] * weight * variance;
            }
        }
        for &(at, variance) in odd.surplus {
            if let Some(weight) = kernels.input[0].get(at - earlier_from) {
                sum += gain * kernels.input[0][at - from] * weight * variance;
            }
        }
        sum
    }
}

/// Inputs of a window that need separate treatment: jumps with their sizes, and those with
/// additional variance.
struct OddInputs<'a> {
    jumps: &'a [(usize, f64)],
    surplus: &'a [(usize, f64)],
}

/// Noise of an equation's input in a block.
struct InputNoise {
    number: usize,
    /// s.
    scale: f64,
    /// σ_u², or its replacement for exact signals.
    variance: f64,
    std: f64,
    /// Relative standard deviation of a jump's size.
    jump_error: f64,
}

impl InputNoise {
    fn new(block: &MeasuredBlock, e: usize) -> Self {
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

    fn odd_within<'a>(&self, block: &'a MeasuredBlock, window: &Window) -> OddInputs<'a> {
        let half = block.form.kernels.input_half;
        let (from, len) = (window.centre - half, 2 * half + 1);
        OddInputs {
            jumps: block.jumps.within(self.number, from, len),
            surplus: within(&block.noise.surplus[self.number], from, len),
        }
    }
}

/// Fills `values` with a straight line from its first value to `last`.
#[inline]
fn draw_line(values: &mut [f64], last: f64) {
    let Some((end, values)) = values.split_last_mut() else {
        return;
    };
    *end = last;
    let Some((&mut first, between)) = values.split_first_mut() else {
        return;
    };
    let rise = (last - first) / (between.len() + 1) as f64;
    let mut steps = 0.0;
    for value in between {
        steps += 1.0;
        *value = first + rise * steps;
    }
}

/// Index of a signal among the slopes.
fn place(kind: Kind) -> usize {
    2 * kind.joint + usize::from(kind.velocity)
}

/// The data for c of an equation.
fn error_weights(block: &MeasuredBlock, e: usize) -> ErrorWeights<'_> {
    let form = &block.form;
    ErrorWeights {
        kernels: &form.kernels,
        transposed: &form.velocity.transposed,
        polynomial: form.separation.equations[e].as_ref(),
        sensitivity: &form.separation.sensitivities[e],
    }
}

/// Variance of an equation's input; exact signals are only exact to within rounding and quadrature.
fn input_variance(block: &MeasuredBlock, e: usize) -> f64 {
    let (input, len) = (block.form.input(e).0, block.samples.len);
    let u = &block.samples.signals.u[input][..len];
    let mean_square = dot(u, u) / len.max(1) as f64;
    block.noise.sensors.input_noise[input].powi(2) + EXACT * EXACT * mean_square.max(EXACT)
}

/// Variance of the rounding of an equation's input to counts over a window, 0 without rounding:
/// white if the input crosses counts, and correlated if it creeps, as for positions.
fn input_rounding(block: &MeasuredBlock, e: usize, row: usize) -> f64 {
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
