//! Effect of noise and rounding of the positions on rows, if velocities are computed from
//! positions.
//!
//! A slope over 2h + 1 samples (`velocity.rs`) and a window (`rows.rs`) are both linear in the
//! positions, so errors e of the positions with variance s², uncorrelated between samples, become
//!
//! ```text
//! q̇ = Σ w_u q_u,    w_u = (S₆ u − S₄ u³)/((S₂ S₆ − S₄²) Δ),    S_p = Σ uᵖ over −h … h             (1)
//! ∫ψ dq̇/∫ψ = Σ g_m q_m,    var = s² Σ g_m²                                                        (2)
//! q_{i+1} − q_i − ½ (t_{i+1} − t_i)(q̇_i + q̇_{i+1}) = Σ r_m e_m,    mean square = s² Σ r_m²          (3)
//! ```
//!
//! (2) is an error of the acceleration. (3) measures the actual s², including the effect of late or
//! early time stamps. If a joint is slower than a count per sample, (3) is too small, so s² is at
//! least that of the rounding, count²/12.

use super::state::RobotSample;
use super::windows::psi;
use crate::model::MAX_JOINTS;

/// Relative change of period or length above which (2) and (3) are recomputed.
const CHANGED: f64 = 0.05;
/// Weight of one interval in the mean period.
const FOLLOWED: f64 = 0.02;

/// Errors of the positions, estimated from the samples.
#[derive(Debug, Clone)]
pub(super) struct EncoderNoise {
    /// Time on either side over which velocities were computed \[s\].
    half_s: f64,
    period_s: f64,
    /// Mean square (3) over about half a window.
    square: [f64; MAX_JOINTS],
    /// Smallest step of a position so far; infinite before the first.
    count: [f64; MAX_JOINTS],
    /// Period and length \[s\] for which the two sums were computed.
    made_for: (f64, f64),
    /// Σ g² of (2) \[1/s⁴\], Σ r² of (3).
    of_window: f64,
    of_step: f64,
}

impl EncoderNoise {
    /// For velocities computed over this time on either side \[s\].
    pub fn new(half_s: f64) -> Self {
        Self {
            half_s,
            period_s: 0.0,
            square: [0.0; MAX_JOINTS],
            count: [f64::INFINITY; MAX_JOINTS],
            made_for: (0.0, 0.0),
            of_window: 0.0,
            of_step: 1.0,
        }
    }

    /// Adds the step of n joints from one sample to the next, with windows of this length \[s\].
    pub fn take(&mut self, last: &RobotSample, sample: &RobotSample, n: usize, length_s: f64) {
        let gap = sample.t_s - last.t_s;
        self.period_s = match self.period_s {
            0.0 => gap,
            period_s => period_s + FOLLOWED * (gap - period_s),
        };
        let share = (2.0 * gap / length_s).min(1.0);
        for k in 0..n {
            let step = sample.q[k] - last.q[k];
            let error = step - 0.5 * gap * (last.dq[k] + sample.dq[k]); // (3)
            self.square[k] += share * (error * error - self.square[k]);
            if step != 0.0 {
                self.count[k] = self.count[k].min(step.abs());
            }
        }
    }

    /// Variances of the accelerations of n joints over a window of this length \[s\], by (2).
    pub fn variances(&mut self, n: usize, length_s: f64) -> [f64; MAX_JOINTS] {
        self.make(length_s);
        let mut variances = [0.0; MAX_JOINTS];
        for (k, variance) in variances.iter_mut().enumerate().take(n) {
            let rounding = match self.square[k] > 0.0 && self.count[k].is_finite() {
                true => self.count[k].powi(2) / 12.0,
                false => 0.0,
            };
            *variance = self.of_window * (self.square[k] / self.of_step).max(rounding); // (2), (3)
        }
        variances
    }

    /// Σ g² of (2) and Σ r² of (3).
    fn make(&mut self, length_s: f64) {
        let (period_s, made) = (self.period_s, self.made_for);
        let is_near = |now: f64, made: f64| (now / made - 1.0).abs() < CHANGED;
        if !(period_s > 0.0) || is_near(period_s, made.0) && length_s == made.1 {
            return;
        }
        self.made_for = (period_s, length_s);
        let h = ((self.half_s / period_s).round() as i32).max(2);
        let sum = |power: i32| -> f64 { (-h..=h).map(|u| f64::from(u).powi(power)).sum() };
        let (s2, s4, s6) = (sum(2), sum(4), sum(6));
        let scale = 1.0 / ((s2 * s6 - s4 * s4) * period_s);
        let slope = |u: i32| -> f64 {
            let x = f64::from(u);
            if u.abs() <= h {
                (s6 * x - s4 * x * x * x) * scale
            } else {
                0.0
            } // (1)
        };
        let step = |m: i32| f64::from(i8::from(m == 1) - i8::from(m == 0));
        let of_step = |m: i32| step(m) - 0.5 * period_s * (slope(m) + slope(m - 1)); // (3)
        self.of_step = (-h..=h + 1).map(|m| of_step(m).powi(2)).sum();
        let reach = (0.5 * length_s / period_s).ceil() as i32;
        let shape = |i: i32| psi(2.0 * f64::from(i) * period_s / length_s);
        let weight: f64 = (-reach..=reach).map(|i| shape(i) * period_s).sum();
        let of_velocity = |i: i32| 0.5 * (shape(i - 1) - shape(i + 1)) / weight; // (2) of rows.rs
        let of_position = |m: i32| -> f64 {
            let overlap = (m - h).max(-reach)..=(m + h).min(reach);
            overlap.map(|i| of_velocity(i) * slope(m - i)).sum()
        };
        self.of_window = (-reach - h..=reach + h).map(|m| of_position(m).powi(2)).sum(); // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::RobotModel;
    use super::super::rows::WeakRows;
    use super::super::selection::Selection;
    use super::super::tree::Robot;
    use super::super::velocity::with_velocities;
    use super::super::windows::WindowOptions;
    use super::*;

    /// (2) with s² by (3) for a robot at rest with noisy encoders, so all accelerations are errors.
    /// Two per window are uncorrelated, so 30 s of six joints with windows of 0.25 s have 1440,
    /// whose mean square has a standard deviation of 3.7 %: 12 % is three times that.
    #[test]
    fn val_accelerations_of_noise_have_the_variance_that_is_foretold() {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        let model = RobotModel::new(robot, true, vec![Default::default(); 6]).unwrap();
        for (period_s, half_s, length_s) in [(0.001, 0.02, 0.1), (0.002, 0.02, 0.25), (0.01, 0.02, 0.25)] {
            let mut random = crate::random::Random(7);
            let log: Vec<RobotSample> = (0..(30.0 / period_s) as usize)
                .map(|i| RobotSample {
                    t_s: period_s * i as f64,
                    q: std::array::from_fn(|_| 1e-4 * random.normal()),
                    ..RobotSample::default()
                })
                .collect();
            let windows = WindowOptions::of_length(length_s);
            let mut rows = WeakRows::new(&model, windows).unwrap().with_formed_velocities(half_s);
            for sample in with_velocities(&log, half_s, windows.max_gap_s) {
                rows.push(&model, &sample, &mut |_| {}).unwrap();
            }
            let motion = rows.motion();
            let (square, noise): (f64, f64) = (motion.square.iter().sum(), motion.noise.iter().sum());
            assert!((square / noise - 1.0).abs() < 0.12, "{period_s}: {}", square / noise);
        }
    }
}
