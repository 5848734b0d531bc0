//! The window of the projected form and its derivatives, as weights on samples.
//!
//! ```text
//! ψ(t) = c (1 − (t/Wh)²)^7 for |t| < Wh, else 0        h sample period, window of 2W + 1 samples, c so that h Σ ψ = 1
//! ∫ ψ (d/dt)^d g dt = (−1)^d ∫ ψ^(d) g dt ≈ Σ_k K_d[k] g(t_k)        K_d[k] = (−1)^d h ψ^(d)(t_k)
//! ```
//!
//! ψ and its first six derivatives vanish at both ends, so the trapezoidal sum is exact up to
//! O((1/W)^8) of the moments of ψ, and the end values of g have no effect. The remaining error is
//! removed: each K_d is corrected to give exactly d/dt^d of every polynomial up to degree d + 1, so
//! that a constant offset of an encoder, or a constant velocity, does not leak into a derivative.
//! With 25 samples per window the leak of an offset of a slow axis would otherwise exceed its
//! friction.
//!
//! # Input
//! The recorded input u acts on the plant with the delay δ: ∫ ψ(t) u(t − δ) dt = ∫ ψ(t + δ) u(t)
//! dt, and in powers of a further delay ε Y(ε) = Y₀ + ε Y₁ + ε²/2 Y₂ with Y_r = ∫ ψ^(r)(t + δ) u
//! dt.
//!
//! - `Held`: u keeps its value from a sample to the next. ψ is integrated exactly over each cell.
//! - `Continuous`: the trapezoidal rule, which is right only between jumps. A jump Δ at t_k, after
//!   which u_k was recorded, adds −h/2 ψ Δ (the sum needs the mean of both limits) and h²/12 ψ′ Δ
//!   (the Euler-Maclaurin term of the kink that ψu then has).

use nalgebra::{DMatrix, DVector};

/// Exponent of the bump.
const POWER: i32 = 7;

/// Behaviour of the input between samples; `input.timing`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum InputTiming {
    /// Held: a sampled controller with zero-order hold.
    #[default]
    Held,
    /// Continuous except for jumps at sample instants: an analog controller, or a measured voltage,
    /// current or force.
    Continuous,
}

impl InputTiming {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Held, "held"), (Self::Continuous, "continuous")];
}

/// ψ on its support −1 < s < 1, without its factor: ψ^(d)(s) = (1 − s²)^(7−d) P_d(s).
#[derive(Debug, Clone)]
struct Bump {
    /// Coefficients of P_d, lowest first.
    polynomials: Vec<Vec<f64>>,
    /// Coefficients of the antiderivative of (1 − s²)^7.
    integral: Vec<f64>,
}

impl Bump {
    fn new(derivatives: usize) -> Self {
        // P_{d+1} = (1 − s²) P_d′ − 2 (7 − d) s P_d
        let mut polynomials = vec![vec![1.0]];
        for d in 0..derivatives {
            let p = &polynomials[d];
            let mut next = vec![0.0; p.len() + 1];
            for (i, &c) in p.iter().enumerate() {
                if i > 0 {
                    next[i - 1] += i as f64 * c;
                }
                next[i + 1] -= i as f64 * c + 2.0 * f64::from(POWER - d as i32) * c;
            }
            polynomials.push(next);
        }
        // (1 − s²)^7 = Σ (7 over k) (−1)^k s^(2k)
        let mut integral = vec![0.0; 2 * POWER as usize + 2];
        let mut binomial = 1.0;
        for k in 0..=POWER as usize {
            integral[2 * k + 1] = binomial / (2 * k + 1) as f64;
            binomial *= -f64::from(POWER - k as i32) / (k + 1) as f64;
        }
        Self { polynomials, integral }
    }

    fn derivative(&self, d: usize, s: f64) -> f64 {
        if s.abs() >= 1.0 {
            return 0.0;
        }
        (1.0 - s * s).powi(POWER - d as i32) * horner(&self.polynomials[d], s)
    }

    /// ∫ from 0 to s.
    fn integral(&self, s: f64) -> f64 {
        horner(&self.integral, s.clamp(-1.0, 1.0))
    }
}

fn horner(coefficients: &[f64], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, &c| sum * s + c)
}

