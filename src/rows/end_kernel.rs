//! The window that ends with the last sample of a block, as weights on samples.
//!
//! ```text
//! ψ(s) = c (1 + s)^2b (1 − s)^b for −1 < s < 1, s = −1 at the first sample and 1 at the last,
//!        b = 1 + the highest derivative
//! ∫ ψ (d/dt)^d g dt ≈ Σ_k K_d[k] g(t_k)
//! K_d[k] = (−1)^d h ψ^(d)(t_k), corrected to be exact on polynomials up to degree d + 3
//! ```
//!
//! A plant that changes a time τ before the end shows in the position since then, in proportion to
//! τ². The symmetric bump of `kernel.rs` gives little weight to that part: it and its first six
//! derivatives vanish at the end. This one vanishes just enough to eliminate the unknown state at
//! the end. The table shows by how many standard deviations a payload of 13 % is detected that the
//! paper's arm picks up while it holds still (16 bits, 0.05 V of noise, regular windows of 100 ms):
//!
//! | window | 10 ms before the end | 15 ms | 20 ms | 30 ms | 50 ms |
//! |---|---|---|---|---|---|
//! | symmetric, 50 ms, ends 10 ms earlier | 0 | 0 | 0.2 | 3.0 | 1.0 |
//! | symmetric, 50 ms | 0.2 | 1.2 | 3.0 | 3.4 | 1.0 |
//! | this one, 50 ms | 1.8 | 3.2 | 3.1 | 1.2 | 0.8 |
//! | this one, 100 ms | 1.7 | 5.6 | 11 | 21 | 17 |
//! | this one, 150 ms | 0.9 | 3.6 | 8.6 | 24 | 51 |
//!
//! With one power less at the end (b = 3) the window sees 2 ms more, but takes a tenth of the
//! motion's resonance for a change, because ψ‴ then jumps at the last sample.

use super::kernel::InputTiming;
use nalgebra::{DMatrix, DVector};

/// Degrees beyond the derivative on which the weights are exact.
const EXACT: usize = 3;

/// Weights of one window, including the quadrature factor.
#[derive(Debug, Clone)]
pub(super) struct EndKernels {
    /// Samples of the window.
    pub count: usize,
    /// Samples before and after the window over which the input weights extend.
    pub before: usize,
    pub after: usize,
    /// K_d on the window's samples.
    pub position: Vec<Vec<f64>>,
    /// Weights on the input's samples, from `before` samples before the window on.
    pub input: Vec<f64>,
    /// Contribution of a jump of size 1 that is complete at the sample; empty for a held input.
    pub jump: Vec<f64>,
}

/// c₀ + c₁ s + …
type Polynomial = Vec<f64>;

fn value(p: &Polynomial, s: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, &c| sum * s + c)
}

fn derivative(p: &Polynomial) -> Polynomial {
    p.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect()
}

/// (1 + s)^left (1 − s)^right.
fn bump(left: usize, right: usize) -> Polynomial {
    let times = |p: &Polynomial, slope: f64| -> Polynomial {
        let lower = p.iter().copied().chain([0.0]);
        let higher = [0.0].into_iter().chain(p.iter().map(|c| slope * c));
        lower.zip(higher).map(|(a, b)| a + b).collect()
    };
    let p = (0..left).fold(vec![1.0], |p, _| times(&p, 1.0));
    (0..right).fold(p, |p, _| times(&p, -1.0))
}

impl EndKernels {
    /// Kernels for `count` samples that are `period_s` \[s\] apart, derivatives up to `order`, and
    /// an input that acts `delay_s` \[s\] after it was recorded. `count` ≥ 17, `order` ≤ 4.
    pub fn new(count: usize, period_s: f64, order: usize, timing: InputTiming, delay_s: f64) -> Self {
        let (left, right) = (2 * (order + 1), order + 1);
        let half_s = 0.5 * (count - 1) as f64 * period_s;
        let s = |t_s: f64| t_s / half_s - 1.0;
        let mut derivatives = vec![bump(left, right)];
        for d in 0..order.max(1) {
            derivatives.push(derivative(&derivatives[d]));
        }
        let sum: f64 = (0..count).map(|k| value(&derivatives[0], s(k as f64 * period_s))).sum();
        let factor = 1.0 / (sum * period_s);
        let at = |d: usize, t_s: f64| {
            let s = s(t_s);
            if s.abs() <= 1.0 {
                factor * value(&derivatives[d], s) / half_s.powi(d as i32)
            } else {
                0.0
            }
        };
        let position = (0..=order)
            .map(|d| {
                let sign = if d % 2 == 0 { period_s } else { -period_s };
                let mut weights: Vec<f64> = (0..count).map(|k| sign * at(d, k as f64 * period_s)).collect();
                if d > 0 {
                    correct_moments(&mut weights, &derivatives[0], d, half_s, &bump(left - d, right - d));
                }
                weights
            })
            .collect();

        let late = (delay_s.abs() / period_s).ceil() as usize;
        let (before, after) = if delay_s > 0.0 { (late + 1, 0) } else { (1, late) };
        let antiderivative: Polynomial = [0.0]
            .into_iter()
            .chain(derivatives[0].iter().enumerate().map(|(i, c)| c / (i + 1) as f64))
            .collect();
        let integral = |t_s: f64| factor * half_s * value(&antiderivative, s(t_s).clamp(-1.0, 1.0));
        let instants = || (0..before + count + after).map(|k| (k as f64 - before as f64) * period_s + delay_s);
        let mut input: Vec<f64> = instants()
            .map(|t_s| match timing {
                InputTiming::Held => integral(t_s + period_s) - integral(t_s),
                InputTiming::Continuous => period_s * at(0, t_s),
            })
            .collect();
        // a constant input is reproduced exactly
        let total: f64 = input.iter().sum();
        input.iter_mut().for_each(|w| *w /= total);
        let jump = match timing {
            InputTiming::Held => Vec::new(),
            InputTiming::Continuous => instants()
                .map(|t_s| -0.5 * period_s * at(0, t_s) + period_s * period_s / 12.0 * at(1, t_s))
                .collect(),
        };
        Self {
            count,
            before,
            after,
            position,
            input,
            jump,
        }
    }
}

