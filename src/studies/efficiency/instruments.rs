//! Least squares on differentiated positions, and the same with instruments from a simulation: the
//! usual off-line methods for robots.
//!
//! ```text
//! y = Φ β        least squares  β = (Φᵀ Φ)⁻¹ Φᵀ y        instruments  β = (Zᵀ Φ)⁻¹ Zᵀ y
//! ```
//!
//! The positions are filtered by a Butterworth filter forwards and backwards, so without delay, and
//! differentiated by central differences. Each equation is linear in parameters β; both sides are
//! filtered by another low-pass filter of the same kind. The noise of the positions is also in Φ
//! and biases β; the instruments Z, the same Φ from a simulation with the recorded setpoints and
//! the last β, have no such noise. This is iterated a few times.
//!
//! Source: A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for
//! industrial robot identification, IEEE Trans. Control Systems Technology 22 (2014).

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::f64::consts::PI;

/// Number of simulations, each with the result of the one before.
const ROUNDS: usize = 5;

/// The estimate with instruments simulated with the previous estimate, starting from least squares;
/// `None` if a simulation is not possible.
pub fn refined<const P: usize>(
    least_squares: Option<SVector<f64, P>>,
    again: impl Fn(&SVector<f64, P>) -> Option<SVector<f64, P>>,
) -> Option<SVector<f64, P>> {
    (0..ROUNDS).try_fold(least_squares?, |theta, _| again(&theta))
}

/// A held input as a function of time: at a sample, where it jumps, it is the mean of both sides.
pub fn held_means(inputs: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut before = None;
    inputs
        .map(|input| 0.5 * (before.replace(input).unwrap_or(input) + input))
        .collect()
}

/// A filter of second order in transposed direct form.
#[derive(Debug, Clone, Copy)]
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
}

impl Biquad {
    /// Butterworth low-pass filter by the bilinear transform, with a prewarped edge.
    fn low_pass(edge_hz: f64, period_s: f64) -> Self {
        let k = (PI * edge_hz * period_s).tan();
        let norm = 1.0 / (1.0 + 2f64.sqrt() * k + k * k);
        Self {
            b: [k * k * norm, 2.0 * k * k * norm, k * k * norm],
            a: [2.0 * (k * k - 1.0) * norm, (1.0 - 2f64.sqrt() * k + k * k) * norm],
        }
    }

    /// Filters in place, starting from the steady state of the first value.
    fn run(&self, values: &mut dyn Iterator<Item = &mut f64>) {
        let mut state: Option<[f64; 2]> = None;
        for value in values {
            let x = *value;
            let [s1, s2] = state.unwrap_or([x * (1.0 - self.b[0]), x * (self.b[2] - self.a[1])]);
            let y = self.b[0] * x + s1;
            state = Some([self.b[1] * x - self.a[0] * y + s2, self.b[2] * x - self.a[1] * y]);
            *value = y;
        }
    }
}

/// A low-pass filter without delay, applied forwards and backwards.
pub fn smooth(values: &mut [f64], edge_hz: f64, period_s: f64) {
    let filter = Biquad::low_pass(edge_hz, period_s);
    filter.run(&mut values.iter_mut());
    filter.run(&mut values.iter_mut().rev());
}

/// Values and their first three derivatives in time, by central differences; the ends repeat their
/// neighbours.
pub fn derivatives(mut values: Vec<f64>, edge_hz: f64, period_s: f64) -> [Vec<f64>; 4] {
    if values.len() < 3 {
        let none = vec![0.0; values.len()];
        return [values, none.clone(), none.clone(), none];
    }
    smooth(&mut values, edge_hz, period_s);
    let differences = |from: &[f64]| -> Vec<f64> {
        let last = from.len() - 1;
        (0..=last)
            .map(|k| {
                let k = k.clamp(1, last - 1);
                (from[k + 1] - from[k - 1]) / (2.0 * period_s)
            })
            .collect()
    };
    let first = differences(&values);
    let second = differences(&first);
    let third = differences(&second);
    [values, first, second, third]
}

