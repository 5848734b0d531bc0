//! A log file as a stream of samples: columns by name, units by configuration, every bad row counted with its line.
//!
//! Rows become samples whose `seq` is their time in sample periods, rounded, so that a hole in the log is a hole in `seq`, as if the samples had been
//! lost on a bus. What cannot be a sample is skipped, counted, and remembered with its first line:
//!
//! | row | what becomes of it |
//! |---|---|
//! | too few or too many fields, no number, a truncated last line | refused |
//! | NaN or infinite | refused |
//! | the time of the row before, or of the same period | duplicate, refused |
//! | earlier than the row before | out of order, refused |
//! | more than a quarter of a period off the grid | used, counted as irregular |
//!
//! A log whose rows are typically another period apart than configured is refused as a whole, and so is one of which more than half
//! the rows are refused: neither is what the configuration says it is.

use crate::config::LogColumns;
use crate::messages::{Sample, sample_flags, signals};
use crate::model::{JointSample, MAX_JOINTS};
use std::io::Read;

/// Rows that are looked at to tell the period of a log.
const LOOK: usize = 200;

/// How many rows of each kind, and the line of the first one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LogCounts {
    /// Rows of data read.
    pub rows: u64,
    /// Rows with the wrong number of fields, or a field that is no number.
    pub unreadable: u64,
    /// Rows with NaN or an infinity.
    pub not_finite: u64,
    /// Rows of the same sample period as the row before.
    pub duplicated: u64,
    /// Rows that are earlier than the row before.
    pub out_of_order: u64,
    /// Rows that were used though they are more than a quarter of a period off the grid.
    pub irregular: u64,
    /// Line of the first refused row.
    pub first_refused: Option<u64>,
    /// Line of the first irregular row.
    pub first_irregular: Option<u64>,
}

impl LogCounts {
    /// Rows that gave no sample.
    pub fn refused(&self) -> u64 {
        self.unreadable + self.not_finite + self.duplicated + self.out_of_order
    }
}

impl std::fmt::Display for LogCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} rows", self.rows)?;
        let kinds = [
            (self.unreadable, "unreadable"),
            (self.not_finite, "not finite"),
            (self.duplicated, "duplicated"),
            (self.out_of_order, "out of order"),
        ];
        for (count, what) in kinds.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {what}")?;
        }
        if let Some(line) = self.first_refused {
            write!(f, " (the first in line {line})")?;
        }
        if let Some(line) = self.first_irregular {
            write!(f, ", {} irregularly timed (the first in line {line})", self.irregular)?;
        }
        Ok(())
    }
}

/// A log that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A column that the configuration names is not there.
    #[error("{key}: expected a column out of {columns}, got \"{name}\"")]
    Column {
        /// Key of the configuration.
        key: &'static str,
        /// Name that it gives.
        name: String,
        /// Names that the file has.
        columns: String,
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
    #[error("rows are {got_s} s apart by the column \"{column}\", but plant.sample_period_s is {expected_s} s")]
    Period {
        /// Column of the time.
        column: String,
        /// Median distance of the first rows \[s\].
        got_s: f64,
        /// Configured period \[s\].
        expected_s: f64,
    },
    /// Most rows cannot be read.
    #[error("expected a log of numbers, got {counts}")]
    Unusable {
        /// What came.
        counts: LogCounts,
    },
    /// The file cannot be read.
    #[error("line {line}: {source}")]
    Read {
        /// Line where reading stopped.
        line: u64,
        /// Why.
        source: csv::Error,
    },
}

/// A row of the file that is a sample but for its `seq`.
#[derive(Debug, Clone, Copy)]
struct Row {
    line: u64,
    t_s: f64,
    joints: JointSample,
}

/// Where each signal stands.
#[derive(Debug, Clone)]
struct Places {
    fields: usize,
    time: Option<usize>,
    q: Vec<usize>,
    input: Vec<usize>,
    setpoint: Vec<usize>,
}

/// Gives the samples of a log, the last one flagged `END`.
pub struct LogReader<R> {
    reader: csv::Reader<R>,
    record: csv::StringRecord,
    columns: LogColumns,
    places: Places,
    period_s: f64,
    /// Rows read ahead, to know the period and the last row.
    ahead: std::collections::VecDeque<Row>,
    first_t_s: Option<f64>,
    last: Option<(f64, u64)>,
    counts: LogCounts,
    ended: bool,
}

