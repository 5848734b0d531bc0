//! Robots of up to 8 joints from their URDF: kinematics, dynamics, base parameters, and their
//! identification in one pass over a log.
//!
//! ```
//! use thetabus::robot::{IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, Selection};
//!
//! let urdf = include_str!("../../config/robots/six_axis.urdf");
//! let robot = Robot::from_urdf(urdf, &Selection::default())?;
//! let joints = robot.len();
//! let model = RobotModel::new(robot, true, vec![JointFriction::default(); joints])?;
//! let mut identifier = RobotIdentifier::new(model, IdentifyOptions::default())?;
//! for k in 0..300 {
//!     // This arm swings without torque; t_s, q, dq and tau normally come from a log or a robot.
//!     let t_s = 0.01 * f64::from(k);
//!     let (q, dq) = ([0.5 * t_s.sin(); 8], [0.5 * t_s.cos(); 8]);
//!     identifier.push(&RobotSample { t_s, q, dq, ..RobotSample::default() })?;
//! }
//! for (i, parameter) in identifier.model().parameters().iter().enumerate() {
//!     println!("{} = {} ± {} {}", parameter.meaning, identifier.theta()[i], identifier.theta_std(i), parameter.unit);
//! }
//! # assert_eq!(identifier.blocks(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | file | what |
//! |---|---|
//! | `urdf`, `tree` | URDF → links and joints → the tree of moving bodies |
//! | `regressor` | momentum and Lagrangian regressors, without accelerations |
//! | `dynamics` | inverse and forward dynamics, by independent algorithms |
//! | `base_parameters` | the parameter combinations on which torques depend |
//! | `friction`, `scales`, `model` | friction per joint; sizes of the parameters; the whole robot as one linear model |
//! | `rows`, `sums`, `information` | samples → weak-form rows → normal equations |
//! | `windows`, `window_review` | length of the windows, and when they become longer |
//! | `acceleration_noise`, `encoder_noise`, `velocity_noise` | effect of errors of the velocities, formed from positions or measured |
//! | `identify`, `learning`, `known`, `figures` | blocks → estimates with standard deviations and goodness of fit |
//! | `friction_drift`, `offset_drift` | friction and offsets that drift |
//! | `clipped`, `torque_counts`, `echo` | clipped torques; torques rounded to counts; signals that are no torques |
//! | `explained` | share of each joint's torque that the model explains |
//! | `left_out` | terms missing in the model, from the residuals |
//! | `block_scatter` | what no term describes, from the scatter of the blocks |
//! | `impossible` | impossible estimates: negative friction, payload or inertia |
//! | `drive_gain` | a joint whose torque contradicts those of the other joints |
//! | `urdf_prior`, `urdf_moments` | a gravity or a zero that contradicts the URDF, from the moments |
//! | `payload`, `change`, `watch`, `physical` | the payload: detected, located in time, estimated, physically possible |
//! | `inquiry`, `gain_columns`, `jump` | whether a drive's gain or an encoder's zero has changed |
//! | `standard`, `urdf_writer` | physically possible bodies from base parameters; written into the URDF |
//! | `calibration` | gains of the drives from a known load |
//! | `velocity`, `velocity_ratio` | velocities from positions; whether measured ones are the rate of change of the positions |
//! | `reference`, `simulator` | motions within limits; a simulated robot in closed loop |
//! | `motion_table`, `prediction`, `excitation` | a motion as a table; its expected information; informative motions |
//! | `log`, `fit`, `judge`, `suspicion` | logs in columns; measured and predicted torque; probable mistakes in a log |
//! | `error` | what can be wrong with each of these |

