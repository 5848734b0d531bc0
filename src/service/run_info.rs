//! The description of a run in its recording.

use crate::config::Config;
use crate::messages::SCHEMA_VERSION;
use crate::node::monitor::MonitorNode;
use crate::recording::RunInfo;
use std::time::{SystemTime, UNIX_EPOCH};

/// The description of a run in its recording.
pub(super) fn run_info(config: &Config, node: &MonitorNode, simulated: bool) -> RunInfo {
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_nanos());
    let plant = config.model.definition();
    RunInfo {
        schema: SCHEMA_VERSION,
        recording_id: format!("{now}-{}", std::process::id()),
        file_number: None,
        robot: config.bus.robot.clone(),
        model: plant.name.clone(),
        model_hash: plant.hash(),
        config_hash: config.config_hash(),
        simulated,
        config_toml: config.to_toml(),
        joints: plant.joints,
        position_unit: plant.position_unit.clone(),
        input_unit: plant.input_unit.clone(),
        equations: plant.equations.iter().map(|e| e.name.to_string()).collect(),
        parameters: node.parameters().to_vec(),
        derived: node.derived().to_vec(),
        clock_epoch_ns: u64::try_from(now)
            .unwrap_or(u64::MAX)
            .saturating_sub(crate::bus::monotonic_ns()),
        joint_states: config.monitor.record_joint_states,
        first_form: false,
    }
}
