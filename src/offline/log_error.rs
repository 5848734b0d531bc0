//! Why a log cannot be used, with the likely mistake.

use super::lines::LineError;
use super::log_counts::LogCounts;
use super::suspicion::Suspicion;

/// Longest part of names and fields shown in an error \[characters\].
const SHOWN: usize = 40;
/// Largest number of columns listed in an error.
const LISTED: usize = 30;

/// A log that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A column named in the configuration is missing.
    #[error("{key}: expected a column out of {columns}, got \"{name}\"{}", hint(.likely))]
    Column {
        /// Key of the configuration.
        key: &'static str,
        /// The configured name.
        name: String,
        /// Names in the file, as many as can be listed.
        columns: String,
        /// The likely mistake.
        likely: Option<Box<Suspicion>>,
    },
    /// A column named in the configuration occurs twice.
    #[error(
        "{key}: the header has the column \"{name}\" twice, as columns {first} and {second}: give each a name of its own"
    )]
    Twice {
        /// Key of the configuration.
        key: &'static str,
        /// The configured name.
        name: String,
        /// The first of them, counted from 1.
        first: usize,
        /// The other one.
        second: usize,
    },
    /// The header is not valid text.
    #[error(
        "line {line}: expected a header with the names of the columns as UTF-8 text, got other bytes or a quote that is not closed"
    )]
    Header {
        /// Its line.
        line: u64,
    },
    /// The configuration does not name one column per joint.
    #[error(
        "{key}: expected {expected} column name(s), one per joint, got {got}; section [log] of the configuration names them"
    )]
    Columns {
        /// Key of the configuration.
        key: &'static str,
        /// Number of joints.
        expected: usize,
        /// Names given.
        got: usize,
    },
    /// Not even a header.
    #[error("expected a header with the names of the columns, got an empty file")]
    Empty,
    /// The rows are another period apart.
    #[error("rows are {got_s} s apart by the column \"{column}\", but plant.sample_period_s is {expected_s} s{}", hint(.likely))]
    Period {
        /// Column of the time.
        column: String,
        /// Median distance of the first rows \[s\].
        got_s: f64,
        /// Configured period \[s\].
        expected_s: f64,
        /// The likely mistake.
        likely: Option<Box<Suspicion>>,
    },
    /// Most rows are earlier than the one before.
    #[error(
        "the column \"{column}\" runs backwards: {back} of the first {steps} rows are earlier than the row before; sort the rows by time"
    )]
    Backwards {
        /// Column of the time.
        column: String,
        /// Number of such rows.
        back: usize,
        /// Number of rows that have one before them.
        steps: usize,
    },
    /// Most rows cannot be used.
    #[error("expected a log of numbers, got {counts}{}", hint(.likely))]
    Unusable {
        /// The counts of rows.
        counts: Box<LogCounts>,
        /// The likely mistake.
        likely: Option<Box<Suspicion>>,
    },
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] LineError),
}

fn hint(likely: &Option<Box<Suspicion>>) -> String {
    likely.as_ref().map_or(String::new(), |likely| format!("; {likely}"))
}

/// At most [`SHOWN`] characters.
pub(super) fn cut(text: &str) -> String {
    crate::words::cut(text, SHOWN)
}

/// Names in quotes, as many as a message can show.
pub(super) fn listed(names: &[&str]) -> String {
    let shown = names.iter().take(LISTED).map(|name| format!("\"{}\"", cut(name)));
    let shown = shown.collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(LISTED).filter(|more| *more > 0) {
        Some(more) => format!("{shown} and {more} more"),
        None => shown,
    }
}
