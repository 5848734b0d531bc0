//! The TOML file of a robot ⇄ a validated model: `[model] kind = "robot"`.
//!
//! Everything except `model.kind` and `model.urdf` has a default. Paths are relative to the file.

use super::config_file::{
    Controller, ExciteSection, File, FrictionSection, IdentifySection, LogSection, Motion, SimulateSection, Velocity,
};
use super::excitation::{ExcitationOptions, JointRange};
use super::friction::{FrictionTerm, JointFriction};
use super::identify::RobotIdentifier;
use super::identify_options::IdentifyOptions;
use super::log::{Drives, LogColumns, width_of};
use super::model::RobotModel;
use super::motion_table::MotionTable;
use super::overrides::{is_robot_override, lay};
use super::reference::{MotionLimits, Motions};
use super::simulator::{PayloadChange, RobotController, RobotSimOptions, RobotSimulator};
use super::state::RobotSample;
use super::tree::{Robot, Selection};
use super::velocity::{median_period_s, with_velocities};
use super::windows::WindowOptions;
use crate::pipe::{MAX_SETTINGS_BYTES, MAX_TABLE_BYTES, read_text};
use nalgebra::Vector3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Time on either side over which velocities are computed from positions \[s\].
const VELOCITY_S: f64 = 0.02;

/// Valid magnitudes of gravity \[m/s²\].
const GRAVITY: std::ops::Range<f64> = 1.5..30.0;

/// Default sample period \[s\].
const SAMPLE_PERIOD_S: f64 = 0.001;

/// Everything needed to identify a robot from a log.
#[derive(Debug, Clone)]
pub struct RobotConfig {
    /// The URDF.
    pub urdf: PathBuf,
    /// The model.
    pub model: RobotModel,
    /// Columns of the logs.
    pub columns: LogColumns,
    /// True if the file names them; otherwise a log has them in order, with or without velocities.
    pub names_columns: bool,
    /// Conversion of a log's inputs to torques.
    pub drives: Drives,
    /// Options of the identification, with windows for the sample period of section `[plant]`;
    /// [`windows_of`](Self::windows_of) gives those of a log.
    pub options: IdentifyOptions,
    windows: StatedWindows,
    /// True if a payload is estimated on line.
    pub payload: bool,
    /// Time on either side over which velocities are computed from positions on line \[s\]; `None`
    /// if they are measured.
    pub velocity_s: Option<f64>,
    /// The simulated robot; sample period and seed are those of section `[plant]`.
    pub simulation: RobotSimOptions,
    /// Options of the design of a motion.
    pub excitation: ExcitationOptions,
    /// Sample period of section `[plant]`, 0.001 by default \[s\].
    pub sample_period_s: f64,
    /// The other sections of the file: `[bus]`, `[plant]`, …
    pub ordinary: toml::Table,
}

