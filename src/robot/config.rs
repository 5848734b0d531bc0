//! The TOML file of a robot ⇄ a validated model: `[model] kind = "robot"`.
//!
//! Everything but `model.kind` and `model.urdf` has a default. Paths are relative to the file.

use super::friction::{FrictionTerm, JointFriction};
use super::identify::{IdentifyOptions, RobotIdentifier};
use super::log::{Drives, LogColumns};
use super::model::RobotModel;
use super::rows::WindowOptions;
use super::tree::{Robot, Selection};
use nalgebra::Vector3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The file as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    model: ModelSection,
    #[serde(default)]
    drive: DriveSection,
    #[serde(default)]
    friction: FrictionSection,
    #[serde(default)]
    log: LogSection,
    #[serde(default)]
    identify: IdentifySection,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelSection {
    #[serde(rename = "kind")]
    _kind: String,
    urdf: PathBuf,
    base: Option<String>,
    tip: Option<String>,
    joints: Option<Vec<String>>,
    gravity_m_per_s2: Option<[f64; 3]>,
    rotor_inertia: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct DriveSection {
    gain: Option<Vec<f64>>,
    coupling: Option<Vec<Vec<f64>>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct FrictionSection {
    terms: Option<Vec<String>>,
    presliding: Option<f64>,
    rest_speed: Option<f64>,
    stribeck_speed: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct LogSection {
    time_column: Option<usize>,
    position_columns: Option<Vec<usize>>,
    velocity_columns: Option<Vec<usize>>,
    input_columns: Option<Vec<usize>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct IdentifySection {
    window_s: Option<f64>,
    stride_s: Option<f64>,
    max_gap_s: Option<f64>,
    block_s: Option<f64>,
    settle_blocks: Option<usize>,
    friction_walk: Option<f64>,
}

/// All that identifying a robot from a log needs.
#[derive(Debug, Clone)]
pub struct RobotConfig {
    /// The model.
    pub model: RobotModel,
    /// Columns of the logs.
    pub columns: LogColumns,
    /// From a log's inputs to torques.
    pub drives: Drives,
    /// How it is identified.
    pub options: IdentifyOptions,
}

impl RobotConfig {
    /// True if a text is the configuration of a robot: `model.kind = "robot"`.
    pub fn is_robot(text: &str) -> bool {
        let table: Result<toml::Table, _> = text.parse();
        table.is_ok_and(|table| {
            let kind = table.get("model").and_then(|model| model.get("kind"));
            kind.and_then(toml::Value::as_str) == Some("robot")
        })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// File, line or key, what is expected and what is there; also what is wrong with the URDF.
    pub fn from_file(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Self::parse(&text, path)
    }

    /// Of a text that stands in the file `path`.
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn parse(text: &str, path: &Path) -> Result<Self, String> {
        let file: File = toml::from_str(text).map_err(|e| {
            let line = e
                .span()
                .map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            format!("{}:{line}: {}", path.display(), e.message().trim_end())
        })?;
        let at = |section: &str, problem: String| format!("{}: {section}: {problem}", path.display());
        let urdf = path.parent().unwrap_or(Path::new("")).join(&file.model.urdf);
        let selection = Selection {
            base: file.model.base,
            tip: file.model.tip,
            joints: file.model.joints,
        };
        let mut robot = Robot::from_file(&urdf, &selection).map_err(|e| e.to_string())?;
        let n = robot.len();
        if let Some(gravity) = file.model.gravity_m_per_s2 {
            if gravity.iter().any(|g| !g.is_finite()) {
                return Err(at(
                    "model.gravity_m_per_s2",
                    format!("expected finite numbers, got {gravity:?}"),
                ));
            }
            robot.gravity = Vector3::from(gravity);
        }
        let friction = friction(file.friction).map_err(|problem| at("friction", problem))?;
        let rotors = file.model.rotor_inertia.unwrap_or(true);
        let model = RobotModel::new(robot, rotors, vec![friction; n]).map_err(|problem| at("friction", problem))?;
        let drives = Drives {
            gain: file.drive.gain.unwrap_or_else(|| vec![1.0; n]),
            coupling: file.drive.coupling,
        };
        drives.validate(n).map_err(|problem| at("drive", problem))?;
        let options = options(&file.identify);
        // Says what is wrong with the options now, not when the log has been read.
        RobotIdentifier::new(model.clone(), options).map_err(|problem| at("identify", problem))?;
        let columns = columns(file.log, n).map_err(|problem| at("log", problem))?;
        Ok(Self {
            model,
            columns,
            drives,
            options,
        })
    }
}

fn friction(section: FrictionSection) -> Result<JointFriction, String> {
    let mut friction = JointFriction::default();
    if let Some(words) = section.terms {
        let term = |word: &String| {
            let found = FrictionTerm::NAMES.iter().find(|(name, _)| name == word);
            found.map(|(_, term)| *term).ok_or_else(|| {
                let names = FrictionTerm::NAMES.map(|(name, _)| name).join(", ");
                format!("terms: expected names among {names}, got \"{word}\"")
            })
        };
        friction.terms = words.iter().map(term).collect::<Result<_, _>>()?;
    }
    friction.presliding = section.presliding.unwrap_or(friction.presliding);
    friction.rest_speed = section.rest_speed.unwrap_or(friction.rest_speed);
    friction.stribeck_speed = section.stribeck_speed.unwrap_or(friction.stribeck_speed);
    Ok(friction)
}

fn options(section: &IdentifySection) -> IdentifyOptions {
    let default = IdentifyOptions::default();
    let windows = default.windows;
    let length_s = section.window_s.unwrap_or(windows.length_s);
    IdentifyOptions {
        windows: WindowOptions {
            length_s,
            stride_s: section.stride_s.unwrap_or(length_s / 5.0),
            max_gap_s: section.max_gap_s.unwrap_or(length_s / 5.0),
            ..windows
        },
        block_s: section.block_s.unwrap_or(default.block_s),
        settle_blocks: section.settle_blocks.unwrap_or(default.settle_blocks),
        friction_walk: section.friction_walk.unwrap_or(default.friction_walk),
        ..default
    }
}

/// Without columns: t, then all positions, all velocities, all inputs.
fn columns(section: LogSection, n: usize) -> Result<LogColumns, String> {
    let list = |name: &str, given: Option<Vec<usize>>, first: usize| {
        let columns = given.unwrap_or_else(|| (first..first + n).collect());
        match columns.len() == n && columns.iter().all(|column| *column >= 1) {
            true => Ok(columns),
            false => Err(format!(
                "{name}: expected {n} columns counted from 1, one per joint, got {columns:?}"
            )),
        }
    };
    let time = section.time_column.unwrap_or(1);
    if time == 0 {
        return Err("time_column: expected a column counted from 1, got 0".to_owned());
    }
    Ok(LogColumns {
        time,
        position: list("position_columns", section.position_columns, 2)?,
        velocity: list("velocity_columns", section.velocity_columns, 2 + n)?,
        input: list("input_columns", section.input_columns, 2 + 2 * n)?,
    })
}
