//! Normal equations of one joint's rows, kept per joint so that their weight can be chosen later.
//!
//! With rows x and torques τ of a joint, A = Σ x xᵀ, b = Σ x τ, c = Σ τ²:
//!
//! ```text
//! Σ (τ − x·θ)² = c − 2 b·θ + θᵀ A θ                                                            (1)
//! dᵀ(b − A θ) = d·b − θᵀ(A d)                                                                  (2)
//! ```

use super::information::Information;
use crate::estimator::persist::{Visit, visit_symmetric};
use std::ops::Range;

/// A, b, c and the number of rows of one joint, over its own columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JointSums {
    columns: Vec<usize>,
    /// A, row-major, in full.
    pub gram: Vec<f64>,
    /// b.
    pub moment: Vec<f64>,
    /// Bias of b by errors of the velocities: (1) of `acceleration_noise.rs`.
    pub bias: Vec<f64>,
    /// c.
    pub square: f64,
    /// Their contribution to c.
    pub noise: f64,
    /// Σ τ.
    pub sum: f64,
    /// Number of rows.
    pub rows: usize,
}

impl JointSums {
    /// No rows yet; `columns` are the indices of the joint's columns in θ.
    pub fn new(columns: &[usize]) -> Self {
        let m = columns.len();
        Self {
            columns: columns.to_vec(),
            gram: vec![0.0; m * m],
            moment: vec![0.0; m],
            bias: vec![0.0; m],
            square: 0.0,
            noise: 0.0,
            sum: 0.0,
            rows: 0,
        }
    }

    /// Indices of the columns in θ.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Forgets its rows.
    pub fn clear(&mut self) {
        self.gram.fill(0.0);
        self.moment.fill(0.0);
        self.bias.fill(0.0);
        self.square = 0.0;
        self.noise = 0.0;
        self.sum = 0.0;
        self.rows = 0;
    }

    /// Copies the sums of another block.
    pub fn copy_from(&mut self, other: &Self) {
        self.gram.copy_from_slice(&other.gram);
        self.moment.copy_from_slice(&other.moment);
        self.bias.copy_from_slice(&other.bias);
        self.square = other.square;
        self.noise = other.noise;
        self.sum = other.sum;
        self.rows = other.rows;
    }

    /// Adds a row to the lower triangle only, see [`mirror`](Self::mirror).
    pub fn add_row(&mut self, x: &[f64], torque: f64) {
        let m = x.len();
        for i in 0..m {
            let row = &mut self.gram[i * m..i * m + i + 1];
            for (entry, value) in row.iter_mut().zip(x) {
                *entry += x[i] * value;
            }
            self.moment[i] += x[i] * torque;
        }
        self.square += torque * torque;
        self.sum += torque;
        self.rows += 1;
    }

    /// Adds the bias of the last row: `add` adds it to its argument and returns the corresponding
    /// variance of the row's torque.
    pub fn add_bias(&mut self, add: &mut dyn FnMut(&mut [f64]) -> f64) {
        self.noise += add(&mut self.bias);
    }

    /// Completes A from its lower triangle.
    pub fn mirror(&mut self) {
        let m = self.moment.len();
        for i in 0..m {
            for j in 0..i {
                self.gram[j * m + i] = self.gram[i * m + j];
            }
        }
    }

    /// Adds another's rows.
    pub fn add(&mut self, other: &Self) {
        self.gram.iter_mut().zip(&other.gram).for_each(|(a, b)| *a += b);
        self.moment.iter_mut().zip(&other.moment).for_each(|(a, b)| *a += b);
        self.bias.iter_mut().zip(&other.bias).for_each(|(a, b)| *a += b);
        self.square += other.square;
        self.noise += other.noise;
        self.sum += other.sum;
        self.rows += other.rows;
    }

    /// Scales its rows by `kept` and adds another's. The other may have further columns before its
    /// last one. The number of rows is not scaled.
    pub fn fade(&mut self, kept: f64, other: &Self) {
        let (m, wide) = (self.moment.len(), other.moment.len());
        let at = |i: usize| {
            if self.columns[i] == other.columns[i] {
                i
            } else {
                wide - 1
            }
        };
        for i in 0..m {
            let from = &other.gram[at(i) * wide..(at(i) + 1) * wide];
            let row = &mut self.gram[i * m..(i + 1) * m];
            let same = if at(m - 1) == m - 1 { m } else { m - 1 };
            row[..same].iter_mut().zip(from).for_each(|(a, b)| *a = kept * *a + b);
            row[same..].iter_mut().for_each(|a| *a = kept * *a + from[wide - 1]);
            self.moment[i] = kept * self.moment[i] + other.moment[at(i)];
            self.bias[i] = kept * self.bias[i] + other.bias[at(i)];
        }
        self.square = kept * self.square + other.square;
        self.noise = kept * self.noise + other.noise;
        self.sum = kept * self.sum + other.sum;
        self.rows += other.rows;
    }

