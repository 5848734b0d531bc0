//! A robot drawn at random with its motion and sensors, and its identifier.

use super::random_case::RandomRobotCase;
use super::random_urdf::random_urdf;
use crate::messages::{nanoseconds, signals};
use crate::node::identifier::IdentifierOptions;
use crate::node::robot::{RobotLearner, RobotNode};
use crate::robot::{
    Drives, FrictionTerm, IdentifyOptions, JointFriction, MotionLimits, Motions, Robot, RobotController, RobotError,
    RobotIdentifier, RobotModel, RobotSimOptions, Selection, Velocities, WindowOptions,
};
use crate::studies::draw::Draw;

/// Length of a run \[s\].
pub(super) const LENGTH_S: f64 = 75.0;
/// Time to either side over which velocities are formed \[s\].
const FORMED_OVER_S: f64 = 0.02;
/// Coulomb friction of [`RobotSimOptions::new`] as a share of the largest torque.
const COULOMB: f64 = 0.04;

/// A machine with its motion and sensors.
pub(super) struct RandomRobot {
    pub robot: Robot,
    pub options: RobotSimOptions,
    /// Period of the samples \[ms\].
    pub period_ms: u64,
    /// True if the model has only viscous and Coulomb friction and offsets, as the machine has.
    pub has_few_terms: bool,
}

impl RandomRobot {
    /// The machine of a seed; its model of friction is the case's.
    pub fn new(case: RandomRobotCase, seed: u64, draw: &mut Draw) -> Result<Self, RobotError> {
        let robot = Robot::from_urdf(&random_urdf(draw), &Selection::default())?;
        let period_ms = draw.of(&[1, 1, 1, 2, 4, 10]);
        let mut options = RobotSimOptions {
            sample_period_s: 1e-3 * period_ms as f64,
            control_steps: period_ms as usize,
            substeps: 2,
            seed,
            machine_seed: seed,
            difference: draw.between(0.0, 0.4),
            presliding: draw.log(2e-5, 2e-3),
            encoder_bits: draw.of(&[14, 16, 16, 17, 20]),
            torque_noise: draw.log(0.001, 0.02),
            bandwidth_rad_per_s: draw.log(15.0, 60.0),
            limits: MotionLimits {
                part: draw.between(0.4, 0.9),
                reach: draw.between(0.4, 1.5),
                acceleration: draw.log(1.0, 12.0),
            },
            has_velocity: case == RandomRobotCase::MeasuredVelocities,
            ..RobotSimOptions::new(&robot)
        };
        if draw.chance(0.2) {
            options.controller = RobotController::Pd;
        }
        options.motions = match draw.chance(0.5) {
            true => Motions::Moves {
                rest_s: draw.of(&[0.0, 0.5, 1.0, 3.0]),
            },
            false => Motions::Fourier {
                harmonics: draw.of(&[2, 3, 5, 8]),
                period_s: draw.between(6.0, 30.0),
            },
        };
        let has_few_terms = match case {
            RandomRobotCase::FewTerms => true,
            RandomRobotCase::AllTerms => false,
            _ => draw.chance(0.5),
        };
        for drive in &mut options.drives {
            let largest = drive.coulomb / COULOMB;
            drive.viscous *= draw.log(0.2, 3.0);
            drive.coulomb *= draw.log(0.2, 3.0);
            drive.rotor_inertia *= draw.log(0.1, 5.0);
            drive.offset = largest * draw.between(-0.02, 0.02);
            let stribeck = drive.coulomb * draw.between(0.0, 0.6);
            if draw.chance(0.3) && !has_few_terms {
                drive.stribeck = stribeck;
            }
        }
        if has_few_terms {
            options.presliding = JointFriction::default().presliding;
        }
        Ok(Self {
            robot,
            options,
            period_ms,
            has_few_terms,
        })
    }

    /// Its identifier, with the service's default options.
    fn identifier(&self) -> Result<RobotIdentifier, RobotError> {
        let mut friction = JointFriction::default();
        if self.has_few_terms {
            friction.terms = vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset];
        }
        let friction = vec![friction; self.robot.len()];
        let model = RobotModel::new(self.robot.clone(), true, friction)?;
        let options = IdentifyOptions {
            windows: WindowOptions::for_period(self.options.sample_period_s),
            lengthens: true,
            formed_over_s: (!self.options.has_velocity).then_some(FORMED_OVER_S),
            payload: true,
            ..IdentifyOptions::default()
        };
        Ok(RobotIdentifier::new(model, options)?)
    }

    /// The signals of a sample.
    pub fn mask(&self) -> u32 {
        let velocity = if self.options.has_velocity { signals::DQ } else { 0 };
        signals::Q | signals::INPUT | velocity
    }

    /// The node of the service with this identifier, with blocks of 1 s.
    pub fn node(&self) -> Result<RobotNode, RobotError> {
        let (options, n) = (&self.options, self.robot.len());
        let half = ((FORMED_OVER_S / options.sample_period_s).round() as usize).max(2);
        let gap_s = FORMED_OVER_S.max(3.0 * options.sample_period_s);
        let former = (!options.has_velocity).then(|| Velocities::new(half, gap_s));
        let node = IdentifierOptions {
            sample_period_ns: nanoseconds(options.sample_period_s),
            ..IdentifierOptions::new(1000 / self.period_ms, n, self.mask())
        };
        let learner = RobotLearner::new(Drives::torque(n), self.identifier()?, former);
        Ok(RobotNode::new(node, learner, 1))
    }
}
