//! The desired motion of a simulator with its derivatives, for feed-forward. The motion of a robot
//! has exact derivatives; those of setpoints are central differences over seven points, h the
//! sample period; the error of q⃛ is 7/120 h⁴ q⁽⁷⁾, below 1e-4 of it up to 10 Hz at 1 kHz:
//!
//! ```text
//! q̇ = Σ a_k q(t + k h)/h      a = (−1, 9, −45, 0, 45, −9, 1)/60
//! q̈ = Σ b_k q(t + k h)/h²     b = (2, −27, 270, −490, 270, −27, 2)/180
//! q⃛ = Σ c_k q(t + k h)/h³     c = (1, −8, 13, 0, −13, 8, −1)/8
//! ```

use crate::model::{JointSample, MAX_JOINTS};
use crate::node::model::{Model, ModelError};
use crate::sim::{DesiredMotion, SetpointPath, SimOptions};

const POINTS: usize = 7;
const BEFORE: usize = 3;
const FIRST: [f64; POINTS] = [-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0];
const SECOND: [f64; POINTS] = [2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0];
const THIRD: [f64; POINTS] = [1.0, -8.0, 13.0, 0.0, -13.0, 8.0, -1.0];

/// Largest advance of a trajectory of setpoints in one call \[samples\]: about 10 ms of work, so a
/// wrong sample number cannot block the caller.
pub const CATCH_UP: u64 = 100_000;

/// Why a machine has no motion that feed-forward could follow.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// Setpoints that jump.
    #[error(
        "plant.setpoint.kind: expected setpoints without jumps (sines, random_sines, chirp, moves), for no input follows a jump"
    )]
    Jumps,
    /// Options that do not fit the model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Desired motion of a simulated machine, sample by sample.
#[derive(Debug, Clone)]
pub struct Trajectory {
    motion: Motion,
    sample_period_s: f64,
    k: u64,
}

#[derive(Debug, Clone)]
enum Motion {
    /// With its derivatives.
    Smooth(Box<dyn DesiredMotion>),
    /// To be differentiated.
    Setpoints(Box<Setpoints>),
}

impl Trajectory {
    /// The motion of a model's simulator, or else the setpoints of the simulation, beginning with
    /// sample 0.
    ///
    /// # Errors
    /// Setpoints that jump: no input follows them. Options that do not fit the model.
    pub fn of(model: &dyn Model, options: &SimOptions) -> Result<Self, TrajectoryError> {
        match model.desired_motion(options)? {
            Some(motion) => Ok(Self {
                motion: Motion::Smooth(motion),
                sample_period_s: options.sample_period_s,
                k: 0,
            }),
            None => Self::new(options),
        }
    }

    /// The setpoints of a simulation, beginning with sample 0.
    ///
    /// # Errors
    /// Setpoints that jump: no input follows them.
    pub fn new(options: &SimOptions) -> Result<Self, TrajectoryError> {
        Ok(Self {
            motion: Motion::Setpoints(Box::new(Setpoints::new(options)?)),
            sample_period_s: options.sample_period_s,
            k: 0,
        })
    }

    /// Number of the sample whose motion comes next.
    pub fn position(&self) -> u64 {
        self.k
    }

    /// The desired motion in the middle between sample k and k + 1; then k + 1 is next.
    pub fn advance(&mut self) -> JointSample {
        let motion = match &mut self.motion {
            Motion::Smooth(motion) => motion.at((self.k as f64 + 0.5) * self.sample_period_s),
            Motion::Setpoints(setpoints) => setpoints.advance(self.k),
        };
        self.k += 1;
        motion
    }

    /// Advances to a later sample, by at most [`CATCH_UP`] samples; true if it has arrived there.
    /// It cannot go back.
    pub fn advance_to(&mut self, k: u64) -> bool {
        match self.motion {
            Motion::Smooth(_) => self.k = self.k.max(k),
            Motion::Setpoints(_) => {
                let reached = k.min(self.k.saturating_add(CATCH_UP));
                while self.k < reached {
                    self.advance();
                }
            }
        }
        self.k >= k
    }
}

