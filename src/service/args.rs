//! Command lines. What overrides the configuration becomes an argument of its loader, so that one
//! place checks everything.

use super::{Failure, cell};
use crate::bus::{Domain, ICEORYX2_VERSION, Limits};
use crate::config::{Catalog, Config, Source, is_robot_override};
use crate::messages::SCHEMA_VERSION;
use crate::runner::Stay;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::sync::LazyLock;

/// What `--version` says: crate, schema, iceoryx2.
pub static VERSION: LazyLock<String> = LazyLock::new(|| {
    format!(
        "{} (message schema {SCHEMA_VERSION}, iceoryx2 {ICEORYX2_VERSION})",
        env!("CARGO_PKG_VERSION")
    )
});

/// The configuration that every program takes if no file is named; what a program with models of
/// its own lays below is `own_plant`.
pub(super) const BUILT_IN: &str = "encoder_only";

/// Log format on standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// What all programs understand.
#[derive(Debug, Clone, Default, Args)]
pub struct CommonArgs {
    /// Configuration file; repeatable, later files override earlier ones key by key. Default:
    /// config/encoder_only.toml, built in
    #[arg(long, value_name = "FILE")]
    pub config: Vec<PathBuf>,
    /// Override a key of the configuration, e.g. --set estimator.block_len=950; repeatable
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
    /// Name of the machine; its topics are thetabus/NAME/… (key bus.robot)
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Domain, which separates whole runs; programs of one run name the same (key bus.domain)
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
    #[command(flatten)]
    pub(super) launched: Launched,
    /// The program draws on the terminal: only errors may come between.
    #[arg(skip)]
    pub(super) draws: bool,
    /// The models that `model.kind` may name.
    #[arg(skip)]
    pub(super) catalog: Catalog,
}

/// What `thetabus run` tells the processes that it starts.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct Launched {
    /// Process id of the launcher: end with it
    #[arg(long, hide = true, value_name = "PID")]
    pub launched_by: Option<u32>,
    /// Start once so many consumers of the own topic are attached
    #[arg(long, hide = true, default_value_t = 0, value_name = "COUNT")]
    pub await_consumers: usize,
    /// Nothing may be lost: the monitor gives receipts for estimates, the identifier waits for them
    #[arg(long, hide = true)]
    pub receipts: bool,
    /// Take over from one that died: append to its files
    #[arg(long, hide = true)]
    pub resume: bool,
    /// End with the stream
    #[arg(long, hide = true)]
    pub until_end: bool,
}

impl Launched {
    /// True in a process that `thetabus run` has started.
    pub(super) fn is_launched(&self) -> bool {
        self.launched_by.is_some()
    }
}

impl CommonArgs {
    /// Of a tool that takes no configuration.
    pub fn with_logs(log_format: LogFormat) -> Self {
        Self {
            log_format,
            ..Self::default()
        }
    }

    /// With these models.
    #[must_use]
    pub(super) fn with_models(mut self, catalog: Catalog) -> Self {
        self.catalog = catalog;
        self
    }

    /// True in a process that `thetabus run` has started.
    pub(super) fn is_launched(&self) -> bool {
        self.launched.is_launched()
    }

    pub(super) fn stay(&self) -> Stay {
        if self.launched.until_end {
            Stay::UntilEnd
        } else {
            Stay::Forever
        }
    }

    /// The configuration: built-in defaults, `sources`, the files, `--set`, then what the command
    /// line says with words of its own. With neither sources nor files it is [`BUILT_IN`], so that
    /// programs which are started one by one mean the same as `thetabus run`.
    pub(super) fn load(&self, sources: Vec<Source>, own: &[(&str, Option<String>)]) -> Result<Config, Failure> {
        let of_sources = sources.iter().filter_map(|source| match source {
            Source::File(path) => Some(path.clone()),
            _ => None,
        });
        let files: Vec<PathBuf> = of_sources.chain(self.config.clone()).collect();
        let config = self.load_quietly(sources, own)?;
        self.warn(&config);
        if !self.is_launched() {
            let words = files
                .iter()
                .filter_map(|path| super::robot::suspicious_unit(path, &self.set));
            words.for_each(|words| tracing::warn!("{words}"));
        }
        Ok(config)
    }

    /// The configurations of all robots that this process is for: those of the `[[robot]]` entries,
    /// or the one of files without any.
    pub(super) fn load_robots(&self, own: &[(&str, Option<String>)]) -> Result<Vec<Config>, Failure> {
        let configs = self.load_robots_quietly(own)?;
        configs.first().into_iter().for_each(|config| self.warn(config));
        Ok(configs)
    }

    /// The same without a word about what is suspicious.
    pub(super) fn load_robots_quietly(&self, own: &[(&str, Option<String>)]) -> Result<Vec<Config>, Failure> {
        let names = match &self.robot {
            Some(_) => None,
            None => cell::robots(&self.config)?,
        };
        let Some(names) = names else {
            return Ok(vec![self.load_quietly(Vec::new(), own)?]);
        };
        let mut configs: Vec<Config> = Vec::with_capacity(names.len());
        for name in names {
            let one = Self {
                robot: Some(name),
                ..self.clone()
            };
            let config = one.load_quietly(Vec::new(), own)?;
            if let Some(first) = configs.first().filter(|first| first.bus.domain != config.bus.domain) {
                return Err(Failure::Usage(format!(
                    "robot {}: bus.domain is {:?}, and {:?} for robot {}; one process serves one domain",
                    config.bus.robot, config.bus.domain, first.bus.domain, first.bus.robot
                )));
            }
            configs.push(config);
        }
        Ok(configs)
    }

