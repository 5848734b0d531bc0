//! Makes the tables in `docs/`.
//!
//! ```text
//! configuration ─▶ simulated runs ─▶ estimators side by side ─▶ docs/results.md and others
//! machines and motions by seed ─▶ simulated robots ─▶ their identifier ─▶ docs/robot-trials.md
//! robots, sensors and motions by seed ─▶ the identifier node ─▶ docs/random-robots.md
//! motions and sensors ─▶ estimators beside the Cramér–Rao bound ─▶ docs/efficiency.md
//! settings of a trial ─▶ simulated runs ─▶ the identifier node ─▶ docs/trials.md
//! ```
#![forbid(unsafe_code)]

use clap::{Parser, Subcommand};
use std::process::ExitCode;
use thetabus::service::studies::{self, CompareArgs, EfficiencyArgs, RobotsArgs, TrackArgs, TrialsArgs};
use thetabus::service::{EXIT_CODES, VERSION, main_with};

/// Compares estimators and tries the published evidence on simulated machines
#[derive(Parser)]
#[command(name = "studies", version = VERSION.as_str(), after_help = EXIT_CODES, propagate_version = true)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Put estimators side by side on one simulated run
    #[command(after_help = EXIT_CODES)]
    Compare(CompareArgs),
    /// Try the evidence on other arms, motions, sensors and disturbances; the tables of
    /// docs/trials.md
    #[command(after_help = EXIT_CODES)]
    Trials(TrialsArgs),
    /// Identify simulated robots of many seeds; the tables of docs/robot-trials.md
    #[command(after_help = EXIT_CODES)]
    Robots(RobotsArgs),
    /// Identify robots drawn at random, with sensors and motions of all kinds; the table of
    /// docs/random-robots.md
    #[command(after_help = EXIT_CODES)]
    RandomRobots(RobotsArgs),
    /// Compare the errors of estimators with the least that the data allow; the tables of
    /// docs/efficiency.md
    #[command(after_help = EXIT_CODES)]
    Efficiency(EfficiencyArgs),
    /// Follow a trajectory with feed-forward from estimates; the table of docs/adaptive.md
    #[command(after_help = EXIT_CODES)]
    Track(TrackArgs),
}

fn main() -> ExitCode {
    match Program::parse().command {
        Command::Compare(args) => main_with(&args.common, |shutdown| studies::compare(&args, shutdown)),
        Command::Trials(args) => main_with(&args.common, |shutdown| studies::trials(&args, shutdown)),
        Command::Robots(args) => main_with(&args.common, |shutdown| studies::robots(&args, shutdown)),
        Command::RandomRobots(args) => main_with(&args.common, |shutdown| studies::random_robots(&args, shutdown)),
        Command::Efficiency(args) => main_with(&args.common, |shutdown| studies::efficiency(&args, shutdown)),
        Command::Track(args) => main_with(&args.common, |shutdown| studies::track(&args, shutdown)),
    }
}