impl<R: Read> LogReader<R> {
    /// Reads the header and the first rows; `joints` is the model's number of joints, `period_s` the sample period \[s\].
    ///
    /// # Errors
    /// Columns that are not there, rows at another period, or a file that is no log.
    pub fn new(input: R, columns: &LogColumns, joints: usize, period_s: f64) -> Result<Self, LogError> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .flexible(true)
            .from_reader(input);
        let header = reader
            .headers()
            .map_err(|source| LogError::Read { line: 1, source })?
            .clone();
        if header.is_empty() {
            return Err(LogError::Empty);
        }
        let find = |key: &'static str, name: &String| {
            header
                .iter()
                .position(|column| column == name)
                .ok_or_else(|| LogError::Column {
                    key,
                    name: name.clone(),
                    columns: header.iter().map(|c| format!("\"{c}\"")).collect::<Vec<_>>().join(", "),
                })
        };
        let per_joint = |key: &'static str, names: &[String], may_be_none: bool| {
            if names.len() != joints.min(MAX_JOINTS) && !(may_be_none && names.is_empty()) {
                return Err(LogError::Columns {
                    key,
                    expected: joints,
                    got: names.len(),
                });
            }
            names.iter().map(|name| find(key, name)).collect::<Result<Vec<_>, _>>()
        };
        let places = Places {
            fields: header.len(),
            time: columns.time.as_ref().map(|name| find("log.time", name)).transpose()?,
            q: per_joint("log.q", &columns.positions, false)?,
            input: per_joint("log.input", &columns.inputs, false)?,
            setpoint: per_joint("log.setpoint", &columns.setpoints, true)?,
        };
        let mut log = Self {
            reader,
            record: csv::StringRecord::new(),
            columns: columns.clone(),
            places,
            period_s,
            ahead: std::collections::VecDeque::new(),
            first_t_s: None,
            last: None,
            counts: LogCounts::default(),
            ended: false,
        };
        log.look_ahead(LOOK)?;
        log.check_period()?;
        Ok(log)
    }

    /// What was read so far.
    pub fn counts(&self) -> LogCounts {
        self.counts
    }

    /// The next sample; `None` after the one flagged `END`.
    ///
    /// # Errors
    /// The file cannot be read any further, or most of it is no log.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        let Some((row, seq)) = self.next_on_grid()? else {
            return Ok(None);
        };
        let mut carried = signals::Q | signals::INPUT;
        if !self.places.setpoint.is_empty() {
            carried |= signals::SETPOINT;
        }
        let first = self.first_t_s.unwrap_or(row.t_s);
        let t_ns = ((row.t_s - first) * 1e9).round().max(0.0) as u64;
        let mut sample = Sample::new(1, seq, t_ns, self.places.q.len(), carried, &row.joints);
        // the last row that counts: nothing but refused rows may follow
        let mut later = 0;
        loop {
            self.look_ahead(later + 1)?;
            match self.ahead.get(later) {
                None => {
                    sample.flags |= sample_flags::END;
                    break;
                }
                Some(next) if self.seq_of(next) > seq && next.t_s > row.t_s => break,
                Some(_) => later += 1,
            }
        }
        if self.counts.rows > LOOK as u64 && 2 * self.counts.refused() > self.counts.rows {
            return Err(LogError::Unusable { counts: self.counts });
        }
        Ok(Some(sample))
    }

    fn seq_of(&self, row: &Row) -> u64 {
        let first = self.first_t_s.unwrap_or(row.t_s);
        ((row.t_s - first) / self.period_s).round().max(0.0) as u64
    }

    /// The next row that is later than the one before by a period or more.
    fn next_on_grid(&mut self) -> Result<Option<(Row, u64)>, LogError> {
        loop {
            self.look_ahead(1)?;
            let Some(row) = self.ahead.pop_front() else {
                return Ok(None);
            };
            self.first_t_s.get_or_insert(row.t_s);
            let seq = self.seq_of(&row);
            if let Some((last_t_s, last_seq)) = self.last {
                if row.t_s < last_t_s {
                    self.counts.out_of_order += 1;
                    self.counts.first_refused.get_or_insert(row.line);
                    continue;
                }
                if seq == last_seq {
                    self.counts.duplicated += 1;
                    self.counts.first_refused.get_or_insert(row.line);
                    continue;
                }
            }
            let first = self.first_t_s.unwrap_or(row.t_s);
            if ((row.t_s - first) / self.period_s - seq as f64).abs() > 0.25 {
                self.counts.irregular += 1;
                self.counts.first_irregular.get_or_insert(row.line);
            }
            self.last = Some((row.t_s, seq));
            return Ok(Some((row, seq)));
        }
    }

    /// Reads until so many rows wait, or to the end.
    fn look_ahead(&mut self, count: usize) -> Result<(), LogError> {
        while self.ahead.len() < count && !self.ended {
            let line = self.reader.position().line();
            match self.reader.read_record(&mut self.record) {
                Ok(false) => self.ended = true,
                Ok(true) => self.take_row(),
                // a row that is no text is a bad row, a file that cannot be read is the end
                Err(source) if source.is_io_error() => return Err(LogError::Read { line, source }),
                Err(_) => {
                    self.counts.rows += 1;
                    self.counts.unreadable += 1;
                    self.counts.first_refused.get_or_insert(line);
                }
            }
        }
        Ok(())
    }

    fn take_row(&mut self) {
        let number = self.counts.rows;
        self.counts.rows += 1;
        let line = self.record.position().map_or(0, csv::Position::line);
        match self.parse(number, line) {
            Some(row) if row.is_finite() => self.ahead.push_back(row),
            Some(_) => {
                self.counts.not_finite += 1;
                self.counts.first_refused.get_or_insert(line);
            }
            None => {
                self.counts.unreadable += 1;
                self.counts.first_refused.get_or_insert(line);
            }
        }
    }

    fn parse(&self, number: u64, line: u64) -> Option<Row> {
        if self.record.len() != self.places.fields {
            return None;
        }
        let field = |index: usize| self.record.get(index)?.parse::<f64>().ok();
        let t_s = match self.places.time {
            Some(index) => field(index)? * self.columns.time_unit_s,
            None => number as f64 * self.period_s,
        };
        let mut joints = JointSample::default();
        for (joint, &index) in self.places.q.iter().enumerate() {
            joints.q[joint] = field(index)? * self.columns.position_unit;
        }
        for (joint, &index) in self.places.input.iter().enumerate() {
            joints.input[joint] = field(index)? * self.columns.input_unit;
        }
        for (joint, &index) in self.places.setpoint.iter().enumerate() {
            joints.setpoint[joint] = field(index)? * self.columns.position_unit;
        }
        Some(Row { line, t_s, joints })
    }

    /// The median distance of the first rows must be the configured period.
    fn check_period(&self) -> Result<(), LogError> {
        let Some(column) = &self.columns.time else {
            return Ok(());
        };
        let rows = self.ahead.iter();
        let mut steps: Vec<f64> = rows
            .clone()
            .zip(rows.skip(1))
            .map(|(a, b)| b.t_s - a.t_s)
            .filter(|step| *step > 0.0)
            .collect();
        steps.sort_by(f64::total_cmp);
        let Some(&median) = steps.get(steps.len() / 2) else {
            return Ok(());
        };
        if (median / self.period_s - 1.0).abs() > 0.2 {
            return Err(LogError::Period {
                column: column.clone(),
                got_s: (median * 1e9).round() * 1e-9,
                expected_s: self.period_s,
            });
        }
        Ok(())
    }
}

