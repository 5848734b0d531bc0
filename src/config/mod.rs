//! Configuration files: TOML ⇄ validated core types. Only this module translates between the two.
//!
//! Sources are applied in layers: built-in defaults, then files in the order given, then
//! `section.key=value` arguments. A file states only what differs. All problems are reported at
//! once, each with its origin, key, what was expected and what was given:
//!
//! ```text
//! config/arm.toml:12: estimator.block_len: expected a whole number from 1 to 10000000 [samples], got "abc" (a string)
//! ```
//!
//! `config/default.toml` lists every key with its default, unit, range and meaning.

mod build;
mod catalog;
mod cell;
mod check;
mod choice;
mod controller;
mod error;
mod estimator;
mod form;
mod identifier;
mod kind;
mod layers;
mod log;
mod memory;
mod nodes;
mod plant;
#[cfg(feature = "robot")]
mod robot;
#[cfg(feature = "robot")]
mod robot_sections;
mod schema;
mod sections;
mod setpoint;
mod setpoint_csv;
mod suspicious;
mod timing;
mod words;

pub use catalog::Catalog;
pub use cell::CellRobot;
pub use choice::Choice;
pub use error::{ConfigError, Origin, Problem};
#[cfg(feature = "service")]
pub(crate) use kind::Short;
pub use kind::{Interval, Key, Kind, Len};
pub use layers::Source;
#[cfg(feature = "robot")]
pub use robot::{RobotConfig, is_robot_override};
pub use schema::{Delivery, FeedForward, FileForm, PositionUnit, RealOr, keys};
pub use sections::{
    BusConfig, CheckpointConfig, Config, ControllerConfig, EstimatorConfig, IdentifierConfig, LogColumns,
    MonitorConfig, PlantConfig, RealtimeConfig, RealtimeSettings, Speed, SupervisionConfig,
};

use crate::words::fnv1a;
use layers::Layers;
use serde::Deserialize;
use std::fmt::Write as _;
use toml::Value;

/// Configurations built into the library, by name; each is also a file in `config/`.
const EMBEDDED: &[(&str, &str)] = &[
    ("default", include_str!("../../config/default.toml")),
    ("cedro2022", include_str!("../../config/cedro2022.toml")),
    ("encoder_only", include_str!("../../config/encoder_only.toml")),
    ("servo_axis", include_str!("../../config/servo_axis.toml")),
    ("cedro2022_best", include_str!("../../config/cedro2022_best.toml")),
    ("own_plant", include_str!("../../config/own_plant.toml")),
    ("adaptive", include_str!("../../config/adaptive.toml")),
];

impl Config {
    /// Applies files to the built-in defaults in the order given, then `section.key=value`
    /// arguments.
    ///
    /// # Errors
    /// All errors in any of them.
    pub fn load(sources: &[Source], arguments: &[String]) -> Result<Self, ConfigError> {
        Self::load_for(&Catalog::default(), sources, arguments)
    }

    /// The same with the caller's own models, by name in `model.kind`; the first of them is the
    /// default.
    ///
    /// # Errors
    /// All errors in any of them, and of the models.
    pub fn load_for(catalog: &Catalog, sources: &[Source], arguments: &[String]) -> Result<Self, ConfigError> {
        Self::load_with(catalog, sources, arguments, &[])
    }

    /// The same with options of a command line on top, each with the option as typed and
    /// `section.key=value`.
    pub(crate) fn load_with(
        catalog: &Catalog,
        sources: &[Source],
        arguments: &[String],
        options: &[(String, String)],
    ) -> Result<Self, ConfigError> {
        let mut layers = Layers::of(&schema::ORDINARY);
        sources.iter().for_each(|source| layers.source(source));
        layers.arguments(arguments);
        layers.options(options);
        let mut problems = std::mem::take(&mut layers.problems);
        // Continue checking the valid part, so that one run of a program reports everything.
        let config = resolve(&layers).and_then(|form| build::config(form, catalog, &layers));
        match config {
            Ok(config) if problems.is_empty() => Ok(config),
            Ok(_) => Err(ConfigError { problems }),
            Err(more) => {
                problems.extend(more);
                Err(ConfigError { problems })
            }
        }
    }

