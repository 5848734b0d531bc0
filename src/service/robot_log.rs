//! The log of a robot from a URDF: columns of numbers, an exported recording, or a ROS 2 bag.

use super::Failure;
use crate::config::RobotConfig;
use crate::messages::{Sample, signals};
use crate::model::MAX_JOINTS;
use crate::node::robot_model::robot_units;
use crate::pipe::read_text_or_other_bytes;
use crate::recording::{
    RecordingReader, SamplesCsvReader, Span, is_beyond_repair, is_samples_csv, read_joint_states,
    separators_of_a_spreadsheet,
};
use crate::robot::{InOrder, LogColumns, RobotSample, Skip, SkippedRows, read_log};
use std::path::Path;

/// Largest log \[bytes\], because it is kept in memory: two hours of seven joints at 1 kHz.
const MAX_LOG_BYTES: u64 = 2 << 30;

/// Samples with velocities, and their origin.
pub(super) struct RobotLog {
    /// The samples.
    pub samples: Vec<RobotSample>,
    /// Columns of the file; `None` if signals were found by name.
    pub columns: Option<LogColumns>,
    /// Rows or messages without a sample.
    pub skipped: SkippedRows,
    /// True if the file has no velocities and these were computed from the positions.
    pub forms_velocities: bool,
}

impl RobotLog {
    /// Reads a log of the configured robot.
    ///
    /// # Errors
    /// The error, with its line.
    pub fn read(path: &Path, config: &RobotConfig) -> Result<Self, Failure> {
        let usage = |problem: &dyn std::fmt::Display| Failure::Usage(format!("{}: {problem}", path.display()));
        let mut skipped = SkippedRows::default();
        let (mut samples, columns, has_velocity) = if is_bag(path) {
            let (samples, has_velocity) = of_bag(path, config, &mut skipped)?;
            skipped.check().map_err(|e| usage(&e))?;
            (samples, None, has_velocity)
        } else {
            let text = read_text_or_other_bytes(path, MAX_LOG_BYTES).map_err(|e| usage(&e))?;
            if let Some(words) = separators_of_a_spreadsheet(text.as_bytes()) {
                return Err(usage(&words));
            }
            if is_samples_csv(text.as_bytes()) {
                let (samples, has_velocity) = of_export(&text, config, &mut skipped).map_err(|e| usage(&e))?;
                skipped.check().map_err(|e| usage(&e))?;
                (samples, None, has_velocity)
            } else {
                let columns = config.columns_of(&text);
                let log = read_log(&text, &columns, &config.drives).map_err(|e| usage(&e))?;
                let has_velocity = !columns.velocity.is_empty();
                skipped = log.skipped;
                (log.samples, Some(columns), has_velocity)
            }
        };
        if !has_velocity {
            samples = config.with_velocities(&samples);
        }
        match (samples.len(), has_velocity) {
            (0, _) if skipped.rows == 0 => Err(usage(&"expected rows of numbers, got none: is this a log?")),
            (0..3, true) => Err(usage(&format!("expected at least 3 samples, got {}", samples.len()))),
            (0..3, false) => Err(usage(&format!(
                "expected at least 3 samples with neighbours within {} s to either side, whose positions give their velocities, got {}",
                config.log_velocity_s(),
                samples.len()
            ))),
            _ => Ok(Self {
                samples,
                columns,
                skipped,
                forms_velocities: !has_velocity,
            }),
        }
    }
}

/// True for a ROS 2 bag that is not a recording of `thetabus`, as a file or as a directory.
pub(super) fn is_bag(path: &Path) -> bool {
    match path.is_dir() {
        true => path.join("metadata.yaml").is_file(),
        false => {
            path.extension().is_some_and(|name| name.eq_ignore_ascii_case("mcap"))
                && RecordingReader::open(path, Span::default()).is_err()
        }
    }
}

