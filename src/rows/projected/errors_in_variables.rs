//! Errors in variables: positions minus their errors as estimated from the residuals.
//!
//! ```text
//! n̂ = E[n | f] = −Σ_q Cᵀ R⁻¹ f(θ̄)        q̂ = q − n̂
//! ```
//!
//! C holds the c_i = −∂f_i/∂q, R is the covariance of the rows of all equations (`covariance.rs`,
//! `shared_errors.rs`), θ̄ is θ̂ before the block. The head of `projected/mod.rs` explains the use.

use super::covariance::RowCovariance;
use super::measured::MeasuredBlock;
use super::reversals;
use super::shared_errors::SharedErrors;
use crate::rows::standstill::Standstill;
use crate::rows::trajectory::Trajectory;
use crate::rows::whitening::Whitening;

/// Limit of the estimated error of a position, in its standard deviations.
const LARGEST_ERROR: f64 = 3.0;

/// The smoothed signals of a block.
#[derive(Debug, Clone)]
pub(super) struct SmoothedSignals {
    signals: Trajectory,
    /// True if the rows use the smoothed signals.
    applied: bool,
    /// Scratch: z of `shared_errors.rs`, then R⁻¹ f \[equation\]\[row\].
    weighted: Vec<Vec<f64>>,
}

impl SmoothedSignals {
    /// Workspace for a block and `rows` rows of each equation.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
        let (features, capacity) = (block.form.separation.features, block.samples.capacity());
        Self {
            signals: Trajectory::new(block.form.plant.joints(), features, capacity),
            applied: false,
            weighted: vec![vec![0.0; rows]; block.form.equations()],
        }
    }

    /// The signals of the rows: smoothed ones if they exist, otherwise those measured.
    pub fn or<'a>(&'a self, measured: &'a Trajectory) -> &'a Trajectory {
        if self.applied { &self.signals } else { measured }
    }

    /// True if the rows use the smoothed signals.
    pub fn exist(&self) -> bool {
        self.applied
    }

    /// Returns to the measured signals.
    pub fn forget(&mut self) {
        self.applied = false;
    }

    /// Estimates the errors from the residuals of all equations, which are whitened forwards:
    /// −n̂/σ_q = σ_q Σ_i c_i (R⁻¹ f)_i in place of the positions, and û.
    pub fn estimate<'a>(
        &mut self,
        block: &MeasuredBlock,
        covariance: &RowCovariance,
        whitening: &[Whitening],
        shared: &mut SharedErrors,
        residuals: impl Fn(usize) -> &'a [f64],
    ) {
        let (own, samples) = (&mut self.signals, &block.samples);
        own.q.iter_mut().for_each(|errors| errors[..samples.len].fill(0.0));
        for (own, measured) in own.u.iter_mut().zip(&samples.signals.u) {
            own[..samples.len].copy_from_slice(&measured[..samples.len]);
        }
        let windows = samples.windows.all();
        for (e, weighted) in self.weighted.iter_mut().enumerate() {
            weighted[..windows.len()].copy_from_slice(&residuals(e)[..windows.len()]);
        }
        shared.compare(block, covariance, whitening);
        shared.solve(block, covariance, whitening, &mut self.weighted);
        for (e, weighted) in self.weighted.iter_mut().enumerate() {
            let weighted = &mut weighted[..windows.len()];
            whitening[e].apply_transposed(weighted);
            covariance.add_errors(block, e, weighted, 1.0, &mut self.signals.q);
            let (input, scale) = block.form.input(e);
            let kernel = &block.form.kernels.input[0];
            for (i, window) in windows.iter().enumerate() {
                let moved = covariance.input_variance(block, e, i) * scale * weighted[i];
                let from = window.centre - block.form.kernels.input_half;
                let u = &mut self.signals.u[input][from..from + kernel.len()];
                u.iter_mut().zip(kernel).for_each(|(u, weight)| *u -= moved * weight);
            }
        }
    }

    /// Limits the estimated errors, subtracts them from the positions, and computes velocities and
    /// features of the result.
    pub fn finish(&mut self, block: &MeasuredBlock, standstill: &Standstill) {
        let (covered, len) = (block.samples.windows.covered(), block.samples.len);
        if covered.is_empty() {
            return;
        }
        for (joint, q) in self.signals.q.iter_mut().enumerate() {
            let measured = block.samples.signals.q[joint].iter().zip(&block.noise.q_std[joint]);
            for (q, (measured, std)) in q[..len].iter_mut().zip(measured) {
                *q = measured + std * q.clamp(-LARGEST_ERROR, LARGEST_ERROR);
            }
        }
        block.form.differentiate(&mut self.signals, covered.clone());
        self.signals.turns.clear();
        let std = |joint: usize| block.noise.sensors.deviations(joint)[0];
        reversals::correct(&block.form, standstill, &mut self.signals, std, covered, |_| {});
        self.applied = true;
    }
}
