//! `studies trials`.

use super::{TrialsArgs, output};
use crate::config::{Config, Source, keys};
use crate::node::identifier::Identifier;
use crate::rows::RowForm;
use crate::runner::Shutdown;
use crate::service::ticker::Ticker;
use crate::service::wiring::identifier_node;
use crate::service::{Exit, Failure, logging};
use crate::studies::for_each_index;
use crate::studies::trials::{
    Case, CaseResult, Disturbance, Spec, Trial, TrialResult, drawn_errors, full_cases, quick_cases, rest_instant,
    trials_document,
};
use std::time::Instant;

/// Runs a trial: the built-in configuration with the trial's settings, then `more` of the form
/// `section.key=value`.
///
/// # Errors
/// If a setting is wrong.
pub fn trial(spec: &Spec, more: &[String]) -> Result<TrialResult, Failure> {
    let config = configuration(spec, more)?;
    let mut node = identifier_node(&config)?;
    let names: Vec<String> = config
        .model
        .parameters()
        .iter()
        .map(|parameter| parameter.name.to_string())
        .collect();
    let trial = Trial {
        sim: &config.plant.sim,
        block_len: config.estimator.block_len as u64,
        names: &names,
        known: config.known,
    };
    let (mut cause, mut limit) = (None, None);
    let mut result = trial.run(|sample, estimates| {
        node.on_sample(sample, &mut |estimate| estimates.push(*estimate));
        if !estimates.is_empty() {
            cause = words(node.as_ref(), "would explain").or(cause.take());
            limit = words(node.as_ref(), "unseen errors").or(limit.take());
        }
    })?;
    (result.named_cause, result.named_limit) = (cause, limit);
    Ok(result)
}

/// The status text if it contains `what`: a term "would explain" a misfit, or σ covers
/// "unseen errors".
fn words(node: &dyn Identifier, what: &str) -> Option<String> {
    let status = node.status();
    let words = status.error.words();
    words.contains(what).then(|| words.to_owned())
}

fn configuration(spec: &Spec, more: &[String]) -> Result<Config, Failure> {
    load(spec, &settings(spec, more)?)
}

fn load(spec: &Spec, settings: &[String]) -> Result<Config, Failure> {
    let sources: Vec<Source> = Config::embedded(spec.basis()).into_iter().collect();
    Ok(Config::load(&sources, settings)?)
}

/// The overrides of the trial's base configuration, including the instant of a change at rest.
fn settings(spec: &Spec, more: &[String]) -> Result<Vec<String>, Failure> {
    let mut settings = spec.settings();
    for (key, value) in spec.disturbance().optional_settings() {
        if keys().any(|known| known.path() == key) {
            settings.push(format!("{key}={value}"));
        }
    }
    settings.extend(more.iter().cloned());
    if let Spec::Arm(arm) = spec
        && arm.disturbance == Disturbance::AtRest
        // Until the change, the motion does not depend on it.
        && let Some(at_s) = rest_instant(&load(spec, &settings)?.plant.sim, arm.middle_s())
    {
        settings.push(format!("plant.mass_2.t_s=[0.0, {at_s:?}]"));
    }
    if let Spec::Arm(arm) = spec
        && arm.disturbance == Disturbance::Drawn
    {
        let config = load(spec, &settings)?;
        if let RowForm::Projected(options) = &config.identifier.rows {
            let drawn = drawn_errors(&config.plant.sim, &options.considered, arm.seed);
            settings.extend(drawn.map_err(|error| Failure::Failed(error.to_string()))?);
        }
    }
    Ok(settings)
}