/// Gravity from three numbers \[m/s²\]: zero, or between that of the Moon and of Jupiter. In units
/// of g its length would be 1, and with the factor applied twice 96.
fn gravity_of(numbers: Vec<f64>) -> Result<Vector3<f64>, String> {
    let [x, y, z] = numbers[..] else {
        return Err(format!(
            "expected three numbers, as [0.0, 0.0, -9.81], got {}",
            numbers.len()
        ));
    };
    let gravity = Vector3::new(x, y, z);
    let size = gravity.norm();
    if size == 0.0 || GRAVITY.contains(&size) {
        return Ok(gravity);
    }
    Err(format!(
        "expected the acceleration of gravity in m/s² in the base's frame, as [0.0, 0.0, -9.81], or zeros for none, got \
         {numbers:?} of length {size:.3}"
    ))
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
    /// File, line or key, what was expected and what was found; also errors of the URDF.
    pub fn from_file(path: &Path) -> Result<Self, String> {
        Self::from_file_with(path, &[])
    }

    /// The same with `section.key=value` arguments applied to it; see
    /// [`parse_with`](Self::parse_with).
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn from_file_with(path: &Path, set: &[String]) -> Result<Self, String> {
        let text = read_text(path, MAX_SETTINGS_BYTES).map_err(|e| format!("{}: {e}", path.display()))?;
        Self::parse_with(&text, path, set)
    }

    /// Reads `text`, the content of the file `path`.
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn parse(text: &str, path: &Path) -> Result<Self, String> {
        Self::parse_with(text, path, &[])
    }

    /// The text with the arguments applied that set keys of a robot's own sections; others are
    /// ignored.
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn overlaid(text: &str, set: &[String]) -> Result<toml::Table, String> {
        let mut table: toml::Table = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
        for argument in set.iter().filter(|argument| is_robot_override(argument)) {
            let problem = |problem: &str| format!("--set {argument}: {}", problem.trim_end());
            lay(&mut table, argument).map_err(|e| problem(&e))?;
            file_of(&table).map_err(|e| problem(&e))?;
        }
        Ok(table)
    }

    /// Reads `text`, the content of the file `path`, with these arguments
    /// [applied](Self::overlaid).
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn parse_with(text: &str, path: &Path, set: &[String]) -> Result<Self, String> {
        // The file is read without arguments first, so that its errors are reported with their
        // lines.
        let mut file: File = toml::from_str(text).map_err(|e| {
            let line = e
                .span()
                .map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            format!("{}:{line}: {}", path.display(), e.message().trim_end())
        })?;
        if !set.is_empty() {
            file = file_of(&Self::overlaid(text, set)?).map_err(|e| format!("{}: {e}", path.display()))?;
        }
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
            robot.gravity = gravity_of(gravity).map_err(|problem| at("model.gravity_m_per_s2", problem))?;
        }
        let friction = friction(file.friction).map_err(|problem| at("friction", problem))?;
        let rotors = file.model.rotor_inertia.unwrap_or(true);
        let model = RobotModel::new(robot, rotors, vec![friction; n]).map_err(|e| at("friction", e.to_string()))?;
        let drives = Drives {
            gain: file.drive.gain.unwrap_or_else(|| vec![1.0; n]),
            coupling: file.drive.coupling,
        };
        drives.validate(n).map_err(|e| at("drive", e.to_string()))?;
        let period_s = sample_period_of(file.plant.as_ref());
        let sample_period_s = period_s.map_err(|problem| at("plant.sample_period_s", problem))?;
        let velocity_s = match file.identify.velocity {
            Some(Velocity::Measured) => None,
            _ => Some(file.identify.velocity_s.unwrap_or(VELOCITY_S)),
        };
        if let Some(half) = velocity_s.filter(|half| !(*half > 0.0 && *half <= 1.0)) {
            return Err(at(
                "identify",
                format!("velocity_s: expected a time above 0 and up to 1 s, got {half}"),
            ));
        }
        let windows = StatedWindows::of(&file.identify);
        let options = IdentifyOptions {
            gain_std: file.drive.gain_std.unwrap_or(0.0),
            lengthens: windows.are_free(),
            formed_over_s: velocity_s,
            ..options(&file.identify, windows.at(sample_period_s))
        };
        // Reports errors of the options now, not after the log has been read.
        RobotIdentifier::new(model.clone(), options).map_err(|e| at("identify", e.to_string()))?;
        let mut simulation =
            simulation(&file.simulate, &model, velocity_s.is_none()).map_err(|problem| at("simulate", problem))?;
        if let Some(name) = &file.simulate.motion_csv {
            let table = table(&path.parent().unwrap_or(Path::new("")).join(name), n);
            simulation.motions = Motions::Table(Arc::new(table.map_err(|problem| at("simulate.motion_csv", problem))?));
        }
        let excitation = excitation(file.excite, &model).map_err(|problem| at("excite", problem))?;
        let sections = [
            ("bus", file.bus),
            ("plant", file.plant),
            ("estimator", file.estimator),
            ("monitor", file.monitor),
            ("checkpoint", file.checkpoint),
            ("supervision", file.supervision),
            ("controller", file.controller),
            ("realtime", file.realtime),
        ];
        let ordinary: toml::Table = sections
            .into_iter()
            .filter_map(|(name, section)| Some((name.to_owned(), toml::Value::Table(section?))))
            .collect();
        let payload = file.identify.payload.unwrap_or(true);
        let names_columns = file.log.names_columns();
        let columns = columns(file.log, n).map_err(|problem| at("log", problem))?;
        Ok(Self {
            urdf,
            model,
            columns,
            names_columns,
            drives,
            options,
            windows,
            payload,
            velocity_s,
            simulation,
            excitation,
            sample_period_s,
            ordinary,
        })
    }

    /// Columns of a log: those that the file names, otherwise as many as its lines contain.
    pub fn columns_of(&self, log: &str) -> LogColumns {
        let n = self.model.robot().len();
        let lacks_velocity = !self.names_columns && width_of(log) == Some(1 + 2 * n);
        match lacks_velocity {
            true => LogColumns {
                time: self.columns.time,
                ..LogColumns::in_order(n, false)
            },
            false => self.columns.clone(),
        }
    }

    /// Time on either side over which velocities are computed for a log without them \[s\].
    pub fn log_velocity_s(&self) -> f64 {
        self.velocity_s.unwrap_or(VELOCITY_S)
    }

    /// The samples of a log without velocities, with velocities computed from the positions.
    pub fn with_velocities(&self, log: &[RobotSample]) -> Vec<RobotSample> {
        let windows = self.windows_of(log);
        with_velocities(log, self.log_velocity_s(), windows.max_gap_s)
    }

    /// The windows for this sample period \[s\]: those in the file, otherwise those of
    /// [`WindowOptions::for_period`].
    pub fn windows_at(&self, period_s: f64) -> WindowOptions {
        self.windows.at(period_s)
    }

    /// The windows of a log.
    pub fn windows_of(&self, log: &[RobotSample]) -> WindowOptions {
        self.windows_at(median_period_s(log).unwrap_or(self.sample_period_s))
    }
}

