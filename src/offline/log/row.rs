//! Converts a line of a log to a row: columns by their names in the header, units by configuration.

use super::super::lines::fields;
use super::super::log_error::{LogError, cut, listed};
use super::super::profile::Signal;
use super::super::suspicion::{Suspicion, judge_field, judge_header};
use super::super::time::Stamp;
use crate::config::LogColumns;
use crate::messages::signals;
use crate::model::{JointSample, MAX_JOINTS};

/// Largest valid time from the first one \[s\], which fits into `t_ns`.
const LONGEST_S: f64 = 1e10;

/// A row of the file: a sample without its `seq`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub line: u64,
    /// Time since the first row.
    pub t_s: f64,
    pub joints: JointSample,
}

impl Row {
    pub fn is_finite(&self) -> bool {
        let JointSample { q, input, setpoint, .. } = &self.joints;
        self.t_s.abs() <= LONGEST_S && q.iter().chain(input).chain(setpoint).all(|v| v.is_finite())
    }
}

/// The name in `log.input` for a joint that nothing drives, unless a column has it.
const PASSIVE: &str = "0";

/// Column and unit of each signal.
#[derive(Debug, Clone)]
pub(super) struct RowReader {
    columns: LogColumns,
    period_s: f64,
    fields: usize,
    time: Option<usize>,
    q: Vec<usize>,
    /// `None` for a joint that nothing drives.
    input: Vec<Option<usize>>,
    setpoint: Vec<usize>,
    /// The first time stamp.
    origin: Option<Stamp>,
}

impl RowReader {
    /// Finds the columns in the header, the first line of a file.
    ///
    /// # Errors
    /// If there is no valid header, columns are missing or occur twice, or their number does not
    /// match the model's joints.
    pub fn new(header: &[u8], line: u64, columns: &LogColumns, joints: usize, period_s: f64) -> Result<Self, LogError> {
        let text = std::str::from_utf8(header).map_err(|_| LogError::Header { line })?;
        let mut names = Vec::new();
        if !fields(text, &mut names) {
            return Err(LogError::Header { line });
        }
        let find = |key: &'static str, name: &String| {
            let mut places = (0..names.len()).filter(|place| names[*place] == name);
            match (places.next(), places.next()) {
                (Some(place), None) => Ok(place),
                (Some(first), Some(second)) => Err(LogError::Twice {
                    key,
                    name: cut(name),
                    first: first + 1,
                    second: second + 1,
                }),
                (None, _) => Err(LogError::Column {
                    key,
                    name: cut(name),
                    columns: listed(&names),
                    likely: judge_header(text).map(Box::new),
                }),
            }
        };
        let count = |key: &'static str, names: &[String], may_be_none: bool| {
            if names.len() != joints.min(MAX_JOINTS) && !(may_be_none && names.is_empty()) {
                return Err(LogError::Columns {
                    key,
                    expected: joints,
                    got: names.len(),
                });
            }
            Ok(())
        };
        let per_joint = |key: &'static str, names: &[String], may_be_none: bool| {
            count(key, names, may_be_none)?;
            names.iter().map(|name| find(key, name)).collect::<Result<Vec<_>, _>>()
        };
        let time = columns.time.as_ref().map(|name| find("log.time", name)).transpose()?;
        let q = per_joint("log.q", &columns.positions, false)?;
        count("log.input", &columns.inputs, false)?;
        let is_passive = |name: &str| name == PASSIVE && !names.contains(&name);
        let input = columns.inputs.iter().map(|name| match is_passive(name) {
            true => Ok(None),
            false => find("log.input", name).map(Some),
        });
        Ok(Self {
            fields: names.len(),
            time,
            q,
            input: input.collect::<Result<Vec<_>, _>>()?,
            setpoint: per_joint("log.setpoint", &columns.setpoints, true)?,
            columns: columns.clone(),
            period_s,
            origin: None,
        })
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.q.len()
    }

    /// The signals of the rows, as bits of [`signals`].
    pub fn signals(&self) -> u32 {
        let setpoint = match self.setpoint.is_empty() {
            true => 0,
            false => signals::SETPOINT,
        };
        signals::Q | signals::INPUT | setpoint
    }

    /// The columns read, with their signals.
    pub fn read(&self) -> impl Iterator<Item = (String, Signal)> {
        let named = |names: &[String], signal: fn(usize) -> Signal| -> Vec<(String, Signal)> {
            let joints = names.iter().enumerate();
            joints.map(|(joint, name)| (name.clone(), signal(joint))).collect()
        };
        let read = [
            named(&self.columns.positions, Signal::Position),
            named(&self.columns.inputs, Signal::Input),
            named(&self.columns.setpoints, Signal::Setpoint),
        ];
        let is_passive = |signal| matches!(signal, Signal::Input(joint) if self.input[joint].is_none());
        read.into_iter()
            .flatten()
            .filter(move |(_, signal)| !is_passive(*signal))
    }

    /// Name of the time column, if there is one.
    pub fn time_column(&self) -> Option<&str> {
        self.columns.time.as_deref()
    }

    /// Unit of the time column \[s\].
    pub fn time_unit_s(&self) -> f64 {
        self.columns.time_unit_s
    }

    /// Parses the row in a line, number `number` after the header, from 0.
    ///
    /// # Errors
    /// If it is not a row; with the likely mistake in a field that is not a number.
    pub fn parse(&mut self, bytes: &[u8], number: u64, line: u64) -> Result<Row, Option<Suspicion>> {
        // A row that is not valid text is a bad row.
        let text = std::str::from_utf8(bytes).map_err(|_| None)?;
        let mut cells = Vec::with_capacity(self.fields);
        if !fields(text, &mut cells) || cells.len() != self.fields {
            // Decimal commas split each number into two fields.
            let commas = cells.len() + 1 >= 2 * self.fields && self.fields > 1;
            let decimal = commas.then(|| Suspicion::DecimalComma { field: cut(text) });
            let header = judge_header(text).filter(|one| *one != Suspicion::NoHeader);
            return Err(header.or(decimal));
        }
        let field = |index: usize, name: &str| -> Result<f64, Option<Suspicion>> {
            let cell = cells.get(index).ok_or(None)?;
            cell.parse().map_err(|_| judge_field(name, cell))
        };
        let time = self.columns.time.as_deref().unwrap_or_default();
        let stamp = match self.time {
            Some(index) => Stamp::parse(cells[index]).ok_or_else(|| judge_field(time, cells[index]))?,
            None => Stamp::of(number as f64 * self.period_s / self.columns.time_unit_s),
        };
        let mut joints = JointSample::default();
        let columns = &self.columns;
        let signals = [
            (&self.q, &columns.positions, &mut joints.q),
            (&self.setpoint, &columns.setpoints, &mut joints.setpoint),
        ];
        for (places, names, values) in signals {
            for (joint, (&index, name)) in places.iter().zip(names).enumerate() {
                values[joint] = field(index, name)? * columns.position_units[joint];
            }
        }
        for (joint, (index, name)) in self.input.iter().zip(&columns.inputs).enumerate() {
            if let Some(index) = index {
                joints.input[joint] = field(*index, name)? * columns.input_unit;
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
}
