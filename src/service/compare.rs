//! `thetabus compare`.

use super::{CompareArgs, Exit, Failure, logging};
use crate::compare::results::{Effort, results_document};
use crate::compare::{CompareError, paper};
use crate::config::Source;

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Self {
        Self::Usage(error.to_string())
    }
}

/// Puts estimators side by side on the configured run and writes the tables.
///
/// # Errors
/// The configuration is wrong or gives nothing to compare, or the file cannot be written.
pub fn run(args: &CompareArgs) -> Result<Exit, Failure> {
    let config = args.common.load(vec![Source::File(args.file.clone())], &[])?;
    let (sim, estimator) = (&config.plant.sim, &config.estimator);
    let document = if args.paper {
        paper::paper_document(sim, &estimator.options, args.seeds)?
    } else {
        let effort = Effort {
            seeds: args.seeds,
            calibration_runs: 10 * args.seeds,
        };
        results_document(sim, estimator.block_len, &estimator.options, effort)?
    };
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
