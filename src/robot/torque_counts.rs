//! Torques quantised to counts without noise.
//!
//! Rounding to counts of Δ is noise of Δ²/12 if the torque changes by a count from sample to
//! sample. If it stays at one count for longer than half a window, its error is constant for that
//! time and appears as friction. With p the share of the samples in motion for which this holds,
//!
//! ```text
//! e² = p² Δ²/12                                                                               (1)
//! P_ii ← P_ii + e²/mean x_i²                                                                   (2)
//! ```
//!
//! over the terms of a joint's friction, x_i the column of one. Δ is the smallest step so far,
//! which is almost 0 for an unquantised torque. With noise of half a count, or motion that crosses
//! counts, p is 0.

use super::model::RobotModel;
use super::state::RobotSample;
use super::sums::JointSums;
use crate::model::MAX_JOINTS;
use std::ops::Range;

/// Averaging time of p, in samples.
const FOLLOWED: f64 = 5000.0;

/// Counts of the torques, estimated from the samples.
#[derive(Debug, Clone)]
pub(super) struct TorqueCounts {
    last: [f64; MAX_JOINTS],
    /// Time of the last step \[s\].
    changed_s: [f64; MAX_JOINTS],
    /// Δ; infinite before the first step.
    count: [f64; MAX_JOINTS],
    /// p, and the number of samples in motion.
    share: [f64; MAX_JOINTS],
    samples: [f64; MAX_JOINTS],
    /// Variance added by (2), per parameter.
    variance: Vec<f64>,
}

impl TorqueCounts {
    /// Workspace for `parameters` parameters.
    pub fn new(parameters: usize) -> Self {
        Self {
            last: [f64::NAN; MAX_JOINTS],
            changed_s: [f64::NAN; MAX_JOINTS],
            count: [f64::INFINITY; MAX_JOINTS],
            share: [0.0; MAX_JOINTS],
            samples: [0.0; MAX_JOINTS],
            variance: vec![0.0; parameters],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        let variance = std::mem::take(&mut self.variance);
        *self = Self {
            variance,
            ..Self::new(0)
        };
        self.variance.fill(0.0);
    }

    /// Adds a sample, with windows of this length \[s\]; resting joints are ignored.
    pub fn take(&mut self, model: &RobotModel, sample: &RobotSample, length_s: f64) {
        for (k, friction) in model.friction().iter().enumerate() {
            let step = (sample.tau[k] - self.last[k]).abs();
            self.last[k] = sample.tau[k];
            if sample.dq[k].abs() < friction.rest_speed {
                continue;
            }
            if step > 0.0 {
                self.count[k] = self.count[k].min(step);
            }
            if step != 0.0 {
                self.changed_s[k] = sample.t_s;
            }
            let stays = f64::from(sample.t_s - self.changed_s[k] > 0.5 * length_s);
            self.samples[k] = (self.samples[k] + 1.0).min(FOLLOWED);
            self.share[k] += (stays - self.share[k]) / self.samples[k];
        }
    }

    /// e² of a joint.
    fn square_error(&self, joint: usize) -> f64 {
        match self.count[joint].is_finite() {
            true => (self.share[joint] * self.count[joint]).powi(2) / 12.0, // (1)
            false => 0.0,
        }
    }

    /// (2) over these blocks of a joint, whose `columns` are `parameters`; no standard deviation is
    /// larger than the `size` of its parameter.
    pub fn look_at<'a>(
        &mut self,
        joint: usize,
        blocks: impl Iterator<Item = &'a JointSums> + Clone,
        (columns, parameters): (Range<usize>, Range<usize>),
        size: impl Fn(usize) -> f64,
    ) {
        let square = self.square_error(joint);
        for (column, parameter) in columns.zip(parameters) {
            let sum: f64 = blocks.clone().map(|sums| sums.squares(column)).sum();
            let rows: usize = blocks.clone().map(|sums| sums.rows).sum();
            let variance = square * rows as f64 / sum; // (2)
            self.variance[parameter] = if sum > 0.0 {
                variance.min(size(parameter).powi(2))
            } else {
                0.0
            };
        }
    }

    /// The variance that (2) adds.
    pub fn variance(&self, parameter: usize) -> f64 {
        self.variance.get(parameter).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// e, relative to Δ/√12, of a torque with this slope per sample.
    fn error(noise: f64, slope: f64) -> f64 {
        let mut random = crate::random::Random(3);
        let mut counts = TorqueCounts::new(0);
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = super::super::tree::Robot::from_urdf(urdf, &Default::default()).unwrap();
        let model = RobotModel::new(robot, true, vec![Default::default(); 6]).unwrap();
        for i in 0..4000 {
            let torque = slope * f64::from(i) + noise * random.normal();
            let sample = RobotSample {
                t_s: 0.001 * f64::from(i),
                dq: [1.0; MAX_JOINTS],
                tau: [0.5 * (torque / 0.5).round(); MAX_JOINTS],
                ..RobotSample::default()
            };
            counts.take(&model, &sample, 0.1);
        }
        counts.square_error(0).sqrt() * 12.0_f64.sqrt() / 0.5
    }

    #[test]
    fn val_rounding_lasts_without_noise_and_motion() {
        // 9 counts in 4 s; the first 50 ms of each do not count
        assert!((error(0.0, 1e-3) - (1.0 - 9.0 * 0.05 / 4.0)).abs() < 0.01);
        assert_eq!(error(0.0, 1e-2), 0.0);
        assert!(error(0.25, 1e-3) < 0.01);
        // without a step there is no evidence of counts
        assert_eq!(error(0.0, 0.0), 0.0);
    }
}
