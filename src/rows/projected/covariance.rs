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
use crate::model::{MAX_JOINTS, Plant};
use crate::rows::error_weights::{ErrorWeights, linear_in_velocity, nonlinear};
use crate::rows::kernel::dot;
use crate::rows::rounding;
use crate::rows::separation::{MAX_ORDER, partials};
use crate::rows::suspects::SuspectColumns;
use crate::rows::whitening::Whitening;

/// R of each equation in turn, and the sensitivities that it is made of.
#[derive(Debug, Clone)]
pub(super) struct RowCovariance {
    /// ∂g/∂q and ∂g/∂q̇ of the nonlinear terms \[2 joint + (0 position, 1 velocity)\]\[sample\].
    slopes: Vec<Vec<[f64; MAX_ORDER + 1]>>,
    /// c_i of every row \[equation\]\[row\], times the standard deviation of each position.
    sensitivity: Vec<Vec<Vec<f64>>>,
    /// Variance of the rounding of each equation's input within each window \[equation\]\[row\].
    rounding: Vec<Vec<f64>>,
    /// Σ_k w_i(k) w_j(k) for windows a number of strides apart.
    input_overlap: Vec<f64>,
    /// Positions of each joint that a row depends on.
    support: usize,
    /// Scratch: c of one row.
    unscaled: Vec<f64>,
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
            slopes: vec![vec![[0.0; MAX_ORDER + 1]; block.samples.capacity()]; 2 * joints],
            sensitivity: vec![vec![vec![0.0; support * joints]; rows]; form.equations()],
            rounding: vec![vec![0.0; rows]; form.equations()],
            input_overlap: (0..=bandwidth)
                .map(|lag| weights.get(lag * stride..).map_or(0.0, |shifted| dot(weights, shifted)))
                .collect(),
            support,
            unscaled: vec![0.0; support * joints],
        }
    }

    /// Neighbours that a row correlates with.
    pub fn bandwidth(&self) -> usize {
        self.input_overlap.len() - 1
    }

    /// c of a row with respect to a joint's positions, times their standard deviations.
    pub fn sensitivity(&self, equation: usize, row: usize, joint: usize) -> &[f64] {
        &self.sensitivity[equation][row][joint * self.support..(joint + 1) * self.support]
    }

    /// Variance of the rounding of an equation's input within a window.
    pub fn rounding(&self, equation: usize, row: usize) -> f64 {
        self.rounding[equation][row]
    }

    /// c of a row, joint after joint; `None` if a position is exact.
    pub fn unscaled<P: Plant>(&mut self, block: &MeasuredBlock<P>, equation: usize, row: usize) -> Option<&[f64]> {
        let first = first_position(block, &block.samples.windows.all()[row]);
        let mut noisy = true;
        for (joint, std) in block.noise.q_std.iter().enumerate() {
            let own = joint * self.support..(joint + 1) * self.support;
            let std = &std[first..first + self.support];
            let scaled = self.sensitivity[equation][row][own.clone()].iter().zip(std);
            for (slope, (c, std)) in self.unscaled[own].iter_mut().zip(scaled) {
                *slope = c / std;
                noisy &= *std > 0.0;
            }
        }
        noisy.then_some(&self.unscaled)
    }

    /// Makes R of an equation at θ, and the columns of errors that turn the positions on the way.
    pub fn make<P: Plant>(
        &mut self,
        block: &MeasuredBlock<P>,
        e: usize,
        theta: &[f64],
        whitening: &mut Whitening,
        suspects: &mut SuspectColumns,
    ) {
        self.differentiate(block, e, theta);
        whitening.begin(block.samples.windows.len());
        let own_variance = input_variance(block, e);
        for i in 0..block.samples.windows.len() {
            self.weigh_positions(block, e, i, theta, suspects);
            self.rounding[e][i] = input_rounding(block, e, i);
            for lag in 0..=self.bandwidth().min(i) {
                // the geometric mean of both windows' rounding; 0 if the input is not rounded
                let rounding = (self.rounding[e][i] * self.rounding[e][i - lag]).sqrt();
                let covariance = self.covariance(block, e, (i, i - lag), own_variance + rounding);
                whitening.add(i, lag, covariance);
            }
        }
    }

    /// ∂g/∂q and ∂g/∂q̇ of an equation's nonlinear part at every sample that a window holds.
    fn differentiate<P: Plant>(&mut self, block: &MeasuredBlock<P>, e: usize, theta: &[f64]) {
        let (form, signals) = (&block.form, &block.samples.signals);
        for (joint, velocity) in form.separation.sensitivities[e].kinds() {
            let linear = linear_in_velocity(form.separation.equations[e].as_ref(), joint, velocity, theta);
            let slopes = &mut self.slopes[2 * joint + usize::from(velocity)];
            for at in block.samples.windows.covered() {
                let mut q = [0.0; MAX_JOINTS];
                let mut dq = [0.0; MAX_JOINTS];
                for j in 0..signals.joints() {
                    (q[j], dq[j]) = (signals.q[j][at], signals.dq[j][at]);
                }
                slopes[at] = nonlinear(partials(&form.plant, e, &q, &dq, theta, joint, velocity), &linear);
            }
        }
    }

    /// c of row i, times the standard deviation of each position.
    fn weigh_positions<P: Plant>(
        &mut self,
        block: &MeasuredBlock<P>,
        e: usize,
        i: usize,
        theta: &[f64],
        suspects: &mut SuspectColumns,
    ) {
        let form = &block.form;
        let weights = ErrorWeights {
            kernels: &form.kernels,
            velocity_weights: &form.velocity.weights,
            polynomial: form.separation.equations[e].as_ref(),
            sensitivity: &form.separation.sensitivities[e],
            order: form.plant.equations()[e].order,
        };
        let window = &block.samples.windows.all()[i];
        let (c, all) = (&mut self.sensitivity[e][i], &self.slopes);
        let start = window.centre - form.kernels.half;
        let slopes = |joint: usize, velocity: bool, k: usize| all[2 * joint + usize::from(velocity)][start + k];
        weights.write(theta, slopes, c);
        let first = first_position(block, window);
        suspects.turn(e, i, c, self.support, first);
        for (own, std) in c.chunks_exact_mut(self.support).zip(&block.noise.q_std) {
            own.iter_mut().zip(&std[first..]).for_each(|(c, std)| *c *= std);
        }
    }

    /// R of two rows, the later one first.
    fn covariance<P: Plant>(
        &self,
        block: &MeasuredBlock<P>,
        e: usize,
        (i, j): (usize, usize),
        input_variance: f64,
    ) -> f64 {
        let kernels = &block.form.kernels;
        let (input, scale) = block.form.input(e);
        let (window, earlier) = (&block.samples.windows.all()[i], &block.samples.windows.all()[j]);
        let distance = (window.number - earlier.number) as usize;
        let strides = distance / block.samples.windows.stride;
        let mut sum = self.input_overlap.get(strides).unwrap_or(&0.0) * scale * scale * input_variance;
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
        let noise = block.noise.input_std(input);
        let relative = if noise > 0.0 { 1e-3 } else { 1e-5 };
        for &(at, size) in block.jumps.within(input, from, len) {
            if let Some(weight) = kernels.jump[0].get(at - earlier_from) {
                let variance = 5.0 * noise * noise + (relative * size) * (relative * size);
                sum += scale * scale * kernels.jump[0][at - from] * weight * variance;
            }
        }
        for &(at, variance) in within(&block.noise.surplus[input], from, len) {
            if let Some(weight) = kernels.input[0].get(at - earlier_from) {
                sum += scale * scale * kernels.input[0][at - from] * weight * variance;
            }
        }
        sum
    }
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
    count * count / 12.0 * (rounding::BEAT / rate).clamp(1.0, rounding::LIMIT)
}
