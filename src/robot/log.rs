//! Log files of robots: numbers in columns, with or without a header line.

use super::error::DrivesError;
use super::skipped::{InOrder, LogError, Skip, SkippedRows};
use super::state::RobotSample;
use crate::model::MAX_JOINTS;

/// Columns of the signals, counted from 1 as in spreadsheets.
#[derive(Debug, Clone, PartialEq)]
pub struct LogColumns {
    /// Time \[s\].
    pub time: usize,
    /// Positions \[rad or m\], one per joint.
    pub position: Vec<usize>,
    /// Velocities \[rad/s or m/s\], one per joint; empty if the log holds none.
    pub velocity: Vec<usize>,
    /// Torques, forces or currents of the drives, one per joint.
    pub input: Vec<usize>,
}

impl LogColumns {
    /// Time, then positions, velocities if present, and inputs of all joints.
    pub fn in_order(joints: usize, has_velocity: bool) -> Self {
        let list = |index: usize| (2 + index * joints..2 + (index + 1) * joints).collect();
        Self {
            time: 1,
            position: list(0),
            velocity: if has_velocity { list(1) } else { Vec::new() },
            input: list(if has_velocity { 2 } else { 1 }),
        }
    }
}

/// Conversion of the drives' inputs to torques at the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Drives {
    /// Torque per input: N m/A for currents, 1 for torques.
    pub gain: Vec<f64>,
    /// Torque of joint i per torque of drive j, for joints that share drives; `None` if each has
    /// its own.
    pub coupling: Option<Vec<Vec<f64>>>,
}

impl Drives {
    /// For inputs that are already torques.
    pub fn torque(joints: usize) -> Self {
        Self {
            gain: vec![1.0; joints],
            coupling: None,
        }
    }

    /// Checks the numbers for a robot of this many joints.
    ///
    /// # Errors
    /// The gains or the coupling, if they do not fit.
    pub fn validate(&self, joints: usize) -> Result<(), DrivesError> {
        if self.gain.len() != joints || self.gain.iter().any(|g| !g.is_finite() || *g == 0.0) {
            let got = self.gain.clone();
            return Err(DrivesError::Gain { joints, got });
        }
        if let Some(rows) = &self.coupling {
            let sound = rows.len() == joints
                && rows
                    .iter()
                    .all(|row| row.len() == joints && row.iter().all(|x| x.is_finite()));
            if !sound {
                let got = rows.clone();
                return Err(DrivesError::Coupling { joints, got });
            }
        }
        Ok(())
    }

    /// Torques or forces at the joints from the inputs of the drives.
    pub fn torques(&self, input: &[f64; MAX_JOINTS]) -> [f64; MAX_JOINTS] {
        let mut own = [0.0; MAX_JOINTS];
        for (i, gain) in self.gain.iter().enumerate() {
            own[i] = gain * input[i];
        }
        let Some(rows) = &self.coupling else { return own };
        let mut tau = [0.0; MAX_JOINTS];
        for (tau, row) in tau.iter_mut().zip(rows) {
            *tau = row.iter().zip(&own).map(|(c, own)| c * own).sum();
        }
        tau
    }

    /// Inputs of the drives for these torques or forces; solved for coupled joints, 0 if their
    /// matrix is singular.
    pub fn inputs(&self, tau: &[f64; MAX_JOINTS]) -> [f64; MAX_JOINTS] {
        let n = self.gain.len().min(MAX_JOINTS);
        let mut own = *tau;
        if let Some(rows) = &self.coupling {
            let matrix = nalgebra::DMatrix::from_fn(n, n, |i, j| rows[i][j]);
            let solved = matrix.lu().solve(&nalgebra::DVector::from_column_slice(&tau[..n]));
            own[..n].fill(0.0);
            if let Some(solved) = solved {
                own[..n].copy_from_slice(solved.as_slice());
            }
        }
        for (own, gain) in own.iter_mut().zip(&self.gain) {
            *own /= gain;
        }
        own
    }
}

/// The content of a log.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotLog {
    /// The samples, in the order of their times.
    pub samples: Vec<RobotSample>,
    /// The rows without a sample.
    pub skipped: SkippedRows,
}

