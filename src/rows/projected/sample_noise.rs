//! Noise of each sample of a block, from the sensors' noise as configured or learnt.
//!
//! ```text
//! σ_q²(k) = σ² + LSB²/12 · v_k        σ_u²(k) = σ_u² + surplus_k
//! ```
//!
//! v_k ≥ 1 says how far the rounding is from white (`rounding.rs`). Samples that were mended
//! (`repair.rs`) are worth less.

use super::samples::Samples;
use super::sensor_noise::SensorNoise;
use super::weak_form::WeakForm;
use crate::model::Plant;
use crate::rows::kernel::dot;
use crate::rows::noise::SignalNoise;
use crate::rows::repair::Kind;
use crate::rows::rounding;
use std::ops::Range;

/// Share of the input's size that counts as noise of signals that are exact.
pub(super) const EXACT: f64 = 1e-7;
/// Standard deviations beyond which an acceleration is more than noise.
const SURE: f64 = 3.0;

/// The noise of the samples.
#[derive(Debug, Clone)]
pub(super) struct SampleNoise {
    /// What the sensors do, as configured or as learnt so far.
    pub sensors: SensorNoise,
    /// What was learnt of each joint's position and input.
    learnt: Vec<[SignalNoise; 2]>,
    /// Standard deviation of each position \[joint\]\[sample\].
    pub q_std: Vec<Vec<f64>>,
    /// Inputs whose variance is not that of the others, and by how much \[joint\].
    pub surplus: Vec<Vec<(usize, f64)>>,
    /// Scratch of the learning.
    statistic: Vec<f64>,
}

impl SampleNoise {
    /// Room for `capacity` samples.
    pub fn new(sensors: SensorNoise, joints: usize, capacity: usize) -> Self {
        Self {
            sensors,
            learnt: vec![<[SignalNoise; 2]>::default(); joints],
            q_std: vec![vec![0.0; capacity]; joints],
            // a vector's clone has no room
            surplus: (0..joints).map(|_| Vec::with_capacity(2 * capacity)).collect(),
            statistic: Vec::with_capacity(capacity),
        }
    }

    /// Learns the noise of a block if it is to be learnt, and says what each sample is worth.
    pub fn sense<P: Plant>(&mut self, form: &WeakForm<P>, samples: &Samples) {
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

    /// Takes the levels of a joint's sensors from a stretch of their signals. Those of a signal of
    /// which too little has been seen stay as they are: 0 would call the sensor exact.
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
    fn weigh_positions<P: Plant>(&mut self, joint: usize, form: &WeakForm<P>, samples: &Samples) {
        let resolution = self.sensors.position_resolution[joint];
        let (white, rounding) = (
            self.sensors.position_noise[joint].powi(2),
            resolution * resolution / 12.0,
        );
        let (q, dq) = (&samples.signals.q[joint], &samples.signals.dq[joint]);
        let std = &mut self.q_std[joint];
        let per_sample = form.options.sample_period_s / resolution;
        let limit = rounding::limit(form.kernels.half);
        // windows lie before a hole as well as behind it
        for stretch in samples.repair.stretches(samples.len) {
            let around = |at: usize, reach: usize, within: &Range<usize>| {
                let clamp = |k: usize| k.clamp(within.start, within.end - 1);
                let (before, after) = (clamp(at.saturating_sub(reach)), clamp(at + reach));
                (before, after, (after - before).max(1) as f64)
            };
            // where the velocity filter has all its samples
            let half = form.velocity.half;
            let filtered = stretch.start + half..stretch.end.saturating_sub(half);
            for at in stretch.clone() {
                // a joint that is not quantised has no counts
                let inflation = if resolution > 0.0 {
                    let fast = (!filtered.is_empty()).then(|| {
                        let (before, after, span) = around(at, half, &filtered);
                        let acceleration = (dq[after] - dq[before]) * per_sample / span;
                        // of the difference of two filtered velocities, in counts
                        let noise = form.velocity.gain / (6f64.sqrt() * span);
                        let velocity = dq[at.clamp(filtered.start, filtered.end - 1)] * per_sample;
                        (acceleration.abs() > SURE * noise).then(|| rounding::inflation(velocity, acceleration, limit))
                    });
                    // otherwise slow enough to be measured over a window's length
                    fast.flatten().unwrap_or_else(|| {
                        let (before, after, span) = around(at, form.kernels.half, &stretch);
                        rounding::inflation((q[after] - q[before]) / resolution / span, 0.0, limit)
                    })
                } else {
                    1.0
                };
                std[at] = (white + rounding * inflation).sqrt();
            }
        }
        if samples.repair.touched() {
            for (at, deviation) in std[..samples.len].iter_mut().enumerate() {
                let own = *deviation * *deviation;
                *deviation = samples.repair.variance(Kind::Position, joint, at, own).sqrt();
            }
        }
    }

    /// Standard deviation of a joint's input.
    pub fn input_std(&self, joint: usize) -> f64 {
        self.sensors.deviations(joint)[1]
    }

    /// Goes on with what others have learnt of the same sensors.
    pub fn take_over(&mut self, other: &Self) {
        self.sensors = other.sensors;
        self.learnt.clone_from_slice(&other.learnt);
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.learnt.iter_mut().flatten().for_each(SignalNoise::reset);
    }
}
