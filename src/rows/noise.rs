//! Learns the sensors' noise from the signals if it is not configured.
//!
//! ```text
//! Δ⁶x_k = x_k − 6 x_{k−1} + 15 x_{k−2} − 20 x_{k−3} + 15 x_{k−4} − 6 x_{k−5} + x_{k−6}
//! Var Δ⁶n = 924 σ² for white noise n
//! σ̂ = median |Δ⁶x| / (0.6745 √924)
//! ```
//!
//! The sixth difference multiplies a motion of ω rad/s by ω⁶h⁶, 3e-7 at 13 Hz and 1 kHz, so only
//! the noise remains; the median ignores the few samples around a jump. The variances of the blocks
//! are averaged with slow exponential forgetting.
//!
//! **Counts.** Rounding to counts of a size c shows: all differences of consecutive samples are
//! multiples of the smallest one that is not zero. Then c²/12 is the variance, and c shows where
//! the joint creeps. The differences add the noise besides the rounding, from samples that cross
//! two counts or more each, because a joint at rest shows none.

/// Coefficients of the sixth difference.
const DIFFERENCE: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];
/// Sum of their squares.
const GAIN: f64 = 924.0;
/// Smallest number of samples of a block that is used.
const ENOUGH: usize = 200;
/// Share of differences that must be whole counts.
const WHOLE: f64 = 0.99;
/// Factor on a block's weight with every further block.
const FORGETTING: f64 = 0.98;
/// Ratio to the variance of rounding above which there is other noise too.
const BEYOND_ROUNDING: f64 = 1.3;

/// Noise of one signal, learnt block by block.
#[derive(Debug, Clone, Default)]
pub(super) struct SignalNoise {
    /// Smallest difference of two consecutive samples so far.
    step: Option<f64>,
    quantised: bool,
    sum: f64,
    weight: f64,
}

impl SignalNoise {
    /// Adds a block of consecutive samples, except those that are `made`; `scratch` needs the same
    /// capacity.
    pub fn learn(&mut self, x: &[f64], made: impl Fn(usize) -> bool, scratch: &mut Vec<f64>) {
        if x.len() < ENOUGH {
            return;
        }
        let pairs = || x.windows(2).enumerate().filter(|(k, _)| !made(*k) && !made(k + 1));
        let differences = || pairs().map(|(_, pair)| (pair[1] - pair[0]).abs()).filter(|d| *d > 0.0);
        if let Some(least) = differences().reduce(f64::min) {
            let step = self.step.map_or(least, |known| known.min(least));
            self.step = Some(step);
            let (mut whole, mut all) = (0usize, 0usize);
            for d in differences() {
                let counts = d / step;
                whole += usize::from((counts - counts.round()).abs() < 0.01);
                all += 1;
            }
            self.quantised = whole as f64 >= WHOLE * all as f64;
        }
        let crossing = if self.quantised {
            12.0 * self.step.unwrap_or(0.0)
        } else {
            0.0
        };
        scratch.clear();
        for part in x.windows(DIFFERENCE.len()) {
            if (part[6] - part[0]).abs() >= crossing {
                let sixth: f64 = part.iter().zip(&DIFFERENCE).map(|(x, c)| c * x).sum();
                scratch.push(sixth.abs());
            }
        }
        if scratch.len() >= ENOUGH {
            let middle = scratch.len() / 2;
            let (_, median, _) = scratch.select_nth_unstable_by(middle, f64::total_cmp);
            let deviation = *median / (0.6745 * GAIN.sqrt());
            let weight = scratch.len() as f64;
            self.sum = FORGETTING * self.sum + weight * deviation * deviation;
            self.weight = FORGETTING * self.weight + weight;
        }
    }

    /// False until enough samples have been seen.
    pub fn is_known(&self) -> bool {
        self.quantised || self.weight > 0.0
    }

    /// Size of a count, 0 if the signal is not rounded.
    pub fn resolution(&self) -> f64 {
        if self.quantised { self.step.unwrap_or(0.0) } else { 0.0 }
    }

    /// Standard deviation of the noise besides the rounding.
    pub fn deviation(&self) -> f64 {
        let variance = if self.weight > 0.0 { self.sum / self.weight } else { 0.0 };
        let rounding = self.resolution().powi(2) / 12.0;
        if variance > BEYOND_ROUNDING * rounding {
            (variance - rounding).sqrt()
        } else {
            0.0
        }
    }

    /// Resets to a state without data.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal numbers by the sum of twelve uniform ones, good enough for a median.
    fn noise(count: usize, sigma: f64) -> Vec<f64> {
        let mut state = 12345u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 * (-53f64).exp2()
        };
        (0..count)
            .map(|_| sigma * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0))
            .collect()
    }

    /// Motion of 13 Hz and a slow one, with a jump.
    fn motion(k: usize) -> f64 {
        let t = k as f64 * 1e-3;
        0.05 * (82.0 * t).sin() + 0.5 * (3.0 * t).sin() + if k > 700 { 10.0 } else { 0.0 }
    }

    #[test]
    fn val_white_noise_is_found_under_motion_and_a_jump() {
        let mut signal = SignalNoise::default();
        for block in 0..5 {
            let x: Vec<f64> = (0..1900)
                .map(motion)
                .zip(noise(1900 * 6, 0.02).split_off(1900 * block))
                .map(|(m, n)| m + n)
                .collect();
            signal.learn(&x, |_| false, &mut Vec::new());
        }
        assert_eq!(signal.resolution(), 0.0);
        // the median of 9500 correlated values has a standard deviation of about 2 %
        assert!((signal.deviation() / 0.02 - 1.0).abs() < 0.06, "{}", signal.deviation());
    }

    #[test]
    fn val_counts_are_found_with_and_without_noise_beside_them() {
        for (count, sigma) in [(1e-4, 0.0), (6e-6, 0.0), (1e-4, 3e-4)] {
            let mut signal = SignalNoise::default();
            let x: Vec<f64> = (0..1900)
                .zip(noise(1900, sigma))
                .map(|(k, n)| ((motion(k) + n) / count).round() * count)
                .collect();
            signal.learn(&x, |_| false, &mut Vec::new());
            assert!(
                (signal.resolution() / count - 1.0).abs() < 1e-6,
                "{}",
                signal.resolution()
            );
            let found = signal.deviation();
            // 1900 values at a few per cent each
            assert!((found - sigma).abs() <= 0.1 * sigma, "{sigma}: {found}");
        }
    }

    #[test]
    fn prop_exact_signals_and_resting_ones_have_next_to_no_noise() {
        let mut signal = SignalNoise::default();
        let x: Vec<f64> = (0..1900).map(|k| motion(k.min(600))).collect();
        signal.learn(&x, |_| false, &mut Vec::new());
        // the sixth difference of the motion itself
        assert!(signal.deviation() < 1e-9, "{}", signal.deviation());
        let mut rest = SignalNoise::default();
        rest.learn(&[1.0; 1900], |_| false, &mut Vec::new());
        assert_eq!((rest.resolution(), rest.deviation()), (0.0, 0.0));
    }
}