/// Weights on the samples of a window, including the quadrature factor.
#[derive(Debug, Clone)]
pub(super) struct Kernels {
    /// W: samples on either side of the centre.
    pub half: usize,
    /// Samples on either side of the centre over which the input weights extend.
    pub input_half: usize,
    /// K_d on samples −W..=W of the centre.
    pub position: Vec<Vec<f64>>,
    /// Weights of Y₀, Y₁, Y₂ on the input's samples −`input_half`..=`input_half`.
    pub input: [Vec<f64>; 3],
    /// Contribution to Y₀, Y₁, Y₂ of a jump of size 1 that is complete at the sample; empty for a
    /// held input.
    pub jump: [Vec<f64>; 3],
}

impl Kernels {
    /// Kernels for windows of 2 `half` + 1 samples that are `period_s` \[s\] apart, derivatives up
    /// to `order`, and an input that acts `delay_s` \[s\] after it was recorded. `half` ≥ 4,
    /// `order` ≤ 5.
    pub fn new(half: usize, period_s: f64, order: usize, timing: InputTiming, delay_s: f64) -> Self {
        let bump = Bump::new(order.max(3));
        let width_s = half as f64 * period_s;
        let sum: f64 = (0..=2 * half)
            .map(|k| bump.derivative(0, k as f64 / half as f64 - 1.0))
            .sum();
        let factor = 1.0 / (sum * period_s);
        // (−1)^d h c ψ^(d), the derivative in t
        let raw = |d: usize, t_s: f64| factor * bump.derivative(d, t_s / width_s) / width_s.powi(d as i32);
        let position = (0..=order)
            .map(|d| {
                let sign = if d % 2 == 0 { period_s } else { -period_s };
                let mut weights: Vec<f64> = (0..=2 * half)
                    .map(|k| sign * raw(d, (k as f64 - half as f64) * period_s))
                    .collect();
                if d > 0 {
                    correct_moments(&mut weights, &bump, d, half, period_s);
                }
                weights
            })
            .collect();

        let input_half = half + (delay_s.abs() / period_s).ceil() as usize + 1;
        let antiderivative = |r: usize, t_s: f64| match r {
            0 => factor * width_s * bump.integral(t_s / width_s),
            _ => raw(r - 1, t_s),
        };
        let at = |k: usize| (k as f64 - input_half as f64) * period_s + delay_s;
        let weights = |r: usize| -> Vec<f64> {
            (0..=2 * input_half)
                .map(|k| match timing {
                    InputTiming::Held => antiderivative(r, at(k) + period_s) - antiderivative(r, at(k)),
                    InputTiming::Continuous => period_s * raw(r, at(k)),
                })
                .collect()
        };
        let jumps = |r: usize| -> Vec<f64> {
            match timing {
                InputTiming::Held => Vec::new(),
                InputTiming::Continuous => (0..=2 * input_half)
                    .map(|k| -0.5 * period_s * raw(r, at(k)) + period_s * period_s / 12.0 * raw(r + 1, at(k)))
                    .collect(),
            }
        };
        let mut input = [weights(0), weights(1), weights(2)];
        // a constant input is reproduced exactly
        let total: f64 = input[0].iter().sum();
        input[0].iter_mut().for_each(|w| *w /= total);
        Self {
            half,
            input_half,
            position,
            input,
            jump: [jumps(0), jumps(1), jumps(2)],
        }
    }
}

/// Makes K_d exact on polynomials up to degree d + 1 by adding the smallest multiples of s^j (1 −
/// s²)^(7−d).
fn correct_moments(weights: &mut [f64], bump: &Bump, d: usize, half: usize, period_s: f64) {
    let count = d + 2;
    let s = |k: usize| k as f64 / half as f64 - 1.0;
    let unit = half as f64 * period_s;
    let bump_sum: f64 = (0..weights.len()).map(|k| bump.derivative(0, s(k))).sum();
    // Σ K_0 s^m, with Σ K_0 = 1
    let moment = |m: usize| -> f64 {
        (0..weights.len())
            .map(|k| bump.derivative(0, s(k)) * s(k).powi(m as i32))
            .sum::<f64>()
            / bump_sum
    };
    let taper = |k: usize| (1.0 - s(k) * s(k)).max(0.0).powi(POWER - d as i32);
    let matrix = DMatrix::from_fn(count, count, |m, j| {
        (0..weights.len())
            .map(|k| s(k).powi((m + j) as i32) * taper(k))
            .sum::<f64>()
    });
    let missing = DVector::from_fn(count, |m, _| {
        // (d/ds)^d s^m = m!/(m−d)! s^(m−d), and d/dt is d/ds over the unit
        let wanted = if m >= d {
            (m - d + 1..=m).product::<usize>() as f64 * moment(m - d) / unit.powi(d as i32)
        } else {
            0.0
        };
        wanted
            - weights
                .iter()
                .enumerate()
                .map(|(k, w)| w * s(k).powi(m as i32))
                .sum::<f64>()
    });
    // the Gram matrix of independent functions is regular
    if let Some(solution) = matrix.lu().solve(&missing) {
        for (k, w) in weights.iter_mut().enumerate() {
            *w += (0..count).map(|j| solution[j] * s(k).powi(j as i32)).sum::<f64>() * taper(k);
        }
    }
}