    /// Parses a text, with a name for messages.
    ///
    /// # Errors
    /// All errors in it.
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        Self::load(
            &[Source::Embedded {
                name: name.to_owned(),
                text: text.to_owned(),
            }],
            &[],
        )
    }

    /// A built-in configuration, such as `cedro2022`; the same as the file of that name in
    /// `config/`.
    pub fn embedded(name: &str) -> Option<Source> {
        let (name, text) = EMBEDDED.iter().find(|(known, _)| *known == name)?;
        Some(Source::Embedded {
            name: format!("built-in {name}.toml"),
            text: (*text).to_owned(),
        })
    }

    /// Names of the built-in configurations.
    pub fn embedded_names() -> impl Iterator<Item = &'static str> {
        EMBEDDED.iter().map(|(name, _)| *name)
    }

    /// The same with one key set to a number, as at run time.
    ///
    /// # Errors
    /// The error, with the key; also if the key would have no effect.
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
            form::section_of(&mut table, section).map(|section| section.remove(name));
        }
        let base = FileForm::deserialize(Value::Table(table)).map(|form| form::render(schema::SECTIONS, &form));
        let source = Source::Embedded {
            name: "the configuration in force".to_owned(),
            text: base.unwrap_or_default(),
        };
        let config = Self::load_for(&self.catalog, &[source], &[format!("{path}={}", form::literal(&value))])?;
        let useless = |problem: &&Problem| problem.key == path && problem.is_without_effect;
        match config.warnings.iter().find(useless) {
            Some(problem) => Err(ConfigError {
                problems: vec![problem.clone()],
            }),
            None => Ok(config),
        }
    }

    /// The available models.
    pub fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    /// Legal but suspicious settings.
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }

    /// A hash of everything that determines the estimates: model, rows, estimator, sample period.
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
        fnv1a(text.bytes())
    }

    /// The whole configuration as a file that loads to the same configuration.
    pub fn to_toml(&self) -> String {
        form::render(schema::SECTIONS, &self.file)
    }

    /// `config/default.toml`: every key with its default, type, range, unit and meaning.
    pub fn reference() -> String {
        form::reference(REFERENCE, schema::SECTIONS, &FileForm::default())
    }

    /// The settings in the form of the file.
    pub fn file_form(&self) -> &FileForm {
        &self.file
    }
}

impl Default for Config {
    /// The paper's experiment: the values of `config/default.toml`.
    fn default() -> Self {
        let layers = Layers::of(&schema::ORDINARY);
        build::config(FileForm::default(), &Catalog::default(), &layers)
            .unwrap_or_else(|problems| unreachable!("the built-in defaults are tested to be valid: {problems:?}"))
    }
}

/// Defaults with the stated values applied.
fn resolve(layers: &Layers) -> Result<FileForm, Vec<Problem>> {
    let mut form: FileForm = form::merged(layers)?;
    let base = layers
        .entries()
        .get("plant.setpoint.csv.path")
        .and_then(|entry| entry.base.as_ref());
    if let (Some(path), Some(base)) = (&mut form.csv.path, base) {
        *path = base.join(&*path).display().to_string();
    }
    Ok(form)
}

/// Section, name and value of every key that is set, in the order of the schema.
fn settings(form: &FileForm) -> impl Iterator<Item = (String, String, Value)> {
    // Serialising plain structures of numbers, words and lists cannot fail.
    let table = toml::Table::try_from(form).unwrap_or_default();
    keys().filter_map(move |key| {
        let value = table.get(key.section)?.get(key.name)?.clone();
        Some((key.section.to_owned(), key.name.to_owned(), value))
    })
}

/// The first lines of `config/default.toml`.
const REFERENCE: &str = "# Every key with its default. A configuration states only what differs: config/encoder_only.toml, which\n\
     # every program takes if no file is named, or config/cedro2022.toml.\n\
     # The same can be said on the command line: --set estimator.block_len=950\n";
