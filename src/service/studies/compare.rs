//! `studies compare`.

use super::{CompareArgs, output};
use crate::config::{Config, Source};
use crate::messages::{Sample, nanoseconds};
use crate::model::MANIPULATOR_PARAMS;
use crate::node::plant::PlantNode;
use crate::recording::{Entry, Span};
use crate::rows::RowForm;
use crate::runner::Shutdown;
use crate::service::record::recorder;
use crate::service::ticker::Ticker;
use crate::service::wiring::{identifier_node, monitor_node};
use crate::service::{Exit, Failure, TableFormat, report};
use crate::sim::{MachineSimulator, SensorOptions, SimOptions};
use crate::studies::encoder::encoder_document;
use crate::studies::results::results_document;
use crate::studies::{CompareError, Effort, EncoderSetup, Section, Table, paper, two_digits};
use std::path::Path;
use std::time::{Duration, Instant};

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::Usage(error.to_string())
    }
}

/// Compares estimators on the configured run and writes the tables; a signal ends it and nothing is
/// written.
///
/// # Errors
/// If the configuration is wrong or gives nothing to compare, a signal arrives, or the file cannot
/// be written.
pub fn run(args: &CompareArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let config = args.common.load(vec![Source::File(args.file.clone())], &[])?;
    if config.model.name() != "manipulator" || config.model.parameters().len() != MANIPULATOR_PARAMS {
        return Err(Failure::Usage(format!(
            "compare runs the simulated arm: expected model.kind = \"manipulator\" without a delay or other terms, got {}",
            config.model.name()
        )));
    }
    let (paper, seeds) = (args.paper, args.seeds);
    let recording = args.recording.as_deref().map(positions_and_voltages).transpose()?;
    // The tables take minutes and do not check for signals; ending the process ends their thread.
    let work = std::thread::spawn(move || {
        let (sim, estimator) = (&config.plant.sim, &config.estimator);
        if paper {
            return paper::paper_document(sim, &estimator.options, seeds);
        }
        let effort = Effort {
            seeds,
            calibration_runs: 10 * seeds,
        };
        if let RowForm::Projected(rows) = config.identifier.rows {
            let setup = EncoderSetup {
                sim: sim.clone(),
                rows,
                options: estimator.options.clone(),
                block_len: estimator.block_len,
            };
            return encoder_document(&setup, effort);
        }
        let mut document = results_document(
            sim,
            estimator.block_len,
            &estimator.options,
            effort,
            recording.as_deref(),
        )?;
        match recording_section(&config) {
            Ok(section) => document.sections.push(section),
            Err(error) => tracing::warn!("what a recording costs is left out: {error}"),
        }
        Ok(document)
    });
    let ticker = Ticker::start(&format!("comparing estimators on {}", args.file.display()));
    while !work.is_finished() {
        if shutdown.requested() {
            return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let document = work
        .join()
        .map_err(|_| Failure::Failed("the comparison broke off, see above".to_owned()))??;
    drop(ticker);
    let text = if args.format == TableFormat::Json {
        serde_json::to_string_pretty(&document).map_err(|error| Failure::Failed(error.to_string()))? + "\n"
    } else {
        document.markdown(&command(args))
    };
    output::write(args.out.as_deref(), &text)?;
    Ok(Exit::Done)
}

/// Cost of recording the configured run, with a file in the system's temporary directory.
fn recording_section(config: &Config) -> Result<Section, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Failed(e.to_string());
    let sim = &config.plant.sim;
    let path = std::env::temp_dir().join(format!("thetabus-cost-{}.mcap", std::process::id()));
    let mut table = Table::new(&["samples", "bytes a sample", "to write", "to read and identify"]);
    for (name, sensors) in [
        ("all six signals, exact", SensorOptions::exact()),
        (
            "position, setpoint, input; 16 bits, 0.05 V of noise",
            SensorOptions::encoder(16, 0.05),
        ),
    ] {
        let sim = SimOptions { sensors, ..sim.clone() };
        let count = sim.sample_count();
        let simulator = MachineSimulator::new(&sim).map_err(|e| failed(&e))?;
        let period_ns = nanoseconds(sim.sample_period_s);
        let mut plant = PlantNode::new(simulator, 1, sim.joints(), sim.signals(), period_ns, count);
        let samples: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).collect();
        let start = Instant::now();
        let mut recorder = recorder(&path, config, &monitor_node(config, None), true, false)?;
        for sample in &samples {
            recorder.sample(sample, 0).map_err(|e| failed(&e))?;
        }
        recorder.finish().map_err(|e| failed(&e))?;
        let wrote_s = start.elapsed().as_secs_f64();
        let bytes = std::fs::metadata(&path).map_err(|e| failed(&e))?.len();
        let mut node = identifier_node(config)?;
        let start = Instant::now();
        let mut reader = report::open(&path, Span::default())?;
        while let Some(entry) = reader.next_entry().map_err(report::unreadable)? {
            if let Entry::Sample { sample, .. } = entry {
                node.on_sample(sample, &mut |_| {});
            }
        }
        let read_s = start.elapsed().as_secs_f64();
        std::fs::remove_file(&path).map_err(|e| failed(&e))?;
        let each = |seconds: f64| format!("{} ns", two_digits(seconds / samples.len() as f64 * 1e9));
        table.push(vec![
            name.to_owned(),
            two_digits(bytes as f64 / samples.len() as f64),
            each(wrote_s),
            each(read_s),
        ]);
    }
    Ok(Section {
        heading: "Recording".to_owned(),
        text: vec![
            "The configured run as MCAP with lz4 chunks, each sample with its time, masks and signals. The configured estimator needs all signals, so the second line \
             is for reading only."
                .to_owned(),
        ],
        table,
    })
}

/// The columns `q_m` and `voltage_v` of a CSV file.
fn positions_and_voltages(file: &Path) -> Result<Vec<(f64, f64)>, Failure> {
    let wrong = |what: String| Failure::Usage(format!("{}: {what}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|error| wrong(error.to_string()))?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let column = |name: &str| {
        let found = head.iter().position(|&h| h == name);
        found.ok_or_else(|| {
            wrong(format!(
                "expected the columns q_m and voltage_v, got {}",
                head.join(", ")
            ))
        })
    };
    let (q, voltage) = (column("q_m")?, column("voltage_v")?);
    lines
        .enumerate()
        .map(|(row, line)| {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |at: usize| fields.get(at).and_then(|field| field.trim().parse::<f64>().ok());
            let pair = number(q).zip(number(voltage));
            pair.filter(|(q, voltage)| q.is_finite() && voltage.is_finite())
                .ok_or_else(|| wrong(format!("line {}: expected numbers, got {line}", row + 2)))
        })
        .collect()
}

/// The command that generates the document.
fn command(args: &CompareArgs) -> String {
    let mut words = vec![output::command("compare"), args.file.display().to_string()];
    if args.paper {
        words.push("--paper".to_owned());
    }
    if args.seeds != 20 {
        words.push(format!("--seeds {}", args.seeds));
    }
    if let Some(file) = &args.recording {
        // only the file name, because the directory is the user's
        let name = file.file_name().unwrap_or(file.as_os_str());
        words.push(format!("--recording {}", name.to_string_lossy()));
    }
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