    /// Its torques divided by a factor.
    pub fn divide_torque(&mut self, factor: f64) {
        self.moment.iter_mut().for_each(|b| *b /= factor);
        self.square /= factor * factor;
        self.sum /= factor;
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        visit_symmetric(v, &mut self.gram, self.moment.len());
        v.reals(&mut self.moment);
        v.reals(&mut self.bias);
        for sum in [&mut self.square, &mut self.noise, &mut self.sum] {
            v.real(sum);
        }
        let mut rows = self.rows as u64;
        v.count(&mut rows);
        self.rows = rows as usize;
    }

    /// (1), never below 0.
    pub fn residual_square(&self, theta: &[f64]) -> f64 {
        let m = self.moment.len();
        let mut sum = self.square;
        for (i, &a) in self.columns.iter().enumerate() {
            let mut row = -2.0 * self.moment[i];
            for (entry, &b) in self.gram[i * m..(i + 1) * m].iter().zip(&self.columns) {
                row += entry * theta[b];
            }
            sum += theta[a] * row; // (1)
        }
        sum.max(0.0)
    }

    /// Gradient b − A θ of one column.
    pub fn gradient(&self, column: usize, theta: &[f64]) -> f64 {
        let m = self.moment.len();
        let row = &self.gram[column * m..(column + 1) * m];
        let predicted: f64 = row.iter().zip(&self.columns).map(|(a, &k)| a * theta[k]).sum();
        self.moment[column] - predicted
    }

    /// (2) and dᵀ A d; d and θ are over all columns.
    pub fn along(&self, d: &[f64], theta: &[f64]) -> (f64, f64) {
        let m = self.moment.len();
        let (mut score, mut information) = (0.0, 0.0);
        for (i, &a) in self.columns.iter().enumerate() {
            let row = self.gram[i * m..(i + 1) * m].iter().zip(&self.columns);
            let product: f64 = row.map(|(entry, &b)| entry * d[b]).sum();
            score += d[a] * self.moment[i] - theta[a] * product; // (2)
            information += d[a] * product;
        }
        (score, information)
    }

    /// eᵀ (FᵀF)⁻¹ e of (3) of [`identify`](super::identify) over these columns, and its number
    /// of directions.
    pub fn friction_misfit(&self, friction: Range<usize>, theta: &[f64]) -> Option<(f64, f64)> {
        const MOST: usize = 8;
        const DEPENDENT: f64 = 1e-6;
        let m = self.columns().len();
        let first = friction.start;
        // Cholesky without square roots; a column that depends on those before it, as in a block
        // without a reversal, adds no direction.
        let mut l = [[0.0; MOST]; MOST];
        let mut d = [0.0; MOST];
        let mut e = [0.0; MOST];
        let (mut square, mut directions) = (0.0, 0.0);
        for i in 0..friction.len().min(MOST) {
            let row = &self.gram[(first + i) * m + first..(first + i + 1) * m];
            e[i] = self.gradient(first + i, theta);
            let mut pivot = row[i];
            for j in 0..i {
                if d[j] > 0.0 {
                    let mut v = row[j];
                    for k in 0..j {
                        v -= l[i][k] * l[j][k] * d[k];
                    }
                    l[i][j] = v / d[j];
                    pivot -= l[i][j] * l[i][j] * d[j];
                    e[i] -= l[i][j] * e[j];
                }
            }
            if pivot > DEPENDENT * row[i] {
                d[i] = pivot;
                square += e[i] * e[i] / pivot;
                directions += 1.0;
            }
        }
        (directions > 0.0).then_some((square, directions))
    }

    /// Σ x² of one column.
    pub fn squares(&self, column: usize) -> f64 {
        self.gram[column * (self.moment.len() + 1)]
    }

    /// Moves the origin to θ: b becomes the gradient there, c the sum of squared residuals.
    pub fn shift(&mut self, theta: &[f64]) {
        self.square = self.residual_square(theta);
        for column in 0..self.moment.len() {
            self.moment[column] = self.gradient(column, theta);
        }
    }

    /// The columns with indices below n, without that of the time, which is the last.
    pub fn columns_below(&self, n: usize) -> &[usize] {
        match self.columns.split_last() {
            Some((last, others)) if *last >= n => others,
            _ => &self.columns,
        }
    }

    /// Adds weight · A, weight · b and the weighted bias to an n × n information and its vectors,
    /// without the column of the time.
    pub fn scatter(&self, weight: f64, into: &mut Information) {
        let n = into.n;
        let m = self.moment.len();
        let columns = self.columns_below(n);
        for (i, &a) in columns.iter().enumerate() {
            for (entry, &b) in self.gram[i * m..(i + 1) * m].iter().zip(columns) {
                into.matrix[a * n + b] += weight * entry;
            }
            into.vector[a] += weight * self.moment[i];
            into.bias[a] += weight * self.bias[i];
        }
    }
}
