//! The identification service.
//!
//! ```text
//! topic `sample` ─▶ rows ─▶ blocks ─▶ estimator ─▶ topics `estimate`, `status`
//! ```
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;
use thetabus::service::{self, EXIT_CODES, IdentifierArgs, VERSION};

/// Identifies a machine's physical parameters from its samples, live
#[derive(Parser)]
#[command(name = "identifier", version = VERSION.as_str(), after_help = EXIT_CODES)]
struct Program {
    #[command(flatten)]
    args: IdentifierArgs,
}

fn main() -> ExitCode {
    let Program { args } = Program::parse();
    service::main_with(&args.common, |shutdown| service::identifier(&args, shutdown))
}
