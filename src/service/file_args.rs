//! Command lines of what works on files, and of `doctor`.

use super::Failure;
use super::args::{CommonArgs, LogFormat, TableFormat};
use crate::recording::Span;
use clap::Args;
use std::path::{Path, PathBuf};

/// A part of a recording.
#[derive(Debug, Clone, Default, Args)]
pub struct SpanArgs {
    /// Leave out what was sampled before this stream time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Leave out what was sampled after this stream time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to: Option<f64>,
}

impl SpanArgs {
    pub(super) fn span(&self) -> Result<Span, Failure> {
        let all = Span::default();
        let nanoseconds = |name: &str, time: Option<f64>, default: u64| match time {
            None => Ok(default),
            Some(t_s) if (0.0..1e10).contains(&t_s) => Ok(crate::messages::nanoseconds(t_s)),
            Some(t_s) => Err(Failure::Usage(format!(
                "--{name}: expected seconds of stream time, 0 or more, got {t_s}"
            ))),
        };
        let span = Span {
            from_ns: nanoseconds("from", self.from, all.from_ns)?,
            to_ns: nanoseconds("to", self.to, all.to_ns)?,
        };
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from > to
        {
            return Err(Failure::Usage(format!(
                "--from {from}: expected a time up to that of --to, {to}, got a later one"
            )));
        }
        Ok(span)
    }

    /// True if only a part is asked for.
    pub(super) fn is_cut(&self) -> bool {
        self.from.is_some() || self.to.is_some()
    }

    /// What to say if a file holds no samples, or none in this part.
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
    /// Look at this domain only; without it, at all domains of this user
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Remove resources of dead processes; resources in use are kept
    #[arg(long)]
    pub clean: bool,
    /// Print the configuration with which iceoryx2's own tools see the domain: write it to
    /// config/iceoryx2.toml and start `iox2` in the directory that holds config
    #[arg(long, requires = "domain", conflicts_with = "clean")]
    pub iox2: bool,
    /// Form of the report on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus report`.
#[derive(Debug, Clone, Args)]
pub struct ReportArgs {
    /// Directory of results, or recording
    #[arg(value_name = "DIR|RECORDING")]
    pub input: PathBuf,
    /// Directory for the report, new or empty; without it, the directory itself, or RECORDING's
    /// name with .report
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Log format on standard error; RUST_LOG chooses what is logged
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
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus identify`.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("config", |arg| arg.help("Configuration file; repeatable, later files override earlier ones, and the recording's own configuration, key by key. Default for a log: config/encoder_only.toml, built in")))]
pub struct IdentifyArgs {
    /// Directory of results, recording, or log. A recording has its own configuration, which
    /// --config and --set override key by key; section log names the columns of a log
    #[arg(value_name = "DIR|RECORDING|LOG.csv")]
    pub input: PathBuf,
    /// Directory for estimates.csv, summary.json and the report, new or empty; none are written
    /// without it
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
    /// Go on from the checkpoint in checkpoint.dir if there is one that fits; a recording
    /// repeats its own warm start anyway
    #[arg(long)]
    pub warm: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `thetabus replay`.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("config", |arg| arg.help("Configuration file; repeatable, later files override earlier ones, and the recording's own configuration, key by key")))]
pub struct ReplayArgs {
    /// Directory of results, or recording
    #[arg(value_name = "DIR|RECORDING")]
    pub input: PathBuf,
    /// Recorded seconds per second, or max
    #[arg(long, value_name = "X|max", default_value = "max", allow_negative_numbers = true)]
    pub speed: String,
    /// Keep what was learned from the replay when the next stream begins
    #[arg(long)]
    pub teach: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub span: SpanArgs,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}
