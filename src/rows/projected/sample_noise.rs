//! Noise of each sample of a block, from the configured or learnt noise of the sensors.
//!
//! ```text
//! σ_q²(k) = σ² + LSB²/12 · v_k        σ_u²(k) = σ_u² + surplus_k
//! ```
//!
//! v_k ≥ 1 accounts for rounding that is not white (`rounding.rs`). Replaced samples (`repair.rs`)
//! have a larger variance.

use super::samples::Samples;
use super::sensor_noise::SensorNoise;
use super::weak_form::WeakForm;
use crate::rows::kernel::dot;
use crate::rows::noise::SignalNoise;
use crate::rows::repair::Kind;
use crate::rows::rounding;
use std::ops::Range;

/// Noise of exact input signals, relative to their size.
pub(super) const EXACT: f64 = 1e-7;
/// Standard deviation of an exact position, so that it can be a divisor; its square adds nothing to
/// R.
const EXACT_STD: f64 = 1e-150;
/// Standard deviations above which an acceleration is more than noise.
const SURE: f64 = 3.0;
/// Share of the largest factor on the variance of rounding that applies if a joint rests on one
/// side of a sample only. An error e that ends within a window at k has the effect of white noise
/// of e² (Σ_{j<k} c_j)²/Σ_{j<k} c_j², some 10 e² for most k. The whole factor would hide a payload
/// of +2 % that is picked up at rest.
const RESTING: f64 = 1.0 / 3.0;

/// The noise of the samples.
#[derive(Debug, Clone)]
pub(super) struct SampleNoise {
    /// Noise of the sensors, as configured or as learnt so far.
    pub sensors: SensorNoise,
    /// Learnt noise of each joint's position and input.
    learnt: Vec<[SignalNoise; 2]>,
    /// Standard deviation of each position \[joint\]\[sample\].
    pub q_std: Vec<Vec<f64>>,
    /// Inputs with additional variance, and its size \[joint\].
    pub surplus: Vec<Vec<(usize, f64)>>,
    /// Scratch of the learning.
    statistic: Vec<f64>,
}

impl SampleNoise {
    /// Workspace for `capacity` samples.
    pub fn new(sensors: SensorNoise, joints: usize, capacity: usize) -> Self {
        Self {
            sensors,
            learnt: vec![<[SignalNoise; 2]>::default(); joints],
            q_std: vec![vec![0.0; capacity]; joints],
            // a cloned vector has no spare capacity
            surplus: (0..joints).map(|_| Vec::with_capacity(2 * capacity)).collect(),
            statistic: Vec::with_capacity(capacity),
        }
    }

    /// Learns the noise from a block if so configured, and computes that of each sample.
    pub fn sense(&mut self, form: &WeakForm, samples: &Samples) {
        let longest = samples.longest_stretch();
        for joint in 0..samples.signals.joints() {
            if form.options.learn_noise {
                self.learn(joint, samples, longest.clone());
            }
            self.weigh_positions(joint, form, samples);
            let own = self.input_std(joint).powi(2);
            let surplus = &mut self.surplus[joint];
            samples.repair.surplus(Kind::Input, joint, samples.len, own, surplus);
        }
    }

    /// Learns the noise levels of a joint's sensors from a stretch of their signals. The level of a
    /// signal with too few samples stays unchanged, because 0 would mean an exact sensor.
    fn learn(&mut self, joint: usize, samples: &Samples, stretch: Range<usize>) {
        let [position, input] = &mut self.learnt[joint];
        let made = |kind| {
            let (repair, first) = (&samples.repair, stretch.start);
            move |k: usize| repair.is_made(kind, joint, first + k)
        };
        let q = &samples.signals.q[joint][stretch.clone()];
        position.learn(q, made(Kind::Position), &mut self.statistic);
        let u = &samples.signals.u[joint][stretch.clone()];
        input.learn(u, made(Kind::Input), &mut self.statistic);
        if position.is_known() {
            self.sensors.position_resolution[joint] = position.resolution();
            self.sensors.position_noise[joint] = position.deviation();
        }
        if !input.is_known() {
            return;
        }
        let deviation = input.deviation().hypot(input.resolution() / 12f64.sqrt());
        let size = (dot(u, u) / u.len().max(1) as f64).sqrt();
        self.sensors.input_noise[joint] = if deviation > EXACT * size { deviation } else { 0.0 };
        self.sensors.input_resolution[joint] = 0.0;
    }

