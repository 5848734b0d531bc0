//! `thetabus config check`, `show` and `new`.

use super::new_file::{refuse_existing, write_new};
use super::robot::robot_text;
use super::{CommonArgs, Exit, Failure, logging};
use crate::config::{Config, RobotConfig, Source};
use std::collections::BTreeSet;
use std::path::Path;

/// Loads a configuration file and reports errors and suspicious settings.
///
/// # Errors
/// All errors of the file.
pub fn config_check(file: &Path, set: &[String], common: &CommonArgs) -> Result<Exit, Failure> {
    let common = CommonArgs {
        config: vec![file.to_owned()],
        set: set.to_vec(),
        ..common.clone()
    };
    let mut told = BTreeSet::new();
    for config in common.load_robots_quietly(&[])? {
        // Some settings can be checked only together with the sample period.
        config
            .identifier()
            .map_err(|e| Failure::Usage(format!("{}: {e}", file.display())))?;
        for warning in config.warnings() {
            let warning = format!("warning: {warning}");
            // Robots that share a file share its warnings, which are shown once.
            if told.insert(warning.clone()) {
                logging::result(&warning)?;
            }
        }
    }
    // it was read before, so it is a regular file
    let text = std::fs::read_to_string(file).unwrap_or_default();
    if set.is_empty() && text.parse::<toml::Table>().is_ok_and(|table| table.is_empty()) {
        logging::result(&format!(
            "warning: {}: states nothing, so every key has its default",
            file.display()
        ))?;
    }
    if let Some(text) = robot_text(file) {
        let robot = RobotConfig::parse_with(&text, file, set)?;
        let arm = robot.model.robot();
        for problem in arm.impossible_links().chain(arm.suspicious_unit()) {
            logging::result(&format!("warning: {}: {problem}", robot.urdf.display()))?;
        }
    }
    logging::result(&format!("{}: ok", file.display()))?;
    Ok(Exit::Done)
}

/// A robot's configuration is read differently, and needs its URDF next to it.
const ROBOT: (&str, &str) = ("six_axis", include_str!("../../config/robots/six_axis.toml"));
const ROBOT_URDF: (&str, &str) = ("six_axis.urdf", include_str!("../../config/robots/six_axis.urdf"));

/// Prints a built-in configuration, or the names of all.
///
/// # Errors
/// If there is none of this name, or standard output cannot be written.
pub fn config_show(name: Option<&str>) -> Result<Exit, Failure> {
    match name {
        Some(name) => logging::result(built_in(name)?.trim_end())?,
        None => logging::result(&names().join("\n"))?,
    }
    Ok(Exit::Done)
}

/// Writes a built-in configuration to a new file, and a robot's URDF next to it.
///
/// # Errors
/// If there is none of this name, or a file exists or cannot be written.
pub fn config_new(file: Option<&Path>, from: &str) -> Result<Exit, Failure> {
    let text = built_in(from)?;
    let file = file.map_or_else(|| Path::new(from).with_extension("toml"), Path::to_path_buf);
    let urdf = (from == ROBOT.0).then(|| file.with_file_name(ROBOT_URDF.0));
    // Writes both files or none: the URDF of an earlier call may stay if it is identical.
    let is_there = |path: &Path| std::fs::read(path).is_ok_and(|bytes| bytes == ROBOT_URDF.1.as_bytes());
    let urdf = urdf.filter(|path| !is_there(path));
    for path in [Some(&file), urdf.as_ref()].into_iter().flatten() {
        refuse_existing(path)?;
    }
    write_new(&file, &text)?;
    logging::result(&format!(
        "{}: written; a configuration states only what differs from the defaults",
        file.display()
    ))?;
    if let Some(urdf) = urdf {
        write_new(&urdf, ROBOT_URDF.1)?;
        logging::result(&format!(
            "{}: written; put your robot's in its place, and its name into model.urdf",
            urdf.display()
        ))?;
    }
    Ok(Exit::Done)
}

fn names() -> Vec<&'static str> {
    Config::embedded_names().chain([ROBOT.0]).collect()
}

fn built_in(name: &str) -> Result<String, Failure> {
    match Config::embedded(name) {
        Some(Source::Embedded { text, .. }) => Ok(text),
        _ if name == ROBOT.0 => Ok(ROBOT.1.to_owned()),
        _ => {
            let message = format!("expected a configuration out of {}, got \"{name}\"", names().join(", "));
            Err(Failure::Usage(message))
        }
    }
}
