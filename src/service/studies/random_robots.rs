//! `studies random-robots`.

use super::robots::{command, refuse_configuration};
use super::{RobotsArgs, output};
use crate::robot::RobotError;
use crate::runner::Shutdown;
use crate::service::ticker::Ticker;
use crate::service::{Exit, Failure, logging};
use crate::studies::for_each_index;
use crate::studies::robots::{RandomRobotCase, random_robot_trial, random_robots_document};
use crate::studies::trials::TrialResult;
use std::sync::atomic::{AtomicUsize, Ordering};

const NAME: &str = "random-robots";

/// Runs the trials and writes their table; a signal ends it and nothing is written.
///
/// # Errors
/// If a configuration is named, a robot cannot be simulated, a signal arrives, or the file cannot
/// be written.
pub fn run(args: &RobotsArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    refuse_configuration(NAME, args)?;
    let ticker = Ticker::start("trials of random robots");
    let (done, seeds) = (AtomicUsize::new(0), args.seeds as usize);
    let count = seeds * RandomRobotCase::ALL.len();
    let runs = for_each_index(count, |index| {
        if shutdown.requested() {
            return Ok(TrialResult::default());
        }
        let (case, _, _) = RandomRobotCase::ALL[index / seeds];
        let result = random_robot_trial(case, args.first_seed + (index % seeds) as u64);
        ticker.at((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / count as f64);
        result
    });
    drop(ticker);
    if shutdown.requested() {
        return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
    }
    let runs: Vec<TrialResult> = runs
        .into_iter()
        .collect::<Result<_, RobotError>>()
        .map_err(|e| Failure::Failed(e.to_string()))?;
    let of_case: Vec<Vec<TrialResult>> = runs.chunks(seeds).map(<[TrialResult]>::to_vec).collect();
    if args.details {
        for ((_, name, _), results) in RandomRobotCase::ALL.iter().zip(&of_case) {
            for (seed, result) in (args.first_seed..).zip(results) {
                logging::result(&details(name, seed, result))?;
            }
        }
    }
    let text = random_robots_document(&of_case).markdown(&command(NAME, args));
    output::write(args.out.as_deref(), &text)?;
    Ok(Exit::Done)
}

/// Result of a robot.
fn details(name: &str, seed: u64, result: &TrialResult) -> String {
    let mut text = format!(
        "{name}, seed {seed}: {} of {} blocks usable, {} dangerous, {} alarms",
        result.use_ok, result.blocks, result.dangerous, result.false_alarms
    );
    if let Some(worst) = &result.worst {
        text += &format!(
            "; worst {} in block {}, {:.1} σ, {:.1} %",
            worst.name,
            worst.block,
            worst.sigmas,
            100.0 * worst.error
        );
    }
    if let Some(cause) = &result.named_cause {
        text += &format!("; {cause}");
    }
    text
}
