//! `studies robots`.

use super::{RobotsArgs, output};
use crate::robot::RobotError;
use crate::runner::Shutdown;
use crate::service::ticker::Ticker;
use crate::service::{Exit, Failure, logging};
use crate::studies::for_each_index;
use crate::studies::robots::{RobotTrial, robot_trial, robots_document};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Runs the trials and writes their tables; a signal ends it and nothing is written.
///
/// # Errors
/// If a configuration is named, the arm cannot be simulated, a signal arrives, or the file cannot
/// be written.
pub fn run(args: &RobotsArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    refuse_configuration("robots", args)?;
    let ticker = Ticker::start("trials of robots");
    let done = AtomicUsize::new(0);
    let runs = for_each_index(args.seeds as usize, |index| {
        if shutdown.requested() {
            return Ok(RobotTrial::default());
        }
        let seed = args.first_seed + index as u64;
        let trial = robot_trial(seed);
        ticker.at((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / args.seeds as f64);
        trial
    });
    drop(ticker);
    if shutdown.requested() {
        return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
    }
    let trials: Vec<RobotTrial> = runs
        .into_iter()
        .collect::<Result<_, RobotError>>()
        .map_err(|e| Failure::Failed(e.to_string()))?;
    if args.details {
        for (seed, trial) in (args.first_seed..).zip(&trials) {
            logging::result(&details(seed, trial))?;
        }
    }
    let text = robots_document(&trials).markdown(&command("robots", args));
    output::write(args.out.as_deref(), &text)?;
    Ok(Exit::Done)
}

/// Refuses a configuration of the command of this name, because it would have no effect.
pub(super) fn refuse_configuration(command: &str, args: &RobotsArgs) -> Result<(), Failure> {
    let common = &args.common;
    let given = [
        ("--config", !common.config.is_empty()),
        ("--set", !common.set.is_empty()),
        ("--robot", common.robot.is_some()),
        ("--domain", common.domain.is_some()),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => Err(Failure::Usage(format!(
            "{command} has machines and settings of its own, src/studies/robots: expected no configuration, got {name}"
        ))),
        None => Ok(()),
    }
}

/// Results of the runs of a seed.
fn details(seed: u64, trial: &RobotTrial) -> String {
    let loaded = &trial.loaded;
    format!(
        "seed {seed}: alarms without a load {:?}, with one that is not declared {:?}\n  load: before {}, found {:?}, after {}, mass {:.3?}",
        trial.empty.alarms, trial.undeclared.alarms, loaded.early, loaded.found, loaded.late, loaded.mass
    )
}

/// The command of this name that generates the document.
pub(super) fn command(name: &str, args: &RobotsArgs) -> String {
    let mut words = vec![output::command(name), format!("--seeds {}", args.seeds)];
    if args.first_seed != 1 {
        words.push(format!("--first-seed {}", args.first_seed));
    }
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
