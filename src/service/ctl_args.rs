//! Command line of `thetabus ctl`.

use super::args::{LogFormat, TableFormat};
use clap::Args;
use std::path::PathBuf;

/// `thetabus ctl`.
#[derive(Debug, Clone, Args)]
pub struct CtlArgs {
    /// Command to the identifier; it takes effect at the next border between two blocks
    #[command(subcommand)]
    pub command: CtlCommand,
    /// How long to wait for an answer, in seconds
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
    /// Log format on standard error; RUST_LOG chooses what is logged
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// What an identifier can be told.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum CtlCommand {
    /// Use no more samples; the estimate stays
    Pause,
    /// Continue after a pause
    Resume,
    /// Begin again with the start values; tunables stay
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
    /// Estimate a held parameter again
    Free {
        /// Name of the parameter
        #[arg(value_name = "PARAMETER")]
        parameter: String,
    },
    /// Declare the robot's payload instead of estimating it: none, or a known load
    Payload {
        /// The flange is empty
        #[arg(value_name = "none", value_parser = ["none"], conflicts_with_all = ["mass", "com", "inertia"])]
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
        /// Its inertia about the centre of mass, in kg m^2; without it, that of a ball of light
        /// metal
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
    /// List parameters, tunables and signals with their units and bounds
    Describe,
}