/// One equation over a run: Φ and y, a row per sample, and which samples are used.
#[derive(Debug, Clone)]
pub struct Regression<const B: usize> {
    /// Columns of Φ.
    pub columns: [Vec<f64>; B],
    /// y.
    pub y: Vec<f64>,
    /// Samples that are used.
    pub counts: Vec<bool>,
}

impl<const B: usize> Regression<B> {
    /// Applies a low-pass filter to both sides.
    pub fn smoothed(mut self, edge_hz: f64, period_s: f64) -> Self {
        for column in self.columns.iter_mut().chain([&mut self.y]) {
            smooth(column, edge_hz, period_s);
        }
        self
    }

    fn row(&self, k: usize) -> SVector<f64, B> {
        SVector::from_fn(|i, _| self.columns[i][k])
    }

    /// β with these instruments; with itself as instruments, least squares. `None` if they do not
    /// determine β.
    pub fn solve(&self, instruments: &Self) -> Option<SVector<f64, B>> {
        let (mut left, mut right) = (SMatrix::<f64, B, B>::zeros(), SVector::<f64, B>::zeros());
        for k in (0..self.y.len()).filter(|&k| self.counts[k] && instruments.counts[k]) {
            let z = instruments.row(k);
            left += z * self.row(k).transpose();
            right += z * self.y[k];
        }
        // on the heap: nalgebra has no trait bound for a decomposition of a generic size
        let left = DMatrix::from_iterator(B, B, left.iter().copied());
        let solution = left.lu().solve(&DVector::from_column_slice(right.as_slice()))?;
        let beta = SVector::<f64, B>::from_column_slice(solution.as_slice());
        beta.iter().all(|b| b.is_finite()).then_some(beta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_slow_sine_passes_with_its_derivatives_and_a_fast_one_does_not() {
        // The second-order filter twice has the gain 1/(1 + (f/f_c)⁴), 1 − 4e-6 at 0.9 Hz with an
        // edge of 20 Hz; each central difference costs (ω h)²/6 = 5e-6.
        let (h, slow) = (1e-3, 2.0 * PI * 0.9);
        let values: Vec<f64> = (0..8000).map(|k| (slow * h * f64::from(k)).sin()).collect();
        let d = derivatives(values, 20.0, h);
        for k in 3000..5000 {
            let phase = slow * h * k as f64;
            let expected = [phase.sin(), phase.cos(), -phase.sin(), -phase.cos()];
            for (order, expected) in expected.into_iter().enumerate() {
                let got = d[order][k] / slow.powi(order as i32);
                assert!(
                    (got - expected).abs() < 3e-5,
                    "derivative {order} at {k}: {got}, expected {expected}"
                );
            }
        }
        // at ten times the edge 1e-4 remains, and less by the bilinear transform
        let mut fast: Vec<f64> = (0..8000).map(|k| (2.0 * PI * 200.0 * h * f64::from(k)).sin()).collect();
        smooth(&mut fast, 20.0, h);
        assert!(fast[3000..5000].iter().all(|y| y.abs() < 1e-4));
    }

    #[test]
    fn val_instruments_remove_the_bias_that_noise_in_the_regressor_gives() {
        // Φ = x + noise of the same size: least squares give half of β from any number of rows.
        let x = |k: usize| (0.1 * k as f64).sin();
        let noise = |k: usize| (k as f64 * 0.618_034 * 1e4).fract() * 2.449 - 1.2245;
        let count = 20_000;
        let data = Regression {
            columns: [(0..count).map(|k| x(k) + noise(k)).collect()],
            y: (0..count).map(|k| 3.0 * x(k)).collect(),
            counts: vec![true; count],
        };
        let instruments = Regression {
            columns: [(0..count).map(x).collect()],
            ..data.clone()
        };
        let least_squares = data.solve(&data).unwrap()[0];
        assert!((least_squares - 1.5).abs() < 0.05, "{least_squares}");
        let beta = data.solve(&instruments).unwrap()[0];
        assert!((beta - 3.0).abs() < 0.05, "{beta}");
    }
}