/// Σ x y in eight running sums, in an order that depends only on the length.
#[inline]
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len().min(y.len());
    let (x, y) = (&x[..n], &y[..n]);
    let mut sums = [0.0; 8];
    let ((xs, x), (ys, y)) = (x.as_chunks::<8>(), y.as_chunks::<8>());
    for (a, b) in xs.iter().zip(ys) {
        add(&mut sums, 0, a, b);
    }
    // the remainder of up to seven as four, two and one, so these are vector operations too
    let (x, y) = add_first::<4>(&mut sums, 0, x, y);
    let (x, y) = add_first::<2>(&mut sums, 4, x, y);
    add_first::<1>(&mut sums, 6, x, y);
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]))
}

/// Adds N products to the sums from `lane` on.
#[inline(always)]
fn add<const N: usize>(sums: &mut [f64; 8], lane: usize, x: &[f64; N], y: &[f64; N]) {
    for at in 0..N {
        sums[lane + at] += x[at] * y[at];
    }
}

/// Adds the first N products, if there are that many, and returns the rest.
#[inline(always)]
fn add_first<'a, const N: usize>(
    sums: &mut [f64; 8],
    lane: usize,
    x: &'a [f64],
    y: &'a [f64],
) -> (&'a [f64], &'a [f64]) {
    match (x.split_first_chunk::<N>(), y.split_first_chunk::<N>()) {
        (Some((a, x)), Some((b, y))) => {
            add(sums, lane, a, b);
            (x, y)
        }
        _ => (x, y),
    }
}

