//! Shows and keeps the estimates.
//!
//! ```text
//! topics `estimate`, `status` ─▶ a readable line each, estimates.csv, summary.json
//! ```
#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;
use thetabus::service::{self, EXIT_CODES, MonitorArgs, VERSION};

/// Shows each estimate of a machine's parameters and keeps them
#[derive(Parser)]
#[command(name = "monitor", version = VERSION.as_str(), after_help = EXIT_CODES)]
struct Program {
    #[command(flatten)]
    args: MonitorArgs,
}

fn main() -> ExitCode {
    let Program { args } = Program::parse();
    service::main_with(&args.common, |shutdown| service::monitor(&args, shutdown))
}
