//! Decides whether the machine has changed within the last second, what changed, and when.
//!
//! With δ the error of the estimate before the last rows, A and g the information and gradient of
//! these rows, and x the possible sudden change:
//!
//! ```text
//! δ ~ N(0, Λ⁻¹),  x ~ N(0, R):   L_E = ½ hᵀ H⁻¹ h − ½ ln det H − ½ ln det R                      (1)
//! H = [Λ + A, A E; Eᵀ A, Eᵀ A E + R⁻¹],   h = (g, Eᵀ g)
//! gain_E = L_E − L_0                         ln of the Bayes factor against "nothing has changed" (2)
//!        = ½ sᵀ S⁻¹ s − ½ ln det S − ½ ln det R,   S = Eᵀ A E + R⁻¹ − Wᵀ W,   s = Eᵀ g − Wᵀ y        (2')
//! Λ + A = F Fᵀ,   W = F⁻¹ A E,   y = F⁻¹ g
//! t_c = argmin Σ_{t < t_c} ‖r(θ)‖² + Σ_{t ≥ t_c} ‖r(θ')‖²                                         (3)
//! ```
//!
//! (2') is (2) by the Schur complement: F is computed once for all possible changes.
//!
//! E is M of [`payload`](super::payload) for a payload and picks columns for friction. (1) compares
//! how much each of them explains with how much it could explain by chance: offsets of friction can
//! imitate a weight for a second, but are unlikely to do so at all joints at once in the proportion
//! of one payload. The rows' weights contain f_j, so the usual misfit of friction raises no alarm.
//! Source: R. Kass, A. Raftery, J. of the American Statistical Association 90 (1995).

use super::information::Information;
use super::payload::Payload;
use super::spatial::BODY_PARAMETERS;
use crate::estimator::linalg::{Cholesky, dot};

/// What has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangeCause {
    /// The payload.
    Payload,
    /// The friction of one or more joints.
    Friction,
    /// Neither explains it: an external force, or another machine.
    Unexplained,
}

/// A detected change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotChange {
    /// What has changed.
    pub cause: ChangeCause,
    /// When \[s\].
    pub t_s: f64,
    /// Time of the last row that was needed to find it \[s\].
    pub found_s: f64,
}

/// What may have changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Suspect {
    Payload,
    /// Friction of a joint, or of all of them.
    Friction(Option<usize>),
    /// Gain of the drive of a joint, or of all of them alike.
    Gain(Option<usize>),
    /// Zero of the encoder of a joint.
    Slip(usize),
}

/// A possible sudden change.
#[derive(Clone, Copy)]
pub(super) enum Extra<'a> {
    Nothing,
    Payload(&'a Payload),
    /// Parameters with the standard deviations of their change.
    Parameters(&'a [usize], &'a [f64]),
    /// A column of the rows that belongs to no parameter, with the standard deviation of its
    /// factor.
    Column(&'a Column, f64),
}

/// A column c of rows, by its products with those of the parameters.
#[derive(Debug, Clone)]
pub(super) struct Column {
    /// Xᵀ W c over all parameters.
    pub cross: Vec<f64>,
    /// cᵀ W c.
    pub square: f64,
    /// cᵀ W r, with r the residuals.
    pub score: f64,
}

/// Workspace for (1).
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    factor: Cholesky,
    a: Vec<f64>,
    h: Vec<f64>,
    rhs: Vec<f64>,
    columns: Vec<f64>,
    free: Vec<usize>,
    /// F of (2') with W by columns, y, S and s.
    base: Cholesky,
    small: Cholesky,
    w: Vec<f64>,
    y: Vec<f64>,
    s: Vec<f64>,
    moved: Vec<f64>,
    /// δ over all parameters, after [`weigh`](Self::weigh).
    pub delta: Vec<f64>,
    /// x.
    pub extra: Vec<f64>,
}

impl Evidence {
    /// For n parameters and changes of up to `extra` dimensions.
    pub fn new(n: usize, extra: usize) -> Self {
        let m = n + extra;
        Self {
            factor: Cholesky::new(m),
            a: vec![0.0; m * m],
            h: vec![0.0; m],
            rhs: vec![0.0; m],
            columns: vec![0.0; n * extra],
            free: Vec::with_capacity(n),
            base: Cholesky::new(n),
            small: Cholesky::new(extra),
            w: vec![0.0; n * extra],
            y: vec![0.0; n],
            s: vec![0.0; extra * extra],
            moved: vec![0.0; extra],
            delta: vec![0.0; n],
            extra: vec![0.0; extra],
        }
    }

    /// F and y of (2'); `known` is Λ, `data` holds A and g at the estimate of it. False if Λ + A is
    /// not positive definite because of rounding.
    pub fn begin(&mut self, known: &Information, data: &Information, fixed: &[bool]) -> bool {
        let n = known.n;
        self.free.clear();
        self.free.extend((0..n).filter(|i| !fixed[*i]));
        let f = self.free.len();
        for (r, &i) in self.free.iter().enumerate() {
            for (c, &j) in self.free.iter().enumerate() {
                self.a[r * f + c] = known.matrix[i * n + j] + data.matrix[i * n + j];
            }
            self.y[r] = data.vector[i];
        }
        if f == 0 || !self.base.factor(f, &self.a[..f * f]) {
            return false;
        }
        self.base.solve_half(&mut self.y[..f]);
        true
    }

