//! Configuration files: TOML ⇄ validated core types. The only place that translates between the two.
//!
//! Sources are laid over each other: built-in defaults, then files in the order given, then `section.key=value` arguments. A file
//! states only what differs. Every problem is told with its place, key, what was expected and what came, and all of them at once:
//!
//! ```text
//! config/arm.toml:12: estimator.block_len: expected a whole number from 1 to 10000000 [samples], got "abc" (a string)
//! ```
//!
//! `config/default.toml` lists every key with its default, unit, range and meaning.

mod build;
mod defaults;
mod error;
mod kind;
mod layers;
mod plant;
mod schema;
mod setpoint_csv;

pub use error::{ConfigError, Origin, Problem};
#[cfg(feature = "service")]
pub(crate) use kind::Short;
pub use kind::{Interval, Kind, Len};
pub use layers::Source;
pub use schema::{FileForm, Key, RealOrWord, keys};

use crate::estimator::{EstimatorOptions, Structure};
use crate::model::{
    Delayed, KnownConstants, MAX_JOINTS, Manipulator, Parameter, Plant as _, PlantDefinition, ServoAxis,
};
use crate::rows::{InputSource, ProjectedOptions};
use crate::sim::SimOptions;
use layers::Layers;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::PathBuf;
use toml::Value;

/// Configurations built into the library, by name; each is also a file in `config/`.
const EMBEDDED: &[(&str, &str)] = &[
    ("default", include_str!("../../config/default.toml")),
    ("cedro2022", include_str!("../../config/cedro2022.toml")),
    ("encoder_only", include_str!("../../config/encoder_only.toml")),
    ("servo_axis", include_str!("../../config/servo_axis.toml")),
    ("cedro2022_best", include_str!("../../config/cedro2022_best.toml")),
    ("own_plant", include_str!("../../config/own_plant.toml")),
];

/// How samples are delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Lockstep for a simulation at full speed, else realtime.
    Auto,
    /// The plant never waits; a late consumer loses the oldest samples.
    Realtime,
    /// The plant waits for its consumers; nothing is lost.
    Lockstep,
}

/// Section `[bus]`.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Robot of the topics' names.
    pub robot: String,
    /// Domain that isolates the run.
    pub domain: String,
    /// Delivery as configured; [`BusConfig::lockstep`] resolves `auto`.
    pub delivery: Delivery,
    /// Consumers that a lockstep run waits for.
    pub lockstep_consumers: usize,
    /// Longest wait for a consumer \[s\].
    pub lockstep_limit_s: f64,
}

impl BusConfig {
    /// Whether a run at this speed is in lockstep.
    pub fn lockstep(&self, speed: Speed) -> bool {
        match self.delivery {
            Delivery::Auto => speed == Speed::Max,
            Delivery::Realtime => false,
            Delivery::Lockstep => true,
        }
    }
}

/// How fast simulated time passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// As fast as it can be computed and consumed.
    Max,
    /// Simulated seconds per second, > 0.
    Factor(f64),
}

/// Section `[plant]`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantConfig {
    /// The simulation.
    pub sim: SimOptions,
    /// Its pace.
    pub speed: Speed,
}

/// Section `[model]`: which equations.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelConfig {
    /// The paper's two-joint arm.
    Manipulator {
        /// The equations.
        plant: Manipulator,
        /// Motor constants, where they are known: physical values are derived with them.
        known: Option<KnownConstants>,
    },
    /// The same with the delay of its input as one more parameter.
    DelayedManipulator {
        /// The equations.
        plant: Delayed<Manipulator>,
        /// As above.
        known: Option<KnownConstants>,
    },
    /// One servo axis.
    ServoAxis {
        /// The equation.
        plant: ServoAxis,
    },
    /// The same with the delay of its input as one more parameter.
    DelayedServoAxis {
        /// The equation.
        plant: Delayed<ServoAxis>,
    },
    /// A plant of the caller's own, which is not in this library.
    Own(PlantDefinition),
}

/// The same expression for the plant of every model, and another one for what is known of a caller's own.
macro_rules! with_plant {
    ($model:expr, $plant:ident => $body:expr, $own:ident => $otherwise:expr) => {
        match $model {
            $crate::config::ModelConfig::Manipulator { plant: $plant, .. } => $body,
            $crate::config::ModelConfig::DelayedManipulator { plant: $plant, .. } => $body,
            $crate::config::ModelConfig::ServoAxis { plant: $plant } => $body,
            $crate::config::ModelConfig::DelayedServoAxis { plant: $plant } => $body,
            $crate::config::ModelConfig::Own($own) => $otherwise,
        }
    };
}
#[cfg(feature = "service")]
pub(crate) use with_plant;

