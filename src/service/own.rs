//! Programs for a plant that is not in this library: the user writes its equations, everything else is here.

use super::own_plant::OwnPlant;
use super::wiring::identifier_of;
use super::{EXIT_CODES, IdentifierArgs, IdentifyArgs, MonitorArgs, identifier, identify, main_with, monitor};
use crate::model::{Plant, PlantDefinition};
use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "On-line identification of this program's own plant", after_help = EXIT_CODES)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The identification service: samples from the bus in, estimates out
    #[command(after_help = EXIT_CODES)]
    Identifier(IdentifierArgs),
    /// Log the estimates, and keep them
    #[command(after_help = EXIT_CODES)]
    Monitor(MonitorArgs),
    /// Identify off line from a recording or a log
    #[command(after_help = EXIT_CODES)]
    Identify(IdentifyArgs),
}

/// The whole `main` of a program that identifies `plant`: identifier process, monitor, and identification off line, chosen by the
/// command line. `--help` tells the rest.
///
/// Configured as ever, on top of `config/own_plant.toml`: rows from positions and inputs, so that nothing else has to be measured. Section `[model]`
/// has no effect, the plant being this one; start values and bounds are its own unless section `[estimator]` lists others. What the programs refuse
/// ends with exit code 2 and the reason on standard error.
pub fn main_for<P>(plant: P) -> ExitCode
where
    P: Plant + Clone + Send + Sync + 'static,
{
    let definition = PlantDefinition::of(&plant);
    let own = OwnPlant::new(definition, move |config| identifier_of(config, &plant));
    match Program::parse().command {
        Command::Identifier(mut args) => {
            args.common.own_plant = Some(own);
            main_with(&args.common, |shutdown| identifier(&args, shutdown))
        }
        Command::Monitor(mut args) => {
            args.common.own_plant = Some(own);
            main_with(&args.common, |shutdown| monitor(&args, shutdown))
        }
        Command::Identify(mut args) => {
            args.common.own_plant = Some(own);
            main_with(&args.common, |shutdown| identify(&args, shutdown))
        }
    }
}
