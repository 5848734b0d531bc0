//! The configuration of a robot from its URDF as one that every program takes: its model for the
//! catalog, and its other sections as an ordinary source.

use super::Failure;
use crate::config::{Catalog, Config, Source};
use crate::node::model::SharedModel;
use crate::node::robot_model::{RobotPlant, RobotSettings};
use crate::robot::{IdentifyOptions, RobotConfig, RobotSimulator};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Sample period if section `[plant]` names none \[s\].
const PERIOD_S: f64 = 0.001;
/// Name of the URDF in a directory of results.
const URDF: &str = "robot.urdf";
/// Name of the simulated robot's motion there.
const MOTION: &str = "motion.csv";
/// Length of a run if it names none \[s\].
const DURATION_S: f64 = 60.0;

/// The model and the rest of a file that is the configuration of a robot; `None` for another file.
///
/// # Errors
/// What is wrong with the file or its URDF.
pub(super) fn source(path: &Path, catalog: &Catalog) -> Result<Option<(Catalog, Source)>, Failure> {
    // What cannot be read is told by who reads ordinary files.
    let small = std::fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() <= 1 << 20);
    let text = match small {
        true => std::fs::read_to_string(path).unwrap_or_default(),
        false => return Ok(None),
    };
    if !RobotConfig::is_robot(&text) {
        return Ok(None);
    }
    let config = RobotConfig::parse(&text, path).map_err(Failure::Usage)?;
    let in_file = |problem: String| Failure::Usage(format!("{}: {problem}", path.display()));
    let settings = RobotSettings {
        options: IdentifyOptions {
            payload: config.payload,
            ..config.options
        },
        model: config.model,
        drives: config.drives,
        velocity_s: config.velocity_s,
        simulation: config.simulation,
    };
    let (block_s, simulation) = (settings.options.block_s, settings.simulation.clone());
    let robot = RobotPlant::new(settings).map_err(in_file)?;
    let mut table = config.ordinary;
    let plant = section(&mut table, "plant");
    let number = |value: Option<&Value>| value.and_then(|v| v.as_float().or(v.as_integer().map(|i| i as f64)));
    let period_s = number(plant.get("sample_period_s")).unwrap_or(PERIOD_S);
    state(plant, "sample_period_s", PERIOD_S);
    state(plant, "duration_s", DURATION_S);
    state(plant, "machine", "model");
    let sensors = section(plant, "sensors");
    sensors.insert(
        "encoder_bits".to_owned(),
        Value::from(i64::from(simulation.encoder_bits)),
    );
    // What the machine really is, for the table: at the start, and after the first change of its
    // payload.
    let machine = RobotSimulator::new(robot.settings().model.robot(), simulation.clone()).map_err(in_file)?;
    let theta = |t_s: f64| -> Value {
        let all = machine.truth(&robot.settings().model, t_s);
        let count = crate::node::model::Model::parameters(&robot).len();
        Value::Array(all.into_iter().take(count).map(Value::Float).collect())
    };
    let truth = section(plant, "model");
    truth.insert("theta".to_owned(), theta(0.0));
    if let Some(change) = simulation.payloads.iter().find(|change| change.t_s > 0.0) {
        truth.insert("change_s".to_owned(), Value::Float(change.t_s));
        truth.insert("theta_after".to_owned(), theta(change.t_s));
    }
    state(
        section(&mut table, "estimator"),
        "block_len",
        ((block_s / period_s).round() as i64).max(1),
    );
    let source = Source::Embedded {
        name: path.display().to_string(),
        text: toml::to_string(&table).map_err(|e| in_file(e.to_string()))?,
    };
    Ok(Some((catalog.clone().with_model(SharedModel::new(robot)), source)))
}

/// The configuration of a run as a file in its directory, with the URDF beside it; `None` if no
/// robot is among the files.
///
/// # Errors
/// The URDF cannot be copied.
pub(super) fn as_file<'a>(
    files: impl Iterator<Item = &'a PathBuf>,
    config: &Config,
    dir: &Path,
) -> Result<Option<String>, Failure> {
    let mut robot = None;
    for path in files {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        if RobotConfig::is_robot(&text) {
            robot = text.parse::<Table>().ok().map(|table| (path, table));
        }
    }
    let Some((path, mut table)) = robot else {
        return Ok(None);
    };
    let model = section(&mut table, "model");
    let urdf = model.get("urdf").and_then(Value::as_str).unwrap_or_default();
    let urdf = path.parent().unwrap_or(Path::new("")).join(urdf);
    let failed = |e: &dyn std::fmt::Display| Failure::Failed(format!("{}: {e}", dir.join(URDF).display()));
    let bytes = std::fs::read(&urdf).map_err(|e| failed(&e))?;
    crate::files::write(&dir.join(URDF), &bytes).map_err(|e| failed(&e))?;
    model.insert("urdf".to_owned(), Value::from(URDF));
    if let Some(name) = table
        .get_mut("simulate")
        .and_then(|section| section.get_mut("motion_csv"))
    {
        let motion = path
            .parent()
            .unwrap_or(Path::new(""))
            .join(name.as_str().unwrap_or_default());
        let bytes = std::fs::read(&motion).map_err(|e| failed(&e))?;
        crate::files::write(&dir.join(MOTION), &bytes).map_err(|e| failed(&e))?;
        *name = Value::from(MOTION);
    }
    let resolved: Table = config.to_toml().parse().map_err(|e| failed(&e))?;
    for name in [
        "bus",
        "plant",
        "estimator",
        "monitor",
        "checkpoint",
        "supervision",
        "controller",
        "realtime",
    ] {
        if let Some(section) = resolved.get(name) {
            table.insert(name.to_owned(), section.clone());
        }
    }
    toml::to_string(&table).map(Some).map_err(|e| failed(&e))
}

/// These models and, if results of a robot stand in this directory, the robot's.
///
/// # Errors
/// What is wrong with the configuration in the directory.
pub(super) fn beside(input: &Path, catalog: &Catalog) -> Result<Catalog, Failure> {
    let dir = if input.is_dir() { Some(input) } else { input.parent() };
    let found = dir.map(|dir| source(&dir.join("config.toml"), catalog)).transpose()?;
    Ok(found.flatten().map_or_else(|| catalog.clone(), |(catalog, _)| catalog))
}

/// A section, empty if there is none.
fn section<'a>(table: &'a mut Table, name: &str) -> &'a mut Table {
    let entry = table.entry(name).or_insert_with(|| Value::Table(Table::new()));
    if !entry.is_table() {
        *entry = Value::Table(Table::new());
    }
    match entry {
        Value::Table(section) => section,
        _ => unreachable!("it was just made one"),
    }
}

/// A key that is not stated.
fn state(section: &mut Table, key: &str, value: impl Into<Value>) {
    section.entry(key).or_insert_with(|| value.into());
}