impl ModelConfig {
    /// The parameters to be identified.
    pub fn parameters(&self) -> &[Parameter] {
        with_plant!(self, plant => plant.parameters(), own => &own.parameters)
    }

    /// Everything about the plant but its terms.
    pub fn definition(&self) -> PlantDefinition {
        with_plant!(self, plant => PlantDefinition::of(plant), own => own.clone())
    }

    /// Which equation has which parameters.
    pub fn structure(&self) -> Structure {
        let definition = self.definition();
        Structure {
            params: definition.parameters.len(),
            equations: definition.equations.into_iter().map(|e| e.parameters).collect(),
        }
    }

    /// Name of the model.
    pub fn name(&self) -> &'static str {
        with_plant!(self, plant => plant.name(), own => own.name)
    }

    /// Motor constants of an arm, where they are known.
    pub fn known(&self) -> Option<KnownConstants> {
        match self {
            Self::Manipulator { known, .. } | Self::DelayedManipulator { known, .. } => *known,
            Self::ServoAxis { .. } | Self::DelayedServoAxis { .. } | Self::Own(_) => None,
        }
    }
}

/// How samples become rows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one per process")]
pub enum Rows {
    /// One row per sample and equation.
    Pointwise,
    /// One row per window and equation, from positions and inputs.
    Projected(ProjectedOptions),
}

/// Section `[identifier]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifierConfig {
    /// Form of the rows.
    pub rows: Rows,
    /// Source of u.
    pub input: InputSource,
    /// Magnitude from which on each joint's measured input is saturated; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// How long a signal may stand still that must move \[s\]; 0 for ever.
    pub frozen_after_s: f64,
}

/// Section `[estimator]`.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatorConfig {
    /// N, samples per block.
    pub block_len: usize,
    /// Everything else, checked against the model.
    pub options: EstimatorOptions,
}

/// Section `[monitor]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorConfig {
    /// Directory for the results, where one is stated.
    pub out_dir: Option<PathBuf>,
    /// A file of a recording that has this size is followed by another \[bytes\]; 0 for no limit.
    pub record_file_bytes: u64,
    /// Files of a recording that are kept; 0 for all.
    pub record_files: usize,
}

/// Section `[checkpoint]`.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckpointConfig {
    /// Directory of the checkpoints; none are written without it.
    pub dir: Option<PathBuf>,
    /// Time from one to the next \[s\].
    pub period_s: f64,
}

/// Section `[supervision]`: what a launcher does about a process that fails.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupervisionConfig {
    /// Restarts of each process before the launcher gives up; 0 for none.
    pub restarts: u64,
    /// Pause before the first restart \[s\], doubled with each.
    pub backoff_s: f64,
    /// Longest pause \[s\].
    pub backoff_limit_s: f64,
    /// Restarts are forgiven after so long without a failure \[s\].
    pub healthy_s: f64,
}

/// What a role asks of the system's scheduler and memory.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealtimeSettings {
    /// Priority of SCHED_FIFO, 1 to 99; `None` for the system's default policy.
    pub scheduler_priority: Option<u8>,
    /// CPUs to run on; none for all.
    pub cpu_affinity: Vec<usize>,
    /// Keep all memory from being swapped out.
    pub lock_memory: bool,
}

/// Sections `[realtime.*]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealtimeConfig {
    /// Of the plant simulator.
    pub plant: RealtimeSettings,
    /// Of the identifier.
    pub identifier: RealtimeSettings,
    /// Of the monitor.
    pub monitor: RealtimeSettings,
}

/// Section `[log]`: what the columns of a log file mean.
#[derive(Debug, Clone, PartialEq)]
pub struct LogColumns {
    /// Column of the time; rows follow each other at the sample period where there is none.
    pub time: Option<String>,
    /// One unit of the time column \[s\].
    pub time_unit_s: f64,
    /// Column of each joint's position.
    pub positions: Vec<String>,
    /// One unit of the positions \[rad or m\].
    pub position_unit: f64,
    /// Column of each joint's input.
    pub inputs: Vec<String>,
    /// One unit of the inputs, in the model's unit.
    pub input_unit: f64,
    /// Column of each joint's setpoint, or none.
    pub setpoints: Vec<String>,
}

/// A whole configuration, valid in itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Topics and delivery.
    pub bus: BusConfig,
    /// The simulated machine.
    pub plant: PlantConfig,
    /// The equations.
    pub model: ModelConfig,
    /// From samples to rows.
    pub identifier: IdentifierConfig,
    /// The recursion.
    pub estimator: EstimatorConfig,
    /// What is kept.
    pub monitor: MonitorConfig,
    /// What the identifier keeps for its next start.
    pub checkpoint: CheckpointConfig,
    /// What is done about processes that fail.
    pub supervision: SupervisionConfig,
    /// What each role asks of the system.
    pub realtime: RealtimeConfig,
    /// How a log file is read.
    pub log: LogColumns,
    file: FileForm,
    warnings: Vec<Problem>,
}