/// y_n += Σ_i w_i x_{n+i} for weights that are odd about their middle: `w` is their first half, the
/// middle one is 0, the others are −w in the reverse order. Summed in the order of i; x must be
/// long enough.
#[inline]
pub(super) fn correlate_odd(w: &[f64], x: &[f64], y: &mut [f64]) {
    const LANES: usize = 16;
    let width = 2 * w.len();
    let (ys, rest) = y.as_chunks_mut::<LANES>();
    let tail = LANES * ys.len();
    for (y, x) in ys.iter_mut().zip(x.windows(width + LANES).step_by(LANES)) {
        let mut sums = *y;
        for (w, (left, right)) in w.iter().zip(x.windows(LANES).zip(x.windows(LANES).rev())) {
            for lane in 0..LANES {
                sums[lane] += w * (left[lane] - right[lane]);
            }
        }
        *y = sums;
    }
    for (y, x) in rest.iter_mut().zip(x[tail..].windows(width + 1)) {
        *y = w
            .iter()
            .zip(x.iter().zip(x.iter().rev()))
            .fold(*y, |sum, (w, (left, right))| sum + w * (left - right));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_correlation_is_the_sum_that_it_stands_for() {
        let w = [0.3, -1.2];
        for len in [1usize, 15, 16, 17, 37] {
            let x: Vec<f64> = (0..len + 4).map(|k| (k as f64).sin()).collect();
            let mut y: Vec<f64> = (0..len).map(|k| k as f64).collect();
            correlate_odd(&w, &x, &mut y);
            for (n, y) in y.iter().enumerate() {
                let (outer, inner) = (x[n] - x[n + 4], x[n + 1] - x[n + 3]);
                assert_eq!(*y, (n as f64 + w[0] * outer) + w[1] * inner);
            }
        }
    }

    #[test]
    fn val_derivatives_of_polynomials_are_exact_for_short_and_long_windows() {
        for half in [12, 20, 50] {
            let h = 1e-3;
            let kernels = Kernels::new(half, h, 4, InputTiming::Held, 0.0);
            for d in 0..=4usize {
                for m in 0..=d + 1 {
                    // x = (t/Wh)^m; its d-th derivative projected is the projection of the
                    // derivative
                    let unit = half as f64 * h;
                    let got: f64 = (0..=2 * half)
                        .map(|k| kernels.position[d][k] * (k as f64 / half as f64 - 1.0).powi(m as i32))
                        .sum();
                    let wanted = if m < d {
                        0.0
                    } else {
                        let factorial = (m - d + 1..=m).product::<usize>() as f64;
                        let moment: f64 = (0..=2 * half)
                            .map(|k| kernels.position[0][k] * (k as f64 / half as f64 - 1.0).powi((m - d) as i32))
                            .sum();
                        factorial * moment / unit.powi(d as i32)
                    };
                    // sums of some hundred numbers of the size of the largest weight, each rounded
                    let size: f64 = kernels.position[d].iter().map(|w| w.abs()).sum();
                    assert!(
                        (got - wanted).abs() < 1e-13 * size,
                        "half {half}, d {d}, m {m}: {got} instead of {wanted}"
                    );
                }
            }
        }
    }

    #[test]
    fn val_the_projected_derivative_of_a_sine_is_that_of_its_derivative() {
        // ω = 20 rad/s over a window of 0.1 s: the remaining error is that of the trapezoidal rule
        // at the ends of ψ‴, where derivatives from the fourth on jump
        let (half, h, omega) = (50usize, 1e-3, 20.0);
        let kernels = Kernels::new(half, h, 3, InputTiming::Held, 0.0);
        let project = |d: usize, x: &dyn Fn(f64) -> f64| -> f64 {
            (0..=2 * half)
                .map(|k| kernels.position[d][k] * x((k as f64 - half as f64) * h + 0.3))
                .sum()
        };
        let third = project(3, &|t| (omega * t).sin());
        let wanted = project(0, &|t| -omega.powi(3) * (omega * t).cos());
        assert!((third / wanted - 1.0).abs() < 1e-8, "{third} {wanted}");
    }

    #[test]
    fn val_a_held_input_is_integrated_exactly_and_a_delay_shifts_it() {
        let (half, h) = (20usize, 1e-3);
        // one cell of height 1 from 3 ms to 4 ms that acts 0.4 ms later
        let delay = 0.4e-3;
        let kernels = Kernels::new(half, h, 3, InputTiming::Held, delay);
        let got = kernels.input[0][kernels.input_half + 3];
        let fine = 100_000;
        let c: f64 = 1.0
            / (0..=2 * half)
                .map(|k| (1.0 - (k as f64 / 20.0 - 1.0f64).powi(2)).powi(7))
                .sum::<f64>()
            / h;
        let wanted: f64 = (0..fine)
            .map(|i| {
                let t = 3e-3 + (i as f64 + 0.5) / fine as f64 * h + delay;
                c * (1.0 - (t / (half as f64 * h)).powi(2)).powi(7) * h / fine as f64
            })
            .sum();
        // the midpoint rule with 1e5 points and the normalisation of the weights, both below 1e-8
        assert!((got / wanted - 1.0).abs() < 1e-8, "{got} {wanted}");
    }

    #[test]
    fn val_a_jump_at_a_sample_is_right_with_both_corrections() {
        // u = sin(30 t) + H(t − t_k), recorded after the jump
        let (half, h) = (50usize, 1e-3);
        let kernels = Kernels::new(half, h, 3, InputTiming::Continuous, 0.0);
        let m = kernels.input_half;
        let jump_at = m + 17;
        let smooth = |t: f64| (30.0 * t).sin();
        let sum: f64 = (0..=2 * m)
            .map(|k| {
                let t = (k as f64 - m as f64) * h;
                kernels.input[0][k] * (smooth(t) + if k >= jump_at { 1.0 } else { 0.0 })
            })
            .sum();
        let without: f64 = (0..=2 * m)
            .map(|k| kernels.input[0][k] * smooth((k as f64 - m as f64) * h))
            .sum();
        let held = Kernels::new(half, h, 3, InputTiming::Held, 0.0);
        let wanted = without + held.input[0][jump_at..].iter().sum::<f64>();
        let corrected = sum + kernels.jump[0][jump_at];
        assert!((sum - wanted).abs() > 1e-3, "uncorrected: {sum} {wanted}");
        // the next Euler-Maclaurin term is h⁴/720 ψ‴, some 2e-8 here
        assert!((corrected - wanted).abs() < 1e-7, "{corrected} {wanted}");
    }
}
