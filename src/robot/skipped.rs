//! Errors of a robot's log: rows without a sample, counted by kind, and the first one.

use std::fmt;

/// An error of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogError {
    /// Line, counted from 1; `None` for an error of the columns.
    pub line: Option<usize>,
    /// What was expected and what was found.
    pub problem: String,
}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "line {line}: {}", self.problem),
            None => f.write_str(&self.problem),
        }
    }
}

impl std::error::Error for LogError {}

/// Why a row was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Skip {
    /// Too few fields, or one that is not a number.
    Unreadable,
    /// A field that is empty, NaN or infinite.
    NotFinite,
    /// Its time is not after that of the row before.
    NotLater,
}

/// Rows without a sample, of a log that is usable without them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SkippedRows {
    /// All rows with data.
    pub rows: usize,
    /// See [`Skip`].
    pub unreadable: usize,
    /// See [`Skip`].
    pub not_finite: usize,
    /// See [`Skip`].
    pub not_later: usize,
    /// Line and problem of the first one.
    pub first: Option<LogError>,
}

impl SkippedRows {
    /// Counts a skipped row.
    pub fn skip(&mut self, why: Skip, line: usize, problem: impl FnOnce() -> String) {
        *match why {
            Skip::Unreadable => &mut self.unreadable,
            Skip::NotFinite => &mut self.not_finite,
            Skip::NotLater => &mut self.not_later,
        } += 1;
        self.first.get_or_insert_with(|| LogError {
            line: Some(line),
            problem: problem(),
        });
    }

    /// Number of skipped rows.
    pub fn count(&self) -> usize {
        self.unreadable + self.not_finite + self.not_later
    }

    /// Call this after the last row.
    ///
    /// # Errors
    /// If half of the rows or more were skipped: the log does not match the configuration.
    pub fn check(&self) -> Result<(), LogError> {
        match &self.first {
            Some(first) if 2 * self.count() >= self.rows => Err(LogError {
                line: first.line,
                problem: match self.count() {
                    1 => first.problem.clone(),
                    count => format!("{}; {count} of {} rows are no samples", first.problem, self.rows),
                },
            }),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for SkippedRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} rows are skipped", self.count(), self.rows)?;
        let kinds = [
            (self.unreadable, "unreadable"),
            (self.not_finite, "not finite"),
            (self.not_later, "not later than the row before"),
        ];
        for (count, what) in kinds.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {what}")?;
        }
        match &self.first {
            Some(first) => write!(f, "; the first is {first}"),
            None => Ok(()),
        }
    }
}
