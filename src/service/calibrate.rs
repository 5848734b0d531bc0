//! `thetabus calibrate EMPTY.csv LOADED.csv`: gains of the drives from a load whose mass is known.

use super::robot_file::robot_with;
use super::robot_log::RobotLog;
use super::{CalibrateArgs, Exit, Failure, TableFormat, logging, robot_profile};
use crate::robot::{BodyParameters, GainCalibration, KnownLoad, declared_load};
use serde_json::json;
use std::fmt::Write as _;

/// Calibrates and shows the section of the configuration that follows.
///
/// # Errors
/// If the configuration, a log or the load is wrong.
pub fn run(args: &CalibrateArgs) -> Result<Exit, Failure> {
    // At once, because reading the logs takes long.
    if !(args.mass > 0.0 && args.mass.is_finite()) {
        return Err(Failure::Usage(format!(
            "--mass: expected the mass of the load in kg, a finite number above 0, got {}; the log without load is given first",
            args.mass
        )));
    }
    let mut config = robot_with(&args.config, &args.set)?;
    if config.drives.coupling.is_some() {
        return Err(Failure::Usage(format!(
            "{}: drive.coupling: expected a drive for each joint, got coupled ones, whose gains one load does not tell apart",
            args.config.display()
        )));
    }
    let load = KnownLoad {
        mass_kg: args.mass,
        center_m: numbers("com", args.com.as_deref())?,
        inertia_kg_m2: numbers("inertia", args.inertia.as_deref())?,
    };
    let [empty, loaded] = [&args.empty, &args.loaded].map(|path| -> Result<RobotLog, Failure> {
        let log = RobotLog::read(path, &config)?;
        robot_profile::tell_skipped(path, &log);
        robot_profile::tell_velocities(path, &config, &log);
        Ok(log)
    });
    let (empty, loaded) = (empty?, loaded?);
    let forms_velocities = empty.forms_velocities || loaded.forms_velocities;
    let (empty, loaded) = (empty.samples, loaded.samples);
    config.options.windows = config.windows_of(&empty);
    config.options.formed_over_s = forms_velocities.then(|| config.log_velocity_s());
    let found = GainCalibration::of(&config.model, &config.options, &empty, &loaded, &load).map_err(Failure::usage)?;
    let gains: Vec<f64> = config
        .drives
        .gain
        .iter()
        .zip(&found.factor)
        .map(|(gain, factor)| gain * factor)
        .collect();
    let joints = &config.model.robot().joints;
    match args.format {
        TableFormat::Json => {
            let list: Vec<_> = (0..joints.len())
                .map(|j| {
                    json!({
                        "name": joints[j].name, "gain_before": config.drives.gain[j], "gain": gains[j],
                        "gain_std": found.factor_std[j] * config.drives.gain[j].abs(),
                    })
                })
                .collect();
            let value = json!({ "joints": list, "mass_std_relative": found.mass_std, "center_m": found.center_m });
            logging::result(&format!("{value:#}"))?;
        }
        TableFormat::Text => {
            let mut text = format!(
                "{:<24} {:>10} {:>10} {:>10} {:>8}\n",
                "joint", "gain so far", "gain", "std", "factor"
            );
            for (j, joint) in joints.iter().enumerate() {
                let before = config.drives.gain[j];
                let _ = writeln!(
                    text,
                    "{:<24} {before:>11.4} {:>10.4} {:>10.4} {:>8.4}",
                    joint.name,
                    gains[j],
                    found.factor_std[j] * before.abs(),
                    found.factor[j]
                );
            }
            let digits: Vec<String> = gains.iter().map(|gain| format!("{gain:.4}")).collect();
            let [x, y, z] = found.center_m;
            let _ = writeln!(
                text,
                "\ncentre of mass of the load {x:.4} {y:.4} {z:.4} m\n\nwrite into {}:\n\n[drive]\ngain = [{}]\ngain_std = {:.4}",
                args.config.display(),
                digits.join(", "),
                found.mass_std
            );
            logging::result(text.trim_end())?;
        }
    }
    Ok(Exit::Done)
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