/// Makes K_d exact on polynomials up to degree d + 3 by adding the smallest multiples of s^j times
/// `taper`.
fn correct_moments(weights: &mut [f64], bump: &Polynomial, d: usize, half_s: f64, taper: &Polynomial) {
    let (count, degrees) = (weights.len(), d + EXACT + 1);
    let s = |k: usize| 2.0 * k as f64 / (count - 1) as f64 - 1.0;
    let sum = |f: &dyn Fn(usize) -> f64| (0..count).map(f).sum::<f64>();
    let whole = sum(&|k| value(bump, s(k)));
    // Σ K_0 s^m
    let moment = |m: usize| sum(&|k| value(bump, s(k)) * s(k).powi(m as i32)) / whole;
    let matrix = DMatrix::from_fn(degrees, degrees, |m, j| {
        sum(&|k| s(k).powi((m + j) as i32) * value(taper, s(k)))
    });
    let missing = DVector::from_fn(degrees, |m, _| {
        // (d/ds)^d s^m = m!/(m−d)! s^(m−d), and d/dt is d/ds over the unit
        let wanted = if m >= d {
            (m - d + 1..=m).product::<usize>() as f64 * moment(m - d) / half_s.powi(d as i32)
        } else {
            0.0
        };
        wanted - sum(&|k| weights[k] * s(k).powi(m as i32))
    });
    // the Gram matrix of independent functions is regular
    if let Some(solution) = matrix.lu().solve(&missing) {
        for (k, weight) in weights.iter_mut().enumerate() {
            *weight += (0..degrees).map(|j| solution[j] * s(k).powi(j as i32)).sum::<f64>() * value(taper, s(k));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_weights_are_the_derivatives_of_a_resonance_and_vanish_at_the_end() {
        let (period_s, omega) = (1e-3, 82.0);
        for count in [17, 51, 101, 151] {
            let kernels = EndKernels::new(count, period_s, 3, InputTiming::Continuous, 0.0);
            let t = |k: usize| k as f64 * period_s;
            for phase in [0.0, 0.7, 1.4] {
                for d in 1..=3 {
                    // (d/dt)^d of cos(ωt + φ) is ω^d cos(ωt + φ + d π/2)
                    let turned = phase + d as f64 * std::f64::consts::FRAC_PI_2;
                    let wanted: f64 = (0..count)
                        .map(|k| kernels.input[kernels.before + k] * (omega * t(k) + turned).cos())
                        .sum();
                    let got: f64 = (0..count)
                        .map(|k| kernels.position[d][k] * (omega * t(k) + phase).cos())
                        .sum();
                    let error = (got / omega.powi(d as i32) - wanted).abs();
                    // both agree up to degree d + 3; a resonance of 13 Hz turns by 12 rad in 150
                    // ms, and the error is of the order of h²/12 times the first derivative that
                    // jumps at the end
                    assert!(error < 2e-4, "{count} {d} {phase}: {error}");
                }
            }
            assert_eq!(kernels.position[0][count - 1], 0.0);
            assert!(kernels.input.iter().all(|w| w.is_finite()));
        }
    }

    #[test]
    fn val_a_delayed_input_is_weighted_where_it_was_recorded() {
        for timing in [InputTiming::Held, InputTiming::Continuous] {
            for delay_s in [-0.0025, 0.0, 0.0035] {
                let kernels = EndKernels::new(101, 1e-3, 3, timing, delay_s);
                // u(t) = t acts as t − δ; a held one is half a sample behind as well
                let recorded = |k: usize| (k as f64 - kernels.before as f64) * 1e-3;
                let got: f64 = kernels.input.iter().enumerate().map(|(k, w)| w * recorded(k)).sum();
                let middle: f64 = kernels.position[0]
                    .iter()
                    .enumerate()
                    .map(|(k, w)| w * k as f64 * 1e-3)
                    .sum();
                let held = if timing == InputTiming::Held { 0.5e-3 } else { 0.0 };
                assert!(
                    (got - (middle - delay_s - held)).abs() < 1e-8,
                    "{timing:?} {delay_s}: {got}"
                );
            }
        }
    }
}