/// Setpoints, and their derivatives by differences.
#[derive(Debug, Clone)]
struct Setpoints {
    paths: Vec<SetpointPath>,
    sample_period_s: f64,
    /// q at samples k − 3 … k + 3, half a period later: a command is held from one sample to the
    /// next, so its mean time is the middle.
    window: [[f64; POINTS]; MAX_JOINTS],
}

impl Setpoints {
    fn new(options: &SimOptions) -> Result<Self, TrajectoryError> {
        let joints = options.joints();
        if options
            .setpoint
            .iter()
            .take(joints)
            .any(crate::sim::Setpoint::has_steps)
        {
            return Err(TrajectoryError::Jumps);
        }
        let mut setpoints = Self {
            paths: (0..joints)
                .map(|joint| {
                    let setpoint = &options.setpoint[joint % options.setpoint.len()];
                    SetpointPath::new(setpoint, joint, options.sample_period_s, options.seed)
                })
                .collect(),
            sample_period_s: options.sample_period_s,
            window: [[0.0; POINTS]; MAX_JOINTS],
        };
        for (window, path) in setpoints.window.iter_mut().zip(&mut setpoints.paths) {
            for k in 0..BEFORE + 1 {
                window[BEFORE + k] = path.value(k as u64, 0.5);
            }
            // before the beginning the machine rests
            let first = window[BEFORE];
            window[..BEFORE].fill(first);
        }
        Ok(setpoints)
    }

    fn advance(&mut self, k: u64) -> JointSample {
        let h = self.sample_period_s;
        let mut motion = JointSample::default();
        for (joint, path) in self.paths.iter_mut().enumerate() {
            let window = &mut self.window[joint];
            let sum = |weights: &[f64; POINTS]| weights.iter().zip(&*window).map(|(w, q)| w * q).sum::<f64>();
            motion.q[joint] = window[BEFORE];
            motion.dq[joint] = sum(&FIRST) / (60.0 * h);
            motion.ddq[joint] = sum(&SECOND) / (180.0 * h * h);
            motion.dddq[joint] = sum(&THIRD) / (8.0 * h * h * h);
            motion.setpoint[joint] = window[BEFORE];
            window.rotate_left(1);
            window[POINTS - 1] = path.value(k + 1 + BEFORE as u64, 0.5);
        }
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Setpoint, Tone};

    #[test]
    fn val_the_derivatives_of_sines_are_those_of_their_formula() {
        let (amplitude_rad, frequency_hz) = (0.4, 1.3);
        let tones = vec![Tone {
            frequency_hz,
            amplitude_rad,
            phase_rad: 0.2,
        }];
        let sines = Setpoint::Sines { offset_rad: 0.1, tones };
        let options = SimOptions {
            setpoint: [sines.clone(), sines],
            ..SimOptions::cedro2022()
        };
        let mut trajectory = Trajectory::new(&options).unwrap();
        assert!(trajectory.advance_to(100));
        for k in 100..2000 {
            let w = std::f64::consts::TAU * frequency_hz;
            let (s, c) = (w * (k as f64 + 0.5) * 1e-3 + 0.2).sin_cos();
            let motion = trajectory.advance();
            let expected = [0.1 + amplitude_rad * s, w * c, -w * w * s, -w * w * w * c];
            // rounding of q, 1e-16, over h, h² and h³; truncation as the head says: (w h)⁴ = 4e-9
            for (got, (expected, limit)) in [motion.q[1], motion.dq[1], motion.ddq[1], motion.dddq[1]]
                .into_iter()
                .zip(
                    [expected[0], 0.4 * expected[1], 0.4 * expected[2], 0.4 * expected[3]]
                        .into_iter()
                        .zip([1e-12, 1e-10, 1e-8, 1e-4]),
                )
            {
                assert!((got - expected).abs() < limit, "{k}: {got} {expected}");
            }
        }
        assert!(!trajectory.advance_to(u64::MAX), "it comes back");
        let jumps = SimOptions::cedro2022();
        assert_eq!(Trajectory::new(&jumps).unwrap_err(), TrajectoryError::Jumps);
    }
}
