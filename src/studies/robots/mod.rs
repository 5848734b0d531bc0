//! Trials of robots: the seven-axis arm simulated over many seeds, identified as in the service,
//! and compared with the truth.
//!
//! Each seed is another machine (bodies 15 % off the URDF) on another motion: 1 kHz, 16-bit
//! encoders, torque noise of 0.5 % of the range, velocities computed from positions. Motion,
//! machine and noise depend only on the seed.
//!
//! The files `random_*` draw other robots at random, with sensors and motions of all kinds.

mod random;
mod random_case;
mod random_faults;
mod random_machine;
mod random_table;
mod random_urdf;
mod table;

pub use random::random_robot_trial;
pub use random_case::RandomRobotCase;
pub use random_table::random_robots_document;
pub use table::robots_document;

use crate::robot::{
    ChangeCause, FrictionTerm, IdentifyOptions, JointFriction, PayloadChange, Robot, RobotChange, RobotError,
    RobotIdentifier, RobotModel, RobotSample, RobotSimOptions, RobotSimulator, Selection, Velocities, WindowOptions,
};

/// The arm of the trials.
const URDF: &str = include_str!("../../../config/robots/seven_axis.urdf");
/// Time from sample to sample \[s\].
const PERIOD_S: f64 = 1e-3;
/// Samples on either side from which a velocity is computed.
const HALF_WIDTH: usize = 20;
/// Length of a run with a constant load \[s\].
pub const EMPTY_S: f64 = 60.0;
/// The load is picked up within a second after this, at a different instant for each seed \[s\].
pub const LOADED_FROM_S: f64 = 20.0;
/// Difference of the instant between seeds \[s\]; 73 of them make a second. No border of a window
/// or a block is preferred.
const LOADED_STEP_S: f64 = 0.0137;
/// Length of a block, and so from one estimate to the next \[s\].
pub const BLOCK_S: f64 = 0.25;
/// How long a run continues after the pick-up \[s\].
const AFTER_S: f64 = 5.1;
/// Delay of a velocity, and so of an estimate, relative to its sample \[s\].
const LAG_S: f64 = HALF_WIDTH as f64 * PERIOD_S;
/// Mass of the load \[kg\].
pub const LOAD_KG: f64 = 3.0;
/// Mass of an undeclared load that is present from the start \[kg\].
pub const UNDECLARED_KG: f64 = 2.0;
/// A parameter is excited if its standard deviation is below this share of it.
pub const EXCITED: f64 = 0.002;

/// A parameter at the end of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// True for a parameter of the arm's bodies and rotors, false for friction.
    pub is_base: bool,
    /// Error over the truth.
    pub relative: f64,
    /// Error over the standard deviation.
    pub sigmas: f64,
    /// Standard deviation over the truth.
    pub relative_std: f64,
}

/// A run with a constant load.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EmptyRun {
    /// Each parameter at the end.
    pub parameters: Vec<Outcome>,
    /// Changes reported although nothing changed.
    pub alarms: Vec<RobotChange>,
    /// Blocks of the run.
    pub blocks: usize,
}

/// A run in which the arm picks up a load.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoadedRun {
    /// When the load was picked up \[s\].
    pub at_s: f64,
    /// Changes before the load.
    pub early: usize,
    /// The first change after it.
    pub found: Option<RobotChange>,
    /// Changes after that.
    pub late: usize,
    /// Mass and its standard deviation, as published last within 2 s and within 5 s after the
    /// pick-up \[kg\].
    pub mass: [Option<[f64; 2]>; 2],
}

/// All runs of one seed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotTrial {
    /// Without a load.
    pub empty: EmptyRun,
    /// With a load that is picked up, and an identifier configured for friction that does not
    /// depend on the load, as is true here.
    pub loaded: LoadedRun,
    /// The same with an identifier configured for load-dependent friction, as on real gears.
    pub guarded: LoadedRun,
    /// With an undeclared load from the start.
    pub undeclared: EmptyRun,
}

/// Runs the trials of a seed.
///
/// # Errors
/// If the arm cannot be simulated or identified.
pub fn robot_trial(seed: u64) -> Result<RobotTrial, RobotError> {
    let robot = arm()?;
    Ok(RobotTrial {
        empty: empty_run(&robot, options(&robot, seed, Vec::new()))?,
        loaded: loaded_trial(seed, 0.0)?,
        guarded: loaded_trial(seed, IdentifyOptions::default().payload_friction)?,
        undeclared: empty_run(&robot, options(&robot, seed, vec![load(0.0, UNDECLARED_KG)]))?,
    })
}

/// Runs the trial of a seed in which a load is picked up, with
/// [`payload_friction`](IdentifyOptions::payload_friction).
///
/// # Errors
/// As [`robot_trial`].
pub fn loaded_trial(seed: u64, payload_friction: f64) -> Result<LoadedRun, RobotError> {
    let robot = arm()?;
    let at_s = LOADED_FROM_S + (seed % 73) as f64 * LOADED_STEP_S;
    let identifier = identifier(&robot, payload_friction)?;
    loaded_run(
        &robot,
        identifier,
        options(&robot, seed, vec![load(at_s, LOAD_KG)]),
        at_s,
    )
}

