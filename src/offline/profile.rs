//! Profile of a log: range of each column, distance of the rows, length; as text for users and as
//! numbers for `suspicion.rs`.

use crate::messages::Sample;
use std::fmt;

/// Standard deviation, relative to the mean distance, that counts as rounding.
const ROUNDING: f64 = 1e-9;

/// Signal of a column, with the joint counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// A position.
    Position(usize),
    /// An input of the drive.
    Input(usize),
    /// A commanded position.
    Setpoint(usize),
}

/// A column in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnProfile {
    /// Its name in the file.
    pub name: String,
    /// Its signal.
    pub signal: Signal,
    /// Values.
    pub count: u64,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Largest magnitude of the difference of neighbouring rows.
    pub largest_step: f64,
    /// Value of the last row.
    pub last: Option<f64>,
}

/// Distances of neighbouring rows in time, by Welford's recursion.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Steps {
    /// Distances.
    pub count: u64,
    /// Mean \[s\].
    pub mean_s: f64,
    /// Smallest \[s\].
    pub min_s: f64,
    /// Largest \[s\].
    pub max_s: f64,
    sum_of_squares: f64,
}

impl Steps {
    /// Standard deviation \[s\]; 0 if it is only rounding of the times.
    pub fn std_s(&self) -> f64 {
        let std_s = (self.sum_of_squares / self.count.max(1) as f64).sqrt();
        if std_s > ROUNDING * self.mean_s.abs() {
            std_s
        } else {
            0.0
        }
    }

    fn add(&mut self, step_s: f64) {
        self.count += 1;
        let ahead = step_s - self.mean_s;
        self.mean_s += ahead / self.count as f64;
        self.sum_of_squares += ahead * (step_s - self.mean_s);
        (self.min_s, self.max_s) = match self.count {
            1 => (step_s, step_s),
            _ => (self.min_s.min(step_s), self.max_s.max(step_s)),
        };
    }
}

/// Profile of a log, over the rows that became samples.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LogProfile {
    /// Position, input and setpoint columns.
    pub columns: Vec<ColumnProfile>,
    /// Rows that became samples.
    pub rows: u64,
    /// Time from the first to the last \[s\].
    pub length_s: f64,
    /// Distances of consecutive rows without a gap.
    pub steps: Steps,
    /// First line after which time continues from an earlier instant.
    pub restart_line: Option<u64>,
}

impl LogProfile {
    /// For columns by name and signal.
    pub(super) fn new(columns: impl Iterator<Item = (String, Signal)>) -> Self {
        let empty = |(name, signal)| ColumnProfile {
            name,
            signal,
            count: 0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            largest_step: 0.0,
            last: None,
        };
        Self {
            columns: columns.map(empty).collect(),
            ..Self::default()
        }
    }

    /// The distances of rows at these times \[s\].
    pub fn of_times(times: impl Iterator<Item = f64>) -> Self {
        let mut profile = Self::default();
        let mut first_and_last: Option<(f64, f64)> = None;
        for t_s in times {
            profile.rows += 1;
            if let Some((first, last)) = first_and_last {
                profile.length_s = t_s - first;
                profile.steps.add(t_s - last);
            }
            first_and_last = Some((first_and_last.map_or(t_s, |(first, _)| first), t_s));
        }
        profile
    }

    /// Adds a row; `t_s` is the time since the first row, `step_s` that since the previous one, if
    /// none is missing between them.
    pub(super) fn take(&mut self, sample: &Sample, t_s: f64, step_s: Option<f64>) {
        self.rows += 1;
        self.length_s = t_s;
        if let Some(step_s) = step_s {
            self.steps.add(step_s);
        }
        for column in &mut self.columns {
            let value = match column.signal {
                Signal::Position(joint) => sample.q[joint],
                Signal::Input(joint) => sample.input[joint],
                Signal::Setpoint(joint) => sample.setpoint[joint],
            };
            column.count += 1;
            (column.min, column.max) = (column.min.min(value), column.max.max(value));
            if let (Some(last), Some(_)) = (column.last, step_s) {
                column.largest_step = column.largest_step.max((value - last).abs());
            }
            column.last = Some(value);
        }
    }

    /// One line on time, then one for each column, with the units of each joint's position and of
    /// the inputs.
    pub fn lines<'a>(&self, position_unit: impl Fn(usize) -> &'a str, input_unit: &'a str) -> Vec<String> {
        let mut lines = vec![self.to_string()];
        for column in self.columns.iter().filter(|c| c.count > 0) {
            let (what, joint, unit) = match column.signal {
                Signal::Position(joint) => ("position", joint, position_unit(joint)),
                Signal::Input(joint) => ("input", joint, input_unit),
                Signal::Setpoint(joint) => ("setpoint", joint, position_unit(joint)),
            };
            let (min, max) = (short(column.min), short(column.max));
            lines.push(format!(
                "column \"{}\" read as {what} of joint {}: {min} to {max} {unit}",
                column.name,
                joint + 1
            ));
        }
        lines
    }
}

/// Rows, length, rate and its spread.
impl fmt::Display for LogProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = if self.rows == 1 { "row" } else { "rows" };
        write!(f, "{} {rows} over {} s", self.rows, short(self.length_s))?;
        let steps = &self.steps;
        if steps.count > 0 {
            let [mean, std, min, max] = [steps.mean_s, steps.std_s(), steps.min_s, steps.max_s].map(|s| short(1e3 * s));
            let rate = short(1.0 / steps.mean_s);
            write!(
                f,
                ", {rate} Hz: {mean} ms apart, standard deviation {std} ms, {min} to {max} ms"
            )?;
        }
        Ok(())
    }
}

/// A number in five significant digits.
pub fn short(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if !(1e-4..1e6).contains(&magnitude) {
        return format!("{value:.4e}");
    }
    let decimals = (4 - magnitude.log10().floor() as i32).clamp(0, 8) as usize;
    let text = format!("{value:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}
