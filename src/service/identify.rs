//! `thetabus identify`: the same node off line, from a recording or a log.

use super::commands::Commands;
use super::offline_run::OfflineRun;
use super::record::recording_at;
use super::run_info::run_info;
use super::script::Script;
use super::wiring::monitor_node;
use super::{Exit, Failure, IdentifyArgs, foreign, identify_log, identify_robot, report, robot_log};
use crate::config::{Config, ConfigError};
use crate::recording::{Entry, Loss, RecordingReader, RunInfo, Span};
use crate::runner::Shutdown;
use std::path::Path;
use std::time::Instant;

/// Identifies from the samples of a recording, with its own configuration and the overrides on the
/// command line.
///
/// # Errors
/// If the recording cannot be read, the configuration is wrong, or results cannot be written.
pub fn run(args: &IdentifyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let is_log = is_log(&args.input);
    let is_bag = robot_log::is_bag(&args.input);
    if (is_log || is_bag || args.validate.is_some())
        && let Some(robot) = identify_robot::configuration(args)?
    {
        return identify_robot::run(args, robot, shutdown);
    }
    if is_log {
        return identify_log::run(args, shutdown);
    }
    let mut own = args.clone();
    own.common.catalog = super::robot::beside(&args.input, &args.common.catalog)?;
    let args = &own;
    let start = Instant::now();
    let recording = recording_at(&args.input);
    let mut reader = report::open(&recording, args.span.span()?)?;
    let source = || vec![report::source_of(reader.info())];
    let config = args.common.load(source(), &[]).map_err(|failure| {
        // The error may or may not be due only to a model that this program does not have.
        match foreign::unknown_model(reader.info(), &args.common.catalog) {
            Some(unknown) => Failure::Usage(format!("{failure}\n{unknown}")),
            None => failure,
        }
    })?;
    config
        .limit_recorded_memory()
        .map_err(|e| in_recording(&recording, &e))?;
    foreign::check_recording(reader.info(), as_recorded(args, reader.info()).as_ref(), &config)?;
    let mut script = Script::read(&recording, Commands::recorded(&config))?;
    let truth = reader.info().simulated.then_some(&config.plant.sim);
    let monitor = monitor_node(&config, truth);
    let recorded = reader.info();
    // the command line may have chosen another model for the same samples
    let info = RunInfo {
        recording_id: recorded.recording_id.clone(),
        robot: recorded.robot.clone(),
        joints: recorded.joints,
        ..run_info(&config, &monitor, recorded.simulated)
    };
    let mut line = OfflineRun::new(args, &config, info, monitor, start)?;
    while let Some(entry) = reader.next_entry().map_err(report::unreadable)? {
        let Entry::Sample { sample, .. } = entry else { continue };
        script.before(sample, &mut *line.node);
        line.take(sample)?;
        line.at(reader.share_read());
        if line.is_stopped(shutdown) {
            break;
        }
    }
    let loss = reader.loss();
    report::tell_loss(&loss);
    let finished = line.finish(loss, None);
    let missing = Loss {
        samples_not_recorded: 0,
        ..loss
    };
    if missing.is_none() {
        return finished;
    }
    if let Err(failure) = finished {
        tracing::error!("{failure}");
    }
    Ok(Exit::DataLoss)
}

/// True for a user's log, which contains no configuration: by its name, or because the file neither
/// claims to be a recording nor is one.
fn is_log(input: &Path) -> bool {
    let named = |name| input.extension().is_some_and(|own| own.eq_ignore_ascii_case(name));
    let is_other = || input.is_file() && !named("mcap") && RecordingReader::open(input, Span::default()).is_err();
    !input.is_dir() && (named("csv") || is_other())
}

/// The recording's configuration in this program, before overrides; `None` if this program does not
/// have its model.
fn as_recorded(args: &IdentifyArgs, info: &RunInfo) -> Option<Config> {
    report::config_of(info, &args.common.catalog).ok()
}

fn in_recording(path: &Path, error: &ConfigError) -> Failure {
    Failure::Usage(format!("{}: {error}", path.display()))
}