    /// Standard deviation of every position of a joint.
    fn weigh_positions(&mut self, joint: usize, form: &WeakForm, samples: &Samples) {
        let resolution = self.sensors.position_resolution[joint];
        let white = self.sensors.position_noise[joint].powi(2);
        let std = &mut self.q_std[joint];
        if resolution > 0.0 {
            let counts = Counts {
                resolution,
                white,
                period_s: form.options.sample_period_s,
                velocity_half: form.velocity.half,
                velocity_gain: form.velocity.gain,
                window_half: form.kernels.half,
            };
            // windows lie both before and after a hole
            for stretch in samples.repair.stretches(samples.len) {
                counts.weigh(&samples.signals.q[joint], &samples.signals.dq[joint], stretch, std);
            }
        } else {
            std[..samples.len].fill(white.sqrt());
        }
        if samples.repair.touched() {
            for (at, deviation) in std[..samples.len].iter_mut().enumerate() {
                let own = *deviation * *deviation;
                *deviation = samples.repair.variance(Kind::Position, joint, at, own).sqrt();
            }
        }
        std[..samples.len].iter_mut().for_each(|std| *std = std.max(EXACT_STD));
    }

    /// Standard deviation of a joint's input.
    pub fn input_std(&self, joint: usize) -> f64 {
        self.sensors.deviations(joint)[1]
    }

    /// True if the noise of every joint's sensors is configured, or learnt from their signals.
    pub fn is_known(&self) -> bool {
        let known = |joint: usize| self.sensors.deviations(joint).iter().any(|std| *std > 0.0);
        (0..self.learnt.len()).all(known)
    }

    /// Adopts what another block has learnt of the same sensors.
    pub fn take_over(&mut self, other: &Self) {
        self.sensors = other.sensors;
        self.learnt.clone_from_slice(&other.learnt);
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.learnt.iter_mut().flatten().for_each(SignalNoise::reset);
    }
}

/// A joint whose positions are rounded to counts.
struct Counts {
    resolution: f64,
    /// Variance of the noise besides the rounding.
    white: f64,
    period_s: f64,
    /// Samples on either side of the velocity filter, and its standard deviation for white noise of
    /// 1.
    velocity_half: usize,
    velocity_gain: f64,
    /// Samples on either side of a window's centre.
    window_half: usize,
}

impl Counts {
    /// Standard deviations of the positions of a stretch without holes.
    fn weigh(&self, q: &[f64], dq: &[f64], stretch: Range<usize>, std: &mut [f64]) {
        // away from the ends every sample has its neighbours, so the loop needs no branches
        let margin = self.window_half.max(2 * self.velocity_half);
        let (first, end) = (stretch.start + margin, stretch.end.saturating_sub(margin));
        if first >= end {
            for at in stretch.clone() {
                std[at] = self.deviation_near_end(q, dq, &stretch, at);
            }
            return;
        }
        let (velocity_span, span) = ((2 * self.velocity_half) as f64, self.window_half as f64);
        let dq_before = &dq[first - self.velocity_half..];
        let dq_behind = &dq[first + self.velocity_half..];
        let q_before = &q[first - self.window_half..];
        let q_behind = &q[first + self.window_half..];
        let velocities = dq[first..end].iter().zip(dq_before).zip(dq_behind);
        let positions = q[first..end].iter().zip(q_before).zip(q_behind);
        for (std, (((dq, dq_before), dq_behind), ((q, q_before), q_behind))) in
            std[first..end].iter_mut().zip(velocities.zip(positions))
        {
            let fast = (*dq, dq_behind - dq_before, velocity_span);
            *std = self.deviation(fast, [q - q_before, q_behind - q], span);
        }
        for at in (stretch.start..first).chain(end..stretch.end) {
            std[at] = self.deviation_near_end(q, dq, &stretch, at);
        }
    }

