//! A motion as a table of times and positions, interpolated by a smooth curve.
//!
//! Cubic splines through the points, with accelerations s_i at the points and intervals h_i:
//!
//! ```text
//! h_{i−1} s_{i−1} + 2 (h_{i−1} + h_i) s_i + h_i s_{i+1} = 6 [(q_{i+1} − q_i)/h_i − (q_i − q_{i−1})/h_{i−1}]   (1)
//! s_0 = s_N = 0                                                                                            (2)
//! ```
//!
//! (2) suits motions that begin and end at rest. With points every h the position is off by 5
//! h⁴/384 times the largest fourth derivative, the acceleration by 3 h²/8 of it: of an acceleration
//! at 1 Hz that is 0.15 % with points at 100 Hz. Source: C. de Boor, *A Practical Guide to Splines*
//! (1978), chapter IV.

use super::error::MotionError;
use super::log::{Drives, LogColumns, read_log, split};
use super::skipped::LogError;
use super::state::Setpoint;
use crate::model::MAX_JOINTS;
use std::fmt::Write as _;

/// First and last posture count as the same within this \[rad or m\].
const SAME_POSTURE: f64 = 1e-4;
/// Name of the column of times.
const TIME: &str = "t_s";

/// A motion of 1 to [`MAX_JOINTS`] joints in a table.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionTable {
    joints: usize,
    /// Times since the first point \[s\].
    t_s: Vec<f64>,
    q: Vec<[f64; MAX_JOINTS]>,
    /// s of (1).
    ddq: Vec<[f64; MAX_JOINTS]>,
}

impl MotionTable {
    /// A motion through positions \[rad or m\] at increasing times \[s\].
    ///
    /// # Errors
    /// If there are fewer than 3 points, times do not increase, or numbers are not finite.
    pub fn new(joints: usize, t_s: &[f64], q: &[[f64; MAX_JOINTS]]) -> Result<Self, MotionError> {
        if !(1..=MAX_JOINTS).contains(&joints) || t_s.len() != q.len() || t_s.len() < 3 {
            return Err(MotionError::Size {
                joints,
                postures: q.len(),
                instants: t_s.len(),
            });
        }
        if let Some(i) = (1..t_s.len()).find(|i| !(t_s[*i] > t_s[i - 1])) {
            return Err(MotionError::NotLater {
                before_s: t_s[i - 1],
                got_s: t_s[i],
            });
        }
        let numbers = || t_s.iter().chain(q.iter().flat_map(|q| q[..joints].iter()));
        if numbers().any(|x| !x.is_finite()) {
            return Err(MotionError::NotFinite);
        }
        let mut table = Self {
            joints,
            t_s: t_s.iter().map(|t| t - t_s[0]).collect(),
            q: q.to_vec(),
            ddq: vec![[0.0; MAX_JOINTS]; q.len()],
        };
        (0..joints).for_each(|joint| table.fit_spline(joint));
        Ok(table)
    }

    /// (1) and (2) by elimination from the first point on.
    fn fit_spline(&mut self, joint: usize) {
        let n = self.t_s.len();
        let (mut pivot, mut right) = (vec![1.0; n], vec![0.0; n]);
        let h = |i: usize| self.t_s[i + 1] - self.t_s[i];
        let slope = |i: usize| (self.q[i + 1][joint] - self.q[i][joint]) / h(i);
        for i in 1..n - 1 {
            let before = if i == 1 { 0.0 } else { h(i - 1) / pivot[i - 1] };
            pivot[i] = 2.0 * (h(i - 1) + h(i)) - before * h(i - 1);
            right[i] = 6.0 * (slope(i) - slope(i - 1)) - before * right[i - 1]; // (1)
        }
        let lengths: Vec<f64> = (0..n - 1).map(h).collect();
        for i in (1..n - 1).rev() {
            self.ddq[i][joint] = (right[i] - lengths[i] * self.ddq[i + 1][joint]) / pivot[i];
        }
    }

