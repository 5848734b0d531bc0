//! `studies efficiency`.

use super::EfficiencyArgs;
use crate::config::{Config, Source};
use crate::messages::Sample;
use crate::runner::Shutdown;
use crate::service::wiring::identifier_node;
use crate::service::{Exit, Failure, logging};
use crate::sim::Machine;
use crate::studies::efficiency::{CaseRuns, Outcome, Published, arm_run, axis_run, efficiency_document};
use crate::studies::for_each_index;
use crate::studies::trials::{AxisMotion, AxisSpec, Motion, Spec, TrialSpec};
use std::time::Instant;

const MOTIONS: [Motion; 4] = [
    Motion::Steps,
    Motion::MinimumJerk,
    Motion::Trapezoidal,
    Motion::Multisine,
];
const BITS: [u32; 3] = [13, 16, 20];

/// One line of the tables.
struct Case {
    group: &'static str,
    name: String,
    spec: Spec,
}

fn cases(blocks: u64) -> Vec<Case> {
    let mut cases = Vec::new();
    for motion in MOTIONS {
        for bits in BITS {
            cases.push(Case {
                group: "The paper's arm",
                name: format!("{}, {bits} bit", motion.name()),
                spec: Spec::Arm(TrialSpec {
                    bits,
                    blocks,
                    ..TrialSpec::new(motion, 0)
                }),
            });
        }
    }
    for motion in AxisMotion::ALL {
        cases.push(Case {
            group: "Servo axis",
            name: motion.name().to_owned(),
            spec: Spec::Axis(AxisSpec {
                motion,
                blocks,
                seed: 0,
            }),
        });
    }
    cases
}

fn configuration(spec: &Spec, more: &[String]) -> Result<Config, Failure> {
    let sources: Vec<Source> = Config::embedded(spec.basis()).into_iter().collect();
    let mut settings = spec.settings();
    if let Spec::Arm(arm) = spec {
        let (first_kg, _) = arm.arm.masses_kg();
        // nothing changes: the bound is that of constant parameters
        settings.push("plant.mass_2.t_s=[0.0]".to_owned());
        settings.push(format!("plant.mass_2.mass_kg=[{first_kg:?}]"));
    }
    settings.extend(more.iter().cloned());
    Ok(Config::load(&sources, &settings)?)
}

/// Ours: the identifier node of the service.
fn identify(config: &Config, samples: &[Sample]) -> Result<Option<Published>, Failure> {
    let mut node = identifier_node(config)?;
    let mut last = None;
    for sample in samples {
        node.on_sample(sample, &mut |estimate| last = Some(*estimate));
    }
    Ok(last.map(|estimate| {
        let params = estimate.params as usize;
        Published {
            theta: estimate.theta[..params].to_vec(),
            std: estimate.theta_std[..params].to_vec(),
        }
    }))
}

fn run_case(spec: &Spec, more: &[String]) -> Result<Outcome, Failure> {
    let config = configuration(spec, more)?;
    let sim = &config.plant.sim;
    let start = &config.estimator.options.theta_start;
    let mut failure = None;
    let ours = |samples: &[Sample]| {
        identify(&config, samples).unwrap_or_else(|error| {
            failure = Some(error);
            None
        })
    };
    let outcome = match &sim.machine {
        Machine::ServoAxis(axis) => axis_run(sim, axis, start, ours)?,
        _ => arm_run(sim, start, ours)?,
    };
    failure.map_or(Ok(outcome), Err)
}

/// Runs every case, one line each, and writes the tables; a signal ends it and nothing is written.
///
/// # Errors
/// A setting is wrong, no case has the words asked for, a signal came, or the file cannot be written.
pub fn run(args: &EfficiencyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let all = cases(args.blocks);
    let wanted = |case: &Case| args.only.is_empty() || args.only.iter().any(|only| case.name.contains(only.as_str()));
    let chosen: Vec<Case> = all.into_iter().filter(wanted).collect();
    if chosen.is_empty() {
        return Err(Failure::Usage(format!(
            "--only: expected a part of the name of a case, such as \"minimum_jerk, 16 bit\", got {}",
            args.only.join(" ")
        )));
    }
    let started = Instant::now();
    let mut results = Vec::with_capacity(chosen.len());
    for case in chosen {
        let runs = for_each_index(args.seeds as usize, |seed| {
            if shutdown.requested() {
                return Ok(Outcome::default());
            }
            run_case(&case.spec.with(seed as u64, None), &args.common.set)
        });
        if shutdown.requested() {
            return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
        }
        let config = configuration(&case.spec, &args.common.set)?;
        let parameters = config
            .model
            .parameters()
            .iter()
            .map(|parameter| parameter.name.to_string());
        let result = CaseRuns {
            group: case.group,
            name: case.name,
            parameters: parameters.collect(),
            runs: runs.into_iter().collect::<Result<_, Failure>>()?,
        };
        logging::result(&result.words())?;
        results.push(result);
    }
    logging::result(&format!("{} s", started.elapsed().as_secs()))?;
    let document = efficiency_document(&results, args.seeds, args.blocks as f64 * 1.9);
    if let Some(file) = &args.out {
        let text = document.markdown(&command(args));
        std::fs::write(file, text).map_err(|error| Failure::Failed(format!("{}: {error}", file.display())))?;
        logging::result(&format!("{}: written", file.display()))?;
    }
    Ok(Exit::Done)
}

/// The command that makes the document again.
fn command(args: &EfficiencyArgs) -> String {
    let mut words = vec![format!(
        "cargo run --release --features studies --bin studies -- efficiency --seeds {} --blocks {}",
        args.seeds, args.blocks
    )];
    words.extend(args.only.iter().map(|only| format!("--only \"{only}\"")));
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
