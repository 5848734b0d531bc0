//! Estimates in information form, with their prior, and their solution with some parameters fixed.
//!
//! ```text
//! Λ θ̂ = b                                                                                        (1)
//! Λ_ff θ_f = b_f − Λ_fh θ_h                              parameters h fixed at θ_h             (2)
//! (Λ⁻¹ + Q)⁻¹ = Λ − Λ_q (Q_q⁻¹ + Λ_qq)⁻¹ Λ_qᵀ,   b likewise                  a random walk of q   (3)
//! Λ_aa − Λ_ap Λ_pp⁻¹ Λ_pa,   b_a − Λ_ap Λ_pp⁻¹ b_p                         p is eliminated         (4)
//! ```
//!
//! (3) is the matrix inversion lemma: the information on fixed parameters stays as if they had been
//! estimated all the time, so they can be freed again.

use crate::estimator::linalg::{Cholesky, dot};
use crate::estimator::persist::Visit;

/// Λ and b of n parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Information {
    pub n: usize,
    /// Λ, row-major, in full.
    pub matrix: Vec<f64>,
    /// b.
    pub vector: Vec<f64>,
    /// Bias of b by errors of the positions.
    pub bias: Vec<f64>,
}

impl Information {
    /// No information on n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            n,
            matrix: vec![0.0; n * n],
            vector: vec![0.0; n],
            bias: vec![0.0; n],
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.matrix.fill(0.0);
        self.vector.fill(0.0);
        self.bias.fill(0.0);
    }

    /// Becomes a copy.
    pub fn copy_from(&mut self, other: &Self) {
        self.matrix.copy_from_slice(&other.matrix);
        self.vector.copy_from_slice(&other.vector);
        self.bias.copy_from_slice(&other.bias);
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.matrix);
        v.reals(&mut self.vector);
        v.reals(&mut self.bias);
    }

    /// Sets the prior of one parameter without other information.
    pub fn set_prior(&mut self, i: usize, mean: f64, std: f64) {
        let n = self.n;
        for j in 0..n {
            self.matrix[i * n + j] = 0.0;
            self.matrix[j * n + i] = 0.0;
        }
        self.matrix[i * n + i] = std.powi(-2);
        self.vector[i] = mean * std.powi(-2);
        self.bias[i] = 0.0;
    }
}

/// Workspace to solve for up to n parameters.
#[derive(Debug, Clone)]
pub(super) struct Solver {
    factor: Cholesky,
    a: Vec<f64>,
    b: Vec<f64>,
    columns: Vec<f64>,
    rows: Vec<f64>,
    free: Vec<usize>,
}

impl Solver {
    pub fn new(n: usize) -> Self {
        Self {
            factor: Cholesky::new(n),
            a: vec![0.0; n * n],
            b: vec![0.0; n],
            columns: vec![0.0; n * n],
            rows: vec![0.0; n * n],
            free: Vec::with_capacity(n),
        }
    }

    fn gather(&mut self, information: &Information, fixed: &[bool]) -> usize {
        let n = information.n;
        self.free.clear();
        self.free.extend((0..n).filter(|i| !fixed[*i]));
        let m = self.free.len();
        for (r, &i) in self.free.iter().enumerate() {
            for (c, &j) in self.free.iter().enumerate() {
                self.a[r * m + c] = information.matrix[i * n + j];
            }
        }
        m
    }

    /// (2): writes θ̂ into the entries of `theta` that are not fixed; returns false and leaves
    /// `theta` unchanged if Λ is not positive definite because of rounding.
    pub fn solve(&mut self, information: &Information, fixed: &[bool], theta: &mut [f64]) -> bool {
        let n = information.n;
        let m = self.gather(information, fixed);
        if m == 0 || !self.factor.factor(m, &self.a[..m * m]) {
            return false;
        }
        for (r, &i) in self.free.iter().enumerate() {
            let row = &information.matrix[i * n..(i + 1) * n];
            let held: f64 = (0..n).filter(|j| fixed[*j]).map(|j| row[j] * theta[j]).sum();
            self.b[r] = information.vector[i] - held; // (2)
        }
        self.factor.solve(&mut self.b[..m]);
        for (r, &i) in self.free.iter().enumerate() {
            theta[i] = self.b[r];
        }
        true
    }

    /// x ← Λ_ff⁻¹ x with the Λ of the last solution, 0 for fixed parameters.
    pub fn apply(&mut self, x: &mut [f64]) {
        let m = self.free.len();
        for (b, &i) in self.b.iter_mut().zip(&self.free) {
            *b = x[i];
        }
        self.factor.solve(&mut self.b[..m]);
        x.fill(0.0);
        for (b, &i) in self.b.iter().zip(&self.free) {
            x[i] = *b;
        }
    }