impl Config {
    /// Lays files over the built-in defaults in the order given, then `section.key=value` arguments over these.
    ///
    /// # Errors
    /// Everything that is wrong with any of them.
    pub fn load(sources: &[Source], arguments: &[String]) -> Result<Self, ConfigError> {
        Self::load_for(None, sources, arguments)
    }

    /// The same for a plant of the caller's own, which takes the place of what section `[model]` chooses.
    ///
    /// # Errors
    /// Everything that is wrong with any of them, and with the definition.
    pub fn load_for(
        own: Option<&PlantDefinition>,
        sources: &[Source],
        arguments: &[String],
    ) -> Result<Self, ConfigError> {
        let mut layers = Layers::default();
        sources.iter().for_each(|source| layers.source(source));
        layers.arguments(arguments);
        let mut problems = std::mem::take(&mut layers.problems);
        // What is right so far is checked on, so that one run of a program tells everything.
        let config = resolve(&layers).and_then(|form| build::config(form, own, &layers));
        match config {
            Ok(config) if problems.is_empty() => Ok(config),
            Ok(_) => Err(ConfigError { problems }),
            Err(more) => {
                problems.extend(more);
                Err(ConfigError { problems })
            }
        }
    }

    /// The configuration in a text, under a name for messages.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        Self::load(
            &[Source::Embedded {
                name: name.to_owned(),
                text: text.to_owned(),
            }],
            &[],
        )
    }

    /// A configuration that is built in, `cedro2022` for instance; the same as the file of that name in `config/`.
    pub fn embedded(name: &str) -> Option<Source> {
        let (name, text) = EMBEDDED.iter().find(|(known, _)| *known == name)?;
        Some(Source::Embedded {
            name: format!("built-in {name}.toml"),
            text: (*text).to_owned(),
        })
    }

    /// The same with one key set to a number, as while an identifier runs.
    ///
    /// # Errors
    /// What is wrong with it, with the key; also where the key would have no effect.
    pub fn with_number(&self, path: &str, value: f64) -> Result<Self, ConfigError> {
        let whole = matches!(schema::key(path).map(|key| key.kind), Some(Kind::Whole(..)));
        let value = if whole && value.fract() == 0.0 && value.abs() < 1e18 {
            Value::Integer(value as i64)
        } else {
            Value::Float(value)
        };
        let mut table = toml::Table::try_from(&self.file).unwrap_or_default();
        for (section, name) in schema::EXCLUSIVE
            .iter()
            .filter(|group| group.contains(&path))
            .flat_map(|group| group.iter())
            .filter_map(|key| key.rsplit_once('.'))
        {
            section_of(&mut table, section).map(|section| section.remove(name));
        }
        let base = FileForm::deserialize(Value::Table(table)).map(|form| render(&form, false));
        let source = Source::Embedded {
            name: "the configuration in force".to_owned(),
            text: base.unwrap_or_default(),
        };
        let own = match &self.model {
            ModelConfig::Own(definition) => Some(definition),
            _ => None,
        };
        let config = Self::load_for(own, &[source], &[format!("{path}={}", literal(&value))])?;
        let useless = |problem: &&Problem| problem.key == path && problem.to_string().contains("has no effect");
        match config.warnings.iter().find(useless) {
            Some(problem) => Err(ConfigError {
                problems: vec![problem.clone()],
            }),
            None => Ok(config),
        }
    }

    /// What is legal but suspicious.
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }

    /// A number that changes with whatever determines the estimates: model, rows, estimator, sample period.
    ///
    /// 64-bit FNV-1a over the settings' text, the same in every build and on every machine.
    pub fn config_hash(&self) -> u64 {
        let relevant = [
            "model",
            "model.known",
            "model.servo_axis",
            "identifier",
            "identifier.projected",
            "identifier.considered",
            "estimator",
        ];
        let lines = settings(&self.file).filter(|(section, name, _)| {
            relevant.contains(&section.as_str()) || (section == "plant" && name == "sample_period_s")
        });
        let text = lines.fold(String::new(), |mut text, (section, name, value)| {
            let _ = writeln!(text, "{section}.{name} = {value}");
            text
        });
        text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
    }

    /// The whole configuration as a file that loads to the same.
    pub fn to_toml(&self) -> String {
        render(&self.file, false)
    }

    /// `config/default.toml`: every key with its default, type, range, unit and meaning.
    pub fn reference() -> String {
        render(&FileForm::default(), true)
    }

    /// The settings in the form of their file.
    pub fn file_form(&self) -> &FileForm {
        &self.file
    }
}

