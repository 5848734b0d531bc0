//! The launcher and the tools.
//!
//! ```text
//! run ─┬─ plant ── sample ──▶ identifier ── estimate ──▶ monitor ─▶ result table, files
//!      └─ one signal, one result
//! ```
//!
//! The three roles are this same program, so that `cargo run` has everything that it needs.
#![forbid(unsafe_code)]

use clap::{Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use thetabus::service::{
    self, CommonArgs, CtlArgs, DoctorArgs, EXIT_CODES, ExportArgs, IdentifierArgs, IdentifyArgs, MonitorArgs,
    PlantArgs, ReplayArgs, ReportArgs, RunArgs, VERSION,
};

/// On-line identification of a running machine's physical parameters
#[derive(Parser)]
#[command(name = "thetabus", version = VERSION.as_str(), after_help = EXIT_CODES, propagate_version = true)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run plant, identifier and monitor, then print the result beside the truth
    #[command(after_help = EXIT_CODES)]
    Run(RunArgs),
    /// Identify off line from a recording or a log
    #[command(after_help = EXIT_CODES)]
    Identify(IdentifyArgs),
    /// Publish a recording's samples again; identifier and monitor follow as ever
    #[command(after_help = EXIT_CODES)]
    Replay(ReplayArgs),
    /// Make figures and a page of a run that was recorded
    #[command(after_help = EXIT_CODES)]
    Report(ReportArgs),
    /// Write a recording's samples as CSV, units in the header; `identify` reads it back to the same bits
    #[command(after_help = EXIT_CODES)]
    Export(ExportArgs),
    /// Pause, resume, reset, tune, fix, free, save or describe a running identifier
    #[command(after_help = EXIT_CODES)]
    Ctl(CtlArgs),
    /// Show what is on the bus: domains, programs, services, locks, memory
    #[command(after_help = EXIT_CODES)]
    Doctor(DoctorArgs),
    /// Tools for configuration files
    #[command(subcommand)]
    Config(ConfigCommand),
    /// The simulated machine, as plant_simulator
    #[command(hide = true)]
    Plant(PlantArgs),
    /// The identification service, as identifier
    #[command(hide = true)]
    Identifier(IdentifierArgs),
    /// The monitor, as monitor
    #[command(hide = true)]
    Monitor(MonitorArgs),
}

#[derive(Subcommand)]
enum ConfigCommand {
    /// Check a configuration file and tell everything that is wrong or suspicious
    #[command(after_help = EXIT_CODES)]
    Check {
        /// The file
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Override a key, as the programs do; repeatable
        #[arg(long, value_name = "SECTION.KEY=VALUE")]
        set: Vec<String>,
    },
}

fn main() -> ExitCode {
    match Program::parse().command {
        Command::Run(args) => service::main_with(&args.plant.common, |shutdown| service::launch(&args, shutdown)),
        Command::Identify(args) => service::main_with(&args.common, |shutdown| service::identify(&args, shutdown)),
        Command::Replay(args) => service::main_with(&args.common, |shutdown| service::replay(&args, shutdown)),
        Command::Report(args) => {
            service::main_with(&CommonArgs::with_logs(args.log_format), |_| service::report(&args))
        }
        Command::Export(args) => {
            service::main_with(&CommonArgs::with_logs(args.log_format), |_| service::export(&args))
        }
        Command::Ctl(args) => service::main_with(&CommonArgs::with_logs(args.log_format), |_| service::ctl(&args)),
        Command::Doctor(args) => {
            service::main_with(&CommonArgs::with_logs(args.log_format), |_| service::doctor(&args))
        }
        Command::Config(ConfigCommand::Check { file, set }) => {
            service::main_with(&CommonArgs::default(), |_| service::config_check(&file, &set))
        }
        Command::Plant(args) => service::main_with(&args.common, |shutdown| service::plant(&args, shutdown)),
        Command::Identifier(args) => service::main_with(&args.common, |shutdown| service::identifier(&args, shutdown)),
        Command::Monitor(args) => service::main_with(&args.common, |shutdown| service::monitor(&args, shutdown)),
    }
}
