//! The noise of the input that the column of a resonance shares with the residuals.
//!
//! ```text
//! d = s ∫ψ″ û,   û = u − σ_u² s Wᵀ R⁻¹ f            smoothed input, `errors_in_variables.rs`          (1)
//! τ = s² Σ_ij (R⁻¹)_ij σ_u² Σ_k w″_i(k) w_j(k)      E[d_uᵀ R⁻¹ f], d_u = s ∫ψ″ u                     (2)
//! η = (d_u − d)ᵀ R⁻¹ f                              what smoothing removes of it                      (3)
//! d ← d_u − α (d_u − d),   α = Σ τ/Σ η              over the blocks                                   (4)
//! ```
//!
//! With the measured input u, the score of a resonance has the mean τ, which is negative in every
//! block, because the input's noise is in the residual, too. τ depends on no other noise. Smoothing
//! removes it if R is right. But R is too large while a joint rests, because the rounding of its
//! position is then constant. So η is too small there, and through 16 bits a fifth to a half of τ
//! remained: after thirty blocks, a right model was said to lack a resonance in every fourth run of
//! `docs/trials.md`. (4) makes smoothing remove τ.

use super::covariance::RowCovariance;
use super::measured::MeasuredBlock;
use crate::rows::kernel::dot;
use crate::rows::whitening::{Direction, Whitening};

/// Share of Σ τ and Σ η that is left after a block: a memory of about fifty blocks, as that of the
/// scores.
const MEMORY: f64 = 0.98;
/// Range of α. Arms of `docs/trials.md` have 1.0 to 3.1; further off, the residuals are not noise.
const ALPHA: (f64, f64) = (0.2, 5.0);

/// The sums of one equation.
#[derive(Debug, Clone)]
pub(super) struct ColumnNoise {
    /// Σ_k w″_i(k) w_j(k) of windows a number of strides apart.
    overlap: Vec<f64>,
    /// Σ τ and Σ η.
    expected: f64,
    removed: f64,
    /// u − û of the block's samples, and σ_u² of its rows.
    noise: Vec<f64>,
    variances: Vec<f64>,
    /// d_u − d of its rows, and the same whitened.
    difference: Vec<f64>,
    white: Vec<f64>,
    rows: usize,
}

impl ColumnNoise {
    /// Workspace for `rows` rows.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
        let [value, _, bend] = &block.form.kernels.input;
        let shifts = (0..value.len()).step_by(block.samples.windows.stride);
        Self {
            // both are symmetric about one instant, so the order of the windows does not matter
            overlap: shifts.map(|shift| dot(bend, &value[shift..])).collect(),
            expected: 0.0,
            removed: 0.0,
            noise: vec![0.0; block.samples.capacity()],
            variances: vec![0.0; rows],
            difference: vec![0.0; rows],
            white: vec![0.0; rows],
            rows: 0,
        }
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        (self.expected, self.removed) = (0.0, 0.0);
    }

    /// Computes d_u − d of a block from its measured and its `smoothed` inputs.
    pub fn compare(&mut self, block: &MeasuredBlock, e: usize, smoothed: &[Vec<f64>]) {
        let ((input, scale), kernels) = (block.form.input(e), &block.form.kernels);
        let windows = block.samples.windows.all();
        self.rows = windows.len();
        let inputs = block.samples.signals.u[input].iter().zip(&smoothed[input]);
        let noise = self.noise[..block.samples.len].iter_mut().zip(inputs);
        noise.for_each(|(noise, (u, smoothed))| *noise = u - smoothed);
        for (difference, window) in self.difference.iter_mut().zip(windows) {
            let span = window.centre - kernels.input_half..=window.centre + kernels.input_half;
            // the jumps of both inputs are the same
            *difference = scale * dot(&kernels.input[2], &self.noise[span]);
        }
    }

    /// Adds τ and η of the block (2), (3). `residuals` are those that the input was smoothed with,
    /// whitened forwards.
    pub fn weigh(
        &mut self,
        block: &MeasuredBlock,
        e: usize,
        covariance: &RowCovariance,
        (residuals, whitening): (&[f64], &mut Whitening),
    ) {
        let (scale, windows) = (block.form.input(e).1, &block.samples.windows);
        let all = windows.all();
        let white = &mut self.white[..self.rows];
        white.copy_from_slice(&self.difference[..self.rows]);
        whitening.apply(Direction::Forward, white);
        let removed = dot(white, residuals);
        for (row, variance) in self.variances[..self.rows].iter_mut().enumerate() {
            *variance = scale * scale * covariance.input_variance(block, e, row);
        }
        let (overlap, variances) = (&self.overlap, &self.variances);
        let expected = whitening.trace_of_inverse(|i, j| {
            let strides = (all[i].number - all[j].number) as usize / windows.stride;
            let overlap = overlap.get(strides).copied().unwrap_or(0.0);
            0.5 * (variances[i] + variances[j]) * overlap
        });
        if removed.is_finite() && expected.is_finite() {
            self.removed = MEMORY * self.removed + removed;
            self.expected = MEMORY * self.expected + expected;
        }
    }

    /// Removes the noise from the raw column of a resonance (4).
    pub fn remove(&self, column: &mut [f64]) {
        let ratio = self.expected / self.removed;
        let alpha = if ratio.is_finite() {
            ratio.clamp(ALPHA.0, ALPHA.1)
        } else {
            1.0
        };
        for (d, difference) in column.iter_mut().zip(&self.difference[..self.rows]) {
            *d -= (alpha - 1.0) * difference;
        }
    }
}