/// The sections of a table. Converting to text and back lets one deserialiser read all sections: a
/// further one would add 0.4 MB to the program.
fn file_of(table: &toml::Table) -> Result<File, String> {
    let text = toml::to_string(table).map_err(|e| e.to_string())?;
    toml::from_str(&text).map_err(|e| e.message().trim_end().to_owned())
}

/// A whole number of seconds is an integer in TOML.
fn sample_period_of(plant: Option<&toml::Table>) -> Result<f64, String> {
    let Some(value) = plant.and_then(|plant| plant.get("sample_period_s")) else {
        return Ok(SAMPLE_PERIOD_S);
    };
    let number = value.as_float().or(value.as_integer().map(|whole| whole as f64));
    let number = number.filter(|period_s| (1e-5..=0.1).contains(period_s));
    number.ok_or_else(|| format!("expected 1e-5 to 0.1 s, got {value}"))
}

/// A motion in a file.
fn table(path: &Path, joints: usize) -> Result<MotionTable, String> {
    let problem = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = read_text(path, MAX_TABLE_BYTES).map_err(|e| problem(&e))?;
    MotionTable::parse(&text, joints).map_err(|e| problem(&e))
}

/// Options of designed motions, from their section.
fn excitation(section: ExciteSection, model: &RobotModel) -> Result<ExcitationOptions, String> {
    let robot = model.robot();
    let part = section.part_of_limits.unwrap_or(MotionLimits::default().part);
    let reach = section.reach.unwrap_or(MotionLimits::default().reach);
    if !(part > 0.0 && part <= 1.0 && reach > 0.0) {
        return Err(format!(
            "expected part_of_limits above 0 and up to 1 and reach above 0, got {part} and {reach}"
        ));
    }
    let mut ranges = JointRange::of(robot, part, reach, MotionLimits::default().acceleration);
    let lists = [
        ("lower", section.lower),
        ("upper", section.upper),
        ("velocity", section.velocity),
        ("acceleration", section.acceleration),
    ];
    for (name, list) in lists {
        let Some(list) = list else { continue };
        if list.len() != robot.len() {
            let n = robot.len();
            return Err(format!(
                "{name}: expected {n} numbers, one per joint, got {}",
                list.len()
            ));
        }
        for ((range, value), joint) in ranges.iter_mut().zip(list).zip(&robot.joints) {
            let limits = &joint.limits;
            let (least, most) = match name {
                "velocity" => (0.0, limits.velocity.filter(|x| *x > 0.0)),
                "acceleration" => (0.0, None),
                _ => (limits.lower.unwrap_or(f64::NEG_INFINITY), limits.upper),
            };
            let most = most.unwrap_or(f64::INFINITY);
            if !(value >= least && value <= most) {
                return Err(format!(
                    "{name} of joint \"{}\": expected {least} to {most} as the URDF says, got {value}",
                    joint.name
                ));
            }
            match name {
                "lower" => range.lower = value,
                "upper" => range.upper = value,
                "velocity" => range.velocity = value,
                _ => range.acceleration = value,
            }
        }
    }
    let default = ExcitationOptions::new(ranges);
    let options = ExcitationOptions {
        duration_s: section.duration_s.unwrap_or(default.duration_s),
        harmonics: section.harmonics.unwrap_or(default.harmonics),
        tries: section.tries.unwrap_or(default.tries),
        seed: section.seed.unwrap_or(default.seed),
        ..default
    };
    options.validate(robot).map_err(|e| e.to_string())?;
    Ok(options)
}

