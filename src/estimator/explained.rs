//! Share of the signal's power that each equation explains, required before θ̂ may be used.
//!
//! ```text
//! explained = 1 − Σ f_n(θ̂)²/Σ (v_n − v̄)²,   v = f + φᵀθ̂,   in the last block with a signal     (1)
//! explained = 1 − (Σ f² − n σ²)⁺/Σ (v − v̄)²,   if the noise σ² is known                         (2)
//! S ← 0.95 S + S_block,   (2) of the sums S,   if  Σ n σ² √(2/Σ n) < 0.0025 Σ (v − v̄)²          (3)
//! ```
//!
//! A noise level that is learnt from the rows cannot tell a bad model from a noisy machine: on
//! white noise, or with the wrong sign of the input, it becomes as large as the signal. The share
//! of the signal's power that the model explains can. It is judged only if the signal exceeds the
//! noise by 20 dB (2), or 30 dB if the level was learnt (1), so that a machine at rest neither
//! confirms nor refutes a model; before the first such block nothing is explained.
//!
//! A machine that moves little may never exceed its noise that far. If the noise of its sensors is
//! known, blocks of at least 10 dB are averaged (3) until the scatter of their residuals' power is
//! below half of what may stay unexplained. They only decide about an equation that no stronger
//! block has shown to be explained.

use super::Structure;
use super::fit_statistic::{EquationFit, NoiseLevel};
use super::persist::Visit;

/// Share of the signal's power that a model must explain: residuals of at most a fourteenth of the
/// signal.
pub const LEAST_EXPLAINED: f64 = 0.995;
/// Ratio of signal power to known noise power above which a single block shows what the model
/// explains.
const STANDS_OUT: f64 = 100.0;
/// The same for a learnt noise level, which includes what is unexplained: the noise alone is then
/// below 0.1 %.
const STANDS_OUT_OF_LEARNT: f64 = 1000.0;
/// The same for a block of (3).
const WEAK: f64 = 10.0;
/// Memory of (3) per block.
const MEMORY: f64 = 0.95;
/// Standard deviation of the share (3) above which it is not used.
const UNCERTAIN: f64 = 0.0025;

/// The share of an equation, and the sums (3).
#[derive(Debug, Clone, Copy, Default)]
pub struct Explained {
    /// 0 to 1; negative if the residuals exceed the signal.
    pub share: f64,
    residual: f64,
    noise: f64,
    signal: f64,
    rows: f64,
}

impl Explained {
    /// Of each equation before the first block: 0, or 1 if it has no parameters and nothing to
    /// explain.
    pub fn nothing(structure: &Structure) -> impl Iterator<Item = Self> {
        structure.equations.iter().map(|own| Self {
            share: f64::from(u8::from(own.is_empty())),
            ..Self::default()
        })
    }

    /// State kept from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        for number in [
            &mut self.share,
            &mut self.residual,
            &mut self.noise,
            &mut self.signal,
            &mut self.rows,
        ] {
            v.real(number);
        }
    }

    /// Takes a block with noise of this level; `sensors` is the variance that the sensors alone
    /// give the rows, if it is known.
    pub fn take(&mut self, fit: &EquationFit, level: NoiseLevel, sensors: Option<f64>) {
        if fit.rows == 0 {
            return;
        }
        let (rows, noise_is_configured) = (fit.rows as f64, level.freedom.is_infinite());
        let (least, known) = match noise_is_configured {
            true => (STANDS_OUT, rows * level.variance),
            false => (STANDS_OUT_OF_LEARNT, 0.0),
        };
        if fit.signal > least * rows * level.variance {
            *self = Self {
                share: 1.0 - (fit.residual - known).max(0.0) / fit.signal, // (1), (2)
                ..Self::default()
            };
        } else if self.share < LEAST_EXPLAINED
            && let Some(variance) = if noise_is_configured {
                Some(level.variance)
            } else {
                sensors
            }
        {
            self.average(fit, rows, variance);
        }
    }

    /// (3).
    fn average(&mut self, fit: &EquationFit, rows: f64, variance: f64) {
        let noise = rows * variance;
        if !(fit.signal > WEAK * noise) {
            return;
        }
        let new = [fit.residual, noise, fit.signal, rows];
        let sums = [&mut self.residual, &mut self.noise, &mut self.signal, &mut self.rows];
        for (sum, new) in sums.into_iter().zip(new) {
            *sum = MEMORY * *sum + new; // (3)
        }
        if self.noise * (2.0 / self.rows).sqrt() < UNCERTAIN * self.signal {
            self.share = 1.0 - (self.residual - self.noise).max(0.0) / self.signal; // (3)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEARNT: NoiseLevel = NoiseLevel {
        variance: 1.0,
        freedom: 200.0,
    };
    const TOLD: NoiseLevel = NoiseLevel {
        variance: 1.0,
        freedom: f64::INFINITY,
    };

    fn fit(residual: f64, signal: f64) -> EquationFit {
        EquationFit {
            rows: 1000,
            residual: 1000.0 * residual,
            signal: 1000.0 * signal,
            ..EquationFit::default()
        }
    }

    /// 17 dB. The residuals' power scatters by √(2/n), so 0.0025 of the signal needs
    /// 2/(0.0025 · 50)² = 128 rows: one block of 1000 is enough.
    #[test]
    fn prop_weak_blocks_count_if_the_noise_is_known_and_until_the_model_is_confirmed() {
        let mut e = Explained::default();
        e.take(&fit(1.1, 50.0), LEARNT, None);
        assert_eq!(e.share, 0.0, "noise learnt from the rows");
        e.take(&fit(1.1, 50.0), LEARNT, Some(1.0));
        assert!((e.share - 0.998).abs() < 1e-12);
        e.take(&fit(20.0, 50.0), TOLD, None);
        assert!(e.share > 0.99, "confirmed: weak blocks no longer decide");
        e.take(&fit(20.0, 500.0), TOLD, None);
        assert!((e.share - 0.962).abs() < 1e-12, "a strong one does");
        for _ in 0..20 {
            e.take(&fit(1.0, 50.0), TOLD, None);
        }
        assert!(e.share > LEAST_EXPLAINED, "sums begin anew after a strong block");
    }

    /// Residuals of a sign error are four times the signal, those of a model without meaning as
    /// large as the signal.
    #[test]
    fn prop_weak_blocks_confirm_no_wrong_model_and_blocks_of_noise_say_nothing() {
        for wrong in [0.1, 1.0, 4.0] {
            let mut e = Explained::default();
            for _ in 0..50 {
                e.take(&fit(1.0 + 15.0 * wrong, 15.0), TOLD, None);
            }
            assert!((e.share - (1.0 - wrong)).abs() < 1e-9);
        }
        let mut e = Explained::default();
        e.take(&fit(1.0, 9.0), TOLD, Some(1.0));
        e.take(&fit(1.0, f64::NAN), TOLD, Some(1.0));
        assert_eq!(e.share, 0.0);
    }
}
