//! Reports how a robot's log was read, and probable mistakes, on standard error.

use super::robot_log::RobotLog;
use crate::config::RobotConfig;
use crate::offline::{LogProfile, short};
use crate::robot::{LogColumns, RobotSample, RobotSuspicion, judge_robot_log};
use std::path::Path;

/// Reports what was read, then probable mistakes.
pub(super) fn tell(input: &Path, config: &RobotConfig, log: &RobotLog) {
    let place = input.display();
    for line in lines(config, log) {
        tracing::info!("{place}: {line}");
    }
    tell_skipped(input, log);
    let robot = config.model.robot();
    for problem in robot.impossible_links().chain(robot.suspicious_unit()) {
        tracing::warn!("{}: {problem}", config.urdf.display());
    }
    tell_velocities(input, config, log);
    let mut found = judge_robot_log(&config.model, &log.samples, config.options.windows.max_gap_s);
    // Velocities that the log does not contain cannot have a wrong column or unit.
    let of_velocities =
        |one: &RobotSuspicion| matches!(one, RobotSuspicion::Speed { .. } | RobotSuspicion::Rate { .. });
    found.retain(|one| !(log.forms_velocities && of_velocities(one)));
    warn(input, &found);
}

/// Reports skipped rows of the log.
pub(super) fn tell_skipped(input: &Path, log: &RobotLog) {
    if log.skipped.count() > 0 {
        tracing::warn!("{}: {}", input.display(), log.skipped);
    }
}

/// Reports if the log has no velocities.
pub(super) fn tell_velocities(input: &Path, config: &RobotConfig, log: &RobotLog) {
    if log.forms_velocities {
        tracing::info!(
            "{}: no velocities: they are formed from the positions over {} s to either side (identify.velocity_s), at least two samples",
            input.display(),
            config.log_velocity_s()
        );
    }
}

/// Reports probable mistakes.
pub(super) fn warn(input: &Path, found: &[RobotSuspicion]) {
    for suspicion in found {
        tracing::warn!("{}: {suspicion}", input.display());
    }
}

/// One line on time, then one for each joint.
fn lines(config: &RobotConfig, log: &RobotLog) -> Vec<String> {
    let samples = &log.samples;
    let mut lines = vec![LogProfile::of_times(samples.iter().map(|sample| sample.t_s)).to_string()];
    for (j, joint) in config.model.robot().joints.iter().enumerate() {
        let (unit, force) = if joint.turns { ("rad", "N m") } else { ("m", "N") };
        let range = |of: &dyn Fn(&RobotSample) -> f64| {
            let values = || samples.iter().map(of);
            let (least, most) = (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            );
            format!("{} to {}", short(least), short(most))
        };
        let column = |list: fn(&LogColumns) -> &Vec<usize>| {
            let number = log.columns.as_ref().and_then(|columns| list(columns).get(j));
            number.map_or_else(String::new, |number| format!(" (column {number})"))
        };
        let by_drive = match config.drives.gain[j] == 1.0 && config.drives.coupling.is_none() {
            true => "",
            false => " by section [drive]",
        };
        lines.push(format!(
            "joint {} \"{}\": position{} {} {unit}, velocity{} {} {unit}/s, input{} {} {force}{by_drive}",
            j + 1,
            joint.name,
            column(|columns| &columns.position),
            range(&|sample| sample.q[j]),
            column(|columns| &columns.velocity),
            range(&|sample| sample.dq[j]),
            column(|columns| &columns.input),
            range(&|sample| sample.tau[j]),
        ));
    }
    lines
}
