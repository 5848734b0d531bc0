//! Command lines of the tools for robots from a URDF.

use super::{CommonArgs, LogFormat, TableFormat};
use clap::Args;
use std::path::PathBuf;

/// `thetabus excite`.
#[derive(Debug, Clone, Args)]
pub struct ExciteArgs {
    /// Configuration of the robot: [model] kind = "robot"
    #[arg(value_name = "ROBOT.toml")]
    pub config: PathBuf,
    /// Length of one period, which begins and ends at rest (key excite.duration_s)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration: Option<f64>,
    /// Number of harmonics (key excite.harmonics)
    #[arg(long, value_name = "N")]
    pub harmonics: Option<usize>,
    /// Number of motions that are tried (key excite.tries)
    #[arg(long, value_name = "N")]
    pub tries: Option<usize>,
    /// Seed of what is tried (key excite.seed)
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Result of an earlier identification, whose misfit of each joint is expected again; without it, the noise of the simulated robot
    #[arg(long, value_name = "DIR|summary.json")]
    pub residuals: Option<PathBuf>,
    /// Points per second of the file
    #[arg(long, value_name = "HZ", default_value_t = 100.0, allow_negative_numbers = true)]
    pub rate: f64,
    /// File for the motion, which must not exist
    #[arg(long, value_name = "MOTION.csv")]
    pub out: Option<PathBuf>,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Form of the logs on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus urdf`.
#[derive(Debug, Clone, Args)]
pub struct UrdfArgs {
    /// Checkpoint, directory of results or recording of a robot from a URDF
    #[arg(value_name = "CHECKPOINT|DIR|RECORDING")]
    pub input: PathBuf,
    /// File for the URDF, which must not exist
    #[arg(long, value_name = "FILE.urdf")]
    pub out: PathBuf,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}
