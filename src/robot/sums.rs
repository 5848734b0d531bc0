//! Normal equations of one joint's rows, kept apart per joint so that their weight can be chosen
//! later.
//!
//! With rows x and torques τ of a joint, A = Σ x xᵀ, b = Σ x τ, c = Σ τ²:
//!
//! ```text
//! Σ (τ − x·θ)² = c − 2 b·θ + θᵀ A θ                                                            (1)
//! ```

/// A, b, c and the number of rows of one joint, over its own columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JointSums {
    columns: Vec<usize>,
    /// A, row-major, in full.
    pub gram: Vec<f64>,
    /// b.
    pub moment: Vec<f64>,
    /// c.
    pub square: f64,
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
            square: 0.0,
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
        self.square = 0.0;
        self.sum = 0.0;
        self.rows = 0;
    }

    /// Takes another joint block's sums over.
    pub fn copy_from(&mut self, other: &Self) {
        self.gram.copy_from_slice(&other.gram);
        self.moment.copy_from_slice(&other.moment);
        self.square = other.square;
        self.sum = other.sum;
        self.rows = other.rows;
    }

    /// Adds a row; the lower triangle only, see [`mirror`](Self::mirror).
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
        self.square += other.square;
        self.sum += other.sum;
        self.rows += other.rows;
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

    /// Takes θ for the origin: b becomes the gradient there, c the sum of squared residuals.
    pub fn shift(&mut self, theta: &[f64]) {
        self.square = self.residual_square(theta);
        for column in 0..self.moment.len() {
            self.moment[column] = self.gradient(column, theta);
        }
    }

    /// Adds weight · A and weight · b to an n × n information matrix and vector.
    pub fn scatter(&self, weight: f64, n: usize, information: &mut [f64], vector: &mut [f64]) {
        let m = self.moment.len();
        for (i, &a) in self.columns.iter().enumerate() {
            for (entry, &b) in self.gram[i * m..(i + 1) * m].iter().zip(&self.columns) {
                information[a * n + b] += weight * entry;
            }
            vector[a] += weight * self.moment[i];
        }
    }
}
