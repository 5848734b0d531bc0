//! What a robot's log was read as, and what is probably wrong with it, on standard error.

use crate::offline::{LogProfile, short};
use crate::robot::{RobotConfig, RobotSample, RobotSuspicion, judge_robot_log};
use std::path::Path;

/// Says what was read, then what looks like a mistake; `is_bag` if joints were found by name.
pub(super) fn tell(input: &Path, config: &RobotConfig, log: &[RobotSample], is_bag: bool) {
    let place = input.display();
    for line in lines(config, log, is_bag) {
        tracing::info!("{place}: {line}");
    }
    warn(
        input,
        &judge_robot_log(&config.model, log, config.options.windows.max_gap_s),
    );
}

/// Says what looks like a mistake.
pub(super) fn warn(input: &Path, found: &[RobotSuspicion]) {
    for suspicion in found {
        tracing::warn!("{}: {suspicion}", input.display());
    }
}

/// One line on time, then one for each joint.
fn lines(config: &RobotConfig, log: &[RobotSample], is_bag: bool) -> Vec<String> {
    let mut lines = vec![LogProfile::of_times(log.iter().map(|sample| sample.t_s)).to_string()];
    let columns = &config.columns;
    for (j, joint) in config.model.robot().joints.iter().enumerate() {
        let (unit, force) = if joint.turns { ("rad", "N m") } else { ("m", "N") };
        let range = |of: &dyn Fn(&RobotSample) -> f64| {
            let values = || log.iter().map(of);
            let (least, most) = (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            );
            format!("{} to {}", short(least), short(most))
        };
        let column = |numbers: &[usize]| match is_bag {
            true => String::new(),
            false => format!(" (column {})", numbers[j]),
        };
        let by_drive = match config.drives.gain[j] == 1.0 && config.drives.coupling.is_none() {
            true => "",
            false => " by section [drive]",
        };
        lines.push(format!(
            "joint {} \"{}\": position{} {} {unit}, velocity{} {} {unit}/s, input{} {} {force}{by_drive}",
            j + 1,
            joint.name,
            column(&columns.position),
            range(&|sample| sample.q[j]),
            column(&columns.velocity),
            range(&|sample| sample.dq[j]),
            column(&columns.input),
            range(&|sample| sample.tau[j]),
        ));
    }
    lines
}
