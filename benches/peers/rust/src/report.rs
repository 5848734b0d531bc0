//! Files for the other programs, and the line of an estimator.

use crate::Failure;
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Each estimator runs so often; its fastest run counts, because the rest is other people's work.
const REPETITIONS: usize = 15;
/// The parameters that the motion tells to 1 %: θ₂, θ₅, θ₇, θ₈, θ₉.
const TOLD: [usize; 5] = [1, 4, 6, 7, 8];

/// Writes rows of numbers under a line of names.
pub fn write(folder: &Path, name: &str, head: &str, rows: impl Iterator<Item = Vec<f64>>) -> Result<(), Failure> {
    let mut text = format!("{head}\n");
    for row in rows {
        for (i, value) in row.iter().enumerate() {
            write!(text, "{}{value:?}", if i > 0 { "," } else { "" })?;
        }
        text.push('\n');
    }
    Ok(std::fs::write(folder.join(name), text)?)
}

/// The fastest run of `work` \[s\] and what it gave.
pub fn fastest<T>(mut work: impl FnMut() -> T) -> (f64, T) {
    let mut timed = || {
        let start = Instant::now();
        let result = black_box(work());
        (start.elapsed().as_secs_f64(), result)
    };
    (1..REPETITIONS).fold(timed(), |best, _| {
        let next = timed();
        if next.0 < best.0 { next } else { best }
    })
}

/// Prints a line; `errors` are relative, and the worst and the median are shown.
pub fn line(job: &str, name: &str, count: usize, seconds: f64, mut errors: Vec<f64>) {
    errors.sort_by(f64::total_cmp);
    println!(
        "{job},\"{name}\",{count},{:.4},{:.4e},{:.4e}",
        seconds / count as f64 * 1e9,
        errors[errors.len() - 1],
        errors[errors.len() / 2]
    );
}

/// Runs an estimator of θ and prints its line.
pub fn report(job: &str, name: &str, count: usize, truth: &[f64], work: impl FnMut() -> Vec<f64>) {
    let (seconds, theta) = fastest(work);
    let errors = TOLD.iter().map(|&i| (theta[i] / truth[i] - 1.0).abs()).collect();
    line(job, name, count, seconds, errors);
}
