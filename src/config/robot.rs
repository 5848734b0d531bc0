//! The file of a robot from its URDF ⇄ a validated model: `[model] kind = "robot"`.
//!
//! It has sections of its own beside those of every configuration, and is read like any other.
//! Everything except `model.kind` and `model.urdf` has a default. Paths are relative to the file.

use super::check::Check;
use super::error::{ConfigError, Origin, Problem};
use super::form;
use super::layers::Layers;
use super::robot_sections::{
    StatedWindows, columns, drives, excitation, friction, gravity, identification, simulation,
};
use super::schema::{ROBOT, RobotForm, VelocityKind, key, own_sections_of_robots};
use crate::pipe::{MAX_SETTINGS_BYTES, read_text};
use crate::robot::{
    Drives, ExcitationOptions, IdentifyOptions, LogColumns, Robot, RobotModel, RobotSample, RobotSimOptions, Selection,
    UrdfError, WindowOptions, columns_in, median_period_s, with_velocities,
};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

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
    log_velocity_s: f64,
    /// The simulated robot; sample period and seed are those of section `[plant]`.
    pub simulation: RobotSimOptions,
    /// Options of the design of a motion.
    pub excitation: ExcitationOptions,
    /// Sample period of section `[plant]`, 0.001 by default \[s\].
    pub sample_period_s: f64,
    stated: BTreeSet<String>,
}

/// True if an argument sets a key of a robot's own sections; `model.kind` chooses the robot itself.
pub fn is_robot_override(argument: &str) -> bool {
    let key = argument.split('=').next().unwrap_or_default().trim();
    let section = key.split('.').next().unwrap_or_default();
    own_sections_of_robots().any(|own| own == section) && key.contains('.') && key != "model.kind"
}

/// True for arguments that a robot's file takes or can explain: of its own sections, or with a key
/// that no configuration has.
fn is_for_robot(argument: &str) -> bool {
    let is_unknown = |(path, _): (&str, &str)| key(path.trim()).is_none();
    is_robot_override(argument) || argument.split_once('=').is_some_and(is_unknown)
}

/// The stated values of a robot's file, and their problems.
fn layers(text: &str, path: &Path, set: &[String]) -> Layers {
    let mut layers = Layers::of(&ROBOT);
    layers.text(&path.display().to_string(), text, None);
    let own: Vec<String> = set.iter().filter(|one| is_for_robot(one)).cloned().collect();
    layers.arguments(&own);
    layers
}

impl RobotConfig {
    /// True if a text is the configuration of a robot: `model.kind = "robot"`.
    pub fn is_robot(text: &str) -> bool {
        let kind = |table: &DeTable<'_>| {
            let kind = table.get("model")?.get_ref().as_table()?.get("kind")?;
            Some(kind.get_ref().as_str() == Some("robot"))
        };
        DeTable::parse(text).is_ok_and(|table| kind(table.get_ref()) == Some(true))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// All errors of the file, with line, key, what was expected and what was given; or the first
    /// one of the URDF.
    pub fn from_file(path: &Path) -> Result<Self, ConfigError> {
        Self::from_file_with(path, &[])
    }

    /// The same with `section.key=value` arguments applied to it; see
    /// [`parse_with`](Self::parse_with).
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn from_file_with(path: &Path, set: &[String]) -> Result<Self, ConfigError> {
        let text = read_text(path, MAX_SETTINGS_BYTES).map_err(|e| ConfigError {
            problems: vec![Problem::new(Origin::whole(path), "", e.to_string())],
        })?;
        Self::parse_with(&text, path, set)
    }

