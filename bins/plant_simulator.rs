//! A simulated machine on the bus.
//!
//! ```text
//! configuration ─▶ arm, motors, controllers ─▶ samples ─▶ topic `sample`
//! ```
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;
use thetabus::service::{self, EXIT_CODES, PlantArgs, VERSION};

/// Simulates the configured machine and publishes its samples
#[derive(Parser)]
#[command(name = "plant_simulator", version = VERSION.as_str(), after_help = EXIT_CODES)]
struct Program {
    #[command(flatten)]
    args: PlantArgs,
}

fn main() -> ExitCode {
    let Program { args } = Program::parse();
    service::main_with(&args.common, |shutdown| service::plant(&args, shutdown))
}