    /// From a text whose first line names the columns: `t_s`, then `q1_rad` or `q1_m`, …, in any
    /// order; other columns are ignored.
    ///
    /// # Errors
    /// The first line that does not describe a motion of this many joints.
    pub fn parse(text: &str, joints: usize) -> Result<Self, LogError> {
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let mut fields = Vec::new();
        let (_, header) = lines.next().unwrap_or((0, ""));
        split(header, &mut fields);
        let names: Vec<String> = fields.iter().map(|name| name.trim_matches('"').to_owned()).collect();
        let expected = |got: String| LogError {
            line: Some(1),
            problem: format!("expected the columns {TIME}, q1_rad or q1_m, …, q{joints}_rad, got {got}"),
        };
        let column = |name: &str| names.iter().position(|x| x == name);
        let position_of = |joint: usize| {
            let mut endings = ["", "_rad", "_m"].into_iter();
            endings.find_map(|ending| column(&format!("q{joint}{ending}")))
        };
        let time = column(TIME).ok_or_else(|| expected(format!("none for {TIME}")))?;
        let mut positions = Vec::with_capacity(joints);
        for joint in 1..=joints {
            positions.push(position_of(joint).ok_or_else(|| expected(format!("none for q{joint}")))?);
        }
        if let Some(further) = position_of(joints + 1) {
            return Err(expected(format!("also {}, of another robot?", names[further])));
        }
        let (mut t_s, mut q) = (Vec::new(), Vec::new());
        for (index, line) in lines {
            let mut fields = Vec::new();
            split(line, &mut fields);
            let value = |column: usize| -> Result<f64, LogError> {
                let field = fields.get(column).copied().unwrap_or("");
                match field.parse::<f64>() {
                    Ok(x) if x.is_finite() => Ok(x),
                    _ => Err(LogError {
                        line: Some(index + 1),
                        problem: format!("column {}: expected a finite number, got \"{field}\"", column + 1),
                    }),
                }
            };
            t_s.push(value(time)?);
            let mut posture = [0.0; MAX_JOINTS];
            for (x, column) in posture.iter_mut().zip(&positions) {
                *x = value(*column)?;
            }
            q.push(posture);
        }
        Self::new(joints, &t_s, &q).map_err(|error| LogError {
            line: None,
            problem: error.to_string(),
        })
    }

