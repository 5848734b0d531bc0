//! `thetabus identify LOG.csv --config ROBOT.toml`: a robot from its URDF, off line.

use super::monitor::unwritable;
use super::offline_run::tell_stopped;
use super::robot::robot_text;
use super::robot_log::RobotLog;
use super::ticker::Ticker;
use super::{Exit, Failure, IdentifyArgs, TableFormat, cell, logging, out_dir, robot_profile, robot_urdf};
use crate::config::{RobotConfig, Source, is_robot_override};
use crate::messages::{Estimate, State};
use crate::node::robot::RobotEvidence;
use crate::robot::{
    FilteredSample, RobotIdentifier, RobotSample, TorqueFit, correlation_time_s, filtered, judge_robot_fit,
    median_period_s,
};
use crate::runner::Shutdown;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Blocks before predictions count, because at first friction is unknown.
const WARM_UP_BLOCKS: usize = 10;

/// The robot's configuration, if the command line names one.
///
/// # Errors
/// If the file is wrong, or an option does not apply to a robot's log.
pub(super) fn configuration(args: &IdentifyArgs) -> Result<Option<RobotConfig>, Failure> {
    // A robot of a cell has its own file; what the cell's robots share has no effect on a log.
    let sources = cell::sources(&args.common.config, args.common.robot.as_deref())?;
    let ([Source::File(path)] | [Source::File(path), Source::Shared(_)]) = &sources[..] else {
        return none_with_validation(args);
    };
    let Some(text) = robot_text(path) else {
        return none_with_validation(args);
    };
    if args.warm {
        return Err(Failure::Usage(
            "--warm is not for the log of a robot from a URDF".to_owned(),
        ));
    }
    if let Some(other) = args.common.set.iter().find(|one| !is_robot_override(one)) {
        return Err(Failure::Usage(format!(
            "--set {other}: expected a key of {}'s sections model, drive, friction, log or identify, got another, which has no effect on the log of a robot from a URDF",
            path.display()
        )));
    }
    let config = RobotConfig::parse_with(&text, path, &args.common.set)?;
    if config.is_stated("checkpoint") {
        tracing::info!(
            "{}: section checkpoint has no effect on the log of a robot from a URDF",
            path.display()
        );
    }
    Ok(Some(config))
}

fn none_with_validation(args: &IdentifyArgs) -> Result<Option<RobotConfig>, Failure> {
    match &args.validate {
        None => Ok(None),
        Some(_) => Err(Failure::Usage(
            "--validate: expected a --config FILE with [model] kind = \"robot\", got another model".to_owned(),
        )),
    }
}

