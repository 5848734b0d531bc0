//! Chooses the window length from the motion.
//!
//! ```text
//! a_k  = (q_{k+1} − 2 q_k + q_{k−1})/h²
//! A(f)   its power at frequency f, less that of the positions' noise, (2 − 2 cos 2πfh)² σ²/h⁴
//! bandwidth f_b: 99 % of ∫ A df lie below     T = 1.3/f_b
//! ```
//!
//! The bump of length T passes frequencies below 1.3/T and averages the rest. Much longer windows
//! lose the fastest motion, which informs on a small inertia or an inductance, unless their stride
//! is short; much shorter ones cost more computing. Within a factor of four either way the
//! estimates hardly change, see docs/method.md.
//!
//! A step of the setpoint is motion at every frequency: f_b is then the frequency at which noise
//! dominates, and 1.3/f_b can be a few samples. But windows of 8 samples give wrong results: with
//! such steps the offset of an axis is 10 % (13 standard deviations) off, while windows of 12 to 60
//! samples agree. So no window of fewer than [`FEWEST_WINDOW_SAMPLES`] samples is advised.

use super::intake::BRIDGED;
use super::noise::SignalNoise;
use super::polynomial::{MOST, weights};
use std::f64::consts::TAU;

/// Smallest number of samples in a window whose length is advised or chosen.
pub const FEWEST_WINDOW_SAMPLES: f64 = 20.0;
/// Number of samples from which a missing value is interpolated.
const STENCIL: usize = 4;
/// Deviation from the grid that counts as rounding of a time stamp \[sample periods\].
const ROUNDING: f64 = 1e-3;

/// Share of the acceleration's power that counts as motion.
const SHARE: f64 = 0.99;
/// Power that may be noise, as a multiple of its expected value.
const DOUBT: f64 = 4.0;
/// Frequencies per factor of e.
const PER_E: f64 = 20.0;
/// Most spectral lines that are averaged for each of them: a single one exceeds four times its
/// expected value once in 55 times, which at high frequencies would look like motion; the mean of
/// 16 never does.
const LINES: usize = 16;

/// A window's length with its reason.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowAdvice {
    /// 99 % of the acceleration's power lie below this frequency \[Hz\].
    pub bandwidth_hz: f64,
    /// T \[s\], a whole even number of sample periods.
    pub window_s: f64,
}

/// Advice from the positions of one joint \[rad or m\], `sample_period_s` \[s\] apart, without
/// holes; `None` if there are fewer than 500 or nothing moves.
pub fn window_advice(q: &[f64], sample_period_s: f64) -> Option<WindowAdvice> {
    Spectrum::new(q.len()).advise(q, sample_period_s, variance(q, |_| false))
}

/// The same from time stamps \[ns\] and positions, of which some may be lost or irregular. Lost
/// samples are interpolated by cubic polynomials, up to as many in a row as windows bridge; of the
/// stretches between longer holes only the longest is used.
pub fn window_advice_at(samples: &[(u64, f64)], sample_period_s: f64) -> Option<WindowAdvice> {
    let period_ns = sample_period_s * 1e9;
    let step = |pair: &[(u64, f64)]| (pair[1].0 as f64 - pair[0].0 as f64) / period_ns;
    let bridged = |pair: &[(u64, f64)]| (0.0..BRIDGED as f64 + 1.5).contains(&step(pair)) && pair[1].0 > pair[0].0;
    let stretch = samples
        .chunk_by(|a, b| bridged(&[*a, *b]))
        .max_by_key(|stretch| stretch.len())?;
    let raw: Vec<f64> = stretch.iter().map(|sample| sample.1).collect();
    let behind_hole = |k: usize| k > 0 && step(&stretch[k - 1..=k]) > 1.5;
    let variance = variance(&raw, behind_hole);
    let q = on_the_grid(stretch, period_ns)?;
    Spectrum::new(q.len()).advise(&q, sample_period_s, variance)
}

/// Variance of the positions' noise; those that are `made` are left out.
fn variance(q: &[f64], made: impl Fn(usize) -> bool) -> f64 {
    let mut noise = SignalNoise::default();
    noise.learn(q, made, &mut Vec::with_capacity(q.len()));
    noise.deviation().powi(2) + noise.resolution().powi(2) / 12.0
}

/// Positions one period apart, from a stretch of samples; `None` if these are too few to
/// interpolate.
fn on_the_grid(stretch: &[(u64, f64)], period_ns: f64) -> Option<Vec<f64>> {
    let (begin, end) = (stretch.first()?.0, stretch.last()?.0);
    let place = |sample: &(u64, f64)| (sample.0 - begin) as f64 / period_ns;
    let mut at = 0;
    let value = |k: usize| {
        let x = k as f64;
        while place(stretch.get(at)?) < x - ROUNDING {
            at += 1;
        }
        if place(&stretch[at]) <= x + ROUNDING {
            return Some(stretch[at].1);
        }
        let from = at.saturating_sub(STENCIL / 2).min(stretch.len().checked_sub(STENCIL)?);
        let near = &stretch[from..from + STENCIL];
        let nodes: [f64; STENCIL] = std::array::from_fn(|j| place(&near[j]) - x);
        let mut w = [0.0; MOST];
        weights(&nodes, STENCIL - 1, 0.0, &mut w);
        Some(near.iter().zip(&w).map(|(sample, w)| w * sample.1).sum())
    };
    let count = ((end - begin) as f64 / period_ns + ROUNDING) as usize + 1;
    (0..count).map(value).collect()
}

