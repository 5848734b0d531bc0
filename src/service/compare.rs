//! `thetabus compare`.

use super::{CompareArgs, Exit, Failure, logging};
use crate::compare::results::{Effort, results_document};
use crate::compare::{CompareError, paper};
use crate::config::{ModelConfig, Source};
use crate::runner::Shutdown;
use std::time::Duration;

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::Usage(error.to_string())
    }
}

/// Puts estimators side by side on the configured run and writes the tables; a signal ends it and nothing is written.
///
/// # Errors
/// The configuration is wrong or gives nothing to compare, a signal came, or the file cannot be written.
pub fn run(args: &CompareArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let config = args.common.load(vec![Source::File(args.file.clone())], &[])?;
    if !matches!(config.model, ModelConfig::Manipulator { .. }) {
        return Err(Failure::Usage(format!(
            "compare runs the simulated arm: expected model.kind = \"manipulator\" without a delay, got {}",
            config.model.name()
        )));
    }
    let (paper, seeds) = (args.paper, args.seeds);
    // The tables take minutes and know nothing of signals; the process ends and takes their thread along.
    let work = std::thread::spawn(move || {
        let (sim, estimator) = (&config.plant.sim, &config.estimator);
        if paper {
            return paper::paper_document(sim, &estimator.options, seeds);
        }
        let effort = Effort {
            seeds,
            calibration_runs: 10 * seeds,
        };
        results_document(sim, estimator.block_len, &estimator.options, effort)
    });
    while !work.is_finished() {
        if shutdown.requested() {
            return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let document = work
        .join()
        .map_err(|_| Failure::Failed("the comparison broke off, see above".to_owned()))??;
    let text = if args.json {
        serde_json::to_string_pretty(&document).map_err(|error| Failure::Failed(error.to_string()))? + "\n"
    } else {
        document.markdown(&command(args))
    };
    match &args.out {
        None => logging::result(text.trim_end()),
        Some(file) => {
            std::fs::write(file, text).map_err(|error| Failure::Failed(format!("{}: {error}", file.display())))?;
            logging::result(&format!("{}: written", file.display()));
        }
    }
    Ok(Exit::Done)
}

/// The command that makes the document again.
fn command(args: &CompareArgs) -> String {
    let mut words = vec![
        "cargo run --release -- compare".to_owned(),
        args.file.display().to_string(),
    ];
    if args.paper {
        words.push("--paper".to_owned());
    }
    if args.seeds != 20 {
        words.push(format!("--seeds {}", args.seeds));
    }
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