/// Options of a simulated robot, from their section.
fn simulation(section: &SimulateSection, model: &RobotModel, has_velocity: bool) -> Result<RobotSimOptions, String> {
    let default = RobotSimOptions::new(model.robot());
    let mut drives = default.drives.clone();
    let lists = [
        ("viscous", &section.viscous),
        ("coulomb", &section.coulomb),
        ("offset", &section.offset),
        ("rotor_inertia", &section.rotor_inertia),
    ];
    for (name, list) in lists {
        let Some(list) = list else { continue };
        if list.len() != drives.len() {
            let n = drives.len();
            return Err(format!(
                "{name}: expected {n} numbers, one per joint, got {}",
                list.len()
            ));
        }
        for (drive, value) in drives.iter_mut().zip(list) {
            match name {
                "viscous" => drive.viscous = *value,
                "coulomb" => drive.coulomb = *value,
                "offset" => drive.offset = *value,
                _ => drive.rotor_inertia = *value,
            }
        }
    }
    let options = RobotSimOptions {
        motions: match section.motion.unwrap_or(Motion::Fourier) {
            Motion::Rest => Motions::Rest,
            Motion::Fourier => Motions::Fourier {
                harmonics: section.harmonics.unwrap_or(5),
                period_s: section.period_s.unwrap_or(20.0),
            },
            Motion::Moves => Motions::Moves {
                rest_s: section.rest_s.unwrap_or(0.5),
            },
        },
        limits: MotionLimits {
            part: section.part_of_limits.unwrap_or(default.limits.part),
            reach: section.reach.unwrap_or(default.limits.reach),
            acceleration: section.acceleration.unwrap_or(default.limits.acceleration),
        },
        controller: match section.controller.unwrap_or(Controller::ComputedTorque) {
            Controller::ComputedTorque => RobotController::ComputedTorque,
            Controller::Pd => RobotController::Pd,
            Controller::Servo => RobotController::Servo,
        },
        bandwidth_rad_per_s: section.bandwidth_rad_per_s.unwrap_or(default.bandwidth_rad_per_s),
        drives,
        difference: section.difference.unwrap_or(0.15),
        machine_seed: section.machine_seed.unwrap_or(0),
        encoder_bits: match has_velocity {
            true => 0,
            false => section.encoder_bits.unwrap_or(default.encoder_bits),
        },
        has_velocity,
        torque_noise: section.torque_noise.unwrap_or(default.torque_noise),
        payloads: section
            .payload
            .iter()
            .map(|payload| PayloadChange {
                t_s: payload.t_s,
                mass_kg: payload.mass_kg,
                center_m: payload.center_m,
                inertia_kg_m2: payload.inertia_kg_m2,
            })
            .collect(),
        ..default
    };
    // Reports errors now, not when the robot is simulated.
    RobotSimulator::new(model.robot(), options.clone()).map_err(|e| e.to_string())?;
    Ok(options)
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

/// The windows as stated in a file \[s\].
#[derive(Debug, Clone, Copy)]
struct StatedWindows {
    length_s: Option<f64>,
    stride_s: Option<f64>,
    max_gap_s: Option<f64>,
}

impl StatedWindows {
    fn of(section: &IdentifySection) -> Self {
        Self {
            length_s: section.window_s,
            stride_s: section.stride_s,
            max_gap_s: section.max_gap_s,
        }
    }

    /// True if the service chooses their length.
    fn are_free(&self) -> bool {
        self.length_s.is_none() && self.stride_s.is_none()
    }

    /// The windows for this sample period \[s\].
    fn at(&self, period_s: f64) -> WindowOptions {
        let mut windows = self
            .length_s
            .map_or_else(|| WindowOptions::for_period(period_s), WindowOptions::of_length);
        windows.stride_s = self.stride_s.unwrap_or(windows.stride_s);
        windows.max_gap_s = self.max_gap_s.unwrap_or(windows.max_gap_s);
        windows
    }
}

fn options(section: &IdentifySection, windows: WindowOptions) -> IdentifyOptions {
    let default = IdentifyOptions::default();
    IdentifyOptions {
        windows,
        block_s: section.block_s.unwrap_or(default.block_s),
        settle_blocks: section.settle_blocks.unwrap_or(default.settle_blocks),
        friction_walk: section.friction_walk.unwrap_or(default.friction_walk),
        payload_friction: section.payload_friction.unwrap_or(default.payload_friction),
        zero_rad: section.zero_rad.unwrap_or(default.zero_rad),
        ..default
    }
}

/// Default columns: t, then all positions, all velocities, all inputs. A section that names the
/// columns of the inputs must also name those of the velocities, if there are any.
fn columns(section: LogSection, n: usize) -> Result<LogColumns, String> {
    let list = |name: &str, given: Option<Vec<usize>>, default: Vec<usize>| {
        let columns = given.unwrap_or(default);
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
    let default = LogColumns::in_order(n, section.input_columns.is_none());
    let velocity = match section.velocity_columns {
        None => default.velocity,
        Some(columns) if columns.is_empty() => columns,
        given => list("velocity_columns", given, Vec::new())
            .map_err(|problem| format!("{problem}; leave it out, or empty, if the log holds no velocities"))?,
    };
    let in_order = LogColumns::in_order(n, !velocity.is_empty());
    Ok(LogColumns {
        time,
        position: list("position_columns", section.position_columns, in_order.position)?,
        input: list("input_columns", section.input_columns, in_order.input)?,
        velocity,
    })
}
