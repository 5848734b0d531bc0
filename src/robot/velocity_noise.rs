//! Errors of measured velocities, found by comparing them with the positions.
//!
//! Velocities and positions each give the mean acceleration over a window ψ of `rows.rs`, with
//! errors of the positions of variance s² at each sample:
//!
//! ```text
//! W a_v = ∫ψ dq̇,   W a_q = −∫ψ̇ dq,   W = ∫ψ dt                                                   (1)
//! E[(a_v − a_q)²] = var(a_v) + s² Σ c_m²,   c_m = Δ ψ̈(t_m)/W                                       (2)
//! e_i = q_{i+1} − q_i − ½ (t_{i+1} − t_i)(q̇_i + q̇_{i+1}),   s² = (E[e_i²] − 2 E[e_i e_{i+1}])/4      (3)
//! ```
//!
//! In (3), white errors of the velocities cancel and slow ones are negative, so that s² is only
//! that of the positions. (2) sees all errors of the velocities, whatever their spectrum: noise,
//! rounding, a filter, a delay. Velocities that are differences of the positions have the errors of
//! these: the left side of (2) is then about 0, and var(a_v) about s² Σ c_m². So var(a_v) is taken
//! as |(a_v − a_q)² − s² Σ c_m²| in the mean, which holds for both.

use super::state::RobotSample;
use super::windows::{psi, psi_and_slope};
use crate::model::MAX_JOINTS;

/// Number of windows in the mean (2).
const WINDOWS: f64 = 64.0;
/// Number of samples in the means (3).
const SAMPLES: f64 = 4096.0;
/// Relative change of the period above which Σ c² is computed again.
const CHANGED: f64 = 0.05;

/// Errors of measured velocities, estimated from the samples.
#[derive(Debug, Clone, Default)]
pub(super) struct VelocityNoise {
    samples: f64,
    period_s: f64,
    /// Last e of (3), and the time of its second sample \[s\].
    error: [f64; MAX_JOINTS],
    error_t_s: f64,
    /// Means of e² and of e_i e_{i+1}.
    square: [f64; MAX_JOINTS],
    product: [f64; MAX_JOINTS],
    windows: f64,
    /// Mean of (a_v − a_q)².
    difference: [f64; MAX_JOINTS],
    /// Period for which Σ c² was computed, 0 before the first time, and Σ c² \[1/s⁴\].
    made_for_s: f64,
    of_window: f64,
    variances: [f64; MAX_JOINTS],
}

impl VelocityNoise {
    /// Adds the step from one sample to the next, q_{i+1} − q_i = `travel`.
    pub fn take(&mut self, last: &RobotSample, sample: &RobotSample, travel: &[f64]) {
        let gap = sample.t_s - last.t_s;
        let follows = self.samples > 0.0 && self.error_t_s == last.t_s;
        self.samples = (self.samples + 1.0).min(SAMPLES);
        let share = 1.0 / self.samples;
        self.period_s += share * (gap - self.period_s);
        for (k, travel) in travel.iter().enumerate() {
            let error = travel - 0.5 * gap * (last.dq[k] + sample.dq[k]); // (3)
            self.square[k] += share * (error * error - self.square[k]);
            if follows {
                self.product[k] += share * (error * self.error[k] - self.product[k]);
            }
            self.error[k] = error;
        }
        self.error_t_s = sample.t_s;
    }

    /// Adds a window of this length \[s\], with the accelerations a_v and a_q of the joints.
    pub fn take_window(&mut self, by_velocities: &[f64], by_positions: &[f64], length_s: f64) {
        if self.made_for_s == 0.0 || (self.period_s / self.made_for_s - 1.0).abs() > CHANGED {
            self.made_for_s = self.period_s;
            self.of_window = squares_of_positions(self.period_s, length_s);
        }
        self.windows = (self.windows + 1.0).min(WINDOWS);
        let accelerations = by_velocities.iter().zip(by_positions);
        for (k, (of_velocity, of_position)) in accelerations.enumerate() {
            let square = (of_velocity - of_position).powi(2);
            self.difference[k] += (square - self.difference[k]) / self.windows;
            let position = (0.25 * (self.square[k] - 2.0 * self.product[k])).max(0.0); // (3)
            self.variances[k] = (self.difference[k] - position * self.of_window).abs(); // (2)
        }
    }

    /// Variances of the accelerations of the joints over a window.
    pub fn variances(&self) -> &[f64; MAX_JOINTS] {
        &self.variances
    }

    /// Forgets the windows, because the next ones have another length.
    pub fn forget_windows(&mut self) {
        (self.windows, self.made_for_s) = (0.0, 0.0);
        self.difference = [0.0; MAX_JOINTS];
    }
}

/// Σ c² of (2) \[1/s⁴\]: the same sums over steps as in `rows.rs`, by parts.
fn squares_of_positions(period_s: f64, length_s: f64) -> f64 {
    let reach = (0.5 * length_s / period_s).ceil() as i32;
    let at = |i: i32| 2.0 * f64::from(i) * period_s / length_s;
    let slope = |i: i32| psi_and_slope(at(i)).1 * 2.0 / length_s;
    let weight: f64 = (-reach..=reach).map(|i| psi(at(i)) * period_s).sum();
    let of_position = |m: i32| 0.5 * (slope(m + 1) - slope(m - 1)) / weight;
    (-reach - 1..=reach + 1).map(|m| of_position(m).powi(2)).sum()
}