impl Row {
    fn is_finite(&self) -> bool {
        let JointSample { q, input, setpoint, .. } = &self.joints;
        self.t_s.is_finite() && q.iter().chain(input).chain(setpoint).all(|v| v.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(time: bool) -> LogColumns {
        LogColumns {
            time: time.then(|| "t".to_owned()),
            time_unit_s: 1e-3,
            positions: vec!["x".to_owned()],
            position_unit: 1e-3,
            inputs: vec!["u".to_owned()],
            input_unit: 2.0,
            setpoints: Vec::new(),
        }
    }

    fn read(text: &str, time: bool) -> Result<(Vec<Sample>, LogCounts), LogError> {
        let mut log = LogReader::new(text.as_bytes(), &columns(time), 1, 1e-3)?;
        let mut samples = Vec::new();
        while let Some(sample) = log.next_sample()? {
            samples.push(sample);
        }
        Ok((samples, log.counts()))
    }

    #[test]
    fn val_columns_are_found_by_name_and_brought_to_si_units() {
        let (samples, counts) = read("u, other, x, t\n1.5, a, 2000, 10\n2.5, b, 3000, 11\n", true).unwrap();
        assert_eq!((samples.len(), counts.refused()), (2, 0));
        assert_eq!((samples[0].q[0], samples[0].input[0]), (2.0, 3.0));
        assert_eq!(samples.iter().map(|s| s.seq).collect::<Vec<_>>(), [0, 1]);
        assert_eq!((samples[1].t_ns, samples[1].joints), (1_000_000, 1));
        assert_eq!(samples[1].signals, signals::Q | signals::INPUT);
        assert!(samples[1].is_end() && !samples[0].is_end());
    }

    #[test]
    fn fault_bad_rows_are_counted_with_their_line_and_leave_holes() {
        // (what stands between good rows 0..5 and 6..10, in periods; expected counts; seqs; line of the first refused row)
        type Check = fn(&LogCounts) -> u64;
        let cases: [(&str, &str, Check); 6] = [
            ("ragged", "5,1", |c| c.unreadable),
            ("no number", "5,1,x", |c| c.unreadable),
            ("not a number", "5,1,NaN", |c| c.not_finite),
            ("infinite", "5,inf,0", |c| c.not_finite),
            ("duplicated", "4,1,0", |c| c.duplicated),
            ("out of order", "2,1,0", |c| c.out_of_order),
        ];
        for (name, bad, count) in cases {
            let mut text = "t,x,u\n".to_owned();
            (0..5).for_each(|k| text.push_str(&format!("{k},1,0\n")));
            text.push_str(&format!("{bad}\n"));
            (6..11).for_each(|k| text.push_str(&format!("{k},1,0\n")));
            let (samples, counts) = read(&text, true).unwrap();
            assert_eq!(
                samples.iter().map(|s| s.seq).collect::<Vec<_>>(),
                [0, 1, 2, 3, 4, 6, 7, 8, 9, 10],
                "{name}"
            );
            assert_eq!((counts.rows, counts.refused(), count(&counts)), (11, 1, 1), "{name}");
            assert_eq!(counts.first_refused, Some(7), "{name}");
            assert!(counts.to_string().contains("line 7"), "{counts}");
        }
    }

    #[test]
    fn fault_the_end_is_flagged_whatever_follows_it() {
        for tail in ["", "3,1", "3,1,NaN\n", "2,1,0\n", "1,1,0\n1,1,0\n"] {
            let (samples, _) = read(&format!("t,x,u\n0,1,0\n1,1,0\n2,1,0\n{tail}"), true).unwrap();
            assert_eq!(samples.len(), 3, "{tail:?}");
            assert!(samples[2].is_end() && !samples[1].is_end(), "{tail:?}");
        }
    }

    #[test]
    fn fault_irregular_times_are_used_and_counted_and_another_period_is_refused() {
        let (samples, counts) = read("t,x,u\n0,1,0\n1.1,1,0\n2.4,1,0\n3,1,0\n", true).unwrap();
        assert_eq!(
            (samples.len(), counts.irregular, counts.first_irregular),
            (4, 1, Some(4))
        );
        let error = read("t,x,u\n0,1,0\n2,1,0\n4,1,0\n", true).err().unwrap().to_string();
        assert!(
            error.contains("0.002 s apart") && error.contains("plant.sample_period_s"),
            "{error}"
        );
    }

    #[test]
    fn fault_a_log_that_is_none_is_refused_with_what_is_missing() {
        let error = read("a,b\n1,2\n", true).err().unwrap().to_string();
        assert!(error.contains("log.time") && error.contains("\"a\", \"b\""), "{error}");
        let garbage: String = (0..2000).map(|k| format!("{},\u{1F600}\n", k % 7)).collect();
        let text = format!("t,x,u\n0,1,0\n1,1,0\n{garbage}");
        assert!(read(&text, true).is_err() || read(&text, true).unwrap().0.len() == 2);
        let mut two = columns(true);
        two.positions.push("y".to_owned());
        let error = LogReader::new("t,x,u\n".as_bytes(), &two, 1, 1e-3).err().unwrap();
        assert!(error.to_string().contains("log.q: expected 1"), "{error}");
        assert_eq!(read("t,x,u\n", true).unwrap().0.len(), 0, "an empty log has no samples");
        let error = read("", true).err().unwrap().to_string();
        assert!(error.contains("got an empty file"), "{error}");
    }

    #[test]
    fn val_without_a_time_column_rows_follow_at_the_period_and_bad_ones_leave_holes() {
        let (samples, counts) = read("x,u\n1,0\nbad,0\n1,0\n", false).unwrap();
        assert_eq!(samples.iter().map(|s| s.seq).collect::<Vec<_>>(), [0, 2]);
        assert_eq!((counts.unreadable, counts.first_refused), (1, Some(3)));
    }
}
