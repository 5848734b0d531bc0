//! A log file as a stream of samples: columns by name, units by configuration, every bad row counted with its line.
//!
//! Rows become samples whose time is that of the row to the nanosecond, and whose `seq` is this time in sample periods, rounded, so that a hole in the log is a hole
//! in `seq`, as if the samples had been lost on a bus. What cannot be a sample is skipped, counted, and remembered with its first line:
//!
//! | row | what becomes of it |
//! |---|---|
//! | too few or too many fields, no number, a truncated last line | refused |
//! | NaN or infinite, or more than 300 years from the first | refused |
//! | the time of the row before, or nearer to it than half a period and of the same period | duplicate, refused |
//! | earlier than the row before | out of order, refused |
//! | later than most of the rows that follow it | out of order, refused |
//! | more than a quarter of a period off the grid | used at its own time, counted as irregular |
//!
//! Samples keep the times of their rows, and projected rows are made for those times, not for rounded ones. Where rows without a hole between them are
//! another period apart on average than configured, the summary says which.
//!
//! A log whose rows are typically another period apart than configured is refused as a whole, and so is one of which more than half
//! the rows are refused: neither is what the configuration says it is. Memory does not grow with the log.

use super::lines::{Lines, fields};
use super::log_counts::{LOOK, LogCounts};
use super::log_error::{LogError, cut, listed};
use super::profile::{LogProfile, Signal};
use super::sign::InputSign;
use super::suspicion::{Suspicion, judge_field, judge_header, judge_period};
use super::time::Stamp;
use crate::config::LogColumns;
use crate::messages::{Sample, sample_flags, signals};
use crate::model::{JointSample, MAX_JOINTS};
use std::collections::VecDeque;
use std::io::Read;