/// Reads a file of `thetabus export`; also returns whether all its samples have velocities.
fn of_export(text: &str, config: &RobotConfig, skipped: &mut SkippedRows) -> Result<(Vec<RobotSample>, bool), String> {
    let joints = config.model.robot().len();
    let (position_unit, input_unit) = robot_units(&config.model, &config.drives);
    let mut reader =
        SamplesCsvReader::of_units(text.as_bytes(), joints, position_unit, input_unit).map_err(|e| e.to_string())?;
    let mut log = InOrder::default();
    let mut has_velocity = true;
    loop {
        let sample = match reader.next_sample() {
            Ok(None) => break,
            Ok(Some(sample)) => sample,
            Err(error) => {
                let line = error.line().ok_or_else(|| error.to_string())?;
                skipped.rows += 1;
                skipped.skip(Skip::Unreadable, line as usize, || error.without_line());
                continue;
            }
        };
        let line = reader.line() as usize;
        skipped.rows += 1;
        let next = match of_message(&sample, config) {
            Ok(next) => next,
            Err(problem) => {
                skipped.skip(Skip::Unreadable, line, || problem);
                continue;
            }
        };
        let signals = next.q.iter().chain(&next.dq).chain(&next.tau);
        if signals.into_iter().any(|x| !x.is_finite()) {
            skipped.skip(Skip::NotFinite, line, || {
                "expected finite numbers, got NaN or an infinity".to_owned()
            });
            continue;
        }
        has_velocity &= sample.signals & signals::DQ != 0;
        log.take(next, line, skipped);
    }
    check_export(skipped)?;
    Ok((log.samples, has_velocity))
}

/// Refuses an export with many unreadable rows or times that go back: it is another file or was
/// edited. Values that are not finite are a matter of the robot's sensors.
fn check_export(skipped: &SkippedRows) -> Result<(), String> {
    let bad = skipped.unreadable + skipped.not_later;
    match &skipped.first {
        Some(first) if is_beyond_repair(bad as u64, skipped.rows as u64) => {
            let advice = match skipped.not_later > skipped.unreadable {
                true => "does it hold several streams? --from and --to of `export` choose one",
                false => "is this the file that was exported?",
            };
            Err(format!(
                "{first}; {bad} of {} rows cannot be used, more than 1 %: {advice}",
                skipped.rows
            ))
        }
        _ => Ok(()),
    }
}

fn of_message(sample: &Sample, config: &RobotConfig) -> Result<RobotSample, String> {
    for (signal, name) in [(signals::Q, "positions"), (signals::INPUT, "torques or currents")] {
        if sample.signals & signal == 0 {
            return Err(format!("expected {name} of all joints, got none"));
        }
    }
    let mut next = RobotSample {
        t_s: sample.t_ns as f64 * 1e-9,
        tau: config.drives.torques(&sample.input),
        ..RobotSample::default()
    };
    let joints = config.model.robot().len();
    next.q[..joints].copy_from_slice(&sample.q[..joints]);
    next.dq[..joints].copy_from_slice(&sample.dq[..joints]);
    Ok(next)
}

/// `sensor_msgs/msg/JointState`, with joints by their names in the URDF; also returns whether all
/// messages have velocities. Effort is the input of the drives.
fn of_bag(path: &Path, config: &RobotConfig, skipped: &mut SkippedRows) -> Result<(Vec<RobotSample>, bool), Failure> {
    let robot = config.model.robot();
    let names: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
    let states = read_joint_states(path, &names).map_err(Failure::usage)?;
    let begin = states.first().map_or(0, |state| state.t_ns);
    let mut log: Vec<RobotSample> = Vec::with_capacity(states.len());
    let mut has_velocity = true;
    for (number, state) in (1..).zip(&states) {
        skipped.rows += 1;
        if state.effort.is_empty() {
            return Err(Failure::Usage(format!(
                "{}: expected an effort of each joint, got messages without; torques or currents are needed",
                path.display()
            )));
        }
        let mut input = [0.0; MAX_JOINTS];
        let mut sample = RobotSample {
            t_s: state.t_ns.saturating_sub(begin) as f64 * 1e-9,
            ..RobotSample::default()
        };
        input[..names.len()].copy_from_slice(&state.effort);
        sample.q[..names.len()].copy_from_slice(&state.position);
        has_velocity &= !state.velocity.is_empty();
        if has_velocity {
            sample.dq[..names.len()].copy_from_slice(&state.velocity);
        }
        sample.tau = config.drives.torques(&input);
        let signals = state.position.iter().chain(&state.velocity).chain(&state.effort);
        if signals.into_iter().any(|x| !x.is_finite()) {
            skipped.skip(Skip::NotFinite, number, || {
                "expected finite numbers, got NaN or an infinity".to_owned()
            });
            continue;
        }
        // Drivers repeat a state if there is no new one.
        if log.last().is_none_or(|last| sample.t_s > last.t_s) {
            log.push(sample);
        }
    }
    Ok((log, has_velocity))
}
