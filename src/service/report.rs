//! `thetabus report`: figures, page and table of a recorded run.

use super::monitor::{SUMMARY_JSON, write_summary};
use super::new_file::whole;
use super::record::recording_at;
use super::ticker::Ticker;
use super::wiring::{input_prediction, monitor_node};
use super::{CommonArgs, Exit, Failure, ReportArgs, foreign, logging, out_dir};
use crate::config::{Catalog, Config, Source};
use crate::node::monitor::MonitorNode;
use crate::recording::{Loss, ReadError, RecordingReader, RunInfo, Span};
use crate::report::{Notes, RunData, Summary, write_report};
use crate::rows::RowForm;
use std::path::{Path, PathBuf};

/// Writes the report of a directory of results, or of a recording.
///
/// # Errors
/// If there is no recording or it cannot be read, or the directory cannot be written.
pub fn run(args: &ReportArgs, common: &CommonArgs) -> Result<Exit, Failure> {
    let path = &args.input;
    let default_out = || match path.is_dir() {
        true => path.clone(),
        false => path.with_extension("report"),
    };
    let out = args.out.clone().unwrap_or_else(default_out);
    // The report of a directory belongs in that directory; elsewhere nothing is overwritten.
    let in_place = path.is_dir() && args.out.is_none();
    if !in_place {
        out_dir::check(&out)?;
    }
    let catalog = super::robot::beside(path, &common.catalog)?;
    let ticker = Ticker::start(&format!("reading {}", path.display()));
    let run = read(&recording_at(path), args.span.span()?, &catalog, |share| {
        ticker.at(share)
    })?;
    // A run that ended before its first sample has a report; a selected part without data has none.
    if args.span.is_cut() && run.samples == 0 && run.estimates.is_empty() && run.loss.is_none() {
        return Err(args.span.nothing(path));
    }
    let known_wall_s = summary_of(path).and_then(|summary| summary.wall_s);
    let mut summary = run.summary();
    summary.wall_s = known_wall_s;
    out_dir::create(&out)?;
    let page = write(&out, &run, &summary, &ticker)?;
    drop(ticker);
    if !in_place {
        write_summary(&out, &summary)?;
    }
    let exit = tell_loss(&run.loss);
    logging::table(&summary, args.format)?;
    logging::note(args.format, &format!("report in {}", page.display()))?;
    Ok(exit)
}

/// Reads a recording; for a simulated run the configuration also gives the truth. `look` is called
/// with the share read so far.
pub(super) fn read(
    recording: &Path,
    span: Span,
    catalog: &Catalog,
    mut look: impl FnMut(f64),
) -> Result<RunData, Failure> {
    let reader = open(recording, span)?;
    let info = reader.info();
    let has_equations = catalog.names().any(|name| name == info.model);
    let simulated = (info.simulated && has_equations).then(|| config_of(info, catalog));
    let node = match simulated
        .transpose()?
        .filter(|config| config.model.definition().hash() == info.model_hash)
    {
        Some(config) => monitor_node(&config, Some(&config.plant.sim)),
        // This program may not have the model of the plant.
        None => MonitorNode::new(info.parameters.clone(), info.derived.clone(), None).of_model(info.model_hash),
    };
    let own = own_config(info, catalog);
    let prediction = own.as_ref().map(input_prediction);
    let notes = notes(info, own.as_ref());
    let run = RunData::new(info.clone(), node).predicting(prediction);
    let mut run = run
        .read(reader, |reader| look(reader.share_read()))
        .map_err(unreadable)?;
    run.notes = notes;
    match run.monitor.foreign_model() {
        Some(_) => Err(foreign::report(&run.info)),
        None => Ok(run),
    }
}

/// The recorded configuration, if this program has its model.
fn own_config(info: &RunInfo, catalog: &Catalog) -> Option<Config> {
    let config = config_of(info, catalog).ok()?;
    (config.model.definition().hash() == info.model_hash).then_some(config)
}

/// Notes on a run, from the recorded configuration and this machine.
pub(super) fn notes(info: &RunInfo, config: Option<&Config>) -> Notes {
    let begun_ns = info
        .recording_id
        .split_once('-')
        .and_then(|(ns, _)| ns.parse::<u64>().ok());
    let meanings = config.map_or_else(Vec::new, |config| {
        let plant = config.model.definition();
        let parameters = plant.parameters.iter().map(|p| p.meaning.to_string());
        parameters
            .chain(plant.derived.iter().map(|d| d.meaning.to_string()))
            .collect()
    });
    let bounds = config.map_or_else(Vec::new, |config| {
        let priors = config.estimator.options.parameters.iter();
        priors.map(|prior| (prior.lower, prior.upper)).collect()
    });
    Notes {
        meanings,
        bounds,
        whitened: config.is_some_and(|config| matches!(config.identifier.rows, RowForm::Projected(_))),
        begun: begun_ns.map_or_else(String::new, |ns| out_dir::date(ns / 1_000_000_000)),
        host: std::fs::read_to_string("/proc/sys/kernel/hostname")
            .map_or_else(|_| String::new(), |name| name.trim().to_owned()),
    }
}

pub(super) fn open(recording: &Path, span: Span) -> Result<RecordingReader, Failure> {
    RecordingReader::open(recording, span).map_err(unreadable)
}

/// The configuration of a recording.
pub(super) fn config_of(info: &RunInfo, catalog: &Catalog) -> Result<Config, Failure> {
    Ok(Config::load_for(catalog, &[source_of(info)], &[])?)
}

/// The same before overrides.
pub(super) fn source_of(info: &RunInfo) -> Source {
    Source::Recorded {
        name: "the recording's configuration".to_owned(),
        text: info.config_toml.clone(),
    }
}

/// Writes figures and page.
pub(super) fn write(dir: &Path, run: &RunData, summary: &Summary, ticker: &Ticker) -> Result<PathBuf, Failure> {
    ticker.stage("drawing the figures");
    write_report(dir, run, summary, |share| ticker.at(share)).map_err(|e| {
        Failure::Failed(format!(
            "the report cannot be written into {}: {e}",
            whole(dir).display()
        ))
    })
}

/// Exit code of a program that read this recording; warns if something was lost.
pub(super) fn tell_loss(loss: &Loss) -> Exit {
    if loss.is_none() {
        return Exit::Done;
    }
    tracing::warn!("the recording is not complete: {loss}");
    Exit::DataLoss
}

pub(super) fn unreadable(error: ReadError) -> Failure {
    match error {
        ReadError::NotARecording { .. } => Failure::Usage(error.to_string()),
        ReadError::Io { ref source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            Failure::Usage(error.to_string())
        }
        ReadError::Io { .. } => Failure::Failed(error.to_string()),
    }
}

fn summary_of(dir: &Path) -> Option<Summary> {
    let text = std::fs::read_to_string(dir.join(SUMMARY_JSON)).ok()?;
    serde_json::from_str(&text).ok()
}