impl Default for Config {
    /// The paper's experiment: the values of `config/default.toml`.
    fn default() -> Self {
        let layers = Layers::default();
        build::config(FileForm::default(), None, &layers)
            .unwrap_or_else(|problems| unreachable!("the built-in defaults are tested to be valid: {problems:?}"))
    }
}

/// Defaults with what was stated laid over them.
fn resolve(layers: &Layers) -> Result<FileForm, Vec<Problem>> {
    let broken = |e: &dyn std::fmt::Display| vec![Problem::new(Origin::Default, "", format!("{e}"))];
    let mut table = toml::Table::try_from(FileForm::default()).map_err(|e| broken(&e))?;
    for group in schema::EXCLUSIVE {
        if group.iter().any(|key| layers.entries().contains_key(*key)) {
            for (section, name) in group.iter().filter_map(|key| key.rsplit_once('.')) {
                section_of(&mut table, section).map(|section| section.remove(name));
            }
        }
    }
    for (path, entry) in layers.entries() {
        let Some((section, name)) = path.rsplit_once('.') else {
            continue;
        };
        section_of(&mut table, section).map(|section| section.insert(name.to_owned(), entry.value.clone()));
    }
    let mut form = FileForm::deserialize(Value::Table(table)).map_err(|e| broken(&e))?;
    let base = layers
        .entries()
        .get("plant.setpoint.csv.path")
        .and_then(|entry| entry.base.as_ref());
    if let (Some(path), Some(base)) = (&mut form.csv.path, base) {
        *path = base.join(&*path).display().to_string();
    }
    Ok(form)
}

fn section_of<'a>(table: &'a mut toml::Table, section: &str) -> Option<&'a mut toml::Table> {
    table.get_mut(section).and_then(Value::as_table_mut)
}

/// Section, name and value of every key that is set, in the order of the schema.
fn settings(form: &FileForm) -> impl Iterator<Item = (String, String, Value)> {
    // Serialising plain structures of numbers, words and lists has no way to fail.
    let table = toml::Table::try_from(form).unwrap_or_default();
    keys().filter_map(move |key| {
        let value = table.get(key.section)?.get(key.name)?.clone();
        Some((key.section.to_owned(), key.name.to_owned(), value))
    })
}

fn render(form: &FileForm, comments: bool) -> String {
    let values: std::collections::BTreeMap<_, _> = settings(form).map(|(s, n, value)| ((s, n), value)).collect();
    let mut text = String::new();
    if comments {
        text.push_str(
            "# Every key with its default. A configuration states only what differs: config/encoder_only.toml, which\n\
             # `thetabus run` takes where no file is named, or config/cedro2022.toml.\n\
             # The same can be said on the command line: --set estimator.block_len=950\n",
        );
    }
    for section in schema::SECTIONS {
        if comments {
            text.push('\n');
            comment(&mut text, &format!("{}.", section.meaning));
        }
        let _ = writeln!(text, "[{}]", section.name);
        for key in section.keys {
            let value = values.get(&(section.name.to_owned(), key.name.to_owned()));
            if comments {
                let default = if value.is_none() { "; not set by default" } else { "" };
                text.push('\n');
                comment(&mut text, &format!("{}.", key.meaning));
                comment(&mut text, &format!("Takes {}{default}.", key.kind.expected(key.unit)));
                if let Kind::Tables(inner) = key.kind {
                    for key in inner {
                        let need = if key.optional { "" } else { "; needed" };
                        let line = format!(
                            "{}: {}. Takes {}{need}.",
                            key.name,
                            key.meaning,
                            key.kind.expected(key.unit)
                        );
                        comment(&mut text, &line);
                    }
                }
            }
            match value {
                Some(value) => _ = writeln!(text, "{} = {}", key.name, literal(value)),
                None if comments => _ = writeln!(text, "#{} =", key.name),
                None => {}
            }
        }
        if !comments {
            text.push('\n');
        }
    }
    text
}

/// A value as people write it: `1e-9`, not `0.000000001`.
fn literal(value: &Value) -> String {
    match value {
        Value::Float(x) => format!("{x:?}"),
        Value::Table(table) => {
            let entries = table.iter().map(|(name, value)| format!("{name} = {}", literal(value)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
        Value::Array(items) => format!("[{}]", items.iter().map(literal).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// A sentence as comment lines of readable length.
fn comment(text: &mut String, sentence: &str) {
    const WIDTH: usize = 110;
    let mut width = WIDTH;
    for word in sentence.split(' ') {
        if width + 1 + word.chars().count() > WIDTH {
            text.push_str(if text.ends_with('\n') { "#" } else { "\n#" });
            width = 1;
        }
        text.push(' ');
        text.push_str(word);
        width += 1 + word.chars().count();
    }
    text.push('\n');
}
