//! Least squares for a robot, off line: over the windows of the service, and over differentiated
//! positions, with the reference motion as instruments or not.
//!
//! ```text
//! (Σ z xᵀ/s² + Λ₀) (θ̂ − θ₀) = Σ z (τ − x·θ₀)/s²       z = x, or the same row of the reference      (1)
//! ```
//!
//! s is the noise of the joint's torque, or equal for all joints. θ₀ is the URDF's value, Λ₀ the
//! prior information, as in the service. Before differentiation, positions are filtered by a
//! Butterworth filter forwards and backwards; both sides of the equations are filtered by another
//! one and thinned out. As usual, rows near rest and reversals are left out there, because friction
//! is not sign q̇.
//!
//! Sources: J. Swevers et al., IEEE Trans. Robotics and Automation 13 (1997); A. Janot, P.-O.
//! Vandanjon, M. Gautier, IEEE Trans. Control Systems Technology 22 (2014) for instruments.

use super::instruments::{derivatives, smooth};
use crate::model::MAX_JOINTS;
use crate::robot::{EnergyRegressors, Engagement, RobotError, RobotModel, RobotSample, WeakRows, WindowOptions};
use nalgebra::{DMatrix, DVector};

/// Edge of the low-pass before differentiation \[Hz\].
const DIFFERENTIATED_HZ: f64 = 20.0;
/// Edge of the low-pass over both sides of the equations \[Hz\].
const EQUATION_HZ: f64 = 10.0;
/// One of this many samples is kept after it.
const KEPT: usize = 20;
/// Samples at either end that the filters need.
const ENDS: usize = 400;
/// Samples on either side of rest that are also left out.
const AROUND: usize = 25;

/// (1), scaled by the prior.
struct Normal<'a> {
    model: &'a RobotModel,
    left: DMatrix<f64>,
    right: DVector<f64>,
}

impl<'a> Normal<'a> {
    fn new(model: &'a RobotModel) -> Self {
        let count = model.parameters().len();
        Self {
            model,
            left: DMatrix::identity(count, count),
            right: DVector::zeros(count),
        }
    }

    /// Adds a row of a joint, over the joint's columns.
    fn add(&mut self, joint: usize, instrument: &[f64], row: &[f64], torque: f64, std: f64) {
        let (columns, parameters) = (self.model.columns(joint), self.model.parameters());
        let nominal: f64 = row
            .iter()
            .zip(columns)
            .map(|(x, &index)| x * parameters[index].nominal)
            .sum();
        let weight = std.powi(-2);
        for (x, &b) in row.iter().zip(columns) {
            let x = x * parameters[b].scale * weight;
            for (z, &a) in instrument.iter().zip(columns) {
                self.left[(a, b)] += z * parameters[a].scale * x;
            }
        }
        for (z, &a) in instrument.iter().zip(columns) {
            self.right[a] += z * parameters[a].scale * (torque - nominal) * weight;
        }
    }

    fn solve(self) -> Option<Vec<f64>> {
        let solution = self.left.lu().solve(&self.right)?;
        let parameters = self.model.parameters().iter();
        let theta: Vec<f64> = parameters
            .zip(&solution)
            .map(|(parameter, x)| parameter.nominal + parameter.scale * x)
            .collect();
        theta.iter().all(|value| value.is_finite()).then_some(theta)
    }
}

/// θ̂ over the rows of these windows, with equal weights and with a weight per joint; `row_std` is
/// the standard deviation of a row due to the noise of each joint's torque.
///
/// # Errors
/// If the windows are invalid.
pub fn in_windows(
    model: &RobotModel,
    windows: WindowOptions,
    samples: &[RobotSample],
    row_std: &[f64],
) -> Result<[Option<Vec<f64>>; 2], RobotError> {
    let mut rows = WeakRows::new(model, windows)?;
    let common = (row_std.iter().map(|std| std * std).sum::<f64>() / row_std.len() as f64).sqrt();
    let (mut ordinary, mut weighted) = (Normal::new(model), Normal::new(model));
    for sample in samples {
        rows.push(model, sample, &mut |row| {
            ordinary.add(row.joint, row.regressor, row.regressor, row.torque, common);
            weighted.add(row.joint, row.regressor, row.regressor, row.torque, row_std[row.joint]);
        })?;
    }
    Ok([ordinary.solve(), weighted.solve()])
}

