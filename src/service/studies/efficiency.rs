//! `studies efficiency`.

use super::{EfficiencyArgs, output};
use crate::config::{Config, Source};
use crate::messages::Sample;
use crate::runner::Shutdown;
use crate::service::wiring::identifier_node;
use crate::service::{Exit, Failure, logging};
use crate::sim::Machine;
use crate::studies::efficiency::{
    CaseRuns, Outcome, Published, ROBOT_RUN_S, RobotCase, RobotMotion, RobotOutcome, RobotRunError, RobotRuns, arm_run,
    axis_run, efficiency_document, robot_sections,
};
use crate::studies::for_each_index;
use crate::studies::trials::{AxisMotion, AxisSpec, Disturbance, Motion, Spec, TrialSpec};

const MOTIONS: [Motion; 4] = [
    Motion::Steps,
    Motion::MinimumJerk,
    Motion::Trapezoidal,
    Motion::Multisine,
];
const BITS: [u32; 3] = [13, 16, 20];
/// Blocks of 1.9 s per run.
const BLOCKS: u64 = 10;

/// One line of the tables.
struct Case {
    group: &'static str,
    name: String,
    spec: Spec,
}

fn cases() -> impl Iterator<Item = Case> {
    let arm = MOTIONS.into_iter().flat_map(|motion| {
        BITS.map(|bits| Case {
            group: "The paper's arm",
            name: format!("{}, {bits} bit", motion.name()),
            spec: Spec::Arm(TrialSpec {
                bits,
                blocks: BLOCKS,
                ..TrialSpec::new(motion, 0)
            }),
        })
    });
    let axis = AxisMotion::ALL.map(|motion| Case {
        group: "Servo axis",
        name: motion.name().to_owned(),
        spec: Spec::Axis(AxisSpec {
            motion,
            disturbance: Disturbance::None,
            blocks: BLOCKS,
            seed: 0,
        }),
    });
    arm.chain(axis)
}

/// The shipped configuration with the assumptions of the bound: θ is constant, and the input is
/// held from sample to sample.
fn configuration(spec: &Spec, more: &[String]) -> Result<Config, Failure> {
    let sources: Vec<Source> = Config::embedded(spec.basis()).into_iter().collect();
    let mut settings = spec.settings();
    match spec.arm() {
        Some(trial) => {
            let (first_kg, _) = trial.arm.masses_kg();
            settings.push("plant.mass_2.t_s=[0.0]".to_owned());
            settings.push(format!("plant.mass_2.mass_kg=[{first_kg:?}]"));
        }
        None => {
            settings.push("plant.controller.kind=\"sampled\"".to_owned());
            settings.push("identifier.projected.timing=\"held\"".to_owned());
        }
    }
    settings.extend(more.iter().cloned());
    Ok(Config::load(&sources, &settings)?)
}

/// Estimates of the service's identifier node.
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
    let start = &config.estimator.options.theta_start();
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
/// If a setting is wrong, no case matches, a signal arrives, or the file cannot be written.
pub fn run(args: &EfficiencyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let mut results = Vec::new();
    for case in cases().filter(|case| is_wanted(args, &case.name)) {
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
        let names = config
            .model
            .parameters()
            .iter()
            .map(|parameter| parameter.name.to_string());
        let result = CaseRuns {
            group: case.group,
            name: case.name,
            parameters: names.collect(),
            runs: runs.into_iter().collect::<Result<_, Failure>>()?,
        };
        logging::result(&result.words())?;
        results.push(result);
    }
    let robots = robots(args, shutdown)?;
    if results.is_empty() && robots.is_empty() {
        return Err(Failure::Usage(format!(
            "--only: expected a part of the name of a case, such as \"minimum_jerk, 16 bit\", got {}",
            args.only.join(" ")
        )));
    }
    let sections = robot_sections(&robots);
    let text = efficiency_document(&results, args.seeds, BLOCKS as f64 * 1.9, sections).markdown(&command(args));
    output::write(args.out.as_deref(), &text)?;
    Ok(Exit::Done)
}

fn is_wanted(args: &EfficiencyArgs, name: &str) -> bool {
    args.only.is_empty() || args.only.iter().any(|only| name.contains(only.as_str()))
}

/// The runs of the six-axis robot; settings of a configuration have no effect on it.
fn robots(args: &EfficiencyArgs, shutdown: &Shutdown) -> Result<Vec<RobotRuns>, Failure> {
    let mut results = Vec::new();
    for motion in RobotMotion::ALL
        .into_iter()
        .filter(|motion| is_wanted(args, motion.name()))
    {
        let case = RobotCase::new(motion).map_err(|e| Failure::Failed(e.to_string()))?;
        let runs = for_each_index(args.seeds as usize, |seed| match shutdown.requested() {
            true => Ok(RobotOutcome::default()),
            false => case.run(seed as u64, ROBOT_RUN_S),
        });
        if shutdown.requested() {
            return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
        }
        let runs: Vec<RobotOutcome> = runs
            .into_iter()
            .collect::<Result<_, RobotRunError>>()
            .map_err(|e| Failure::Failed(e.to_string()))?;
        let result = RobotRuns::new(motion.name(), case.model(), runs);
        logging::result(&result.words())?;
        results.push(result);
    }
    Ok(results)
}

/// The command that generates the document.
fn command(args: &EfficiencyArgs) -> String {
    let mut words = vec![output::command("efficiency"), format!("--seeds {}", args.seeds)];
    words.extend(args.only.iter().map(|only| format!("--only \"{only}\"")));
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