mod acceleration_noise;
mod allowances;
mod base_parameters;
mod block_gain;
mod block_scatter;
mod block_scatter_room;
mod butterworth;
mod calibration;
mod carried;
mod change;
mod clipped;
mod comparison;
mod doubt;
mod drive_gain;
mod drive_gain_room;
mod dynamics;
mod echo;
mod encoder_noise;
mod error;
mod estimate;
mod excitation;
mod explained;
mod figures;
mod fit;
mod flange;
mod friction;
mod friction_drift;
mod friction_walk;
mod gain_columns;
mod identify;
mod identify_options;
mod impossible;
mod impossible_room;
mod information;
mod inquiry;
mod intervals;
mod judge;
mod jump;
mod known;
mod learning;
mod left_out;
mod left_out_room;
mod levels;
mod log;
mod model;
mod model_checks;
mod motion_table;
mod offset_drift;
mod open_block;
mod other_travel;
mod past;
mod payload;
mod persist;
mod physical;
mod prediction;
mod recent;
mod recent_blocks;
mod reference;
mod regressor;
mod rows;
mod scales;
mod selection;
mod signal_checks;
mod simulator;
mod skipped;
mod spatial;
mod standard;
mod state;
mod sums;
mod suspicion;
mod torque_counts;
mod tree;
mod unmodelled;
mod urdf;
mod urdf_moments;
mod urdf_prior;
mod urdf_writer;
mod velocity;
mod velocity_noise;
mod velocity_ratio;
mod verdict;
mod watch;
mod window_review;
mod windows;
mod xml;

pub use acceleration_noise::RowErrors;
pub use base_parameters::{BaseParameter, BaseParameters, Standard};
pub use butterworth::ZeroPhaseLowPass;
pub use calibration::{CalibrationError, GainCalibration, KnownLoad};
pub use carried::{CarriedPayload, PAYLOAD_VALUES};
pub use change::{ChangeCause, RobotChange};
pub use doubt::RobotDoubt;
pub use drive_gain_room::WrongGain;
pub use dynamics::{forward_dynamics, inverse_dynamics};
pub use error::{
    DrivesError, FrictionError, IdentifyError, LoadError, MotionError, RobotError, RobotSimError, SampleFault,
    StandardError, UrdfError,
};
pub use excitation::{Excitation, ExcitationOptions, JointRange, MAX_EXCITATION_HARMONICS};
pub use explained::LEAST_EXPLAINED;
pub use figures::BlockFigures;
pub use fit::{TorqueFit, correlation_time_s, filtered};
pub use friction::{Engagement, FrictionTerm, JointFriction};
pub use identify::RobotIdentifier;
pub use identify_options::IdentifyOptions;
pub use impossible_room::Impossible;
pub use judge::{judge_robot_fit, judge_robot_log};
pub use left_out_room::LeftOutCause;
#[cfg(feature = "config")]
pub(crate) use log::columns_in;
pub use log::{Drives, LogColumns, RobotLog, read_log};
pub use model::{Meaningful, RobotModel, RobotParameter};
pub use motion_table::{MotionTable, read_motion};
pub use other_travel::OtherTravel;
pub use payload::Payload;
pub use physical::{
    BodyInformation, controller_std, controller_values, declared_load, information, is_physical, project,
    pseudo_inertia,
};
pub use prediction::{Forecaster, ParameterForecast, RowMisfit};
pub use reference::{MAX_HARMONICS, MotionLimits, Motions, Reference};
pub use regressor::EnergyRegressors;
pub use rows::{WeakRow, WeakRows};
pub use selection::Selection;
pub use simulator::{PayloadChange, RobotController, RobotSimOptions, RobotSimulator, SimulatedDrive};
#[cfg(feature = "service")]
pub(crate) use skipped::InOrder;
pub use skipped::{LogError, Skip, SkippedRows};
pub use spatial::{BODY_PARAMETERS, BodyParameters, Motion, Placement};
pub use standard::StandardParameters;
pub use state::{FilteredSample, RobotSample, Setpoint};
pub use suspicion::RobotSuspicion;
pub use tree::{Robot, RobotJoint, RobotLink};
pub use unmodelled::Unmodelled;
pub use urdf::{Joint, JointKind, Limits, Link, Urdf};
pub use urdf_prior::{Reversed, UrdfContradiction};
pub use urdf_writer::{JointValues, LinkValues, write_urdf};
pub use velocity::{Velocities, median_period_s, with_velocities};
pub use velocity_ratio::WrongVelocities;
pub use windows::{TooFarApart, WindowOptions};
