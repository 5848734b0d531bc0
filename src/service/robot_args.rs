//! Command lines of the tools for robots from a URDF.

use super::{CommonArgs, LogFormat, TableFormat};
use clap::Args;
use std::path::PathBuf;

/// `thetabus excite`.
#[derive(Debug, Clone, Args)]
pub struct ExciteArgs {
    /// Configuration of the robot, with model.kind = "robot"
    #[arg(value_name = "ROBOT.toml")]
    pub config: PathBuf,
    /// Override a key of the configuration; repeatable
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
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
    /// Result of an earlier identification, whose misfit of each joint is expected again; without
    /// it, the noise that section simulate states
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
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// `thetabus urdf`.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("config", |arg| arg.help("Configuration of the robot; the directory of a run, and a recording in it, bring their own")))]
pub struct UrdfArgs {
    /// Checkpoint, directory of results, or recording of a robot from a URDF
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

/// `thetabus calibrate`.
#[derive(Debug, Clone, Args)]
pub struct CalibrateArgs {
    /// Log of a motion without load
    #[arg(value_name = "EMPTY.csv")]
    pub empty: PathBuf,
    /// Log of a motion with the load on the flange, on the same day
    #[arg(value_name = "LOADED.csv")]
    pub loaded: PathBuf,
    /// Configuration of the robot with the gains so far
    #[arg(long, value_name = "ROBOT.toml")]
    pub config: PathBuf,
    /// Override a key of the configuration; repeatable
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
    /// Mass of the load in kg
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    pub mass: f64,
    /// Its centre of mass in the flange's frame, in m, if it is known
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', allow_negative_numbers = true)]
    pub com: Option<Vec<f64>>,
    /// Its inertia about the centre of mass, in kg m^2, if it is known
    #[arg(
        long,
        value_name = "XX,XY,YY,XZ,YZ,ZZ",
        value_delimiter = ',',
        requires = "com",
        allow_negative_numbers = true
    )]
    pub inertia: Option<Vec<f64>>,
    /// Form of the table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}
