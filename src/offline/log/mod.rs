//! Reads a log file as a stream of samples: columns by name, units by configuration, bad rows
//! counted with their first line.
//!
//! A row becomes a sample with the row's time to the nanosecond; its `seq` is this time in sample
//! periods, rounded, so a gap in the log is a gap in `seq`, as if the samples had been lost on a
//! bus. Invalid rows are skipped and counted, with the line of the first:
//!
//! | row | result |
//! |---|---|
//! | too few or too many fields, no number, a truncated last line | refused |
//! | NaN or infinite, or more than 300 years from the first | refused |
//! | same time as the row before, or less than half a period from it and in the same period | duplicate, refused |
//! | earlier than the row before | out of order, refused |
//! | later than most of the rows that follow it | out of order, refused |
//! | more than a quarter of a period off the grid | used at its own time, counted as irregular |
//!
//! Samples keep the times of their rows, and projected rows use those times, not rounded ones. If
//! the average period of consecutive rows differs from the configured one, the summary reports it.
//!
//! A log with another typical period than configured is refused as a whole, and so is one with more
//! than half of its rows refused: neither matches the configuration. Memory does not grow with the
//! log.

mod grid;
mod row;
#[cfg(test)]
mod tests;

use self::grid::{Grid, Refusal};
use self::row::{Row, RowReader};
use super::echo::InputEcho;
use super::lines::Lines;
use super::log_counts::{LOOK, LogCounts};
use super::log_error::LogError;
use super::profile::LogProfile;
use super::sign::InputSign;
use super::suspicion::Suspicion;
use crate::config::LogColumns;
use crate::messages::{Sample, nanoseconds, sample_flags};
use std::collections::VecDeque;
use std::io::Read;

/// Number of later rows used to check whether a row's time is ahead of them.
const JUDGES: usize = 16;
/// Number of consecutive refused rows, in order among themselves, that indicate a second log or a
/// clock that was set.
const RESTART: u32 = 50;

/// Reads the samples of a log, the last one flagged `END`.
pub struct LogReader<R> {
    lines: Lines<R>,
    reader: RowReader,
    grid: Grid,
    /// Rows read ahead, at most [`LOOK`]: at the beginning to find the period, later to detect a
    /// time that is ahead.
    ahead: VecDeque<Row>,
    /// The sample that waits for its successor, because the last one is flagged.
    waiting: Option<Sample>,
    counts: LogCounts,
    profile: LogProfile,
    sign: InputSign,
    /// Unit of the input columns \[SI units\].
    input_unit: f64,
    /// The likely mistake in the first field that is not a number.
    likely: Option<Suspicion>,
    /// Time and number of refused rows that are in order among themselves, and the line of the
    /// first.
    run: Option<(f64, u32, u64)>,
    ended: bool,
}

impl<R: Read> LogReader<R> {
    /// Reads the header and the first rows; `joints` is the model's number of joints, `period_s`
    /// the sample period \[s\].
    ///
    /// # Errors
    /// If columns are missing, rows have another period, or the file is not a log.
    pub fn new(input: R, columns: &LogColumns, joints: usize, period_s: f64) -> Result<Self, LogError> {
        let mut lines = Lines::new(input);
        if !lines.advance()? {
            return Err(LogError::Empty);
        }
        let reader = RowReader::new(lines.line(), lines.number(), columns, joints, period_s)?;
        let mut log = Self {
            lines,
            grid: Grid::new(period_s),
            ahead: VecDeque::with_capacity(LOOK),
            waiting: None,
            counts: LogCounts {
                period_ns: nanoseconds(period_s),
                ..LogCounts::default()
            },
            profile: LogProfile::new(reader.read()),
            reader,
            sign: InputSign::new(joints),
            input_unit: columns.input_unit,
            likely: None,
            run: None,
            ended: false,
        };
        log.look_ahead(LOOK)?;
        log.grid.check_period(&log.ahead, &log.reader)?;
        log.grid.check_first(&mut log.ahead, &mut log.counts);
        Ok(log)
    }

    /// Counts of the rows so far.
    pub fn counts(&self) -> LogCounts {
        self.counts
    }

    /// Ranges and rate of the rows so far.
    pub fn profile(&self) -> &LogProfile {
        &self.profile
    }

    /// Partial correlation of each joint's input with its acceleration, see [`InputSign`].
    pub fn input_correlations(&self) -> Vec<Option<f64>> {
        (0..self.reader.joints())
            .map(|joint| self.sign.correlation(joint))
            .collect()
    }

