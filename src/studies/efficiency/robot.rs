//! The shipped six-axis robot: simulated runs, the identifier, and other methods on the same
//! samples.
//!
//! ```text
//! simulated robot ─▶ positions, torques, 1 kHz ─┬▶ RobotIdentifier, on line, as shipped
//!                                                ├▶ its windows, least squares off line
//!                                                └▶ differentiated positions, with instruments or not
//! its true states ─▶ the Cramér–Rao bound, `robot_bound`
//! ```
//!
//! Everything is as in `config/robots/six_axis.toml`, except for offsets of the drives, which are 0
//! there, and without a payload.

use super::robot_bound::{RobotBound, RobotTruth};
use super::robot_regression::{differentiated, in_windows};
use crate::model::MAX_JOINTS;
use crate::robot::{
    Excitation, ExcitationOptions, Forecaster, IdentifyOptions, JointFriction, JointRange, MotionLimits, Motions,
    Robot, RobotError, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions, RobotSimulator, RowMisfit, Selection,
    SimulatedDrive, WindowOptions, with_velocities,
};
use std::sync::Arc;

const URDF: &str = include_str!("../../../config/robots/six_axis.urdf");
const JOINTS: usize = 6;
/// Length of a run \[s\].
pub const ROBOT_RUN_S: f64 = 40.0;
/// Time on either side over which velocities are computed \[s\].
const VELOCITY_S: f64 = 0.02;
/// Largest relative difference of each body from the URDF.
const DIFFERENCE: f64 = 0.15;
/// Offset of the drives relative to their Coulomb friction.
const OFFSET: f64 = 0.5;
/// Number of motions tried for the designed one.
const TRIES: usize = 400;
/// Period of the points of the designed motion \[s\], as `thetabus excite` writes them.
const POINTS_S: f64 = 0.01;

/// Why a run of the robot has no outcome.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotRunError {
    /// The robot cannot be simulated or identified.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The robot has another number of joints.
    #[error("expected a robot of six joints")]
    Joints,
    /// The state of the simulated robot is no longer finite.
    #[error("the simulated robot is lost")]
    Lost,
    /// The information of the run cannot be inverted.
    #[error("the run determines no parameter")]
    Uninformative,
}

/// Motions of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotMotion {
    /// Sums of sines, different for each seed, as in the configuration.
    Fourier,
    /// The periodic motion that `thetabus excite` designs, the same for each seed.
    Designed,
    /// From posture to posture with rests of half a second, different for each seed.
    Moves,
}

impl RobotMotion {
    /// Every motion, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Fourier, Self::Designed, Self::Moves];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fourier => "six-axis, fourier",
            Self::Designed => "six-axis, designed",
            Self::Moves => "six-axis, moves",
        }
    }

    fn motions(self, model: &RobotModel) -> Result<Motions, RobotError> {
        Ok(match self {
            Self::Fourier => Motions::Fourier {
                harmonics: 5,
                period_s: 20.0,
            },
            Self::Moves => Motions::Moves { rest_s: 0.5 },
            Self::Designed => {
                let MotionLimits {
                    part,
                    reach,
                    acceleration,
                } = MotionLimits::default();
                let ranges = JointRange::of(model.robot(), part, reach, acceleration);
                let options = ExcitationOptions {
                    tries: TRIES,
                    ..ExcitationOptions::new(ranges)
                };
                let windows = RobotCase::identification(model.robot()).windows;
                let misfit = RowMisfit::white(&torque_std(model.robot()), sample_period_s(model.robot()), &windows);
                let mut forecaster = Forecaster::new(model.clone(), windows, misfit)?;
                let motion = Excitation::design(&mut forecaster, &options, &mut |_| true)?;
                Motions::Table(Arc::new(motion.table(POINTS_S)?))
            }
        })
    }
}

/// An estimator in the comparison of robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotMethod {
    /// The service as shipped, on line.
    Ours,
    /// Least squares over the rows of its windows with equal weights, off line.
    Windows,
    /// The same with the noise of each joint's torque as weights.
    WeightedWindows,
    /// Weighted least squares on differentiated positions, off line.
    Differentiated,
    /// The same with the reference motion as instruments.
    Instruments,
}

impl RobotMethod {
    /// Every estimator, in the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::Ours,
        Self::Windows,
        Self::WeightedWindows,
        Self::Differentiated,
        Self::Instruments,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "thetabus",
            Self::Windows => "windows, least squares",
            Self::WeightedWindows => "windows, weighted",
            Self::Differentiated => "differentiated, weighted",
            Self::Instruments => "instrumental variables",
        }
    }
}

/// Result of a run after its last sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotOutcome {
    /// True θ.
    pub truth: Vec<f64>,
    /// Smallest standard deviations with an unknown initial state.
    pub bound: Vec<f64>,
    /// The same with exact positions.
    pub exact_bound: Vec<f64>,
    /// θ̂ of each of [`RobotMethod::ALL`]; `None` if it does not determine θ.
    pub estimates: [Option<Vec<f64>>; RobotMethod::ALL.len()],
    /// Standard deviations published by the service.
    pub own_std: Vec<f64>,
}

impl RobotOutcome {
    /// (θ̂ − θ)/bound of a parameter; `None` if there is no θ̂.
    pub fn ratio(&self, method: RobotMethod, i: usize) -> Option<f64> {
        let theta = self.estimates[method as usize].as_ref()?;
        Some((theta[i] - self.truth[i]) / self.bound[i])
    }
}

