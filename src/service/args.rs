//! Command lines. What overrides the configuration becomes an argument of its loader, so that one place checks everything.

use super::{Failure, cell};
use crate::bus::{Domain, ICEORYX2_VERSION, Limits};
use crate::config::{Catalog, Config, Source};
use crate::live::Screen;
use crate::messages::SCHEMA_VERSION;
use crate::recording::Span;
use crate::runner::Stay;
use clap::{Args, ValueEnum};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// What `--version` says: crate, schema, iceoryx2.
pub static VERSION: LazyLock<String> = LazyLock::new(|| {
    format!(
        "{} (message schema {SCHEMA_VERSION}, iceoryx2 {ICEORYX2_VERSION})",
        env!("CARGO_PKG_VERSION")
    )
});

/// The configuration that every program takes if no file is named; what a program with models of its own lays below is `own_plant`.
pub(super) const BUILT_IN: &str = "encoder_only";

/// Form of the logs on standard error.
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
    /// Configuration file; repeated, later files win key by key. Without one config/encoder_only.toml, which is built in
    #[arg(long, value_name = "FILE")]
    pub config: Vec<PathBuf>,
    /// Override a key of the configuration, e.g. --set estimator.block_len=950; repeatable
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
    /// Name of the machine; its topics are thetabus/NAME/… (key bus.robot)
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Keeps whole runs apart; programs that belong together name the same (key bus.domain)
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
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

    /// The configuration: built-in defaults, `sources`, the files, `--set`, then what the command line says with words of its own. With
    /// neither sources nor files it is [`BUILT_IN`], so that programs which are started one by one mean the same as `thetabus run`.
    pub(super) fn load(&self, sources: Vec<Source>, own: &[(&str, Option<String>)]) -> Result<Config, Failure> {
        let config = self.load_quietly(sources, own)?;
        self.warn(&config);
        Ok(config)
    }

    /// The configurations of all robots that this process is for: those of the `[[robot]]` entries, or the one of files without any.
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
        let mut catalog = self.catalog.clone();
        let mut all: Vec<Source> = basis.into_iter().collect();
        let files = cell::sources(&self.config, self.robot.as_deref())?;
        for source in sources.into_iter().chain(files) {
            let robot = match &source {
                Source::File(path) => super::robot::source(path, &catalog)?,
                _ => None,
            };
            all.push(match robot {
                Some((with_robot, own)) => {
                    catalog = with_robot;
                    own
                }
                None => source,
            });
        }
        let sources = all;
        let names = [
            ("bus.robot", quoted(self.robot.as_ref())),
            ("bus.domain", quoted(self.domain.as_ref())),
        ];
        let own = names
            .iter()
            .chain(own)
            .filter_map(|(key, value)| value.as_ref().map(|value| format!("{key}={value}")));
        let arguments: Vec<String> = self.set.iter().cloned().chain(own).collect();
        Ok(Config::load_for(&catalog, &sources, &arguments)?)
    }
}

/// A string as the configuration's loader reads it, whatever is in it.
pub(super) fn quoted(value: Option<impl Into<String>>) -> Option<String> {
    value.map(|value| toml::Value::String(value.into()).to_string())
}

/// The domain of a configuration.
pub(super) fn domain(config: &Config) -> Result<Domain, Failure> {
    Ok(Domain::new(&config.bus.domain)?.with_limits(Limits {
        sample_buffer: config.bus.sample_buffer,
        sample_subscribers: config.bus.max_sample_subscribers,
        estimate_subscribers: config.bus.max_estimate_subscribers,
        programs: config.bus.max_programs,
    }))
}

/// `plant_simulator`.
#[derive(Debug, Clone, Default, Args)]
pub struct PlantArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Simulated seconds per second, or max (key plant.speed)
    #[arg(long, value_name = "X|max", allow_negative_numbers = true)]
    pub speed: Option<String>,
    /// Length of the run in simulated seconds (key plant.duration_s)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration: Option<String>,
    /// Seed of everything random (key plant.seed)
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<String>,
}

impl PlantArgs {
    pub(super) fn overrides(&self) -> [(&'static str, Option<String>); 3] {
        [
            ("plant.speed", self.speed.clone()),
            ("plant.duration_s", self.duration.clone()),
            ("plant.seed", self.seed.clone()),
        ]
    }
}

/// `identifier`.
#[derive(Debug, Clone, Default, Args)]
pub struct IdentifierArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Go on from the checkpoint in checkpoint.dir where there is one that fits
    #[arg(long)]
    pub warm: bool,
}