    /// What each joint's input repeats, see [`InputEcho`].
    pub fn input_echoes(&self) -> Vec<Option<InputEcho>> {
        (0..self.reader.joints())
            .map(|joint| self.sign.echo(joint, self.input_unit))
            .collect()
    }

    /// The likely mistake in the first field that is not a number.
    pub fn likely(&self) -> Option<&Suspicion> {
        self.likely.as_ref()
    }

    /// The next sample; `None` after the one flagged `END`.
    ///
    /// # Errors
    /// If the file cannot be read any further, or most of its rows are invalid.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        // A sample is returned once its successor exists, so that the last one is flagged even if
        // refused rows follow it.
        while let Some((row, seq)) = self.next_on_grid()? {
            let sample = self.sample(&row, seq);
            if let Some(before) = self.waiting.replace(sample) {
                return Ok(Some(before));
            }
        }
        if 2 * self.counts.refused() > self.counts.rows {
            return Err(self.unusable());
        }
        let mut last = self.waiting.take();
        if let Some(last) = &mut last {
            last.flags |= sample_flags::END;
        }
        Ok(last)
    }

    fn sample(&mut self, row: &Row, seq: u64) -> Sample {
        let t_s = self.grid.since_first(row.t_s);
        let t_ns = (t_s * 1e9).round().max(0.0) as u64;
        let sample = Sample::new(1, seq, t_ns, self.reader.joints(), self.reader.signals(), &row.joints);
        let follows = self
            .grid
            .last
            .filter(|(_, last_seq)| last_seq.checked_add(1) == Some(seq));
        self.profile
            .take(&sample, t_s, follows.map(|(last_t_s, _)| row.t_s - last_t_s));
        self.sign.take(&sample);
        self.grid.last = Some((row.t_s, seq));
        sample
    }

    /// The next row that is later than the one before.
    fn next_on_grid(&mut self) -> Result<Option<(Row, u64)>, LogError> {
        loop {
            self.look_ahead(1 + JUDGES)?;
            let Some(row) = self.ahead.pop_front() else {
                return Ok(None);
            };
            let judges = self.ahead.iter().take(JUDGES);
            let seq = match self.grid.place(&row, judges, &mut self.counts) {
                Ok(seq) => seq,
                Err(why) => {
                    if row.t_s < self.grid.before() {
                        self.note_run(&row);
                    }
                    self.refuse(why, row.line)?;
                    continue;
                }
            };
            self.run = None;
            return Ok(Some((row, seq)));
        }
    }

    /// Follows refused rows that are in order among themselves.
    fn note_run(&mut self, row: &Row) {
        let run = match self.run {
            Some((t_s, count, line)) if row.t_s > t_s => (row.t_s, count + 1, line),
            _ => (row.t_s, 1, row.line),
        };
        if run.1 >= RESTART {
            self.profile.restart_line.get_or_insert(run.2);
        }
        self.run = Some(run);
    }

    fn refuse(&mut self, why: Refusal, line: u64) -> Result<(), LogError> {
        let counts = &mut self.counts;
        match why {
            Refusal::Unreadable => counts.unreadable += 1,
            Refusal::NotFinite => counts.not_finite += 1,
            Refusal::Duplicated => counts.duplicated += 1,
            Refusal::OutOfOrder => counts.out_of_order += 1,
        }
        let first = counts.first_refused.get_or_insert(line);
        *first = line.min(*first);
        match counts.rows > LOOK as u64 && 2 * counts.refused() > counts.rows {
            true => Err(self.unusable()),
            false => Ok(()),
        }
    }

    fn unusable(&self) -> LogError {
        let restart = self.profile.restart_line.map(|line| Suspicion::Restarts { line });
        LogError::Unusable {
            counts: Box::new(self.counts),
            likely: self.likely.clone().or(restart).map(Box::new),
        }
    }

    /// Reads until `count` rows wait, or to the end.
    fn look_ahead(&mut self, count: usize) -> Result<(), LogError> {
        while self.ahead.len() < count && !self.ended {
            match self.lines.advance()? {
                false => self.ended = true,
                true => self.take_row()?,
            }
        }
        Ok(())
    }

    fn take_row(&mut self) -> Result<(), LogError> {
        let number = self.counts.rows;
        self.counts.rows += 1;
        let line = self.lines.number();
        match self.reader.parse(self.lines.line(), number, line) {
            Ok(row) if row.is_finite() => self.ahead.push_back(row),
            Ok(_) => self.refuse(Refusal::NotFinite, line)?,
            Err(likely) => {
                if self.counts.unreadable == 0 {
                    self.likely = likely;
                }
                self.refuse(Refusal::Unreadable, line)?;
            }
        }
        Ok(())
    }
}
