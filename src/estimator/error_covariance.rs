//! Covariance of the error of θ̂, split by its causes.
//!
//! θ̂ is a linear function of the past data: with K = Γ_m and A = I − K S the error obeys e_m = A
//! e_{m−1} + K Σ φ n, whatever the forgetting rule. So its covariance propagates as (Joseph's form)
//!
//! ```text
//! P ← A P Aᵀ + K (Σ_e σ_e² S_e) K
//! ```
//!
//! For exponential forgetting this is the sandwich Γ M Γ with M ← λ² M + S. It is kept per equation
//! for noise of unit variance, so that the noise level may still be learnt, and separately for the
//! uncertainty of the start value and of changes since.

use super::curvature::Curvature;
use super::equation::EquationState;
use super::linalg::Congruence;
use super::persist::Visit;
use super::workspace::Workspace;

/// The covariances of a group, n × n each. The part that an equation's noise of unit variance
/// causes is in [`EquationState::noise_covariance`].
#[derive(Debug, Clone)]
pub struct ErrorCovariance {
    n: usize,
    /// Of the error of the start value.
    guess: Vec<f64>,
    /// Of the error from changes of the plant since then.
    change: Vec<f64>,
    /// P: the sum of all parts, weighted with the noise variances.
    total: Vec<f64>,
    congruence: Congruence,
}

impl ErrorCovariance {
    /// Zero covariances for n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            n,
            guess: vec![0.0; n * n],
            change: vec![0.0; n * n],
            total: vec![0.0; n * n],
            congruence: Congruence::new(n),
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.guess);
        v.reals(&mut self.change);
        v.reals(&mut self.total);
    }

    /// True if no variance is negative.
    pub fn is_sound(&self) -> bool {
        let diagonal = |m: &[f64]| (0..self.n).all(|i| m[i * self.n + i] >= 0.0);
        diagonal(&self.guess) && diagonal(&self.change) && diagonal(&self.total)
    }

    /// Resets parameter i to a guess with this variance.
    pub fn forget_parameter(&mut self, i: usize, variance: f64) {
        clear_entries(self.n, &mut self.guess, i, variance);
        clear_entries(self.n, &mut self.change, i, 0.0);
        clear_entries(self.n, &mut self.total, i, variance);
    }

    /// P, n × n.
    pub fn total(&self) -> &[f64] {
        &self.total
    }

    /// P_ii.
    pub fn variance(&self, i: usize) -> f64 {
        self.total[i * self.n + i]
    }

    /// Entry k of P with the guess's variance multiplied by `factor`.
    pub fn doubting_guess(&self, k: usize, factor: f64) -> f64 {
        self.total[k] + (factor - 1.0) * self.guess[k]
    }

    /// Parameter i may have changed by an amount of this variance. [`add_up`](Self::add_up) adds it
    /// to P.
    pub fn add_change(&mut self, i: usize, variance: f64) {
        self.change[i * self.n + i] += variance;
    }

    /// What is known comes from a line, whose end has errors of this `covariance`(i, j); see
    /// [`end_guess`](Self::end_guess).
    pub fn take_line(&mut self, covariance: impl Fn(usize, usize) -> f64) {
        for i in 0..self.n {
            for j in 0..self.n {
                self.change[i * self.n + j] = covariance(i, j);
            }
        }
    }

    /// The start value has no share in the error any more.
    pub fn end_guess(&mut self) {
        self.guess.fill(0.0);
    }

    /// Refers guess and change to the θ that `curvature` was turned to.
    pub fn turn(&mut self, curvature: &Curvature) {
        curvature.turn_covariance(&mut self.guess);
        curvature.turn_covariance(&mut self.change);
    }

    /// P ← A P Aᵀ for guess and change; `room` holds A as `transition`.
    pub fn carry(&mut self, room: &mut Workspace) {
        for covariance in [&mut self.guess, &mut self.change] {
            self.congruence.apply(self.n, &room.transition, covariance, &mut room.b);
            covariance.copy_from_slice(&room.b);
        }
    }

    /// P ← A P Aᵀ + K S K for one equation's noise; `room` holds A as `transition`, K as `gain`, S
    /// as `total`.
    pub fn carry_noise(&mut self, room: &mut Workspace, noise: &mut [f64]) {
        self.congruence.apply(self.n, &room.transition, noise, &mut room.b);
        noise.copy_from_slice(&room.b);
        self.congruence.apply(self.n, &room.gain, &room.total, &mut room.b);
        noise.iter_mut().zip(&room.b).for_each(|(p, v)| *p += v);
    }

    /// Sums the parts into the total.
    pub fn add_up(&mut self, equations: &[EquationState]) {
        for (k, c) in self.total.iter_mut().enumerate() {
            *c = self.guess[k] + self.change[k];
        }
        for e in equations {
            for (c, p) in self.total.iter_mut().zip(&e.noise_covariance) {
                *c += e.variance * p;
            }
        }
    }
}

/// Clears row and column i of an n × n matrix and sets its diagonal entry to `diagonal`.
pub fn clear_entries(n: usize, matrix: &mut [f64], i: usize, diagonal: f64) {
    for k in 0..n {
        matrix[i * n + k] = 0.0;
        matrix[k * n + i] = 0.0;
    }
    matrix[i * n + i] = diagonal;
}