/// Identifies a robot from a log in one pass.
///
/// # Errors
/// If the log is wrong, or results cannot be written.
pub(super) fn run(args: &IdentifyArgs, mut config: RobotConfig, shutdown: &Shutdown) -> Result<Exit, Failure> {
    if let Some(dir) = &args.out {
        out_dir::check(dir)?;
    }
    let ticker = Ticker::start(&format!("reading {}", args.input.display()));
    let log = cut(args, RobotLog::read(&args.input, &config)?)?;
    let held_out = args.validate.as_deref().map(|path| RobotLog::read(path, &config));
    let held_out = held_out.transpose()?;
    // Before the next ticker, because their lines would overlap.
    drop(ticker);
    config.options.windows = config.windows_of(&log.samples);
    config.options.formed_over_s = log.forms_velocities.then(|| config.log_velocity_s());
    robot_profile::tell(&args.input, &config, &log);
    if let (Some(path), Some(log)) = (&args.validate, &held_out) {
        robot_profile::tell(path, &config, log);
    }
    let log = log.samples;
    let ticker = Ticker::start(&format!("identifying from {}", args.input.display()));
    let mut identifier = RobotIdentifier::new(config.model, config.options).map_err(Failure::usage)?;
    let states = filtered(identifier.model(), &log);
    let Pass {
        before,
        last,
        estimates,
        uninformed,
        stopped,
    } = Pass::through(&mut identifier, (&log, &states), &args.input, &ticker, shutdown)?;
    if identifier.blocks() == 0 {
        let why = without_rows(&identifier, &log);
        return Err(Failure::Usage(format!("{}: {why}", args.input.display())));
    }
    ticker.stage("judging the fit");
    let fit = |states: &[FilteredSample]| TorqueFit::of(identifier.model(), identifier.theta(), states);
    let fits = Fits {
        learnt: fit(&states),
        before,
        correlation_s: (0..identifier.model().robot().len())
            .map(|joint| correlation_time_s(identifier.model(), identifier.theta(), &states, joint))
            .collect(),
        held_out: held_out.map(|log| fit(&filtered(identifier.model(), &log.samples))),
    };
    let summary = summary(&identifier, &last, &fits, log.len());
    let found = judge_robot_fit(&identifier, &states);
    drop(ticker);
    robot_profile::warn(&args.input, &found);
    if let Some(dir) = &args.out {
        out_dir::create(dir)?;
        write(dir, "summary.json", &pretty(&summary)?)?;
        write(dir, "estimates.csv", &estimates)?;
        let (_, covariance) = robot_urdf::arm(&identifier);
        let table = robot_urdf::covariance_csv(identifier.model(), &covariance);
        write(dir, robot_urdf::COVARIANCE, &table)?;
    }
    match args.format {
        TableFormat::Json => logging::result(&pretty(&summary)?)?,
        TableFormat::Text => {
            logging::result(table(&identifier, &fits).trim_end())?;
            let (state, usable) = (state_of(&last), last.usable.len());
            logging::result(&format!(
                "\nstate {state}, use_ok {}, {usable} parameters usable in the last block",
                last.use_ok
            ))?;
            if let Some(words) = uninformed {
                logging::result(&words)?;
            }
        }
    }
    if let Some(dir) = &args.out {
        logging::note(args.format, &format!("results in {}", dir.display()))?;
    }
    if stopped {
        tell_stopped(&args.input);
        return Ok(Exit::DataLoss);
    }
    Ok(Exit::Done)
}

/// Result of one pass through a log.
struct Pass {
    /// How well each block was predicted before it was used.
    before: TorqueFit,
    last: Estimate,
    /// Text of `estimates.csv`.
    estimates: String,
    /// Why the data are not enough for `use_ok`, if they are not.
    uninformed: Option<String>,
    /// True if a signal arrived before the end of the log.
    stopped: bool,
}

impl Pass {
    /// Processes a log sample by sample, with the filtered states, until asked to stop.
    fn through(
        identifier: &mut RobotIdentifier,
        (log, states): (&[RobotSample], &[FilteredSample]),
        input: &Path,
        ticker: &Ticker,
        shutdown: &Shutdown,
    ) -> Result<Self, Failure> {
        let mut evidence = RobotEvidence::new(identifier);
        let mut pass = Self {
            before: TorqueFit::default(),
            last: Estimate::default(),
            estimates: estimates_header(identifier),
            uninformed: None,
            stopped: false,
        };
        for (index, (sample, state)) in log.iter().zip(states).enumerate() {
            ticker.at(index as f64 / log.len() as f64);
            if identifier.blocks() >= WARM_UP_BLOCKS {
                pass.before.add(identifier.model(), identifier.theta(), state);
            }
            let closed = identifier
                .push(sample)
                .map_err(|e| Failure::Usage(format!("{}: at {} s: {e}", input.display(), sample.t_s)))?;
            if closed {
                pass.note(identifier, &mut evidence, sample.t_s);
            }
            pass.stopped = shutdown.requested();
            if pass.stopped {
                break;
            }
        }
        if identifier.end_of_recording()
            && let Some(sample) = log.last()
        {
            pass.note(identifier, &mut evidence, sample.t_s);
        }
        Ok(pass)
    }

