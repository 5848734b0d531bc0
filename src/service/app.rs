//! The whole command line, for the models of this library and for those of a user's program.
//!
//! ```text
//! run ─┬─ plant ── sample ──▶ identifier ── estimate ──▶ monitor ─▶ result table, files
//!      └─ one signal, one result
//! ```
//!
//! All three roles are the same program, so `run` has everything that it needs, including a user's
//! own model.

use super::args::BUILT_IN;
use super::{
    BenchArgs, CalibrateArgs, CommonArgs, ControllerArgs, CtlArgs, DoctorArgs, EXIT_CODES, ExciteArgs, ExportArgs,
    IdentifierArgs, IdentifyArgs, LogFormat, MonitorArgs, PlantArgs, ReplayArgs, ReportArgs, RunArgs, UrdfArgs,
    VERSION, WatchArgs, main_with,
};
use crate::config::Catalog;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

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
    /// Watch a running identification as a table on the terminal
    #[command(after_help = EXIT_CODES)]
    Watch(WatchArgs),
    /// Identify off line from a recording or a log
    #[command(after_help = EXIT_CODES)]
    Identify(IdentifyArgs),
    /// Design a motion for the identification of a robot, and predict how well each parameter will
    /// be known
    #[command(after_help = EXIT_CODES)]
    Excite(ExciteArgs),
    /// Find the gains of a robot's drives from logs without load and with a known one
    #[command(after_help = EXIT_CODES)]
    Calibrate(CalibrateArgs),
    /// Write the URDF of a robot with what was identified of it
    #[command(after_help = EXIT_CODES)]
    Urdf(UrdfArgs),
    /// Publish a recording's samples again; identifier and monitor take them as those of a plant
    #[command(after_help = EXIT_CODES)]
    Replay(ReplayArgs),
    /// Make figures and a page of a run that was recorded
    #[command(after_help = EXIT_CODES)]
    Report(ReportArgs),
    /// Write a recording's samples as CSV, units in the header; `identify` reads them back bit for
    /// bit
    #[command(after_help = EXIT_CODES)]
    Export(ExportArgs),
    /// Command a running identifier: pause, resume, reset, set, fix, free, payload, save, describe
    #[command(after_help = EXIT_CODES)]
    Ctl(CtlArgs),
    /// Show what is on the bus: domains, programs, services, locks, memory
    #[command(after_help = EXIT_CODES)]
    Doctor(DoctorArgs),
    /// Measure latencies of the bus and the identifier on this machine
    #[command(after_help = EXIT_CODES)]
    Bench(BenchArgs),
    /// Tools for configuration files
    #[command(subcommand)]
    Config(ConfigCommand),
    /// Print what a shell needs to complete this program's command line
    #[command(after_help = EXIT_CODES)]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page
    #[command(after_help = EXIT_CODES)]
    Man,
    /// Publish the samples of a simulated machine on the bus
    #[command(after_help = EXIT_CODES)]
    Plant(PlantArgs),
    /// Publish the samples of all robots of a file on the bus, simulated in real time
    #[command(after_help = EXIT_CODES, mut_arg("config", |arg| arg.help("File with [[robot]] entries, or of one robot; it must state a speed (plant.speed = 1); repeatable, later files override earlier ones key by key")))]
    Load(PlantArgs),
    /// The identification service on its own: samples from the bus in, estimates out
    #[command(after_help = EXIT_CODES)]
    Identifier(IdentifierArgs),
    /// The controller on its own: feed-forward from estimates onto the bus
    #[command(after_help = EXIT_CODES)]
    Controller(ControllerArgs),
    /// The monitor on its own: logs and stores the estimates
    #[command(after_help = EXIT_CODES)]
    Monitor(MonitorArgs),
}

#[derive(Subcommand)]
enum ConfigCommand {
    /// Check a configuration file and report errors and suspicious settings
    #[command(after_help = EXIT_CODES)]
    Check {
        /// The file
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Override a key, as the programs do; repeatable
        #[arg(long, value_name = "SECTION.KEY=VALUE")]
        set: Vec<String>,
        /// Report which parameters of a robot can be identified from this motion: a file of
        /// `thetabus excite`, or a log
        #[arg(long, value_name = "MOTION.csv")]
        motion: Option<PathBuf>,
        /// Result of an identification, whose misfit is expected with --motion
        #[arg(long, value_name = "DIR|summary.json", requires = "motion")]
        residuals: Option<PathBuf>,
    },
    /// Print a built-in configuration, or list their names
    #[command(after_help = EXIT_CODES)]
    Show {
        /// Name, for example encoder_only; `default` prints every key. Without a name: list the
        /// names
        #[arg(value_name = "NAME")]
        name: Option<String>,
    },
    /// Write a built-in configuration to a file, to begin your own with; a robot's comes with its
    /// URDF
    #[command(after_help = EXIT_CODES)]
    New {
        /// The file, which must not exist; without it, NAME.toml in this directory
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
        /// The configuration to begin with
        #[arg(long, value_name = "NAME", default_value = BUILT_IN)]
        from: String,
    },
}

