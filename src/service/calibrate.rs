//! `thetabus calibrate EMPTY.csv LOADED.csv`: gains of the drives from a load whose mass is known.

use super::robot_file::robot_with;
use super::robot_log::RobotLog;
use super::{CalibrateArgs, Exit, Failure, TableFormat, logging, robot_profile};
use crate::config::RobotConfig;
use crate::robot::{BodyParameters, GainCalibration, KnownLoad, RobotJoint, declared_load};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Calibrates and shows the section of the configuration that follows.
///
/// # Errors
/// If the configuration, a log or the load is wrong.
pub fn run(args: &CalibrateArgs) -> Result<Exit, Failure> {
    // At once, because reading the logs takes long.
    check_mass(args.mass)?;
    let mut config = robot_with(&args.config, &args.set)?;
    check_drives(&config, &args.config)?;
    let load = KnownLoad {
        mass_kg: args.mass,
        center_m: numbers("com", args.com.as_deref())?,
        inertia_kg_m2: numbers("inertia", args.inertia.as_deref())?,
    };
    let [empty, loaded] = [&args.empty, &args.loaded].map(|path| read(path, &config));
    let (empty, loaded) = (empty?, loaded?);
    let forms_velocities = empty.forms_velocities || loaded.forms_velocities;
    let (empty, loaded) = (empty.samples, loaded.samples);
    config.options.windows = config.windows_of(&empty);
    config.options.formed_over_s = forms_velocities.then(|| config.log_velocity_s());
    let found = GainCalibration::of(&config.model, &config.options, &empty, &loaded, &load).map_err(Failure::usage)?;
    let drives = calibrated(&config, &found);
    match args.format {
        TableFormat::Json => logging::result(&format!("{:#}", json_of(&drives, &found)))?,
        TableFormat::Text => logging::result(text_of(&drives, &found, &args.config).trim_end())?,
    }
    Ok(Exit::Done)
}

fn check_mass(mass: f64) -> Result<(), Failure> {
    if mass > 0.0 && mass.is_finite() {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "--mass: expected the mass of the load in kg, a finite number above 0, got {mass}; the log without load is given first"
    )))
}

fn check_drives(config: &RobotConfig, path: &Path) -> Result<(), Failure> {
    match config.drives.coupling {
        None => Ok(()),
        Some(_) => Err(Failure::Usage(format!(
            "{}: drive.coupling: expected a drive for each joint, got coupled ones, whose gains one load does not tell apart",
            path.display()
        ))),
    }
}

/// Reads a log, and tells what is missing in it.
fn read(path: &Path, config: &RobotConfig) -> Result<RobotLog, Failure> {
    let log = RobotLog::read(path, config)?;
    robot_profile::tell_skipped(path, &log);
    robot_profile::tell_velocities(path, config, &log);
    Ok(log)
}

/// A drive with its gain so far and the calibrated one.
struct Drive<'a> {
    joint: &'a str,
    gain_before: f64,
    gain: f64,
    gain_std: f64,
    factor: f64,
}

fn calibrated<'a>(config: &'a RobotConfig, found: &GainCalibration) -> Vec<Drive<'a>> {
    let drive = |(j, joint): (usize, &'a RobotJoint)| {
        let gain_before = config.drives.gain[j];
        Drive {
            joint: &joint.name,
            gain_before,
            gain: gain_before * found.factor[j],
            gain_std: found.factor_std[j] * gain_before.abs(),
            factor: found.factor[j],
        }
    };
    config.model.robot().joints.iter().enumerate().map(drive).collect()
}

fn json_of(drives: &[Drive<'_>], found: &GainCalibration) -> Value {
    let list: Vec<_> = drives
        .iter()
        .map(|drive| {
            json!({
                "name": drive.joint, "gain_before": drive.gain_before, "gain": drive.gain,
                "gain_std": drive.gain_std,
            })
        })
        .collect();
    json!({ "joints": list, "mass_std_relative": found.mass_std, "center_m": found.center_m })
}

/// A table of the drives, and the lines for the configuration.
fn text_of(drives: &[Drive<'_>], found: &GainCalibration, config: &Path) -> String {
    let mut text = format!(
        "{:<24} {:>10} {:>10} {:>10} {:>8}\n",
        "joint", "gain so far", "gain", "std", "factor"
    );
    for drive in drives {
        let _ = writeln!(
            text,
            "{:<24} {:>11.4} {:>10.4} {:>10.4} {:>8.4}",
            drive.joint, drive.gain_before, drive.gain, drive.gain_std, drive.factor
        );
    }
    let digits: Vec<String> = drives.iter().map(|drive| format!("{:.4}", drive.gain)).collect();
    let [x, y, z] = found.center_m;
    let _ = writeln!(
        text,
        "\ncentre of mass of the load {x:.4} {y:.4} {z:.4} m\n\nwrite into {}:\n\n[drive]\ngain = [{}]\ngain_std = {:.4}",
        config.display(),
        digits.join(", "),
        found.mass_std
    );
    text
}

/// The load stated on the command line.
pub(super) fn load_of(
    mass: Option<f64>,
    com: Option<&[f64]>,
    inertia: Option<&[f64]>,
) -> Result<BodyParameters, Failure> {
    let mass = mass.ok_or_else(|| Failure::Usage("payload: expected `none` or --mass KG, got neither".to_owned()))?;
    let center = numbers("com", com)?.unwrap_or_default();
    declared_load(mass, center, numbers("inertia", inertia)?).map_err(Failure::usage)
}

fn numbers<const N: usize>(name: &str, list: Option<&[f64]>) -> Result<Option<[f64; N]>, Failure> {
    list.map(|list| {
        list.try_into()
            .map_err(|_| Failure::Usage(format!("--{name}: expected {N} numbers, got {}", list.len())))
    })
    .transpose()
}
