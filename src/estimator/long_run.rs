//! Long-run variance of a block's residuals: the noise of their sums if neighbours are correlated.
//!
//! ```text
//! r_i  = f_i − φ_iᵀ δ                              δ: the fit of the block alone
//! γ_k  = Σ_i r_i r_{i+k}/ν                         k = 0 … L, ν degrees of freedom
//! σ_L² = γ_0 + 2 Σ_{k=1}^{L} (1 − k/(L + 1)) γ_k                                               (1)
//! ```
//!
//! Rows are whitened for noise that is white, and the rounding of an encoder is not: a joint that
//! settles between two counts has the same error in many windows. Then the residuals of neighbours
//! are correlated, and sums over them vary more than their variance says: with encoders of 13 bits
//! by a factor of up to three. The residuals themselves are then no larger than the noise; if they
//! are, the plant has changed within the block, and their correlation is no noise. (1) is never
//! negative: W. K. Newey and K. D. West 1987.

use super::equation::EquationState;
use super::pass::Summable;

/// L: windows overlap over about ten rows.
const LAGS: usize = 10;

/// σ_L² of an equation over a block, with the residuals at `theta` and the step `delta` from there.
pub fn long_run_variance(
    rows: &dyn Summable,
    equation: &EquationState,
    (theta, delta): (&[f64], &[f64]),
    regressor: &mut [f64],
    freedom: f64,
) -> f64 {
    let mut last = [0.0; LAGS];
    let mut sum = 0.0;
    for index in 0..rows.len() {
        let mut residual = 0.0;
        if rows.is_used(equation.index, index) {
            residual = rows.row(equation.index, index, theta, regressor);
            let explained: f64 = regressor.iter().zip(delta).map(|(phi, step)| phi * step).sum();
            residual = (residual - explained) / equation.divisor;
        }
        sum += residual * residual;
        for (k, before) in last.iter().enumerate() {
            let weight = 1.0 - (k + 1) as f64 / (LAGS + 1) as f64;
            sum += 2.0 * weight * residual * before; // (1)
        }
        last.rotate_right(1);
        last[0] = residual;
    }
    sum.max(0.0) / freedom
}

#[cfg(test)]
mod tests {
    use super::super::robust::tests::Values;
    use super::super::{EstimatorOptions, ParameterPrior};
    use super::*;

    /// σ_L² of a moving mean over `width` numbers of variance 1.
    fn variance(width: usize) -> f64 {
        const ROWS: usize = 20_000;
        let mut state = 7u64;
        // signs of a congruential generator with Knuth's factor
        let mut sign = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            if state >> 63 == 0 { 1.0 } else { -1.0 }
        };
        let white: Vec<f64> = (0..ROWS + width).map(|_| sign()).collect();
        let gain = 1.0 / (width as f64).sqrt();
        let rows = Values(white.windows(width).map(|w| gain * w.iter().sum::<f64>()).collect());
        let options = EstimatorOptions::recommended([ParameterPrior::new(1.0)], 1);
        let equation = EquationState::new(0, 0..1, &(0..1), &options);
        long_run_variance(&rows, &equation, (&[1.0], &[0.0]), &mut [0.0], ROWS as f64)
    }

    #[test]
    fn val_the_variance_of_sums_is_that_of_their_correlated_terms() {
        // white: 1 to within four standard deviations, √(4 (L + 1)/3 / rows)
        assert!((variance(1) - 1.0).abs() < 0.11, "{}", variance(1));
        // γ_k = 1 − k/3 for k < 3, weighted by 1 − k/11: 1 + 2 (2/3 · 10/11 + 1/3 · 9/11) = 2.76
        assert!((variance(3) - 2.76).abs() < 0.3, "{}", variance(3));
    }
}