    /// As text with the columns `t_s`, positions, velocities and accelerations; `turns` is true for
    /// each revolute joint.
    pub fn to_csv(&self, turns: &[bool]) -> String {
        let mut text = TIME.to_owned();
        for (name, rate) in [("q", ""), ("dq", "_per_s"), ("ddq", "_per_s2")] {
            for (i, turns) in turns.iter().enumerate().take(self.joints) {
                let unit = if *turns { "rad" } else { "m" };
                let _ = write!(text, ",{name}{}_{unit}{rate}", i + 1);
            }
        }
        text.push('\n');
        for t_s in &self.t_s {
            let _ = write!(text, "{t_s:.6}");
            let setpoints = self.at(*t_s);
            for d in 0..3 {
                for setpoint in &setpoints[..self.joints] {
                    let _ = write!(text, ",{:.9}", setpoint[d]);
                }
            }
            text.push('\n');
        }
        text
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Time from the first point to the last \[s\], > 0.
    pub fn duration_s(&self) -> f64 {
        self.t_s.last().copied().unwrap_or(0.0)
    }

    /// The first posture \[rad or m\].
    pub fn start(&self) -> [f64; MAX_JOINTS] {
        self.q[0]
    }

    /// True if it ends in the posture that it begins in, so that it can be repeated.
    pub fn is_closed(&self) -> bool {
        let last = self.q.len() - 1;
        (0..self.joints).all(|i| (self.q[last][i] - self.q[0][i]).abs() <= SAME_POSTURE)
    }

    /// Position, velocity and acceleration of each joint at a time since the first point \[s\]. A
    /// closed motion repeats; any other rests at its end.
    pub fn at(&self, t_s: f64) -> [Setpoint; MAX_JOINTS] {
        let (end, last) = (self.duration_s(), self.t_s.len() - 1);
        let t = match t_s > end {
            true if self.is_closed() => t_s % end,
            _ => t_s,
        };
        let mut setpoints = [[0.0; 3]; MAX_JOINTS];
        if !(t >= 0.0 && t <= end) {
            let at = if t > end { last } else { 0 };
            (0..self.joints).for_each(|j| setpoints[j][0] = self.q[at][j]);
            return setpoints;
        }
        let i = self.t_s.partition_point(|x| *x <= t).clamp(1, last) - 1;
        let h = self.t_s[i + 1] - self.t_s[i];
        let (b, a) = ((t - self.t_s[i]) / h, (self.t_s[i + 1] - t) / h);
        for (j, setpoint) in setpoints.iter_mut().enumerate().take(self.joints) {
            let (q0, q1, s0, s1) = (self.q[i][j], self.q[i + 1][j], self.ddq[i][j], self.ddq[i + 1][j]);
            *setpoint = [
                a * q0 + b * q1 + (a * (a * a - 1.0) * s0 + b * (b * b - 1.0) * s1) * h * h / 6.0,
                (q1 - q0) / h + ((3.0 * b * b - 1.0) * s1 - (3.0 * a * a - 1.0) * s0) * h / 6.0,
                a * s0 + b * s1,
            ];
        }
        setpoints
    }
}

/// Reads a motion: a table whose first line names `t_s` and positions, see [`MotionTable::parse`],
/// or a log with these columns.
///
/// # Errors
/// The first line that does not describe a motion of this many joints.
pub fn read_motion(text: &str, columns: &LogColumns) -> Result<MotionTable, LogError> {
    let joints = columns.position.len();
    let mut fields = Vec::new();
    split(text.lines().next().unwrap_or(""), &mut fields);
    if fields.contains(&"t_s") && fields.iter().any(|name| name.starts_with("q1")) {
        return MotionTable::parse(text, joints);
    }
    // Only positions are read: velocities and inputs may be anything.
    let positions = LogColumns {
        velocity: Vec::new(),
        input: columns.position.clone(),
        ..columns.clone()
    };
    let log = read_log(text, &positions, &Drives::torque(joints))?;
    // a missing setpoint would make a drive jump
    if let Some(first) = log.skipped.first {
        return Err(first);
    }
    let (t_s, q): (Vec<f64>, Vec<_>) = log.samples.iter().map(|sample| (sample.t_s, sample.q)).unzip();
    MotionTable::new(joints, &t_s, &q).map_err(|error| LogError {
        line: None,
        problem: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(t: f64) -> [f64; MAX_JOINTS] {
        let mut q = [0.0; MAX_JOINTS];
        // Value and acceleration are 0 at multiples of π, as (2) requires.
        (q[0], q[1]) = (t.sin(), 1.0 - 0.5 * (2.0 * t).sin());
        q
    }

    fn table(step: f64) -> MotionTable {
        let count = (std::f64::consts::TAU / step).round() as usize;
        let t: Vec<f64> = (0..=count)
            .map(|i| std::f64::consts::TAU * i as f64 / count as f64)
            .collect();
        let q: Vec<_> = t.iter().map(|t| sine(*t)).collect();
        MotionTable::new(2, &t, &q).unwrap()
    }

    /// Bounds for h = 0.02 and a fourth derivative of up to 8: 5 · 8 h⁴/384 = 1.7e-8, 8 h³/24 =
    /// 2.7e-6, 3 · 8 h²/8 = 1.2e-3 (C. Hall, W. Meyer, J. of Approximation Theory 16, 1976).
    #[test]
    fn val_the_curve_follows_a_sine_with_its_derivatives() {
        let table = table(0.02);
        for i in 0..1000 {
            let t = 6.2 * f64::from(i) / 1000.0;
            let [one, two, ..] = table.at(t);
            for (got, wanted) in [
                (one, [t.sin(), t.cos(), -t.sin()]),
                (
                    two,
                    [1.0 - 0.5 * (2.0 * t).sin(), -(2.0 * t).cos(), 2.0 * (2.0 * t).sin()],
                ),
            ] {
                for (d, bound) in [1.7e-8, 2.7e-6, 1.2e-3].into_iter().enumerate() {
                    assert!(
                        (got[d] - wanted[d]).abs() < bound,
                        "{t} s, derivative {d}: {got:?} {wanted:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn prop_a_closed_motion_is_repeated_and_another_one_rests_behind_its_end() {
        let closed = table(0.1);
        assert!(closed.is_closed());
        let (now, later) = (closed.at(1.0), closed.at(1.0 + closed.duration_s()));
        assert!((now[0][0] - later[0][0]).abs() < 1e-9 && (now[1][1] - later[1][1]).abs() < 1e-9);
        let open = MotionTable::new(1, &[0.0, 1.0, 2.0], &[[0.0; 8], [1.0; 8], [2.0; 8]]).unwrap();
        assert_eq!(open.at(5.0)[0], [2.0, 0.0, 0.0]);
        assert_eq!(open.at(-1.0)[0], [0.0; 3]);
    }

    #[test]
    fn prop_what_is_written_is_read_again() {
        let table = table(0.1);
        let read = MotionTable::parse(&table.to_csv(&[true, false]), 2).unwrap();
        // Times are written to a microsecond, positions to 1e-9.
        for i in 0..60 {
            let t = 0.1 * f64::from(i);
            for (a, b) in table.at(t).iter().zip(read.at(t)) {
                assert!((a[0] - b[0]).abs() < 3e-6 && (a[1] - b[1]).abs() < 1e-3, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn fault_a_table_that_is_no_motion_is_refused_by_its_line() {
        for (text, said) in [
            ("", "expected the columns t_s"),
            ("t_s,q1_rad\n0,0\n1,0\n2,0\n", "got none for q2"),
            (
                "t_s,q1_rad,q2_m,q3_m\n0,0,0,0\n1,0,0,0\n2,0,0,0\n",
                "also q3_m, of another",
            ),
            ("t_s,q1_rad,q2_m\n0,0,0\n1,x,0\n2,0,0\n", "line 3: column 2"),
            ("t_s,q1_rad,q2_m\n0,0,0\n1,0,0\n1,0,0\n", "expected a time after 1 s"),
            ("t_s;q1;q2\n0;0;0\n1;0;0\n", "3 instants or more"),
        ] {
            let error = MotionTable::parse(text, 2).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
