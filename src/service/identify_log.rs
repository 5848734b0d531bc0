//! `thetabus identify LOG.csv`: the very same node off line, on the user's own data or on what `thetabus export` wrote.

use super::advice::Advisor;
use super::monitor::{ESTIMATES_CSV, create, unwritable, write_summary};
use super::record::run_info;
use super::wiring::{identifier_node, monitor_node};
use super::{Exit, Failure, IdentifyArgs, logging, out_dir, report, warm};
use crate::messages::Sample;
use crate::offline::{LogError, LogReader};
use crate::recording::{EstimatesCsv, SamplesCsvReader, is_samples_csv};
use crate::report::RunData;
use crate::runner::Shutdown;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::time::Instant;

/// Samples as rows of a file.
enum Rows {
    /// Columns as `[log]` names them.
    Log(Box<LogReader<BufReader<File>>>),
    /// An exported recording.
    Exported(Box<SamplesCsvReader<BufReader<File>>>),
}

/// Identifies from a log file with columns as `[log]` names them, or from an exported recording.
///
/// # Errors
/// A configuration or log that is wrong, results that cannot be written.
pub(super) fn run(args: &IdentifyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let start = Instant::now();
    let (input, out) = (&args.input, args.out.as_deref());
    let span = args.span.span()?;
    let config = args.common.load(Vec::new(), &[])?;
    if let Some(dir) = out {
        out_dir::check(dir)?;
    }
    let place = |error: &dyn std::fmt::Display| format!("{}: {error}", input.display());
    let file = File::open(input).map_err(|e| Failure::Usage(place(&e)))?;
    let refused = |error: LogError| match error {
        LogError::Read { .. } => Failure::Failed(place(&error)),
        _ => Failure::Usage(place(&error)),
    };
    let monitor = monitor_node(&config, None)?;
    let info = run_info(&config, &monitor, false);
    let mut source = BufReader::new(file);
    let beginning = source.fill_buf().map_err(|e| Failure::Failed(place(&e)))?;
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
            Rows::Exported(reader) => reader.next_sample().map_err(|e| Failure::Usage(place(&e))),
        }
    };
    let mut node = identifier_node(&config, args.common.own_plant.as_ref())?;
    if args.warm {
        warm::start(&config, &mut *node, None)?;
    }
    let mut csv = match out {
        None => None,
        Some(dir) => {
            out_dir::create(dir)?;
            let csv = create(&dir.join(ESTIMATES_CSV))
                .and_then(|file| EstimatesCsv::new(file, monitor.parameters(), monitor.derived()));
            Some(csv.map_err(|e| unwritable(ESTIMATES_CSV, &e))?)
        }
    };
    let mut run = RunData::new(info, monitor);
    let mut failure = None;
    let mut advisor = Advisor::new(&config);
    while let Some(sample) = next_sample()? {
        if !(span.from_ns..=span.to_ns).contains(&sample.t_ns) {
            continue;
        }
        run.sample(&sample, 0);
        advisor.take(&sample);
        node.on_sample(&sample, &mut |estimate| {
            tracing::info!("{}", run.monitor.line(estimate));
            run.estimate(estimate, 0);
            if let Some(csv) = &mut csv
                && let Err(e) = csv.write(estimate)
            {
                failure.get_or_insert(e);
            }
        });
        if shutdown.requested() {
            break;
        }
    }
    run.status(&node.status());
    if let Some(e) = failure {
        return Err(unwritable(ESTIMATES_CSV, &e));
    }
    let mut summary = run.summary();
    summary.wall_s = Some((start.elapsed().as_secs_f64() * 1e3).round() / 1e3);
    logging::table(&summary, args.format)?;
    if let Some(line) = advisor.line() {
        logging::note(args.format, &line);
    }
    let refused_rows = match &rows {
        Rows::Log(log) => {
            let counts = log.counts();
            logging::note(args.format, &format!("{}: {counts}", input.display()));
            counts.refused()
        }
        Rows::Exported(_) => 0,
    };
    if let Some(dir) = out {
        write_summary(dir, &summary)?;
        report::write(dir, &run, &summary)?;
        logging::note(args.format, &format!("results in {}", dir.display()));
    }
    let lost = refused_rows > 0 || node.status().missing > 0;
    Ok(if lost { Exit::DataLoss } else { Exit::Done })
}
