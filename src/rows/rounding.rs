//! The noise of an encoder's rounding, relative to white noise.
//!
//! ```text
//! e_k = round(x_k) − x_k,   x_k = x_0 + v k        in counts; v counts per sample
//! ```
//!
//! While a joint crosses counts irregularly, e is white with variance 1/12. If v is close to a
//! fraction p/n, e is the sum of a pattern of period n, to which windows are insensitive, and of a
//! sawtooth of height 1/n that beats with |n v − p| cycles per sample. All of its energy lies at
//! that one frequency, and windows pass it if it is low: for them the variance is larger by a
//! factor of about (c/beat)/n². A beat must last for its own period, so with an acceleration of a
//! counts per sample² it is not slower than about √(n a)/2. n = 1, p = 0 is a joint that creeps; at
//! 13 bits and 1 kHz a joint at 0.77 rad/s moves by one count per sample, n = 1, p = 1.
//!
//! Source: the sawtooth series of the rounding error, B. Widrow and I. Kollár, Quantization Noise,
//! Cambridge University Press, 2008.

/// Cycles per sample below which windows pass a beat.
pub(super) const BEAT: f64 = 0.2;
/// Largest factor on the variance in windows of up to [`SHORT`] samples on either side: at a slower
/// beat the rounding hardly changes within a window, and an offset is not noise.
const LIMIT: f64 = 30.0;
const SHORT: f64 = 50.0;
/// √n up to the largest n; the fourth sawtooth would only occasionally double the variance.
const ROOTS: [f64; 3] = [1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];

/// Largest factor on the variance in windows of `half` samples on either side. Relative to white
/// noise, a step of one count has more effect in longer windows; at 1 kHz a higher limit would hide
/// a payload picked up at rest.
pub(super) fn limit(half: usize) -> f64 {
    LIMIT * (half as f64 / SHORT).max(1.0)
}

/// Factor of the variance of rounding at a velocity \[counts per sample\] and an acceleration
/// \[counts per sample²\], from 1 to `limit`.
#[inline]
pub(super) fn inflation(velocity: f64, acceleration: f64, limit: f64) -> f64 {
    // the largest of (BEAT/beat)/n², within 1 and `limit`/n²: one division and one root for all n
    let (shortest, slowest) = (0.5 * acceleration.abs().sqrt(), BEAT / limit);
    let beats = ROOTS.iter().zip(1..).map(|(root, n)| {
        let cycles = f64::from(n) * velocity;
        let beat = (cycles - nearest_integer(cycles)).abs();
        f64::from(n * n) * beat.max(root * shortest).max(slowest)
    });
    BEAT / beats.fold(BEAT, f64::min)
}

/// The nearest integer, ties to even, without calling the maths library: above 2^52 a double has no
/// fractional digits, so adding and subtracting such a number rounds.
#[inline]
fn nearest_integer(x: f64) -> f64 {
    const SHIFT: f64 = 6_755_399_441_055_744.0; // 3/2 · 2^52
    (x + SHIFT) - SHIFT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_nearest_integer_is_that_of_the_library() {
        for k in -4000..4000 {
            let x = f64::from(k) * 0.12345 + 1e-7;
            assert_eq!(nearest_integer(x), x.round());
        }
        assert_eq!(nearest_integer(1e15), 1e15);
        assert!(nearest_integer(f64::NAN).is_nan());
    }

    #[test]
    fn prop_only_slow_beats_raise_the_variance() {
        assert_eq!(inflation(0.0, 0.0, 30.0), 30.0);
        assert_eq!(inflation(3.0, 0.0, 30.0), 30.0);
        assert_eq!(inflation(0.5, 0.0, 30.0), 7.5);
        assert_eq!(inflation(-0.28, 0.0, 30.0), 1.0);
        // an accelerating joint does not stay at any beat
        assert_eq!(inflation(1.0, 1.0, 30.0), 1.0);
    }

    /// Power of the rounding error of a ramp, in the first derivative of a window of `half` samples
    /// on either side, relative to that of white noise; the mean over starting points.
    fn power(half: i32, v: f64) -> f64 {
        let kernel: Vec<f64> = (-half..=half)
            .map(|k| {
                let s = f64::from(k) / f64::from(half);
                s * (1.0 - s * s).max(0.0).powi(6)
            })
            .collect();
        let white: f64 = kernel.iter().map(|w| w * w).sum::<f64>() / 12.0;
        let starts = 400;
        let seen = |start: i32| -> f64 {
            let x = |k: usize| f64::from(start) / f64::from(starts) + v * k as f64;
            let errors = kernel.iter().enumerate().map(|(k, w)| w * (x(k).round() - x(k)));
            errors.sum()
        };
        (0..starts)
            .map(|start| seen(start).powi(2) / f64::from(starts))
            .sum::<f64>()
            / white
    }

    #[test]
    fn val_the_power_that_a_window_passes_is_that_of_the_rounding_itself() {
        for v in [0.28, 0.72, 1.28] {
            // velocities that are no fraction with a small denominator: white to within a factor of
            // two
            let seen = power(20, v);
            assert!(seen < 2.0 * inflation(v, 0.0, limit(20)), "{v}: {seen}");
        }
        for v in [0.03, 0.98, 2.04] {
            // the sawtooth itself, at the frequencies that this window passes best
            let (seen, taken) = (power(20, v), inflation(v, 0.0, limit(20)));
            assert!(
                seen > 2.0 && taken > 0.3 * seen && taken < 4.0 * seen,
                "{v}: {seen} {taken}"
            );
        }
        for v in [0.004, 0.003] {
            // a few steps of one count in a long window
            let (seen, taken) = (power(100, v), inflation(v, 0.0, limit(100)));
            assert!(taken > seen && taken < 2.0 * seen, "{v}: {seen} {taken}");
        }
    }
}