/// Standard deviation of the recorded torques.
fn torque_std(robot: &Robot) -> Vec<f64> {
    let part = RobotSimOptions::new(robot).torque_noise;
    let effort = |joint: &crate::robot::RobotJoint| joint.limits.effort.unwrap_or(100.0);
    robot.joints.iter().map(|joint| part * effort(joint)).collect()
}

fn sample_period_s(robot: &Robot) -> f64 {
    RobotSimOptions::new(robot).sample_period_s
}

/// The robot with one motion, for any seed.
#[derive(Debug, Clone)]
pub struct RobotCase {
    model: RobotModel,
    motions: Motions,
}

impl RobotCase {
    /// The robot with a motion; designing one takes seconds.
    ///
    /// # Errors
    /// If the robot or the motion is invalid.
    pub fn new(motion: RobotMotion) -> Result<Self, RobotError> {
        let selection = Selection {
            tip: Some("flange".to_owned()),
            ..Selection::default()
        };
        let robot = Robot::from_urdf(URDF, &selection)?;
        let model = RobotModel::new(robot, true, vec![JointFriction::default(); JOINTS])?;
        Ok(Self {
            motions: motion.motions(&model)?,
            model,
        })
    }

    /// Its model.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// Options of the simulation for a seed, which selects the machine, the noise and, if drawn,
    /// the motion.
    pub fn options(&self, seed: u64) -> RobotSimOptions {
        let robot = self.model.robot();
        let offset = |(i, drive): (usize, SimulatedDrive)| SimulatedDrive {
            offset: if i.is_multiple_of(2) { OFFSET } else { -OFFSET } * drive.coulomb,
            ..drive
        };
        RobotSimOptions {
            seed,
            machine_seed: seed,
            difference: DIFFERENCE,
            motions: self.motions.clone(),
            drives: SimulatedDrive::sized(robot)
                .into_iter()
                .enumerate()
                .map(offset)
                .collect(),
            ..RobotSimOptions::new(robot)
        }
    }

    /// Options of the identification.
    pub fn identification(robot: &Robot) -> IdentifyOptions {
        IdentifyOptions {
            windows: WindowOptions::for_period(sample_period_s(robot)),
            lengthens: true,
            formed_over_s: Some(VELOCITY_S),
            payload: true,
            // The zeros of the simulated encoders are those of the URDF, and nothing is late.
            zero_rad: 0.0,
            delay_s: 0.0,
            friction_shape: 0.0,
            spring_share: 0.0,
            ..IdentifyOptions::default()
        }
    }

    /// Simulates a run of this length and passes its samples to every estimator.
    ///
    /// # Errors
    /// If the robot cannot be simulated or identified.
    pub fn run(&self, seed: u64, duration_s: f64) -> Result<RobotOutcome, RobotRunError> {
        let (model, robot) = (&self.model, self.model.robot());
        let options = self.options(seed);
        let period_s = options.sample_period_s;
        let mut simulator = RobotSimulator::new(robot, options.clone()).map_err(RobotError::from)?;
        let count = model.parameters().len();
        let mut truth = simulator.truth(model, 0.0);
        truth.truncate(count);
        let resolution = std::f64::consts::TAU / f64::from(options.encoder_bits).exp2();
        let machine = RobotTruth {
            bodies: simulator.bodies().to_vec(),
            drives: options.drives.clone(),
            presliding: options.presliding,
            sample_period_s: period_s,
            torque_std: torque_std(robot),
            position_std: vec![resolution / 12f64.sqrt(); JOINTS],
        };
        let mut bound = RobotBound::<JOINTS>::new(model, machine).ok_or(RobotRunError::Joints)?;
        let samples = (duration_s / period_s).round() as usize;
        let mut log = Vec::with_capacity(samples);
        let mut setpoints: Vec<[f64; MAX_JOINTS]> = Vec::with_capacity(samples);
        for k in 0..samples {
            let (q, dq) = simulator.state();
            bound.advance(&q, &dq);
            let sample = simulator.next().ok_or(RobotRunError::Lost)?;
            log.push(RobotSample {
                t_s: period_s * k as f64,
                q: sample.q,
                dq: sample.dq,
                tau: sample.input,
            });
            setpoints.push(sample.setpoint);
        }
        let [bound, exact_bound] = bound.std().ok_or(RobotRunError::Uninformative)?;
        let identification = Self::identification(self.model.robot());
        let moving = with_velocities(&log, VELOCITY_S, identification.windows.max_gap_s);
        let mut identifier = RobotIdentifier::new(model.clone(), identification).map_err(RobotError::from)?;
        for sample in &moving {
            identifier.push(sample).map_err(RobotError::from)?;
        }
        let noise = torque_std(robot);
        let of_rows = RowMisfit::white(&noise, period_s, &identification.windows);
        let of_rows: Vec<f64> = of_rows
            .std
            .iter()
            .zip(&of_rows.correlation)
            .map(|(s, f)| s * f)
            .collect();
        let [windows, weighted_windows] = in_windows(model, identification.windows, &moving, &of_rows)?;
        let [differentiated, instruments] = differentiated(model, &log, &setpoints, &noise);
        Ok(RobotOutcome {
            truth,
            bound,
            exact_bound,
            estimates: [
                Some(identifier.theta()[..count].to_vec()),
                windows,
                weighted_windows,
                differentiated,
                instruments,
            ],
            own_std: (0..count).map(|i| identifier.theta_std(i)).collect(),
        })
    }
}