    /// (2) of `acceleration_noise.rs`, with P = `covariance`.
    pub fn bias(information: &Information, covariance: &[f64], bias: &mut [f64]) {
        let n = information.n;
        for (i, bias) in bias.iter_mut().enumerate() {
            *bias = dot(&covariance[i * n..(i + 1) * n], &information.bias);
        }
    }

    /// P = Λ_ff⁻¹ in the rows and columns of the free parameters, 0 for fixed ones. Returns false
    /// and leaves `covariance` unchanged if Λ is not positive definite because of rounding.
    pub fn covariance(&mut self, information: &Information, fixed: &[bool], covariance: &mut [f64]) -> bool {
        let n = information.n;
        let m = self.gather(information, fixed);
        if m == 0 || !self.factor.factor(m, &self.a[..m * m]) {
            return false;
        }
        self.factor.inverse(&mut self.columns[..m * m]);
        let is_sound = |variance: f64| variance > 0.0 && variance.is_finite();
        if !(0..m).all(|r| is_sound(self.columns[r * m + r])) {
            return false;
        }
        covariance[..n * n].fill(0.0);
        for (r, &i) in self.free.iter().enumerate() {
            for (c, &j) in self.free.iter().enumerate() {
                covariance[i * n + j] = self.columns[r * m + c];
            }
        }
        true
    }

    /// (3) for the parameters q with the variances `walk`; those with variance 0 stay unchanged.
    pub fn walk(&mut self, information: &mut Information, q: &[usize], walk: &[f64]) {
        self.eliminate(information, q, Some(walk));
    }

    /// (4): eliminates the parameters p, which may have any value, and clears their entries.
    pub fn marginalise(&mut self, information: &mut Information, p: &[usize]) {
        self.eliminate(information, p, None);
        let n = information.n;
        for &i in p {
            for j in 0..n {
                information.matrix[i * n + j] = 0.0;
                information.matrix[j * n + i] = 0.0;
            }
            information.vector[i] = 0.0;
            information.bias[i] = 0.0;
        }
    }

    /// Applies (2) permanently: conditions on these values of the parameters p and clears their
    /// entries.
    pub fn condition(information: &mut Information, p: &[usize], theta: &[f64]) {
        let n = information.n;
        for i in (0..n).filter(|i| !p.contains(i)) {
            let held: f64 = p.iter().map(|j| information.matrix[i * n + j] * theta[*j]).sum();
            information.vector[i] -= held; // (2)
        }
        for &i in p {
            for j in 0..n {
                information.matrix[i * n + j] = 0.0;
                information.matrix[j * n + i] = 0.0;
            }
            information.vector[i] = 0.0;
            information.bias[i] = 0.0;
        }
    }

    fn eliminate(&mut self, information: &mut Information, q: &[usize], walk: Option<&[f64]>) {
        let n = information.n;
        self.free.clear();
        let moves = |k: &usize| walk.is_none_or(|walk| walk[*k] > 0.0);
        self.free.extend((0..q.len()).filter(moves));
        let m = self.free.len();
        for r in 0..m {
            for c in 0..m {
                self.a[r * m + c] = information.matrix[q[self.free[r]] * n + q[self.free[c]]];
            }
            if let Some(walk) = walk {
                self.a[r * m + r] += 1.0 / walk[self.free[r]];
            }
        }
        if m == 0 || !self.factor.factor(m, &self.a[..m * m]) {
            return;
        }
        // Row i of `rows` is Λ_qi, of `columns` (Q⁻¹ + Λ_qq)⁻¹ Λ_qi.
        for i in 0..n {
            for (r, &k) in self.free.iter().enumerate() {
                self.rows[i * m + r] = information.matrix[i * n + q[k]];
            }
            let column = &mut self.columns[i * m..(i + 1) * m];
            column.copy_from_slice(&self.rows[i * m..(i + 1) * m]);
            self.factor.solve(column);
        }
        for vector in [&mut information.vector, &mut information.bias] {
            for (entry, &k) in self.b.iter_mut().zip(&self.free) {
                *entry = vector[q[k]];
            }
            for i in 0..n {
                vector[i] -= dot(&self.columns[i * m..(i + 1) * m], &self.b[..m]); // (3), (4)
            }
        }
        for i in 0..n {
            let column = &self.columns[i * m..(i + 1) * m];
            for j in 0..=i {
                let less = information.matrix[i * n + j] - dot(column, &self.rows[j * m..(j + 1) * m]); // (3), (4)
                information.matrix[i * n + j] = less;
                information.matrix[j * n + i] = less;
            }
        }
    }
}