    /// A launcher has shown the warnings already, with the user's own file and line.
    fn warn(&self, config: &Config) {
        if !self.is_launched() {
            config.warnings().iter().for_each(|warning| tracing::warn!("{warning}"));
        }
    }

    fn load_quietly(&self, sources: Vec<Source>, own: &[(&str, Option<String>)]) -> Result<Config, Failure> {
        let basis = |catalog: &Catalog| match catalog.preferred() {
            Some(_) => Config::embedded("own_plant"),
            None if sources.is_empty() && self.config.is_empty() => Config::embedded(BUILT_IN),
            None => None,
        };
        let basis = basis(&self.catalog);
        let files = cell::sources(&self.config, self.robot.as_deref())?;
        let sources: Vec<Source> = basis.into_iter().chain(sources).chain(files).collect();
        let (config, counted_with_s) = self.load_at(&sources, own, None)?;
        // The time of a robot's block holds whatever is laid over its sample period.
        let period_s = config.plant.sim.sample_period_s;
        match counted_with_s {
            Some(counted) if counted != period_s => Ok(self.load_at(&sources, own, Some(period_s))?.0),
            _ => Ok(config),
        }
    }

    /// With the blocks of robots counted at a sample period, or at that of their files; also which
    /// one that was, if blocks were counted.
    fn load_at(
        &self,
        sources: &[Source],
        own: &[(&str, Option<String>)],
        period_s: Option<f64>,
    ) -> Result<(Config, Option<f64>), Failure> {
        let (mut catalog, mut has_robot, mut counted_with_s) = (self.catalog.clone(), false, None);
        let mut all = Vec::with_capacity(sources.len());
        for source in sources {
            let robot = match source {
                Source::File(path) => super::robot::source(path, &catalog, &self.set, period_s)?,
                _ => None,
            };
            all.push(match robot {
                Some(robot) => {
                    (catalog, has_robot, counted_with_s) = (robot.catalog, true, robot.counted_with_s);
                    robot.source
                }
                None => source.clone(),
            });
        }
        if !has_robot {
            super::robot::refuse_overrides(&self.set)?;
        }
        let names = [
            ("bus.robot", quoted(self.robot.as_ref())),
            ("bus.domain", quoted(self.domain.as_ref())),
        ];
        let own = names.iter().chain(own).filter_map(|(key, value)| {
            let value = value.as_ref()?;
            let typed = format!("{} {}", option_of(key), value.trim_matches('"'));
            Some((typed, format!("{key}={value}")))
        });
        let options: Vec<(String, String)> = own.collect();
        // A robot's own keys have been laid over its file.
        let set = self.set.iter().filter(|one| !(has_robot && is_robot_override(one)));
        let arguments: Vec<String> = set.cloned().collect();
        Ok((Config::load_with(&catalog, &all, &arguments, &options)?, counted_with_s))
    }
}

/// The option that stands for a key, for messages.
fn option_of(key: &str) -> &str {
    match key {
        "bus.robot" => "--robot",
        "bus.domain" => "--domain",
        "monitor.out_dir" => "--out",
        "plant.speed" => "--speed",
        "plant.duration_s" => "--duration",
        "plant.seed" => "--seed",
        other => other,
    }
}

/// A string as the configuration's loader reads it, whatever is in it.
pub(super) fn quoted(value: Option<impl Into<String>>) -> Option<String> {
    value.map(|value| toml::Value::String(value.into()).to_string())
}

/// The domain of a configuration.
pub(super) fn domain(config: &Config) -> Result<Domain, Failure> {
    if let Some(words) = Domain::warning() {
        tracing::warn!("{words}");
    }
    Ok(Domain::new(&config.bus.domain)?.with_limits(Limits {
        sample_buffer: config.bus.sample_buffer,
        sample_subscribers: config.bus.max_sample_subscribers,
        estimate_subscribers: config.bus.max_estimate_subscribers,
        programs: config.bus.max_programs,
    }))
}

/// Form of a result table on standard output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TableFormat {
    /// Columns for people.
    #[default]
    Text,
    /// One JSON object.
    Json,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_wrong_option_is_reported_as_it_was_typed() {
        let own = |key, value: &str| [(key, Some(value.to_owned()))];
        for (key, value, said) in [
            ("plant.speed", "fast", "--speed fast: plant.speed: expected"),
            ("plant.duration_s", "nan", "--duration nan: plant.duration_s: expected"),
            ("plant.seed", "-1", "--seed -1: plant.seed: expected"),
        ] {
            let error = CommonArgs::default().load(Vec::new(), &own(key, value));
            let error = error.map(|_| ()).expect_err(key).to_string();
            assert!(error.starts_with(said), "{error}");
        }
        let named = CommonArgs {
            domain: Some("a/b".to_owned()),
            ..CommonArgs::default()
        };
        let error = named
            .load(Vec::new(), &[])
            .map(|_| ())
            .expect_err("no name")
            .to_string();
        assert!(error.starts_with("--domain a/b: bus.domain: expected"), "{error}");
        // An option overrides --set, and a shortened run is not warned of.
        let both = CommonArgs {
            set: vec!["plant.duration_s=90".to_owned()],
            ..CommonArgs::default()
        };
        let config = both.load(Vec::new(), &own("plant.duration_s", "30")).expect("valid");
        assert_eq!(config.plant.sim.duration_s, 30.0);
        assert!(config.warnings().is_empty(), "{:?}", config.warnings());
    }
}
