//! Errors of a robot's log: rows without a sample, counted by kind, and the first one.

use super::state::RobotSample;
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

/// Takes the samples of a log in the order of their times; skips a row that is not later than the
/// one before, or, if the two behind a row are earlier than it, that row instead of all behind it.
#[derive(Debug, Default)]
pub(crate) struct InOrder {
    /// The samples so far.
    pub samples: Vec<RobotSample>,
    /// Line of the last sample.
    line: usize,
    /// The row skipped last, if nothing was taken since, with its line.
    skipped: Option<(RobotSample, usize)>,
}

impl InOrder {
    /// Takes the sample of a row, or skips and counts it.
    pub fn take(&mut self, sample: RobotSample, line: usize, counts: &mut SkippedRows) {
        let last = self.samples.last().map(|last| last.t_s);
        let Some(last_s) = last.filter(|last_s| sample.t_s <= *last_s) else {
            self.skipped = None;
            return self.push(sample, line);
        };
        let before_s = self.samples.iter().rev().nth(1).map(|before| before.t_s);
        let follows = |(other, _): &(RobotSample, usize)| {
            other.t_s < sample.t_s && before_s.is_none_or(|before_s| before_s < other.t_s)
        };
        match self.skipped.take_if(|other| follows(other)) {
            Some((other, other_line)) => {
                self.samples.pop();
                let ahead_line = std::mem::replace(&mut self.line, other_line);
                // The row that is ahead is counted instead of the one that was.
                if let Some(first) = counts.first.as_mut().filter(|first| first.line == Some(other_line)) {
                    *first = LogError {
                        line: Some(ahead_line),
                        problem: format!(
                            "expected a time before those of the next rows, {} s and {} s, got {last_s} s",
                            other.t_s, sample.t_s
                        ),
                    };
                }
                self.samples.push(other);
                self.push(sample, line);
            }
            None => {
                counts.skip(Skip::NotLater, line, || {
                    format!("expected a time after {last_s} s, got {} s", sample.t_s)
                });
                self.skipped = Some((sample, line));
            }
        }
    }

    fn push(&mut self, sample: RobotSample, line: usize) {
        self.samples.push(sample);
        self.line = line;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(times: &[f64]) -> (Vec<f64>, SkippedRows) {
        let (mut log, mut skipped) = (InOrder::default(), SkippedRows::default());
        for (line, t_s) in (1..).zip(times) {
            let sample = RobotSample {
                t_s: *t_s,
                ..RobotSample::default()
            };
            log.take(sample, line, &mut skipped);
        }
        (log.samples.iter().map(|sample| sample.t_s).collect(), skipped)
    }

    #[test]
    fn fault_a_wrong_time_costs_its_own_row_and_no_other() {
        let cases: [(&[f64], &[f64], usize); 8] = [
            (&[1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], 0),
            // repeated, late, ahead
            (&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0], 3),
            (&[1.0, 2.0, 3.0, 2.5, 4.0], &[1.0, 2.0, 3.0, 4.0], 4),
            (&[1.0, 2.0, 9e9, 3.0, 4.0, 5.0], &[1.0, 2.0, 3.0, 4.0, 5.0], 3),
            (&[9e9, 1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], 1),
            (&[1.0, 9e9, 2.0, 3.0, 2.0, 4.0], &[1.0, 2.0, 3.0, 4.0], 2),
            // a second log behind the first, and one that runs backwards
            (&[1.0, 2.0, 3.0, 1.0, 2.0, 3.0], &[1.0, 2.0, 3.0], 4),
            (&[3.0, 2.0, 1.0], &[3.0], 2),
        ];
        for (times, kept, first) in cases {
            let (got, skipped) = taken(times);
            assert_eq!(got, kept, "{times:?}");
            assert_eq!(skipped.count(), times.len() - kept.len(), "{times:?}");
            assert_eq!(
                skipped.first.and_then(|first| first.line).unwrap_or(0),
                first,
                "{times:?}"
            );
        }
    }
}
