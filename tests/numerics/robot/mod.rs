//! Robots from a URDF, each stage against something independent of it.

mod calibration;
mod coarse_encoders;
#[cfg(feature = "config")]
mod config;
mod contradiction;
mod drifting_offsets;
mod drive_gains;
mod drives;
mod dynamics;
mod excitation;
mod judge;
mod left_out;
mod log;
mod measured_velocities;
mod node;
mod payload;
mod peers;
mod reversal;
mod simulated;
mod simulator;
mod standard;
mod unexplained;
mod ur10e;
mod urdf;

use std::ops::Range;
use std::path::PathBuf;
use thetabus::robot::{
    Drives, FrictionTerm, JointFriction, LogColumns, Robot, RobotSample, Selection, WindowOptions, read_log,
};

/// The arms of this project.
pub const SIX_AXIS: &str = include_str!("../../../config/robots/six_axis.urdf");
pub const SEVEN_AXIS: &str = include_str!("../../../config/robots/seven_axis.urdf");

/// Steps of the simulation per step of the controller, half of the default. The simulation takes most
/// of the time of these tests, and their conclusions do not depend on its last digits.
pub const SUBSTEPS: usize = 2;

pub fn robot(urdf: &str) -> Robot {
    Robot::from_urdf(urdf, &Selection::default()).unwrap()
}

/// Friction and windows of a simulated robot at 1 kHz.
pub fn at_1_khz(joints: usize) -> (Vec<JointFriction>, WindowOptions) {
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: 1e-4,
        ..JointFriction::default()
    };
    let windows = WindowOptions {
        length_s: 0.1,
        stride_s: 0.02,
        max_gap_s: 0.02,
        ..WindowOptions::default()
    };
    (vec![friction; joints], windows)
}

/// A file of the data kept outside the project, or `None` with a message; a gate that requires it
/// fails instead.
pub fn shared(name: &str) -> Option<(PathBuf, String)> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let named = std::env::var_os("THETABUS_DATA_DIR").map(PathBuf::from);
    let path = named.unwrap_or_else(|| root.join("../shared/data")).join(name);
    match std::fs::read_to_string(&path) {
        Ok(text) => Some((path, text)),
        Err(why) => {
            let why = format!("{}: {why}", path.display());
            assert!(std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"), "{why}");
            println!("skipped: {why}");
            None
        }
    }
}

/// The UR10e, or `None` with a message.
pub fn ur10e() -> Option<Robot> {
    shared("ur10e/ur10e.urdf").map(|(path, _)| Robot::from_file(&path, &Selection::default()).unwrap())
}

/// Torque constants of the UR10e as published with its recordings [N m/A].
const UR10E_GAINS: [f64; 6] = [14.87, 13.26, 11.13, 10.62, 11.03, 11.47];

/// A whole recording of the UR10e with these multiples of the published torque constants, or `None`
/// with a message.
pub fn ur10e_recording(name: &str, factor: &[f64]) -> Option<Vec<RobotSample>> {
    let (_, text) = shared(&format!("ur10e/{name}"))?;
    let columns = LogColumns::in_order(6, true);
    let drives = Drives {
        gain: UR10E_GAINS
            .iter()
            .zip(factor)
            .map(|(gain, factor)| gain * factor)
            .collect(),
        coupling: None,
    };
    Some(read_log(&text, &columns, &drives).unwrap().samples)
}

/// Rows of a recording of the UR10e as its source uses them, counted from 1.
pub fn ur10e_rows(name: &str, rows: Range<usize>) -> Option<Vec<RobotSample>> {
    Some(ur10e_recording(name, &[1.0; 6])?[rows.start - 1..rows.end - 1].to_vec())
}