/// Reads a log; numbers are separated by semicolons, bars, tabs, commas or spaces, a header line is
/// skipped. Commas that do not separate numbers are decimal commas. Without columns of velocities
/// these are 0, see [`with_velocities`](super::with_velocities). A row is skipped and counted if a
/// column has no finite number, or if its time is not after that of the sample before or is ahead
/// of the two rows behind it.
///
/// # Errors
/// If the columns do not fit together; the first skipped row, if half of the rows or more were
/// skipped.
pub fn read_log(text: &str, columns: &LogColumns, drives: &Drives) -> Result<RobotLog, LogError> {
    let problem = |problem: String| LogError { line: None, problem };
    let joints = columns.position.len();
    let lists = [
        ("position", &columns.position),
        ("velocity", &columns.velocity),
        ("input", &columns.input),
    ];
    for (name, list) in lists {
        let is_left_out = name == "velocity" && list.is_empty();
        if !is_left_out && list.len() != joints || !(1..=MAX_JOINTS).contains(&joints) {
            return Err(problem(format!(
                "{name} columns: expected one per joint, got {} beside {joints} positions",
                list.len()
            )));
        }
    }
    let all = || lists.iter().flat_map(|(_, list)| list.iter()).chain([&columns.time]);
    if all().any(|column| *column == 0) {
        return Err(problem("columns: expected numbers from 1, got 0".to_owned()));
    }
    drives.validate(joints).map_err(|e| problem(e.to_string()))?;
    let widest = all().copied().max().unwrap_or(1);
    let (mut log, mut skipped) = (InOrder::default(), SkippedRows::default());
    let mut fields: Vec<&str> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        fields.clear();
        split(line, &mut fields);
        if fields.is_empty() {
            continue;
        }
        let is_header = skipped.rows == 0 && fields.iter().all(|field| number_of(field).is_none());
        if is_header {
            continue;
        }
        skipped.rows += 1;
        let row = match fields.len() < widest {
            true => Err((Skip::Unreadable, too_narrow(fields.len(), widest, columns))),
            false => row(&fields, columns, drives),
        };
        match row {
            Ok(sample) => log.take(sample, index + 1, &mut skipped),
            Err((why, what)) => skipped.skip(why, index + 1, || what),
        }
    }
    skipped.check()?;
    Ok(RobotLog {
        samples: log.samples,
        skipped,
    })
}

fn too_narrow(fields: usize, widest: usize, columns: &LogColumns) -> String {
    let hint = match columns.velocity.is_empty() {
        true => "",
        false => "; a log without velocities needs log.velocity_columns = []",
    };
    format!("expected at least {widest} columns, got {fields}{hint}")
}

/// The sample of a row, or why it is invalid; the row must be wide enough.
fn row(fields: &[&str], columns: &LogColumns, drives: &Drives) -> Result<RobotSample, (Skip, String)> {
    let value = |column: usize| -> Result<f64, (Skip, String)> {
        let field = fields[column - 1];
        let number = number_of(field);
        match number.filter(|x| x.is_finite()) {
            Some(x) => Ok(x),
            None => {
                let is_none = number.is_some() || field.is_empty();
                let why = if is_none { Skip::NotFinite } else { Skip::Unreadable };
                let what = format!("column {column}: expected a finite number, got \"{field}\"");
                Err((why, what))
            }
        }
    };
    let mut sample = RobotSample {
        t_s: value(columns.time)?,
        ..RobotSample::default()
    };
    let mut input = [0.0; MAX_JOINTS];
    for (joint, position) in columns.position.iter().enumerate() {
        sample.q[joint] = value(*position)?;
        if let Some(column) = columns.velocity.get(joint) {
            sample.dq[joint] = value(*column)?;
        }
        input[joint] = value(columns.input[joint])?;
    }
    sample.tau = drives.torques(&input);
    Ok(sample)
}

/// Number of columns of the first line that holds a number; `None` if none does.
#[cfg(feature = "config")]
pub(crate) fn columns_in(text: &str) -> Option<usize> {
    let mut fields = Vec::new();
    text.lines().find_map(|line| {
        fields.clear();
        split(line, &mut fields);
        let has_number = fields.iter().any(|field| number_of(field).is_some());
        has_number.then_some(fields.len())
    })
}

/// A number with a decimal point or a decimal comma.
fn number_of(field: &str) -> Option<f64> {
    field.parse().or_else(|_| field.replacen(',', ".", 1).parse()).ok()
}

/// Splits a line at semicolons, bars, tabs or commas, whichever occurs first in this order,
/// otherwise at white space.
pub(super) fn split<'a>(line: &'a str, fields: &mut Vec<&'a str>) {
    let line = line.trim();
    let separator = [';', '|', '\t', ','].into_iter().find(|c| line.contains(*c));
    match separator {
        Some(c) => fields.extend(line.split(c).map(str::trim)),
        None => fields.extend(line.split_whitespace()),
    }
}