/// Rows behind a row that tell whether its time ran ahead of them.
const JUDGES: usize = 16;
/// Times further from the first one are none \[s\]: `t_ns` holds them all.
const LONGEST_S: f64 = 1e10;
/// Refused rows in a row, in order among themselves, that are a second log or a clock that was set.
const RESTART: u32 = 50;
/// A row of the file that is a sample but for its `seq`.
#[derive(Debug, Clone, Copy)]
struct Row {
    line: u64,
    /// From the first row that was read.
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

/// Why a row gives no sample.
#[derive(Debug, Clone, Copy)]
enum Refusal {
    Unreadable,
    NotFinite,
    Duplicated,
    OutOfOrder,
}

/// Gives the samples of a log, the last one flagged `END`.
pub struct LogReader<R> {
    lines: Lines<R>,
    columns: LogColumns,
    places: Places,
    period_s: f64,
    /// Rows read ahead: to know the period at the beginning, later to see a time that runs ahead. At most [`LOOK`].
    ahead: VecDeque<Row>,
    origin: Option<Stamp>,
    first_t_s: Option<f64>,
    last: Option<(f64, u64)>,
    /// The sample that waits for its successor, for the last one is flagged.
    waiting: Option<Sample>,
    counts: LogCounts,
    profile: LogProfile,
    sign: InputSign,
    /// What the first field that is no number looks like.
    likely: Option<Suspicion>,
    /// Time and number of refused rows that are in order among themselves, and the line of the first.
    run: Option<(f64, u32, u64)>,
    ended: bool,
}

impl<R: Read> LogReader<R> {
    /// Reads the header and the first rows; `joints` is the model's number of joints, `period_s` the sample period \[s\].
    ///
    /// # Errors
    /// Columns that are not there, rows at another period, or a file that is no log.
    pub fn new(input: R, columns: &LogColumns, joints: usize, period_s: f64) -> Result<Self, LogError> {
        let mut lines = Lines::new(input);
        if !lines.advance()? {
            return Err(LogError::Empty);
        }
        let no_header = LogError::Header { line: lines.number() };
        let Ok(text) = std::str::from_utf8(lines.line()) else {
            return Err(no_header);
        };
        let mut header = Vec::new();
        if !fields(text, &mut header) {
            return Err(no_header);
        }
        let find = |key: &'static str, name: &String| {
            let place = header.iter().position(|column| column == name);
            place.ok_or_else(|| LogError::Column {
                key,
                name: cut(name),
                columns: listed(&header),
                likely: judge_header(text).map(Box::new),
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
        let named = |names: &[String], signal: fn(usize) -> Signal| -> Vec<(String, Signal)> {
            let joints = names.iter().enumerate();
            joints.map(|(joint, name)| (name.clone(), signal(joint))).collect()
        };
        let read = [
            named(&columns.positions, Signal::Position),
            named(&columns.inputs, Signal::Input),
            named(&columns.setpoints, Signal::Setpoint),
        ];
        let mut log = Self {
            lines,
            columns: columns.clone(),
            places,
            period_s,
            ahead: VecDeque::with_capacity(LOOK),
            origin: None,
            first_t_s: None,
            last: None,
            waiting: None,
            counts: LogCounts {
                period_ns: (period_s * 1e9).round() as u64,
                ..LogCounts::default()
            },
            profile: LogProfile::new(read.into_iter().flatten()),
            sign: InputSign::new(joints),
            likely: None,
            run: None,
            ended: false,
        };
        log.look_ahead(LOOK)?;
        log.check_period()?;
        log.check_first();
        Ok(log)
    }

    /// What was read so far.
    pub fn counts(&self) -> LogCounts {
        self.counts
    }

    /// Ranges and rate of what was read so far.
    pub fn profile(&self) -> &LogProfile {
        &self.profile
    }

    /// Partial correlation of each joint's input with its acceleration, see [`InputSign`].
    pub fn input_correlations(&self) -> Vec<Option<f64>> {
        (0..self.places.q.len())
            .map(|joint| self.sign.correlation(joint))
            .collect()
    }

    /// What the first field that is no number looks like.
    pub fn likely(&self) -> Option<&Suspicion> {
        self.likely.as_ref()
    }

    /// The next sample; `None` after the one flagged `END`.
    ///
    /// # Errors
    /// The file cannot be read any further, or most of it is no log.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        // A sample is given when its successor is known to be there, so that the last one is flagged whatever refused rows follow it.
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
        let mut carried = signals::Q | signals::INPUT;
        if !self.places.setpoint.is_empty() {
            carried |= signals::SETPOINT;
        }
        let t_s = row.t_s - self.first_t_s.unwrap_or(row.t_s);
        let t_ns = (t_s * 1e9).round().max(0.0) as u64;
        let sample = Sample::new(1, seq, t_ns, self.places.q.len(), carried, &row.joints);
        let follows = self.last.filter(|(_, last_seq)| last_seq.checked_add(1) == Some(seq));
        self.profile
            .take(&sample, t_s, follows.map(|(last_t_s, _)| row.t_s - last_t_s));
        self.sign.take(&sample);
        self.last = Some((row.t_s, seq));
        sample
    }

    /// The next row that is later than the one before.
    fn next_on_grid(&mut self) -> Result<Option<(Row, u64)>, LogError> {
        loop {
            self.look_ahead(1 + JUDGES)?;
            let Some(row) = self.ahead.pop_front() else {
                return Ok(None);
            };
            let before = self.last.map_or(f64::NEG_INFINITY, |(t_s, _)| t_s);
            if row.t_s < before {
                self.note_run(&row);
                self.refuse(Refusal::OutOfOrder, row.line)?;
                continue;
            }
            if row.t_s == before {
                self.refuse(Refusal::Duplicated, row.line)?;
                continue;
            }
            // One time that runs ahead would refuse all rows behind it; so it is judged by them, before it is believed.
            let judges = self.ahead.iter().take(JUDGES);
            let overtaken = judges.clone().filter(|r| before < r.t_s && r.t_s < row.t_s).count();
            if 2 * overtaken > judges.len() {
                self.refuse(Refusal::OutOfOrder, row.line)?;
                continue;
            }
            let distance_s = row.t_s - before;
            if distance_s < 1.5 * self.period_s {
                self.counts.pairs += 1;
                self.counts.pairs_span_ns += (distance_s * 1e9).round() as u64;
            }
            let first = *self.first_t_s.get_or_insert(row.t_s);
            let on_grid = (row.t_s - first) / self.period_s;
            let mut seq = on_grid.round().max(0.0) as u64;
            if let Some((last_t_s, last_seq)) = self.last
                && seq <= last_seq
            {
                // Two rows that jitter has put into the same period are two samples, unless more of them come than periods pass.
                let next = last_seq.saturating_add(1);
                if row.t_s - last_t_s < 0.5 * self.period_s || next as f64 - on_grid > 0.75 {
                    self.refuse(Refusal::Duplicated, row.line)?;
                    continue;
                }
                seq = next;
            }
            if (on_grid - seq as f64).abs() > 0.25 {
                self.counts.irregular += 1;
                self.counts.first_irregular.get_or_insert(row.line);
            }
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

    /// Reads until so many rows wait, or to the end.
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
        match self.parse(number, line) {
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

    /// The row in the current line, or what a field that is no number looks like.
    fn parse(&mut self, number: u64, line: u64) -> Result<Row, Option<Suspicion>> {
        // A row that is no text is a bad row.
        let text = std::str::from_utf8(self.lines.line()).map_err(|_| None)?;
        let mut cells = Vec::with_capacity(self.places.fields);
        if !fields(text, &mut cells) || cells.len() != self.places.fields {
            // Decimal commas make two fields of each number.
            let commas = cells.len() + 1 >= 2 * self.places.fields && self.places.fields > 1;
            let decimal = commas.then(|| Suspicion::DecimalComma { field: cut(text) });
            return Err(judge_header(text).or(decimal));
        }
        let field = |index: usize| -> Result<f64, Option<Suspicion>> {
            let cell = cells.get(index).ok_or(None)?;
            cell.parse().map_err(|_| judge_field(cell))
        };
        let stamp = match self.places.time {
            Some(index) => Stamp::parse(cells[index]).ok_or_else(|| judge_field(cells[index]))?,
            None => Stamp::of(number as f64 * self.period_s / self.columns.time_unit_s),
        };
        let mut joints = JointSample::default();
        let signals = [
            (&self.places.q, &mut joints.q, self.columns.position_unit),
            (&self.places.input, &mut joints.input, self.columns.input_unit),
            (&self.places.setpoint, &mut joints.setpoint, self.columns.position_unit),
        ];
        for (places, values, unit) in signals {
            for (value, &index) in values.iter_mut().zip(places) {
                *value = field(index)? * unit;
            }
        }
        let from_origin = self.origin.map_or(0.0, |origin| stamp.since(&origin));
        let t_s = match self.origin {
            None if !stamp.since(&Stamp::of(0.0)).is_finite() => f64::NAN,
            None => {
                self.origin = Some(stamp);
                0.0
            }
            Some(_) => from_origin * self.columns.time_unit_s,
        };
        Ok(Row { line, t_s, joints })
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
                column: cut(column),
                got_s: (median * 1e9).round() * 1e-9,
                expected_s: self.period_s,
                likely: judge_period(median, self.period_s, self.columns.time_unit_s).map(Box::new),
            });
        }
        Ok(())
    }

    /// A first time far before all others would begin the log with a hole of years.
    fn check_first(&mut self) {
        let far = |gap: f64| gap > 1000.0 * self.period_s;
        let mut times = self.ahead.iter().map(|row| row.t_s);
        if let [Some(first), Some(second), Some(third)] = [times.next(), times.next(), times.next()]
            && far(second - first)
            && !far((third - second).abs())
            && let Some(row) = self.ahead.pop_front()
        {
            self.counts.out_of_order += 1;
            let line = self.counts.first_refused.get_or_insert(row.line);
            *line = row.line.min(*line);
        }
    }
}

impl Row {
    fn is_finite(&self) -> bool {
        let JointSample { q, input, setpoint, .. } = &self.joints;
        self.t_s.abs() <= LONGEST_S && q.iter().chain(input).chain(setpoint).all(|v| v.is_finite())
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
    fn fault_a_single_time_stamp_far_ahead_or_far_behind_costs_its_own_row_and_bounded_memory() {
        for (bad_row, bad_time) in [
            (0, 1e12),
            (0, -1e12),
            (1, 1e9),
            (700, 1e9),
            (700, -1e9),
            (1998, 1e9),
            (1999, 1e9),
        ] {
            let mut text = "t,x,u\n".to_owned();
            for k in 0..2000 {
                let t = if k == bad_row { bad_time } else { f64::from(k) };
                text.push_str(&format!("{t},1,0\n"));
            }
            let mut log = LogReader::new(text.as_bytes(), &columns(true), 1, 1e-3).unwrap();
            let mut samples = Vec::new();
            while let Some(sample) = log.next_sample().unwrap() {
                assert!(log.ahead.len() <= LOOK && log.ahead.capacity() <= 2 * LOOK);
                samples.push(sample);
            }
            let counts = log.counts();
            // Nothing follows the very last row that could contradict it: a gap is as likely as a wrong time.
            let refused = u64::from(bad_row != 1999);
            assert_eq!(
                (samples.len() as u64, counts.refused()),
                (2000 - refused, refused),
                "row {bad_row}: {counts}"
            );
            let rates = samples[..1998].windows(2).map(|pair| pair[1].seq - pair[0].seq);
            assert!(rates.max() <= Some(2), "row {bad_row} leaves a hole");
        }
    }

    #[test]
    fn fault_a_log_is_refused_when_most_of_it_is_wherever_that_is_noticed() {
        // A clock that is set ahead for some rows, and back: what follows is out of order for good.
        let mut text = "t,x,u\n".to_owned();
        (0..1000).for_each(|k| text.push_str(&format!("{k},1,0\n")));
        (0..100).for_each(|k| text.push_str(&format!("{},1,0\n", 1_000_000 + k)));
        (1000..4000).for_each(|k| text.push_str(&format!("{k},1,0\n")));
        let error = read(&text, true).err().unwrap();
        assert!(matches!(error, LogError::Unusable { .. }), "{error}");
        assert!(error.to_string().contains("goes back in line 1102"), "{error}");
        // The same where it is less than half.
        let text: String = text.lines().take(1800).map(|line| format!("{line}\n")).collect();
        let (samples, counts) = read(&text, true).unwrap();
        assert_eq!((samples.len(), counts.out_of_order), (1100, 699));
        // A log that is short and bad.
        assert!(read("t,x,u\n0,1,0\nx,1,0\ny,1,0\n", true).is_err());
    }

    #[test]
    fn fault_a_quote_that_is_not_closed_costs_its_own_row() {
        let mut text = "t,x,u\n".to_owned();
        (0..500).for_each(|k| text.push_str(&format!("{k},{}1,0\n", if k == 50 { "\"" } else { "" })));
        let (samples, counts) = read(&text, true).unwrap();
        assert_eq!(
            (samples.len(), counts.unreadable, counts.first_refused),
            (499, 1, Some(52))
        );
    }

    #[test]
    fn fault_the_likely_mistake_is_named() {
        let rows = |row: fn(u64) -> String| -> String { (0..300).map(|k| row(k) + "\n").collect() };
        let cases = [
            (
                "semicolons",
                format!("t;x;u\n{}", rows(|k| format!("{k};1;0"))),
                "semicolons",
            ),
            (
                "semicolons below",
                format!("t,x,u\n{}", rows(|k| format!("{k};1;0"))),
                "semicolons",
            ),
            (
                "dates",
                format!(
                    "t,x,u\n{}",
                    rows(|k| format!("2026-11-21T08:15:{:02}.{k:03},1,0", k / 1000))
                ),
                "date or time",
            ),
            (
                "decimal commas",
                format!("t,x,u\n{}", rows(|k| format!("\"{k},5\",\"1,5\",0"))),
                "decimal point",
            ),
            (
                "seconds",
                format!("t,x,u\n{}", rows(|k| format!("{},1,0", k as f64 * 1e-3))),
                "log.time_unit = \"s\"",
            ),
            (
                "nanoseconds",
                format!("t,x,u\n{}", rows(|k| format!("{},1,0", k * 1_000_000))),
                "log.time_unit = \"ns\"",
            ),
            (
                "another period",
                format!("t,x,u\n{}", rows(|k| format!("{},1,0", k * 2))),
                "plant.sample_period_s = 0.002",
            ),
            ("another language", "a\u{ff},b\n".to_owned(), "\"a\u{ff}\", \"b\""),
        ];
        for (what, text, words) in cases {
            let error = read(&text, true).err().unwrap().to_string();
            assert!(error.contains(words), "{what}: {error}");
        }
        let wide: String = (0..1000).map(|k| format!("column_{k}_{},", "x".repeat(50))).collect();
        let error = read(&format!("{wide}\n"), true).err().unwrap().to_string();
        assert!(error.len() < 2000 && error.contains("971 more"), "{error}");
    }

    #[test]
    fn prop_time_stamps_come_through_to_the_nanosecond_with_rate_and_spread() {
        // Rows of 0.8 and 1.2 ms in turn, and seconds since 1970 with all their digits.
        let mut text = "t,x,u\n".to_owned();
        let mut expected = Vec::new();
        let mut t_us = 0_u64;
        for k in 0..1000_u64 {
            text.push_str(&format!("17953056{:08}.{:03},1,0\n", t_us / 1000, t_us % 1000));
            expected.push(t_us * 1000);
            t_us += if k % 2 == 0 { 800 } else { 1200 };
        }
        let mut log = LogReader::new(text.as_bytes(), &columns(true), 1, 1e-3).unwrap();
        let mut times = Vec::new();
        while let Some(sample) = log.next_sample().unwrap() {
            times.push(sample.t_ns);
        }
        assert_eq!(times, expected);
        let steps = log.profile().steps;
        assert!(
            (steps.mean_s - 1e-3).abs() < 1e-6 && (steps.std_s() - 2e-4).abs() < 1e-6,
            "{steps:?}"
        );
        let told = log.profile().to_string();
        assert!(told.contains("1000 rows") && told.contains("0.8 to 1.2 ms"), "{told}");
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
