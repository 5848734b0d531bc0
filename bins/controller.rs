//! A controller that uses estimates.
//!
//! ```text
//! topic `estimate` ─▶ θ that may be used ─┐
//! topic `sample` ─▶ where the machine is ─┴▶ feed-forward ─▶ topic `command`
//! ```
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;
use thetabus::service::{self, ControllerArgs, EXIT_CODES, VERSION};

/// Follows a trajectory with feed-forward from estimated parameters
#[derive(Parser)]
#[command(name = "controller", version = VERSION.as_str(), after_help = EXIT_CODES)]
struct Program {
    #[command(flatten)]
    args: ControllerArgs,
}

fn main() -> ExitCode {
    let Program { args } = Program::parse();
    service::main_with(&args.common, |shutdown| service::controller(&args, shutdown))
}