    /// The same for a sample near an end of a stretch, with the neighbours that exist.
    fn deviation_near_end(&self, q: &[f64], dq: &[f64], stretch: &Range<usize>, at: usize) -> f64 {
        let around = |reach: usize, within: &Range<usize>| {
            let clamp = |k: usize| k.clamp(within.start, within.end - 1);
            let (before, behind) = (clamp(at.saturating_sub(reach)), clamp(at + reach));
            (before, behind, (behind - before).max(1) as f64)
        };
        let (before, behind, span) = around(self.window_half, stretch);
        let half = 0.5 * span;
        let moved = |from: usize, to: usize| match to - from {
            0 => 0.5 * (q[behind] - q[before]),
            samples => half / samples as f64 * (q[to] - q[from]),
        };
        let slow = [moved(before, at), moved(at, behind)];
        // where the velocity filter has all its samples
        let filtered = stretch.start + self.velocity_half..stretch.end.saturating_sub(self.velocity_half);
        if filtered.is_empty() {
            return self.deviation((0.0, 0.0, 1.0), slow, half);
        }
        let (before, behind, span) = around(self.velocity_half, &filtered);
        let velocity = dq[at.clamp(filtered.start, filtered.end - 1)];
        self.deviation((velocity, dq[behind] - dq[before], span), slow, half)
    }

    /// √(σ² + LSB²/12 · v) of a sample, from its velocity and the change of velocity over `span`
    /// samples, if that exceeds the noise. Otherwise the joint is so slow that the position's
    /// changes over `samples` samples before and after are used. A joint that rests until a step of
    /// its setpoint has the same rounding error until then, although it moves within the same
    /// window.
    #[inline(always)]
    fn deviation(&self, (dq, change, span): (f64, f64, f64), moved: [f64; 2], samples: f64) -> f64 {
        let per_sample = self.period_s / self.resolution;
        let acceleration = change * (per_sample / span);
        // standard deviation of the difference of two filtered velocities, in counts
        let noise = self.velocity_gain / (6f64.sqrt() * span);
        let limit = rounding::limit(self.window_half);
        let inflation = match acceleration.abs() > SURE * noise {
            true => rounding::inflation(dq * per_sample, acceleration, limit),
            false => {
                let [before, after] = moved.map(|moved| moved * (1.0 / (self.resolution * samples)));
                let slower = if before.abs() < after.abs() { before } else { after };
                let resting = rounding::inflation(slower, 0.0, RESTING * limit);
                rounding::inflation(0.5 * (before + after), 0.0, limit).max(resting)
            }
        };
        (self.white + self.resolution * self.resolution / 12.0 * inflation).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Variances in units of LSB²/12 of a joint that rests for 300 samples and then moves by
    /// `counts` per sample.
    fn variances(counts: f64) -> Vec<f64> {
        let resting = Counts {
            resolution: 1.0,
            white: 0.0,
            period_s: 1e-3,
            velocity_half: 8,
            velocity_gain: 0.1,
            window_half: 50,
        };
        let q: Vec<f64> = (0..600)
            .map(|k| (counts * f64::from((k - 300).max(0))).round())
            .collect();
        let dq: Vec<f64> = (0..600).map(|k| if k < 300 { 0.0 } else { counts * 1e3 }).collect();
        let mut std = vec![0.0; 600];
        resting.weigh(&q, &dq, 0..600, &mut std);
        std.iter().map(|std| 12.0 * std * std).collect()
    }

    #[test]
    fn regress_rounding_stays_the_same_until_a_resting_joint_moves() {
        let of = variances(0.72);
        let limit = rounding::limit(50);
        // both sides rest, then the window reaches into the motion, then both sides move
        assert!(of[100..240].iter().all(|&v| (v - limit).abs() < 1e-9));
        assert!(
            of[252..290].iter().all(|&v| v > 0.99 * RESTING * limit),
            "{:?}",
            &of[252..290]
        );
        assert!(of[360..500].iter().all(|&v| v < 3.0), "{:?}", &of[360..500]);
    }
}