/// `controller`.
#[derive(Debug, Clone, Default, Args)]
pub struct ControllerArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `thetabus ctl`.
#[derive(Debug, Clone, Args)]
pub struct CtlArgs {
    /// What the identifier shall do; it takes effect at the next border between two blocks
    #[command(subcommand)]
    pub command: CtlCommand,
    /// How long to wait for an answer
    #[arg(
        long,
        global = true,
        value_name = "S",
        default_value_t = 3.0,
        allow_negative_numbers = true
    )]
    pub timeout: f64,
    /// Form of the answer on standard output
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Configuration file that names robot and domain; repeated, later files win key by key
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Vec<PathBuf>,
    /// Name of the machine (key bus.robot)
    #[arg(long, global = true, value_name = "NAME")]
    pub robot: Option<String>,
    /// Domain that the identifier runs in (key bus.domain)
    #[arg(long, global = true, value_name = "NAME")]
    pub domain: Option<String>,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// What an identifier can be told.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum CtlCommand {
    /// Take no more samples in; the estimate stays
    Pause,
    /// Go on after a pause
    Resume,
    /// Back to the start values; tunables stay
    Reset,
    /// Set a tunable, e.g. set forgetting_factor=0.98; `describe` lists them
    Set {
        /// Tunable and value
        #[arg(value_name = "KEY=VALUE")]
        assignment: String,
    },
    /// Hold a parameter, at a value or at its estimate
    Fix {
        /// Name of the parameter
        #[arg(value_name = "PARAMETER")]
        parameter: String,
        /// Value, in the parameter's unit
        #[arg(value_name = "VALUE", allow_negative_numbers = true)]
        value: Option<f64>,
    },
    /// Estimate a parameter that was held
    Free {
        /// Name of the parameter
        #[arg(value_name = "PARAMETER")]
        parameter: String,
    },
    /// Say what a robot's flange carries instead of finding it: nothing, or a known load
    Payload {
        /// The flange is empty
        #[arg(value_name = "none", value_parser = ["none"], conflicts_with_all = ["mass", "com", "inertia"], required_unless_present = "mass")]
        none: Option<String>,
        /// Mass of the load in kg
        #[arg(long, value_name = "KG", allow_negative_numbers = true)]
        mass: Option<f64>,
        /// Its centre of mass in the flange's frame, in m
        #[arg(
            long,
            value_name = "X,Y,Z",
            value_delimiter = ',',
            requires = "mass",
            allow_negative_numbers = true
        )]
        com: Option<Vec<f64>>,
        /// Its inertia about the centre of mass, in kg m^2; without it, that of a ball of light metal
        #[arg(
            long,
            value_name = "XX,XY,YY,XZ,YZ,ZZ",
            value_delimiter = ',',
            requires = "mass",
            allow_negative_numbers = true
        )]
        inertia: Option<Vec<f64>>,
    },
    /// Write a checkpoint now
    Save,
    /// Tell parameters, tunables and signals with their units and bounds
    Describe,
}

/// The page in a browser.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct WebArgs {
    /// Show it live as a page in a browser, on this machine only unless another address is named; port 0 for any that is free
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8080")]
    pub web: Option<SocketAddr>,
    /// Let the page pause, resume, reset, fix and free, for whoever knows the token in the address that is printed
    #[arg(long, requires = "web")]
    pub web_control: bool,
    /// Stream samples, estimates and status to Foxglove or Lichtblick, ws://ADDRESS:PORT; the protocol has no token, so only on this machine
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765")]
    pub foxglove: Option<SocketAddr>,
    /// Stream to Foxglove on an address of the network, too: whoever reaches it reads along
    #[cfg(feature = "foxglove")]
    #[arg(long, requires = "foxglove")]
    pub foxglove_open: bool,
}

impl WebArgs {
    /// Whether anything here shows samples.
    pub(super) fn takes_samples(&self) -> bool {
        #[cfg(feature = "foxglove")]
        if self.foxglove.is_some() {
            return true;
        }
        self.web.is_some()
    }

    /// Refuses what would be open to all of a network unless that is meant.
    #[cfg(feature = "foxglove")]
    pub(super) fn check(&self) -> Result<(), Failure> {
        match self.foxglove {
            Some(address) if !address.ip().is_loopback() && !self.foxglove_open => Err(Failure::Usage(format!(
                "--foxglove {address}: expected an address of this machine alone, such as 127.0.0.1:{port}: the protocol has no token, so whoever \
                 reaches {address} would read along; from elsewhere use ssh -L {port}:127.0.0.1:{port} HOST, or add --foxglove-open if all \
                 of the network may",
                port = address.port()
            ))),
            _ => Ok(()),
        }
    }
}

/// `thetabus watch`.
#[derive(Debug, Clone, Default, Args)]
pub struct WatchArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

impl WatchArgs {
    /// What logging may say while the terminal is drawn on.
    pub fn logs(&self) -> CommonArgs {
        CommonArgs {
            draws: Screen::is_possible(),
            ..self.common.clone()
        }
    }
}

