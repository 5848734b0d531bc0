//! Velocities from positions alone: the slope of a polynomial through a sample and its neighbours
//! on both sides.
//!
//! ```text
//! q(t_c + u) ≈ a₀ + a₁ u + a₂ u² + a₃ u³ in the least squares sense over 2 h + 1 samples,   q̇(t_c) = a₁
//! ```
//!
//! The neighbours' own time stamps are used, so these need not be regular. The sample in the middle
//! is passed on h samples late, with its own time, position and torque, so no signal is shifted
//! relative to another. Source: A. Savitzky, M. Golay, Analytical Chemistry 36 (1964).

use super::state::RobotSample;
use crate::model::MAX_JOINTS;
use nalgebra::{Matrix4, Vector4};

/// Adds velocities to samples.
#[derive(Debug, Clone)]
pub struct Velocities {
    samples: Vec<RobotSample>,
    next: usize,
    len: usize,
    max_gap_s: f64,
}

impl Velocities {
    /// Velocities over `half` samples on either side, 2 or more; restarts after a gap longer than
    /// `max_gap_s` \[s\].
    pub fn new(half: usize, max_gap_s: f64) -> Self {
        Self {
            samples: vec![RobotSample::default(); 2 * half.max(2) + 1],
            next: 0,
            len: 0,
            max_gap_s,
        }
    }

    /// Forgets the samples so far.
    pub fn restart(&mut self) {
        (self.next, self.len) = (0, 0);
    }

    /// Adds a sample without velocity; returns the one in the middle with its velocity, once it has
    /// neighbours on both sides.
    pub fn push(&mut self, sample: &RobotSample) -> Option<RobotSample> {
        let room = self.samples.len();
        let last = (self.next + room - 1) % room;
        if self.len > 0 && !(sample.t_s - self.samples[last].t_s <= self.max_gap_s) {
            self.restart();
        }
        self.samples[self.next] = *sample;
        self.next = (self.next + 1) % room;
        self.len = (self.len + 1).min(room);
        if self.len < room {
            return None;
        }
        // The ring is full: the oldest is at `next`.
        let at = |age: usize| &self.samples[(self.next + age) % room];
        let mut middle = *at(room / 2);
        let width = at(room - 1).t_s - at(0).t_s;
        let u = |sample: &RobotSample| 2.0 * (sample.t_s - middle.t_s) / width;
        let mut moments = [0.0; 7];
        for age in 0..room {
            let mut power = 1.0;
            for moment in &mut moments {
                *moment += power;
                power *= u(at(age));
            }
        }
        let gram = Matrix4::from_fn(|i, j| moments[i + j]);
        let weights = gram.cholesky()?.solve(&Vector4::y());
        let mut slope = [0.0; MAX_JOINTS];
        for age in 0..room {
            let sample = at(age);
            let x = u(sample);
            let weight = weights[0] + x * (weights[1] + x * (weights[2] + x * weights[3]));
            for (slope, q) in slope.iter_mut().zip(&sample.q) {
                *slope += weight * q;
            }
        }
        middle.dq = slope.map(|slope| 2.0 * slope / width);
        Some(middle)
    }
}

/// The samples of a log with velocities computed from positions over `half_s` \[s\] on either side,
/// at least two samples. Samples at the ends and next to gaps longer than `max_gap_s` \[s\] lack
/// neighbours and are left out.
pub fn with_velocities(log: &[RobotSample], half_s: f64, max_gap_s: f64) -> Vec<RobotSample> {
    let Some(period_s) = median_period_s(log) else {
        return Vec::new();
    };
    // Not more neighbours than there are samples: a wrong unit of time is reported elsewhere.
    let half = ((half_s / period_s).round() as usize).clamp(2, log.len());
    let mut velocities = Velocities::new(half, max_gap_s.max(1.5 * period_s));
    log.iter().filter_map(|sample| velocities.push(sample)).collect()
}

/// Median time between samples \[s\], which pauses do not affect; `None` for fewer than two
/// samples.
pub fn median_period_s(log: &[RobotSample]) -> Option<f64> {
    if log.len() < 2 {
        return None;
    }
    let mut steps: Vec<f64> = log.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let (_, period_s, _) = steps.select_nth_unstable_by((log.len() - 1) / 2, f64::total_cmp);
    Some(*period_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_cubic_has_its_slope_at_irregular_stamps() {
        let mut velocities = Velocities::new(3, 0.1);
        let mut given = 0;
        for k in 0..50 {
            let t = 0.01 * f64::from(k) + 0.003 * f64::from(k % 3);
            let mut sample = RobotSample {
                t_s: t,
                ..RobotSample::default()
            };
            sample.q[1] = 1.0 - 2.0 * t + 3.0 * t * t - 4.0 * t * t * t;
            sample.tau[1] = t;
            if let Some(middle) = velocities.push(&sample) {
                let t = middle.t_s;
                assert!((middle.dq[1] - (-2.0 + 6.0 * t - 12.0 * t * t)).abs() < 1e-9);
                assert_eq!(middle.tau[1], t);
                given += 1;
            }
        }
        assert_eq!(given, 44);
        // After a gap, the next velocity needs as many samples again.
        let late = RobotSample {
            t_s: 9.0,
            ..RobotSample::default()
        };
        assert!(velocities.push(&late).is_none());
    }

    #[test]
    fn val_a_log_has_velocities_but_at_its_ends_and_beside_a_gap() {
        let at = |t: f64| {
            let mut sample = RobotSample {
                t_s: t,
                ..RobotSample::default()
            };
            sample.q[0] = t.sin();
            sample
        };
        // 100 Hz, 2 s, a gap of 1 s, 2 s: 20 ms are two samples to either side.
        let log: Vec<RobotSample> = (0..400)
            .map(|k| at(0.01 * f64::from(k) + if k < 200 { 0.0 } else { 1.0 }))
            .collect();
        let with = with_velocities(&log, 0.02, 0.05);
        assert_eq!(with.len(), 400 - 4 - 4);
        // The cubic leaves 4/5! · 0.01⁴ of the fifth derivative: 3e-10.
        assert!(with.iter().all(|sample| (sample.dq[0] - sample.t_s.cos()).abs() < 1e-8));
        assert_eq!(with_velocities(&log[..4], 0.02, 0.05), []);
        assert_eq!(with_velocities(&[], 0.02, 0.05), []);
    }
}
