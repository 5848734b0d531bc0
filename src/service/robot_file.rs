//! Reads the file of a robot for the tools that take no other.

use super::{CommonArgs, Failure};
use crate::config::{RobotConfig, is_robot_override};
use std::path::Path;

/// The configuration of a robot, with the arguments of `--set` applied.
///
/// # Errors
/// Errors of the file, its URDF or the arguments.
pub(super) fn robot_with(path: &Path, set: &[String]) -> Result<RobotConfig, Failure> {
    let mut config = RobotConfig::from_file_with(path, set)?;
    // The sample period is a key of all machines.
    if set.iter().any(|argument| !is_robot_override(argument)) {
        let common = CommonArgs {
            config: vec![path.to_owned()],
            set: set.to_vec(),
            ..CommonArgs::default()
        };
        config.sample_period_s = common.load(Vec::new(), &[])?.plant.sim.sample_period_s;
    }
    Ok(config)
}