/// The equations of a motion, thinned out.
struct Equations {
    /// Each entry of the rows of [`RobotModel::rows`] over time.
    entries: Vec<Vec<f64>>,
    /// For each joint, whether it moves.
    moves: Vec<Vec<bool>>,
}

impl Equations {
    /// From positions at a fixed period.
    fn new(model: &RobotModel, positions: &[[f64; MAX_JOINTS]], period_s: f64) -> Self {
        let (n, count, width) = (model.robot().len(), positions.len(), model.row_entries());
        let joints: Vec<[Vec<f64>; 4]> = (0..n)
            .map(|joint| {
                derivatives(
                    positions.iter().map(|q| q[joint]).collect(),
                    DIFFERENTIATED_HZ,
                    period_s,
                )
            })
            .collect();
        let mut regressors = EnergyRegressors::new(n);
        let mut engagement = [Engagement::default(); MAX_JOINTS];
        let mut entries = vec![vec![0.0; count]; width];
        let (mut d, mut c) = (vec![0.0; width], vec![0.0; width]);
        let (mut q, mut dq) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        for k in 0..count {
            for i in 0..n {
                (q[i], dq[i]) = (joints[i][0][k], joints[i][1][k]);
                engagement[i] = model.friction()[i].engagement(dq[i] * period_s, engagement[i]);
            }
            model.rows(&mut regressors, &q[..n], &dq[..n], &engagement[..n], &mut d, &mut c);
            // d/dt d + c, by central differences of d
            for ((entry, d), c) in entries.iter_mut().zip(&d).zip(&c) {
                entry[k] += c;
                if k > 0 {
                    entry[k - 1] += d / (2.0 * period_s);
                }
                if k + 1 < count {
                    entry[k + 1] -= d / (2.0 * period_s);
                }
            }
        }
        for entry in &mut entries {
            thin(entry, period_s);
        }
        let moves = (0..n).map(|i| {
            let slow: Vec<bool> = joints[i][1]
                .iter()
                .map(|dq| dq.abs() < model.friction()[i].rest_speed)
                .collect();
            kept(count)
                .map(|k| !slow[k - AROUND..=k + AROUND].contains(&true))
                .collect()
        });
        Self {
            moves: moves.collect(),
            entries,
        }
    }

    fn row(&self, entries: std::ops::Range<usize>, k: usize) -> Vec<f64> {
        self.entries[entries].iter().map(|entry| entry[k]).collect()
    }
}

/// Indices of the samples kept out of `count`.
fn kept(count: usize) -> impl Iterator<Item = usize> {
    (ENDS..count.saturating_sub(ENDS)).step_by(KEPT)
}

fn thin(values: &mut Vec<f64>, period_s: f64) {
    smooth(values, EQUATION_HZ, period_s);
    *values = kept(values.len()).map(|k| values[k]).collect();
}

/// θ̂ from differentiated positions, and with the same rows of the setpoints as instruments.
pub fn differentiated(
    model: &RobotModel,
    log: &[RobotSample],
    setpoints: &[[f64; MAX_JOINTS]],
    torque_std: &[f64],
) -> [Option<Vec<f64>>; 2] {
    let [first, second, ..] = log else {
        return [None, None];
    };
    let period_s = second.t_s - first.t_s;
    let positions: Vec<[f64; MAX_JOINTS]> = log.iter().map(|sample| sample.q).collect();
    let measured = Equations::new(model, &positions, period_s);
    let reference = Equations::new(model, setpoints, period_s);
    let (mut least_squares, mut instruments) = (Normal::new(model), Normal::new(model));
    let mut begin = 0;
    for (joint, std) in torque_std.iter().enumerate() {
        let entries = begin..begin + model.columns(joint).len();
        begin = entries.end;
        let mut torque: Vec<f64> = log.iter().map(|sample| sample.tau[joint]).collect();
        thin(&mut torque, period_s);
        for (k, torque) in torque.into_iter().enumerate() {
            if measured.moves[joint][k] {
                let (row, instrument) = (measured.row(entries.clone(), k), reference.row(entries.clone(), k));
                least_squares.add(joint, &row, &row, torque, *std);
                instruments.add(joint, &instrument, &row, torque, *std);
            }
        }
    }
    [least_squares.solve(), instruments.solve()]
}