/// `monitor`.
#[derive(Debug, Clone, Default, Args)]
pub struct MonitorArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Directory for estimates.csv and summary.json, new or empty (key monitor.out_dir)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Record samples, estimates and status as MCAP; the file must not exist
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub web: WebArgs,
    /// Form of the result table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
}

/// `thetabus run`.
#[derive(Debug, Clone, Default, Args)]
pub struct RunArgs {
    /// Configuration file; without one config/encoder_only.toml, which is built in
    #[arg(value_name = "CONFIG")]
    pub file: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub plant: PlantArgs,
    /// Directory for the results, new or empty; thetabus-out/TIME without it (key monitor.out_dir)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Make no recording, and so no report
    #[arg(long)]
    pub no_record: bool,
    /// The identifier goes on from the checkpoint in checkpoint.dir where there is one that fits
    #[arg(long)]
    pub warm: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub web: WebArgs,
    /// Form of the result table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
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

/// A part of a recording.
#[derive(Debug, Clone, Default, Args)]
pub struct SpanArgs {
    /// Leave out what came before this stream time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Leave out what came after this stream time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to: Option<f64>,
}

impl SpanArgs {
    pub(super) fn span(&self) -> Result<Span, Failure> {
        let all = Span::default();
        let nanoseconds = |name: &str, time: Option<f64>, default: u64| match time {
            None => Ok(default),
            Some(t_s) if (0.0..1e10).contains(&t_s) => Ok((t_s * 1e9).round() as u64),
            Some(t_s) => Err(Failure::Usage(format!(
                "--{name}: expected seconds of stream time, 0 or more, got {t_s}"
            ))),
        };
        let span = Span {
            from_ns: nanoseconds("from", self.from, all.from_ns)?,
            to_ns: nanoseconds("to", self.to, all.to_ns)?,
        };
        if span.from_ns > span.to_ns {
            return Err(Failure::Usage("--from lies behind --to".to_owned()));
        }
        Ok(span)
    }

    /// True where only a part is asked for.
    pub(super) fn is_cut(&self) -> bool {
        self.from.is_some() || self.to.is_some()
    }

    /// What to say where a file holds no samples, or none in this part.
    pub(super) fn nothing(&self, input: &Path) -> Failure {
        let what = match (self.from, self.to) {
            (None, None) => "holds no samples".to_owned(),
            (Some(from), None) => format!("holds no samples from {from} s on (--from)"),
            (None, Some(to)) => format!("holds no samples up to {to} s (--to)"),
            (Some(from), Some(to)) => format!("holds no samples from {from} s to {to} s (--from, --to)"),
        };
        Failure::Usage(format!("{} {what}", input.display()))
    }
}

/// `thetabus doctor`.
#[derive(Debug, Clone, Args)]
pub struct DoctorArgs {
    /// Look at this domain only, instead of all of this user
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Remove what is dead and only that
    #[arg(long)]
    pub clean: bool,
    /// Print what iceoryx2's own tools need to see the domain: put it into config/iceoryx2.toml and start `iox2` beside
    #[arg(long, requires = "domain", conflicts_with = "clean")]
    pub iox2: bool,
    /// Form of the report on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus report`.
#[derive(Debug, Clone, Args)]
pub struct ReportArgs {
    /// Directory of results, or recording
    #[arg(value_name = "DIR|RECORDING")]
    pub input: PathBuf,
    /// Directory for the report, new or empty; without it, the directory itself, or RECORDING's name with .report
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus export`.
#[derive(Debug, Clone, Args)]
pub struct ExportArgs {
    /// Directory of results, or recording
    #[arg(value_name = "DIR|RECORDING")]
    pub input: PathBuf,
    /// File for the samples, which must not exist; standard output without it
    #[arg(long, value_name = "FILE.csv")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus identify`.
#[derive(Debug, Clone, Args)]
pub struct IdentifyArgs {
    /// Directory of results or recording, whose own configuration holds where --config and --set say nothing, or log with columns as section log names them
    #[arg(value_name = "DIR|RECORDING|LOG.csv")]
    pub input: PathBuf,
    /// Directory for estimates.csv, summary.json and the report, new or empty; none are written without it
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    /// Log that is predicted and not learnt, for a robot from a URDF
    #[arg(long, value_name = "LOG.csv")]
    pub validate: Option<PathBuf>,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Go on from the checkpoint in checkpoint.dir where there is one that fits; a recording repeats its own warm start anyway
    #[arg(long)]
    pub warm: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `thetabus replay`.
#[derive(Debug, Clone, Args)]
pub struct ReplayArgs {
    /// Directory of results, or recording
    #[arg(value_name = "DIR|RECORDING")]
    pub input: PathBuf,
    /// Recorded seconds per second, or max
    #[arg(long, value_name = "X|max", default_value = "max", allow_negative_numbers = true)]
    pub speed: String,
    /// Keep what the identifier learns from it for the stream that comes next
    #[arg(long)]
    pub teach: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}