    /// Records a block that ended at `t_s`.
    fn note(&mut self, identifier: &RobotIdentifier, evidence: &mut RobotEvidence, t_s: f64) {
        self.last = evidence.judge(identifier, true, 0.0);
        estimates_line(identifier, (t_s, &self.last), &mut self.estimates);
        let report = evidence.report();
        let free = self.last.params as usize - self.last.fixed.len();
        self.uninformed = (!report.informed).then(|| {
            format!(
                "use_ok needs more than half of the {free} free parameters known from data, got {}: move all joints, at different speeds",
                report.rank
            )
        });
    }
}

/// Why a log gave no row.
fn without_rows(identifier: &RobotIdentifier, log: &[RobotSample]) -> String {
    match median_period_s(log).and_then(|period_s| identifier.windows().too_far_apart(period_s)) {
        Some(too_far_apart) => too_far_apart.to_string(),
        None => format!(
            "expected at least a second in which a joint moves, got {} samples that give no row",
            log.len()
        ),
    }
}

/// How well torques are predicted: on the same log afterwards, on it before each block was used,
/// and on another log.
struct Fits {
    learnt: TorqueFit,
    before: TorqueFit,
    /// Correlation time of the misfit on the same log, per joint.
    correlation_s: Vec<Option<f64>>,
    held_out: Option<TorqueFit>,
}

impl Fits {
    /// Relative residual of a joint on the other log \[%\], if that log can tell.
    fn held_out(&self, joint: usize) -> Option<f64> {
        let judged = self.held_out.as_ref().filter(|fit| fit.can_be_judged(joint));
        judged.and_then(|fit| fit.relative_residual(joint))
    }
}

/// The part selected by --from and --to, in seconds after the first sample.
fn cut(args: &IdentifyArgs, mut log: RobotLog) -> Result<RobotLog, Failure> {
    let span = args.span.span()?;
    let start = log.samples.first().map_or(0.0, |sample| sample.t_s);
    log.samples.retain(|sample| {
        let t_ns = ((sample.t_s - start) * 1e9).round() as u64;
        (span.from_ns..=span.to_ns).contains(&t_ns)
    });
    match log.samples.len() {
        0..3 => Err(args.span.nothing(&args.input)),
        _ => Ok(log),
    }
}

fn write(dir: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = dir.join(name);
    std::fs::write(&path, text).map_err(|e| unwritable(&path, &e))
}

fn pretty(value: &Value) -> Result<String, Failure> {
    serde_json::to_string_pretty(value).map_err(|e| Failure::Failed(format!("the table cannot be written: {e}")))
}

fn estimates_header(identifier: &RobotIdentifier) -> String {
    let names = || identifier.model().parameters().iter().map(|p| &p.name);
    let mut text = "block,t_s".to_owned();
    names().for_each(|name| _ = write!(text, ",{name}"));
    names().for_each(|name| _ = write!(text, ",{name}_std"));
    names().for_each(|name| _ = write!(text, ",{name}_usable"));
    text.push_str(",state,use_ok,fit_probability");
    text.push('\n');
    text
}

fn estimates_line(identifier: &RobotIdentifier, (t_s, estimate): (f64, &Estimate), text: &mut String) {
    let _ = write!(text, "{},{t_s}", identifier.blocks());
    identifier.theta().iter().for_each(|x| _ = write!(text, ",{x}"));
    (0..identifier.theta().len()).for_each(|i| _ = write!(text, ",{}", identifier.theta_std(i)));
    let count = identifier.theta().len();
    (0..count).for_each(|i| _ = write!(text, ",{}", u8::from(estimate.usable.contains(i))));
    let state = state_of(estimate);
    let _ = write!(text, ",{state},{},{}", estimate.use_ok, estimate.fit_probability);
    text.push('\n');
}

fn state_of(estimate: &Estimate) -> &'static str {
    State::from_wire(estimate.state).unwrap_or_default().name()
}