/// The whole `main` of a program: every command of `thetabus`, with the models of `catalog`.
///
/// ```no_run
/// # use thetabus::model::Manipulator as Pendulum;
/// use thetabus::config::Catalog;
///
/// fn main() -> std::process::ExitCode {
///     thetabus::service::app(Catalog::default().with(Pendulum::default()))
/// }
/// ```
///
/// A program with its own models uses the first of them by default, configured as in
/// `config/own_plant.toml`: rows from positions and inputs, so nothing else needs to be measured.
/// `run` simulates its equations, see section `[plant.model]`; for a real machine, start
/// `identifier` and `monitor` instead, and let the machine publish. Errors of usage end with exit
/// code 2 and the reason on standard error.
pub fn app(catalog: Catalog) -> ExitCode {
    let matches = Program::command().bin_name(program_name()).get_matches();
    let command = match Program::from_arg_matches(&matches) {
        Ok(program) => program.command,
        Err(error) => error.exit(),
    };
    command.execute(catalog)
}

/// Prints a text generated by another crate.
fn print(text: &[u8]) -> Result<super::Exit, super::Failure> {
    super::logging::result(String::from_utf8_lossy(text).trim_end())?;
    Ok(super::Exit::Done)
}

/// What the user typed to start this program.
fn program_name() -> String {
    let started_as = std::env::args_os().next().unwrap_or_default();
    let stem = Path::new(&started_as).file_stem().unwrap_or_default();
    match stem.to_string_lossy().into_owned() {
        name if name.is_empty() => "thetabus".to_owned(),
        name => name,
    }
}

impl Command {
    fn execute(self, catalog: Catalog) -> ExitCode {
        let tool = |log_format| CommonArgs::with_logs(log_format).with_models(catalog.clone());
        match self {
            Self::Run(mut args) => {
                args.plant.common.catalog = catalog;
                main_with(&args.plant.common, |shutdown| super::launch(&args, shutdown))
            }
            Self::Watch(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.logs(), |shutdown| super::watch(&args, shutdown))
            }
            Self::Identify(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::identify(&args, shutdown))
            }
            Self::Excite(args) => main_with(&tool(args.log_format), |shutdown| super::excite(&args, shutdown)),
            Self::Calibrate(args) => main_with(&tool(args.log_format), |_| super::calibrate(&args)),
            Self::Urdf(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |_| super::urdf(&args))
            }
            Self::Replay(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::replay(&args, shutdown))
            }
            Self::Report(args) => {
                let common = tool(args.log_format);
                main_with(&common, |_| super::report(&args, &common))
            }
            Self::Export(args) => main_with(&tool(args.log_format), |_| super::export(&args)),
            Self::Ctl(args) => {
                let common = tool(args.log_format);
                main_with(&common, |_| super::ctl(&args, &common))
            }
            Self::Doctor(args) => main_with(&tool(args.log_format), |_| super::doctor(&args)),
            Self::Bench(args) => main_with(&tool(args.log_format), |shutdown| super::bench(&args, shutdown)),
            Self::Config(command) => {
                let common = CommonArgs::default().with_models(catalog);
                main_with(&common, |_| match &command {
                    ConfigCommand::Check {
                        file,
                        set,
                        motion,
                        residuals,
                    } => {
                        let exit = super::config_check(file, set, &common)?;
                        let motion = motion.as_deref();
                        motion.map_or(Ok(()), |motion| {
                            super::check_motion(file, set, motion, residuals.as_deref())
                        })?;
                        Ok(exit)
                    }
                    ConfigCommand::Show { name } => super::config_show(name.as_deref()),
                    ConfigCommand::New { file, from } => super::config_new(file.as_deref(), from),
                })
            }
            Self::Completions { shell } => main_with(&tool(LogFormat::Text), |_| {
                // it panics if it cannot write
                let mut text = Vec::new();
                let mut line = without_hidden(&Program::command()).version(VERSION.as_str());
                clap_complete::generate(shell, &mut line, program_name(), &mut text);
                print(&text)
            }),
            Self::Man => main_with(&tool(LogFormat::Text), |_| {
                let mut page = Vec::new();
                clap_mangen::Man::new(Program::command())
                    .render(&mut page)
                    .map_err(|e| super::Failure::Failed(format!("cannot make the page: {e}")))?;
                print(&page)
            }),
            Self::Plant(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::plant(&args, shutdown))
            }
            Self::Load(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::load(&args, shutdown))
            }
            Self::Identifier(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::identifier(&args, shutdown))
            }
            Self::Controller(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::controller(&args, shutdown))
            }
            Self::Monitor(mut args) => {
                args.common.catalog = catalog;
                main_with(&args.common, |shutdown| super::monitor(&args, shutdown))
            }
        }
    }
}

/// A command line without its hidden options, which shells would offer like all others.
fn without_hidden(line: &clap::Command) -> clap::Command {
    // Names of commands that are made at run time must last; a few words, once in a process.
    let name: &'static str = line.get_name().to_owned().leak();
    let mut shown = clap::Command::new(name).propagate_version(true);
    if let Some(about) = line.get_about() {
        shown = shown.about(about.clone());
    }
    let arguments = line.get_arguments().filter(|argument| !argument.is_hide_set());
    shown
        .args(arguments.cloned())
        .subcommands(line.get_subcommands().map(without_hidden))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn regress_shells_complete_every_option_that_is_for_users_and_no_other() {
        for shell in clap_complete::Shell::value_variants() {
            let mut text = Vec::new();
            let mut line = without_hidden(&Program::command()).version(VERSION.as_str());
            clap_complete::generate(*shell, &mut line, "thetabus", &mut text);
            let text = String::from_utf8(text).expect("text");
            for shown in ["describe", "duration", "web-control", "validate"] {
                assert!(text.contains(shown), "{shell}: {shown}");
            }
            for hidden in ["launched-by", "await-consumers", "receipts", "until-end"] {
                assert!(!text.contains(hidden), "{shell}: {hidden}");
            }
        }
    }
}