    /// Reads `text`, the content of the file `path`.
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        Self::parse_with(text, path, &[])
    }

    /// Reads `text`, the content of the file `path`, with those arguments applied that set keys of
    /// a robot's own sections; others are ignored, except those with an unknown key.
    ///
    /// # Errors
    /// See [`from_file`](Self::from_file).
    pub fn parse_with(text: &str, path: &Path, set: &[String]) -> Result<Self, ConfigError> {
        let mut layers = layers(text, path, set);
        let mut problems = std::mem::take(&mut layers.problems);
        // The file is for something else, so what it lacks or has too much says nothing.
        let is_other = |problem: &Problem| problem.key == "model.kind";
        if problems.iter().any(is_other) {
            problems.retain(is_other);
            return Err(ConfigError { problems });
        }
        if !layers.entries().contains_key("model.kind") {
            // After a syntax error nothing is known of the file.
            if !problems.iter().any(|problem| problem.key.is_empty()) {
                let origin = Origin::whole(path);
                problems = vec![Problem::expected(origin, "model.kind", "\"robot\"", "none")];
            }
            return Err(ConfigError { problems });
        }
        // Continue checking the valid part, so that one run of a program reports everything.
        let lacks_urdf = problems.iter().any(|problem| problem.key == "model.urdf");
        let config = match lacks_urdf {
            true => Err(Vec::new()),
            false => form::merged(&layers).and_then(|form| build(&form, path, &layers)),
        };
        match config {
            Ok(config) if problems.is_empty() => Ok(config),
            Ok(_) => Err(ConfigError { problems }),
            Err(more) => {
                problems.extend(more.into_iter().map(|problem| problem.or_in(path)));
                Err(ConfigError { problems })
            }
        }
    }

    /// The own sections of a file, the URDF not read.
    ///
    /// # Errors
    /// All errors of single keys.
    #[cfg(feature = "service")]
    pub(crate) fn own_sections(text: &str, path: &Path, set: &[String]) -> Result<RobotForm, ConfigError> {
        let mut layers = layers(text, path, set);
        let problems = std::mem::take(&mut layers.problems);
        match problems.is_empty() {
            true => form::merged(&layers).map_err(|problems| ConfigError { problems }),
            false => Err(ConfigError { problems }),
        }
    }

    /// True if the file, or an argument for it, states this key or a key of this section.
    pub fn is_stated(&self, path: &str) -> bool {
        let is_within = |key: &String| key == path || key.strip_prefix(path).is_some_and(|rest| rest.starts_with('.'));
        self.stated.iter().any(is_within)
    }

    /// Columns of a log: those that the file names, otherwise as many as its lines contain.
    pub fn columns_of(&self, log: &str) -> LogColumns {
        let n = self.model.robot().len();
        let lacks_velocity = !self.names_columns && columns_in(log) == Some(1 + 2 * n);
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
        self.log_velocity_s
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

impl RobotForm {
    /// The sections as a file that loads to the same.
    #[cfg(feature = "service")]
    pub(crate) fn to_toml(&self) -> String {
        form::render(ROBOT.own_sections(), self)
    }
}

/// An error of the URDF by its own place; a file that cannot be read by the place that names it.
fn of_urdf(error: UrdfError, path: &Path, layers: &Layers) -> Problem {
    if error.is_of_file() {
        const KEY: &str = "model.urdf";
        let got = format!("{}: {}", path.display(), error.got);
        return Problem::expected(layers.origin(KEY), KEY, error.expected, got);
    }
    let origin = Origin::File {
        name: error.file.as_deref().unwrap_or(path).display().to_string(),
        line: error.line.unwrap_or(0),
    };
    Problem::expected(origin, &error.element, error.expected, error.got)
}

/// Builds and checks what depends on several keys or on the URDF; on failure returns all problems.
fn build(form: &RobotForm, path: &Path, layers: &Layers) -> Result<RobotConfig, Vec<Problem>> {
    let mut check = Check {
        layers,
        problems: Vec::new(),
        warnings: Vec::new(),
    };
    let dir = path.parent().unwrap_or(Path::new(""));
    let Some(urdf) = &form.model.urdf else {
        let origin = layers.origin("model.kind");
        let problem = Problem::expected(origin, "model.urdf", "the path of a URDF as a string", "none");
        return Err(vec![problem]);
    };
    let urdf = dir.join(urdf);
    let selection = Selection {
        base: form.model.base.clone(),
        tip: form.model.tip.clone(),
        joints: form.model.joints.clone(),
    };
    let mut robot = Robot::from_file(&urdf, &selection).map_err(|e| vec![of_urdf(e, &urdf, layers)])?;
    let n = robot.len();
    if let Some(gravity) = gravity(form, &mut check) {
        robot.gravity = gravity;
    }
    let friction = friction(&form.friction, &mut check);
    let model = match RobotModel::new(robot, form.model.rotor_inertia, vec![friction; n]) {
        Ok(model) => model,
        Err(error) => {
            check.wrong("friction", error.to_string());
            return Err(check.problems);
        }
    };
    let drives = drives(&form.drive, n, &mut check);
    let stated_s = layers.entries().get("plant.sample_period_s");
    let sample_period_s = stated_s
        .and_then(|entry| entry.value.as_float())
        .unwrap_or(SAMPLE_PERIOD_S);
    let log_velocity_s = form.identify.velocity_s;
    let velocity_s = (form.identify.velocity == VelocityKind::Differentiated).then_some(log_velocity_s);
    let windows = StatedWindows::of(&form.identify);
    let options = IdentifyOptions {
        gain_std: form.drive.gain_std,
        formed_over_s: velocity_s,
        ..identification(&form.identify, &windows, sample_period_s, &model, &mut check)
    };
    let simulation = simulation(&form.simulate, &model, velocity_s.is_none(), dir, &mut check);
    let excitation = excitation(&form.excite, model.robot(), &mut check);
    let columns = columns(&form.log, n, &mut check);
    let names_columns = ["log.position_columns", "log.velocity_columns", "log.input_columns"];
    match (drives, simulation, excitation, columns) {
        (Some(drives), Some(simulation), Some(excitation), Some(columns)) if check.problems.is_empty() => {
            Ok(RobotConfig {
                urdf,
                model,
                columns,
                names_columns: names_columns.iter().any(|key| check.stated(key)),
                drives,
                options,
                windows,
                payload: form.identify.payload,
                velocity_s,
                log_velocity_s,
                simulation,
                excitation,
                sample_period_s,
                stated: layers.entries().keys().cloned().collect(),
            })
        }
        _ => Err(check.problems),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The file that is copied for a new robot is the list of the keys for its users.
    #[test]
    fn regress_the_shipped_file_shows_each_key_in_its_section() {
        let text = include_str!("../../config/robots/six_axis.toml");
        let own: Vec<&str> = own_sections_of_robots().collect();
        for key in ROBOT.keys().filter(|key| own.contains(&key.section)) {
            let begin = text.find(&format!("[{}]\n", key.section));
            let begin = begin.or_else(|| text.find(&format!("[{}] ", key.section)));
            let section = &text[begin.expect(key.section) + 1..];
            let section = &section[..section.find("\n[").unwrap_or(section.len())];
            let is_list = key.name == "payload" && text.contains("[[simulate.payload]]");
            assert!(section.contains(key.name) || is_list, "{}", key.path());
        }
    }

    #[test]
    fn regress_only_keys_of_a_robots_own_sections_are_laid_over_its_file() {
        let own = [
            "identify.block_s=0.5",
            "simulate.payload=[]",
            "log.time_column=2",
            "model.tip=x",
        ];
        assert!(own.iter().all(|argument| is_robot_override(argument)));
        let other = [
            "plant.seed=1",
            "model.kind=arm",
            "identifier.rows=x",
            "identify",
            "plant.a=log.b",
        ];
        assert!(other.iter().all(|argument| !is_robot_override(argument)));
    }
}
