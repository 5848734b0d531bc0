//! Log files of robots: numbers in columns, with or without a line of names.

use super::state::RobotSample;
use crate::model::MAX_JOINTS;
use std::fmt;

/// Which columns hold what, counted from 1 as spreadsheets do.
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
    /// Time, then positions, velocities if there are any, and inputs of all joints.
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

/// From the input of the drives to the torques at the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Drives {
    /// Torque per input: N m/A for currents, 1 for torques.
    pub gain: Vec<f64>,
    /// Torque of joint i per torque of drive j, for joints that share drives; `None` if each has
    /// its own.
    pub coupling: Option<Vec<Vec<f64>>>,
}

impl Drives {
    /// Inputs that are torques already.
    pub fn torque(joints: usize) -> Self {
        Self {
            gain: vec![1.0; joints],
            coupling: None,
        }
    }

    /// Checks the numbers for a robot of this many joints.
    ///
    /// # Errors
    /// What is expected and what is there, in words.
    pub fn validate(&self, joints: usize) -> Result<(), String> {
        if self.gain.len() != joints || self.gain.iter().any(|g| !g.is_finite() || *g == 0.0) {
            return Err(format!(
                "gain: expected {joints} finite numbers other than 0, got {:?}",
                self.gain
            ));
        }
        if let Some(rows) = &self.coupling {
            let sound = rows.len() == joints
                && rows
                    .iter()
                    .all(|row| row.len() == joints && row.iter().all(|x| x.is_finite()));
            if !sound {
                return Err(format!(
                    "coupling: expected {joints} rows of {joints} finite numbers, got {rows:?}"
                ));
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
}

impl Drives {
    /// Inputs of the drives that give these torques or forces; coupled joints are solved for, and
    /// get none if their matrix is singular.
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

/// Reads a log; numbers are separated by semicolons, bars, tabs, commas or spaces, a first line of
/// names is skipped. Where commas do not separate they are decimal commas. Without columns of
/// velocities these are 0, see [`with_velocities`](super::with_velocities).
///
/// # Errors
/// The first line that does not hold finite numbers in the columns, or whose time is not after the
/// line before.
pub fn read_log(text: &str, columns: &LogColumns, drives: &Drives) -> Result<Vec<RobotSample>, LogError> {
    let problem = |line: Option<usize>, problem: String| LogError { line, problem };
    let joints = columns.position.len();
    let lists = [
        ("position", &columns.position),
        ("velocity", &columns.velocity),
        ("input", &columns.input),
    ];
    for (name, list) in lists {
        let is_left_out = name == "velocity" && list.is_empty();
        if !is_left_out && list.len() != joints || !(1..=MAX_JOINTS).contains(&joints) {
            return Err(problem(
                None,
                format!(
                    "{name} columns: expected one per joint, got {} beside {joints} positions",
                    list.len()
                ),
            ));
        }
    }
    let all = || lists.iter().flat_map(|(_, list)| list.iter()).chain([&columns.time]);
    if all().any(|column| *column == 0) {
        return Err(problem(None, "columns: expected numbers from 1, got 0".to_owned()));
    }
    drives.validate(joints).map_err(|text| problem(None, text))?;
    let widest = all().copied().max().unwrap_or(1);
    let mut samples: Vec<RobotSample> = Vec::new();
    let mut fields: Vec<&str> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let number = Some(index + 1);
        fields.clear();
        split(line, &mut fields);
        if fields.is_empty() {
            continue;
        }
        let is_header = samples.is_empty() && fields.iter().all(|field| number_of(field).is_none());
        if is_header {
            continue;
        }
        if fields.len() < widest {
            let hint = match columns.velocity.is_empty() {
                true => "",
                false => "; a log without velocities needs log.velocity_columns = []",
            };
            return Err(problem(
                number,
                format!("expected at least {widest} columns, got {}{hint}", fields.len()),
            ));
        }
        let value = |column: usize| -> Result<f64, LogError> {
            let field = fields[column - 1];
            match number_of(field) {
                Some(x) if x.is_finite() => Ok(x),
                _ => Err(problem(
                    number,
                    format!("column {column}: expected a finite number, got \"{field}\""),
                )),
            }
        };
        let mut sample = RobotSample {
            t_s: value(columns.time)?,
            ..RobotSample::default()
        };
        let mut input = [0.0; MAX_JOINTS];
        for joint in 0..joints {
            sample.q[joint] = value(columns.position[joint])?;
            if let Some(column) = columns.velocity.get(joint) {
                sample.dq[joint] = value(*column)?;
            }
            input[joint] = value(columns.input[joint])?;
        }
        sample.tau = drives.torques(&input);
        if let Some(last) = samples.last()
            && sample.t_s <= last.t_s
        {
            return Err(problem(
                number,
                format!("expected a time after {} s, got {} s", last.t_s, sample.t_s),
            ));
        }
        samples.push(sample);
    }
    Ok(samples)
}

/// Number of columns of the first line that holds a number; `None` if none does.
#[cfg(feature = "config")]
pub(super) fn width_of(text: &str) -> Option<usize> {
    let mut fields = Vec::new();
    text.lines().find_map(|line| {
        fields.clear();
        split(line, &mut fields);
        let has_number = fields.iter().any(|field| number_of(field).is_some());
        has_number.then_some(fields.len())
    })
}

/// With a decimal point, or with a comma in its place.
fn number_of(field: &str) -> Option<f64> {
    field.parse().or_else(|_| field.replacen(',', ".", 1).parse()).ok()
}

/// Fields of a line: at semicolons, bars, tabs or commas, whichever is there first in this order,
/// else at white space.
pub(super) fn split<'a>(line: &'a str, fields: &mut Vec<&'a str>) {
    let line = line.trim();
    let separator = [';', '|', '\t', ','].into_iter().find(|c| line.contains(*c));
    match separator {
        Some(c) => fields.extend(line.split(c).map(str::trim)),
        None => fields.extend(line.split_whitespace()),
    }
}
