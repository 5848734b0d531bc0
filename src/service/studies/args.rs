//! Command lines of the studies.

use crate::service::{CommonArgs, TableFormat};
use clap::Args;
use std::path::PathBuf;

/// `studies compare`.
#[derive(Debug, Clone, Args)]
pub struct CompareArgs {
    /// Configuration file of the run to compare estimators on
    #[arg(value_name = "CONFIG")]
    pub file: PathBuf,
    /// The paper's recursion in its variants, instead of all estimators and the studies of this one
    #[arg(long)]
    pub paper: bool,
    /// Runs with other seeds, for medians
    #[arg(long, value_name = "COUNT", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Recording of the EMPS rig as CSV with the columns q_m and voltage_v, for the table of a real
    /// machine in the results
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,
    /// File to write the tables to; standard output without it
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Form of the tables; text is Markdown
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `studies trials`.
#[derive(Debug, Clone, Args)]
pub struct TrialsArgs {
    /// Few cases with two seeds each, in minutes
    #[arg(long)]
    pub quick: bool,
    /// Only cases with all of these words, such as minimum_jerk,16bit; repeatable, any of them then
    #[arg(long, value_name = "WORDS")]
    pub only: Vec<String>,
    /// Seeds per case; 8, or 2 with --quick
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: Option<u64>,
    /// First of the seeds
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=1_000_000))]
    pub first_seed: u64,
    /// Blocks per run, instead of the case's own number
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(4..=100_000))]
    pub blocks: Option<u64>,
    /// States and parameters of each run
    #[arg(long)]
    pub details: bool,
    /// Print the settings of each case, for a run by hand, instead of running it
    #[arg(long)]
    pub show: bool,
    /// File to write the tables to
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `studies robots`.
#[derive(Debug, Clone, Args)]
pub struct RobotsArgs {
    /// Machines and motions to try
    #[arg(long, value_name = "COUNT", default_value_t = 40, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// First of the seeds
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=1_000_000))]
    pub first_seed: u64,
    /// What was found in each run
    #[arg(long)]
    pub details: bool,
    /// File to write the tables to; standard output without it
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `studies track`.
#[derive(Debug, Clone, Args)]
pub struct TrackArgs {
    /// Configuration files with smooth setpoints and a change of the machine, such as
    /// config/adaptive.toml
    #[arg(value_name = "CONFIG", required = true)]
    pub files: Vec<PathBuf>,
    /// Runs with other seeds
    #[arg(long, value_name = "COUNT", default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Tables as Markdown; standard output without it
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Tracking error over time as SVG, of the first seed
    #[arg(long, value_name = "FILE")]
    pub figure: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// `studies efficiency`.
#[derive(Debug, Clone, Args)]
pub struct EfficiencyArgs {
    /// Seeds per case
    #[arg(long, value_name = "COUNT", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Only cases with this in their name, such as "minimum_jerk, 16 bit" or "six-axis";
    /// repeatable, any of them then
    #[arg(long, value_name = "WORDS")]
    pub only: Vec<String>,
    /// File to write the tables to
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}
