//! `thetabus identify LOG.csv`: the same node off line, on a user's log or on a file of `thetabus
//! export`.

use super::offline_run::OfflineRun;
use super::run_info::run_info;
use super::wiring::monitor_node;
use super::{Exit, Failure, IdentifyArgs};
use crate::config::Config;
use crate::messages::Sample;
use crate::offline::{Configured, LineError, LogError, LogReader, judge_bounds, judge_inputs, judge_profile};
use crate::recording::{Loss, RunInfo, SamplesCsvReader, is_samples_csv, separators_of_a_spreadsheet};
use crate::runner::Shutdown;
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;
use std::time::Instant;

/// Number of samples between queries of the position in the file.
const LOOK: u64 = 4096;

/// Samples as rows of a file.
enum Rows {
    /// Columns as `[log]` names them.
    Log(Box<LogReader<BufReader<File>>>),
    /// An exported recording.
    Exported(Box<SamplesCsvReader<BufReader<File>>>),
}

/// Identifies from a log file with the columns of `[log]`, or from an exported recording.
///
/// # Errors
/// If the configuration or the log is wrong, or results cannot be written.
pub(super) fn run(args: &IdentifyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let start = Instant::now();
    let input = &args.input;
    let span = args.span.span()?;
    let config = args.common.load(Vec::new(), &[])?;
    let place = |error: &dyn std::fmt::Display| format!("{}: {error}", input.display());
    crate::pipe::refuse_named_pipe(input).map_err(|e| Failure::Usage(place(&e)))?;
    let file = File::open(input).map_err(|e| Failure::Usage(place(&e)))?;
    let refused = |error: LogError| match error {
        LogError::Read(LineError::Io { .. }) => Failure::Failed(place(&error)),
        LogError::Columns { .. } if args.common.config.is_empty() => Failure::Usage(format!(
            "{}; no --config was given, so config/encoder_only.toml holds, an arm of two joints",
            place(&error)
        )),
        _ => Failure::Usage(place(&error)),
    };
    let monitor = monitor_node(&config, None);
    let info = RunInfo {
        // The time at which a log was written is unknown.
        recording_id: String::new(),
        ..run_info(&config, &monitor, false)
    };
    // Shares the position with the file being read.
    let mut place_in_file = file.try_clone().ok();
    let bytes = file.metadata().map_or(0, |data| data.len());
    let mut source = BufReader::new(file);
    let beginning = source.fill_buf().map_err(|e| Failure::Failed(place(&e)))?;
    if let Some(words) = separators_of_a_spreadsheet(beginning) {
        return Err(Failure::Usage(place(&words)));
    }
    let mut rows = if is_samples_csv(beginning) {
        let reader = SamplesCsvReader::new(source, &info).map_err(|e| Failure::Usage(place(&e)))?;
        Rows::Exported(Box::new(reader))
    } else {
        let (joints, period_s) = (info.joints, config.plant.sim.sample_period_s);
        Rows::Log(Box::new(
            LogReader::new(source, &config.log, joints, period_s).map_err(refused)?,
        ))
    };
    let mut next_sample = || -> Result<Option<Sample>, Failure> {
        match &mut rows {
            Rows::Log(log) => log.next_sample().map_err(refused),
            Rows::Exported(reader) => reader.next_usable().map_err(|e| Failure::Usage(place(&e))),
        }
    };
    let mut line = OfflineRun::new(args, &config, info, monitor, start)?;
    let mut read = 0_u64;
    let outcome = loop {
        let sample = match next_sample() {
            Ok(Some(sample)) => sample,
            Ok(None) => break Ok(()),
            Err(failure) => break Err(failure),
        };
        if !(span.from_ns..=span.to_ns).contains(&sample.t_ns) {
            continue;
        }
        line.take(&sample)?;
        read += 1;
        // Query the file rarely, because that is a system call.
        if read.is_multiple_of(LOOK)
            && let Some(Ok(at)) = place_in_file.as_mut().map(|file| file.stream_position())
        {
            line.at(at as f64 / bytes.max(1) as f64);
        }
        if line.is_stopped(shutdown) {
            break Ok(());
        }
    };
    if let Rows::Log(log) = &rows {
        tell(input, &config, log, &line);
    }
    outcome?;
    let (about_rows, all_good) = match &rows {
        Rows::Log(log) => (Some(place(&log.counts())), log.counts().refused() == 0),
        Rows::Exported(reader) => {
            let refused = reader.refused();
            refused.iter().for_each(|words| tracing::warn!("{}", place(words)));
            (None, refused.is_none())
        }
    };
    let exit = line.finish(Loss::default(), about_rows.as_deref())?;
    Ok(if all_good { exit } else { Exit::DataLoss })
}

/// Reports what was read, and probable mistakes.
fn tell(input: &Path, config: &Config, log: &LogReader<BufReader<File>>, line: &OfflineRun<'_>) {
    let input = input.display();
    let definition = config.model.definition();
    for line in log
        .profile()
        .lines(|joint| definition.joint_unit(joint), &definition.input_unit)
    {
        tracing::info!("{input}: {line}");
    }
    let configured = Configured {
        turns: &definition.turns,
        position_unit: config.file_form().log.position_unit,
        input_sign: input_sign(config),
    };
    let parameters = config.model.parameters().iter();
    let known = parameters
        .zip(&config.estimator.options.parameters)
        .zip(line.estimates());
    let bounds = known.filter(|((_, prior), _)| !prior.fixed);
    let bounds = bounds.map(|((p, prior), estimate)| (&*p.name, prior.start, [prior.lower, prior.upper], estimate));
    let found = judge_profile(log.profile(), &configured, &log.input_correlations());
    let inputs = judge_inputs(log.profile(), &definition.input_unit, &log.input_echoes());
    for suspicion in found
        .into_iter()
        .chain(inputs)
        .chain(judge_bounds(bounds))
        .chain(log.likely().cloned())
    {
        tracing::warn!("{input}: {suspicion}");
    }
}

/// Sign of the acceleration due to a positive input; 0 if unknown.
fn input_sign(config: &Config) -> f64 {
    match config.model.name() {
        "servo_axis" => config.file_form().servo_axis.gain.signum(),
        "manipulator" => 1.0,
        _ => 0.0,
    }
}
