//! What is wrong with a robot's log: rows that are no samples, how many of each kind, and the first
//! one.

use std::fmt;

/// What is wrong with a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogError {
    /// Line, counted from 1; `None` for the columns that were asked for.
    pub line: Option<usize>,
    /// What is expected and what is there.
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

/// Why a row is no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Skip {
    /// Too few fields, or one that is no number.
    Unreadable,
    /// A field that is empty, NaN or infinite.
    NotFinite,
    /// Its time is not after that of the row before.
    NotLater,
}

/// Rows that gave no sample, of a log that is of use without them.
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
    /// Counts one.
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

    /// How many.
    pub fn count(&self) -> usize {
        self.unreadable + self.not_finite + self.not_later
    }

    /// After the last row.
    ///
    /// # Errors
    /// Half of the rows or more are no samples: the log is not what the configuration says it is.
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