fn summary(identifier: &RobotIdentifier, last: &Estimate, fits: &Fits, samples: usize) -> Value {
    let model = identifier.model();
    let parameters: Vec<Value> = model
        .parameters()
        .iter()
        .enumerate()
        .map(|(i, p)| {
            json!({
                "name": p.name, "unit": p.unit, "meaning": p.meaning,
                "estimate": identifier.theta()[i], "std": identifier.theta_std(i), "urdf": p.nominal,
                "usable": last.usable.contains(i),
            })
        })
        .collect();
    let joints: Vec<Value> = model
        .robot()
        .joints
        .iter()
        .enumerate()
        .map(|(j, joint)| {
            json!({
                "name": joint.name,
                "fit_percent": fits.learnt.fit(j),
                "relative_residual_percent": fits.learnt.relative_residual(j),
                "predicted_before_learnt_percent": fits.before.relative_residual(j),
                "validation_percent": fits.held_out(j),
                "torque_std": identifier.torque_std(j),
                "misfit_correlation": identifier.inflation(j),
                "residual_correlation_s": fits.correlation_s[j],
            })
        })
        .collect();
    json!({
        "robot": model.robot().name, "held_joints": model.robot().held,
        "samples": samples, "blocks": identifier.blocks(),
        "state": state_of(last), "use_ok": last.use_ok == 1,
        "parameters": parameters, "joints": joints,
    })
}

fn table(identifier: &RobotIdentifier, fits: &Fits) -> String {
    let model = identifier.model();
    let mut text = format!(
        "{:<12} {:>12} {:>12} {:>12}  {:<10} {}\n",
        "parameter", "estimate", "std", "URDF", "unit", "meaning"
    );
    for (i, p) in model.parameters().iter().enumerate() {
        let _ = writeln!(
            text,
            "{:<12} {:>12.5} {:>12.5} {:>12.5}  {:<10} {}",
            p.name,
            identifier.theta()[i],
            identifier.theta_std(i),
            p.nominal,
            p.unit,
            p.meaning
        );
    }
    let percent = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.2}"));
    let _ = writeln!(
        text,
        "\n{:<24} {:>9} {:>12} {:>22} {:>14} {:>15}",
        "joint", "fit [%]", "residual [%]", "before learning [%]", "held out [%]", "correlated [s]"
    );
    for (j, joint) in model.robot().joints.iter().enumerate() {
        let _ = writeln!(
            text,
            "{:<24} {:>9} {:>12} {:>22} {:>14} {:>15}",
            joint.name,
            percent(fits.learnt.fit(j)),
            percent(fits.learnt.relative_residual(j)),
            percent(fits.before.relative_residual(j)),
            percent(fits.held_out(j)),
            percent(fits.correlation_s[j])
        );
    }
    if let Some(held_out) = &fits.held_out {
        let joints = model.robot().joints.iter().enumerate();
        let unjudged: Vec<&str> = joints
            .filter(|(j, _)| !held_out.can_be_judged(*j))
            .map(|(_, joint)| &*joint.name)
            .collect();
        if !unjudged.is_empty() {
            let _ = writeln!(
                text,
                "\nheld out cannot be judged, because the log of --validate hardly moves these joints or has too few samples: {}",
                unjudged.join(", ")
            );
        }
    }
    if !model.robot().held.is_empty() {
        let _ = writeln!(text, "\nheld at 0: {}", model.robot().held.join(", "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Args as _, Command, FromArgMatches as _};

    #[test]
    fn regress_the_log_of_a_cells_robot_is_read_by_its_own_file() {
        let cell = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/cell.toml");
        let joints = |robot: &str| {
            let line = IdentifyArgs::augment_args(Command::new("identify"));
            let typed = line.try_get_matches_from(["identify", "log.csv", "--config", cell, "--robot", robot]);
            let args = IdentifyArgs::from_arg_matches(&typed.expect("taken")).expect("arguments");
            configuration(&args)
                .expect("valid")
                .map(|config| config.model.robot().len())
        };
        assert_eq!((joints("welder"), joints("arm-3")), (Some(6), None));
    }
}
