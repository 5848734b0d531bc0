//! Robots from a URDF, each stage against something independent of it.

mod calibration;
mod dynamics;
mod excitation;
mod log;
mod node;
mod payload;
mod peers;
mod simulated;
mod simulator;
mod standard;
mod ur10e;
mod urdf;

use std::path::PathBuf;
use thetabus::robot::{Robot, Selection};

/// The arms of this project.
pub const SIX_AXIS: &str = include_str!("../../../config/robots/six_axis.urdf");
pub const SEVEN_AXIS: &str = include_str!("../../../config/robots/seven_axis.urdf");

pub fn robot(urdf: &str) -> Robot {
    Robot::from_urdf(urdf, &Selection::default()).unwrap()
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
