//! Programs for a plant that is not in this library: the user writes its equations, everything else is here.

use super::wiring::identifier_of;
use super::{EXIT_CODES, Failure, IdentifierArgs, IdentifyArgs, MonitorArgs, identifier, identify, main_with, monitor};
use crate::config::Config;
use crate::model::{Plant, PlantDefinition};
use crate::node::identifier::Identifier;
use clap::{Parser, Subcommand};
use std::fmt;
use std::process::ExitCode;
use std::sync::Arc;

/// From a configuration to the identifier of one plant.
type Make = dyn Fn(&Config) -> Result<Box<dyn Identifier>, Failure> + Send + Sync;

/// A plant of the user's own as the programs see it.
#[derive(Clone)]
pub(super) struct OwnPlant {
    definition: PlantDefinition,
    make: Arc<Make>,
}

impl OwnPlant {
    fn new<P: Plant + Clone + Send + Sync + 'static>(plant: P) -> Self {
        Self {
            definition: PlantDefinition::of(&plant),
            make: Arc::new(move |config| identifier_of(config, &plant)),
        }
    }

    pub(super) fn definition(&self) -> &PlantDefinition {
        &self.definition
    }

    pub(super) fn identifier(&self, config: &Config) -> Result<Box<dyn Identifier>, Failure> {
        (self.make)(config)
    }
}

impl fmt::Debug for OwnPlant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnPlant").field(&self.definition.name).finish()
    }
}

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
    let own = OwnPlant::new(plant);
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