    /// (2') after [`begin`](Self::begin) with the same `data`; `None` if S is not positive definite
    /// because of rounding.
    pub fn gain(&mut self, data: &Information, extra: Extra<'_>) -> Option<f64> {
        let (n, f, k) = (data.n, self.free.len(), extra.len());
        for i in 0..n {
            for e in 0..k {
                self.columns[i * k + e] = extra.cross(data, i, e); // A E
            }
        }
        for e in 0..k {
            let w = &mut self.w[e * f..(e + 1) * f];
            for (w, &i) in w.iter_mut().zip(&self.free) {
                *w = self.columns[i * k + e];
            }
            self.base.solve_half(w);
        }
        let mut spread = 0.0;
        for e in 0..k {
            let w = &self.w[e * f..(e + 1) * f];
            for d in 0..=e {
                let entry = extra.product_of(&self.columns, k, d, e) - dot(w, &self.w[d * f..(d + 1) * f]); // (2')
                self.s[d * k + e] = entry;
                self.s[e * k + d] = entry;
            }
            self.s[e * k + e] += extra.std(e).powi(-2);
            spread += 2.0 * extra.std(e).ln();
            self.moved[e] = extra.score(data, e) - dot(w, &self.y[..f]); // (2')
        }
        if !self.small.factor(k, &self.s[..k * k]) {
            return None;
        }
        self.small.solve_half(&mut self.moved[..k]);
        let explained = dot(&self.moved[..k], &self.moved[..k]);
        Some(0.5 * (explained - self.small.log_determinant() - spread)) // (2')
    }

    /// L_E of (1), and its δ and x; `known` is Λ, `data` holds A and g at the estimate of it.
    /// `None` if H is not positive definite because of rounding.
    pub fn weigh(&mut self, known: &Information, data: &Information, fixed: &[bool], extra: Extra<'_>) -> Option<f64> {
        let n = known.n;
        self.free.clear();
        self.free.extend((0..n).filter(|i| !fixed[*i]));
        let (f, k) = (self.free.len(), extra.len());
        let m = f + k;
        for i in 0..n {
            for e in 0..k {
                self.columns[i * k + e] = extra.cross(data, i, e); // A E
            }
        }
        for (r, &i) in self.free.iter().enumerate() {
            for (c, &j) in self.free.iter().enumerate() {
                self.a[r * m + c] = known.matrix[i * n + j] + data.matrix[i * n + j];
            }
            for e in 0..k {
                self.a[r * m + f + e] = self.columns[i * k + e];
                self.a[(f + e) * m + r] = self.columns[i * k + e];
            }
            self.h[r] = data.vector[i];
        }
        let mut spread = 0.0;
        for e in 0..k {
            for d in 0..k {
                self.a[(f + d) * m + f + e] = extra.product_of(&self.columns, k, d, e); // Eᵀ A E
            }
            self.a[(f + e) * m + f + e] += extra.std(e).powi(-2);
            spread += 2.0 * extra.std(e).ln();
            self.h[f + e] = extra.score(data, e);
        }
        if !self.factor.factor(m, &self.a[..m * m]) {
            return None;
        }
        self.rhs[..m].copy_from_slice(&self.h[..m]);
        self.factor.solve(&mut self.rhs[..m]);
        let explained: f64 = self.h[..m].iter().zip(&self.rhs[..m]).map(|(a, b)| a * b).sum();
        self.delta.fill(0.0);
        for (r, &i) in self.free.iter().enumerate() {
            self.delta[i] = self.rhs[r];
        }
        self.extra[..k].copy_from_slice(&self.rhs[f..m]);
        Some(0.5 * (explained - self.factor.log_determinant() - spread)) // (1)
    }
}

impl Extra<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::Payload(_) => BODY_PARAMETERS,
            Self::Parameters(indices, _) => indices.len(),
            Self::Column(..) => 1,
        }
    }

    fn std(&self, e: usize) -> f64 {
        match self {
            Self::Nothing => 1.0,
            Self::Payload(payload) => payload.prior[e],
            Self::Parameters(_, std) => std[e],
            Self::Column(_, std) => *std,
        }
    }

    /// Entry (i, e) of A E.
    fn cross(&self, data: &Information, i: usize, e: usize) -> f64 {
        match self {
            Self::Column(column, _) => column.cross[i],
            _ => self.product(&data.matrix[i * data.n..(i + 1) * data.n], e),
        }
    }

    /// Entry e of Eᵀ g.
    fn score(&self, data: &Information, e: usize) -> f64 {
        match self {
            Self::Column(column, _) => column.score,
            _ => self.product(&data.vector, e),
        }
    }

    /// A row over the parameters times column e of E.
    fn product(&self, row: &[f64], e: usize) -> f64 {
        match self {
            Self::Nothing | Self::Column(..) => 0.0,
            Self::Payload(payload) => (0..payload.first).map(|a| row[a] * payload.row(a)[e]).sum(),
            Self::Parameters(indices, _) => row[indices[e]],
        }
    }

    /// Entry (d, e) of Eᵀ (A E).
    fn product_of(&self, columns: &[f64], k: usize, d: usize, e: usize) -> f64 {
        match self {
            Self::Nothing => 0.0,
            Self::Payload(payload) => (0..payload.first).map(|a| payload.row(a)[d] * columns[a * k + e]).sum(),
            Self::Parameters(indices, _) => columns[indices[d] * k + e],
            Self::Column(column, _) => column.square,
        }
    }

    /// step + E x, as a step of the arm's parameters; a column besides theirs is ignored.
    pub fn add(&self, extra: &[f64], step: &mut [f64]) {
        match self {
            Self::Nothing | Self::Column(..) => {}
            Self::Payload(payload) => {
                for (a, step) in step.iter_mut().enumerate().take(payload.first) {
                    *step += payload.row(a).iter().zip(extra).map(|(m, x)| m * x).sum::<f64>();
                }
            }
            Self::Parameters(indices, _) => indices.iter().zip(extra).for_each(|(&i, x)| step[i] += x),
        }
    }
}