fn arm() -> Result<Robot, RobotError> {
    Ok(Robot::from_urdf(URDF, &Selection::default())?)
}

/// A load of this mass from `t_s` on.
fn load(t_s: f64, mass_kg: f64) -> PayloadChange {
    PayloadChange {
        t_s,
        mass_kg,
        center_m: [0.02, 0.01, 0.08],
        inertia_kg_m2: [0.01, 0.0, 0.012, 0.0, 0.0, 0.008].map(|x| x * mass_kg / LOAD_KG),
    }
}

fn options(robot: &Robot, seed: u64, payloads: Vec<PayloadChange>) -> RobotSimOptions {
    RobotSimOptions {
        seed,
        machine_seed: seed,
        difference: 0.15,
        payloads,
        ..RobotSimOptions::new(robot)
    }
}

fn identifier(robot: &Robot, payload_friction: f64) -> Result<RobotIdentifier, RobotError> {
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: 1e-4,
        ..JointFriction::default()
    };
    let model = RobotModel::new(robot.clone(), true, vec![friction; robot.len()])?;
    let options = IdentifyOptions {
        windows: WindowOptions {
            length_s: 0.1,
            stride_s: 0.02,
            max_gap_s: 0.02,
            ..WindowOptions::default()
        },
        formed_over_s: Some(LAG_S),
        block_s: BLOCK_S,
        friction_walk: 0.0,
        zero_rad: 0.0,
        delay_s: 0.0,
        friction_shape: 0.0,
        spring_share: 0.0,
        payload_friction,
        payload: true,
        ..IdentifyOptions::default()
    };
    Ok(RobotIdentifier::new(model, options)?)
}

/// Passes the samples of a simulation to an identifier, with velocities computed from positions;
/// `closed` is called after each block.
fn run(
    simulator: RobotSimulator,
    seconds: f64,
    identifier: &mut RobotIdentifier,
    mut closed: impl FnMut(f64, &RobotIdentifier),
) -> Result<(), RobotError> {
    let mut velocities = Velocities::new(HALF_WIDTH, 0.01);
    for (k, sample) in simulator.take((seconds / PERIOD_S).round() as usize).enumerate() {
        let sample = RobotSample {
            t_s: PERIOD_S * k as f64,
            q: sample.q,
            dq: sample.dq,
            tau: sample.input,
        };
        if let Some(sample) = velocities.push(&sample)
            && identifier.push(&sample)?
        {
            closed(sample.t_s, identifier);
        }
    }
    Ok(())
}

fn empty_run(robot: &Robot, options: RobotSimOptions) -> Result<EmptyRun, RobotError> {
    let mut identifier = identifier(robot, 0.0)?;
    let simulator = RobotSimulator::new(robot, options)?;
    let truth = simulator.truth(identifier.model(), EMPTY_S);
    let mut alarms = Vec::new();
    run(simulator, EMPTY_S, &mut identifier, |_, identifier| {
        alarms.extend(identifier.change())
    })?;
    let (arm, base) = (
        identifier.model().parameters().len(),
        identifier.model().base().parameters.len(),
    );
    let outcome = |(i, truth): (usize, &f64)| {
        let (error, std) = (identifier.theta()[i] - truth, identifier.theta_std(i));
        Outcome {
            is_base: i < base,
            relative: (error / truth).abs(),
            sigmas: error / std,
            relative_std: (std / truth).abs(),
        }
    };
    Ok(EmptyRun {
        parameters: truth[..arm].iter().enumerate().map(outcome).collect(),
        alarms,
        blocks: identifier.blocks(),
    })
}

fn loaded_run(
    robot: &Robot,
    mut identifier: RobotIdentifier,
    options: RobotSimOptions,
    at_s: f64,
) -> Result<LoadedRun, RobotError> {
    let simulator = RobotSimulator::new(robot, options)?;
    let mut result = LoadedRun {
        at_s,
        ..LoadedRun::default()
    };
    run(simulator, at_s + AFTER_S, &mut identifier, |t_s, identifier| {
        if let Some(change) = identifier.change() {
            match &result.found {
                _ if change.found_s < at_s => result.early += 1,
                None => result.found = Some(change),
                Some(_) => result.late += 1,
            }
        }
        for (mass, after_s) in result.mass.iter_mut().zip([2.0, 5.0]) {
            if t_s >= at_s && t_s <= at_s + after_s + LAG_S {
                // No known payload: a mass of 0.
                let carried = identifier.carried().map(|carried| [carried.values[0], carried.std[0]]);
                *mass = Some(carried.unwrap_or_default());
            }
        }
    })?;
    Ok(result)
}

impl LoadedRun {
    /// The located instant minus the true one \[s\]; `None` if no payload was found.
    pub fn located_s(&self) -> Option<f64> {
        let found = self.found.filter(|change| change.cause == ChangeCause::Payload)?;
        Some(found.t_s - self.at_s)
    }

    /// How long it took to find the payload \[s\].
    pub fn delay_s(&self) -> Option<f64> {
        let found = self.found.filter(|change| change.cause == ChangeCause::Payload)?;
        Some(found.found_s - self.at_s)
    }
}