/// Runs the trials, one line per case, and writes their tables; a signal ends it and nothing is
/// written.
///
/// # Errors
/// If a setting is wrong, no case matches, a signal arrives, or the file cannot be written.
pub fn run(args: &TrialsArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let all = if args.quick { quick_cases() } else { full_cases() };
    let count = all.len();
    let cases: Vec<Case> = all
        .into_iter()
        .filter(|case| args.only.is_empty() || args.only.iter().any(|only| case.matches(only)))
        .collect();
    if cases.is_empty() {
        let message = format!(
            "--only: expected words of at least one of {count} cases, such as minimum_jerk,16bit, got {}",
            args.only.join(" ")
        );
        return Err(Failure::Usage(message));
    }
    let seeds = args.seeds.unwrap_or(if args.quick { 2 } else { 8 });
    let started = Instant::now();
    let mut results: Vec<(Case, CaseResult)> = Vec::with_capacity(cases.len());
    let ticker = Ticker::start("trials");
    let chosen = cases.len();
    for (index, case) in cases.into_iter().enumerate() {
        if args.show {
            let spec = case.spec.with(args.first_seed, args.blocks);
            let settings = settings(&spec, &args.common.set)?.join("\n  ");
            let text = format!("{} on {}.toml\n  {settings}", case.name(), case.spec.basis());
            ticker.aside(|| logging::result(&text))?;
            continue;
        }
        ticker.at(index as f64 / chosen as f64);
        let runs = for_each_index(seeds as usize, |index| {
            if shutdown.requested() {
                return Ok((Disturbance::None, TrialResult::default()));
            }
            let spec = case.spec.with(args.first_seed + index as u64, args.blocks);
            Ok((spec.disturbance(), trial(&spec, &args.common.set)?))
        });
        if shutdown.requested() {
            return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
        }
        let result = CaseResult {
            runs: runs.into_iter().collect::<Result<_, Failure>>()?,
        };
        ticker.aside(|| logging::result(&format!("{:<46} {}", case.name(), result.line())))?;
        if args.details {
            for ((_, run), seed) in result.runs.iter().zip(args.first_seed..) {
                ticker.aside(|| logging::result(&details(seed, run)))?;
            }
        }
        results.push((case, result));
    }
    drop(ticker);
    if args.show {
        return Ok(Exit::Done);
    }
    let pooled = CaseResult::pool(results.iter().map(|(_, result)| result));
    logging::result(&format!("{:<46} {}", "all", pooled.line()))?;
    logging::result(&format!("{} s", started.elapsed().as_secs()))?;
    if let Some(file) = &args.out {
        let text = trials_document(&results, seeds).markdown(&command(args));
        output::write(Some(file), &text)?;
    }
    Ok(Exit::Done)
}

/// Figures of one run, one line per parameter.
fn details(seed: u64, run: &TrialResult) -> String {
    let states: Vec<String> = run
        .states
        .iter()
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    let mut text = format!(
        "  seed {seed}: first use_ok in block {}, states: {}",
        run.first_use_ok.map_or("–".to_owned(), |block| block.to_string()),
        states.join(", ")
    );
    if let Some(cause) = &run.named_cause {
        text += &format!(", cause named: {cause}");
    }
    if !run.alarmed.is_empty() {
        let blocks: Vec<String> = run.alarmed.iter().map(u64::to_string).collect();
        text += &format!("\n    false alarms in blocks {}", blocks.join(", "));
    }
    for danger in &run.dangers {
        text += &format!(
            "\n    dangerous: block {}, {} {:.2} % off, {:.1} sigma",
            danger.block,
            danger.name,
            100.0 * danger.error,
            danger.sigmas
        );
    }
    for (i, p) in run.parameters.iter().enumerate() {
        text += &format!(
            "\n    theta_{}: at the end {:.3} % off, {:.1} sigma; bound {:.3} %, error / bound {:.2}; {} of {} intervals hold",
            i + 1,
            100.0 * p.end_error,
            p.end_sigmas,
            100.0 * p.bound,
            (p.squared_ratio / f64::from(p.marks)).sqrt(),
            p.covered,
            p.intervals
        );
    }
    text
}

/// The command that generates the document.
fn command(args: &TrialsArgs) -> String {
    let mut words = vec![output::command("trials")];
    if args.quick {
        words.push("--quick".to_owned());
    }
    words.extend(args.seeds.iter().map(|seeds| format!("--seeds {seeds}")));
    if args.first_seed > 0 {
        words.push(format!("--first-seed {}", args.first_seed));
    }
    words.extend(args.blocks.iter().map(|blocks| format!("--blocks {blocks}")));
    words.extend(args.only.iter().map(|only| format!("--only {only}")));
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
