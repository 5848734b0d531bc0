//! `thetabus identify`: the very same node off line, from a recording or a log.

use super::advice::Advisor;
use super::commands::Commands;
use super::monitor::{ESTIMATES_CSV, create, unwritable, write_summary};
use super::script::Script;
use super::wiring::{identifier_node, monitor_node};
use super::{Exit, Failure, IdentifyArgs, identify_log, logging, out_dir, report, warm};
use crate::config::{Config, Source};
use crate::recording::{Entry, EstimatesCsv, Loss};
use crate::report::RunData;
use crate::runner::Shutdown;
use std::time::Instant;

/// Identifies from the samples of a recording, with its own configuration or with what the command line lays over it.
///
/// # Errors
/// A recording that cannot be read, a configuration that is wrong, results that cannot be written.
pub fn run(args: &IdentifyArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    // A log of the user's own has no configuration inside.
    if args.input.extension().is_some_and(|extension| extension == "csv") {
        return identify_log::run(args, shutdown);
    }
    let start = Instant::now();
    let mut reader = report::open(&args.input, args.span.span()?)?;
    let recorded = Source::Embedded {
        name: "the recording's configuration".to_owned(),
        text: reader.info().config_toml.clone(),
    };
    let config: Config = args.common.load(vec![recorded], &[])?;
    if let Some(dir) = &args.out {
        out_dir::check(dir)?;
    }
    let mut node = identifier_node(&config, args.common.own_plant.as_ref())?;
    if args.warm {
        warm::start(&config, &mut *node, None)?;
    }
    let mut script = Script::read(&args.input, Commands::new(&config, args.common.own_plant.clone()))?;
    let truth = reader.info().simulated.then_some(&config.plant.sim);
    let monitor = monitor_node(&config, truth)?;
    let mut csv = match &args.out {
        None => None,
        Some(dir) => {
            out_dir::create(dir)?;
            let csv = create(&dir.join(ESTIMATES_CSV))
                .and_then(|file| EstimatesCsv::new(file, monitor.parameters(), monitor.derived()));
            Some(csv.map_err(|e| unwritable(ESTIMATES_CSV, &e))?)
        }
    };
    let mut info = reader.info().clone();
    info.config_toml = config.to_toml();
    info.config_hash = config.config_hash();
    let mut run = RunData::new(info, monitor);
    let mut failure = None;
    let mut advisor = Advisor::new(&config);
    while let Some(entry) = reader.next_entry().map_err(report::unreadable)? {
        let Entry::Sample { sample, .. } = entry else { continue };
        run.sample(sample, 0);
        advisor.take(sample);
        script.before(sample, &mut *node);
        node.on_sample(sample, &mut |estimate| {
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
    run.loss = reader.loss();
    if let Some(e) = failure {
        return Err(unwritable(ESTIMATES_CSV, &e));
    }
    let mut summary = run.summary();
    summary.wall_s = Some((start.elapsed().as_secs_f64() * 1e3).round() / 1e3);
    logging::table(&summary, args.format)?;
    if let Some(line) = advisor.line() {
        logging::note(args.format, &line);
    }
    if let Some(dir) = &args.out {
        write_summary(dir, &summary)?;
        report::write(dir, &run, &summary)?;
        logging::note(args.format, &format!("results in {}", dir.display()));
    }
    let missing = Loss {
        samples_not_recorded: 0,
        ..run.loss
    };
    // A gap is lost data whoever counts it: the recorder, or the node.
    let lost = !missing.is_none() || node.status().missing > 0;
    report::tell_loss(&run.loss);
    Ok(if lost { Exit::DataLoss } else { Exit::Done })
}
