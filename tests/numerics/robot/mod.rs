//! Robots from a URDF, each stage against something independent of it.

mod calibration;
mod dynamics;
mod excitation;
mod log;
mod node;
mod payload;
mod peers;
mod reversal;
mod simulated;
mod simulator;
mod standard;
mod ur10e;
mod urdf;

use std::path::PathBuf;
use thetabus::robot::{FrictionTerm, JointFriction, Robot, Selection, WindowOptions};

/// The arms of this project.
pub const SIX_AXIS: &str = include_str!("../../../config/robots/six_axis.urdf");
pub const SEVEN_AXIS: &str = include_str!("../../../config/robots/seven_axis.urdf");

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

/// A file of the data that stands beside the project, or `None` with a message; a gate that
/// requires it fails instead.
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