/// Repeated advice, with its own workspace.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    acceleration: Vec<f64>,
    /// Frequency, and the motion's power there.
    parts: Vec<(f64, f64)>,
}

impl Spectrum {
    /// Workspace for at most `samples` samples.
    pub fn new(samples: usize) -> Self {
        Self {
            acceleration: Vec::with_capacity(samples),
            parts: Vec::with_capacity((PER_E * (0.2 * samples as f64).max(1.0).ln()).ceil() as usize + 1),
        }
    }

    /// As [`window_advice`], from positions with noise of this `variance`; if there are more
    /// samples than the workspace holds, the last ones are used.
    pub fn advise(&mut self, q: &[f64], sample_period_s: f64, variance: f64) -> Option<WindowAdvice> {
        let q = &q[q.len().saturating_sub(self.acceleration.capacity())..];
        let h = sample_period_s;
        if q.len() < 500 || !(h > 0.0) {
            return None;
        }
        // Hann's taper keeps slow motion out of the fast bins
        let n = q.len() - 2;
        let taper = |k: usize| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n as f64).cos();
        let (a, parts) = (&mut self.acceleration, &mut self.parts);
        a.clear();
        a.extend((0..n).map(|k| taper(k) * (q[k + 2] - 2.0 * q[k + 1] + q[k]) / (h * h)));
        let gain: f64 = (0..n).map(|k| taper(k).powi(2)).sum();
        let lowest = 2.0 / (n as f64 * h);
        let count = (PER_E * (0.4 / (h * lowest)).ln()).max(1.0) as usize;
        parts.clear();
        for i in 0..count.min(parts.capacity()) {
            let frequency = lowest * (i as f64 / PER_E).exp();
            // as many lines as the record resolves up to the next frequency
            let lines = ((frequency / PER_E * n as f64 * h) as usize).clamp(1, LINES);
            let (mut power, mut expected) = (0.0, 0.0);
            for line in 0..lines {
                let angle = TAU * h * frequency * (line as f64 / lines as f64 / PER_E).exp();
                // Goertzel's recursion
                let (coefficient, mut s1, mut s2) = (2.0 * angle.cos(), 0.0, 0.0);
                for &x in a.iter() {
                    (s1, s2) = (x + coefficient * s1 - s2, s1);
                }
                power += (s1 * s1 + s2 * s2 - coefficient * s1 * s2) / gain / lines as f64;
                expected += (2.0 - 2.0 * angle.cos()).powi(2) * variance / h.powi(4) / lines as f64;
            }
            let motion = if power > DOUBT * expected {
                power - expected
            } else {
                0.0
            };
            // equal steps of the logarithm: df is proportional to f
            parts.push((frequency, motion * frequency));
        }
        let total: f64 = parts.iter().map(|part| part.1).sum();
        let mut sum = 0.0;
        let bandwidth_hz = parts.iter().find_map(|&(frequency, part)| {
            sum += part;
            (total > 0.0 && sum >= SHARE * total).then_some(frequency)
        })?;
        let half = (0.65 / (bandwidth_hz * h)).round();
        Some(WindowAdvice {
            bandwidth_hz,
            window_s: 2.0 * half.clamp(0.5 * FEWEST_WINDOW_SAMPLES, 1000.0) * h,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_advice_follows_the_fastest_motion_and_ignores_rounding() {
        for (frequency, count) in [(13.0, 1e-4), (13.0, 1e-6), (2.0, 1e-5)] {
            let q: Vec<f64> = (0..8000)
                .map(|k| {
                    let t = k as f64 * 1e-3;
                    let x = 0.5 * (3.0 * t).sin() + 0.01 * (TAU * frequency * t).sin();
                    (x / count).round() * count
                })
                .collect();
            let advice = window_advice(&q, 1e-3).unwrap();
            // the step of a twentieth of e, and the width of the taper's main lobe
            assert!(
                (advice.bandwidth_hz / frequency - 1.0).abs() < 0.2,
                "{frequency} {count}: {advice:?}"
            );
            assert!(
                (advice.window_s * advice.bandwidth_hz / 1.3 - 1.0).abs() < 0.05,
                "{advice:?}"
            );
        }
        // white noise that exceeds the motion at high frequencies: no single line of it counts as
        // motion
        let mut state = 1_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for record in 0..12 {
            let q: Vec<f64> = (0..4000)
                .map(|k| 0.01 * (TAU * 13.0 * 1e-3 * k as f64).sin() + 4e-4 * noise())
                .collect();
            let bandwidth_hz = window_advice(&q, 1e-3).unwrap().bandwidth_hz;
            assert!((10.0..17.0).contains(&bandwidth_hz), "{record}: {bandwidth_hz}");
        }
        assert_eq!(window_advice(&[1.0; 1000], 1e-3), None);
        assert_eq!(window_advice(&[0.0, 1.0], 1e-3), None);
    }
}
