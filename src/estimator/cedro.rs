//! The paper's block recursion on one page, to be read beside the paper: equations (5) to (11).
//!
//! ```text
//! f_n(θ) = 0                                                                the plant           (5)
//! J_m(θ) = Σ_j λ^(m−j) Σ_{i∈α(j)} f_i(θ)² + λ^m (θ̂₀−θ)ᵀ Γ₀⁻¹ (θ̂₀−θ)         the cost            (6)
//! f_n(θ) ≈ v_n − φ_nᵀ θ,   φ_n = −∂f_n/∂θ,   v_n = f_n(θ̂) + φ_nᵀ θ̂          linear near θ̂       (7)
//! θ̂_m   = θ̂_{m−1} + Γ_m Σ_{i∈α(m)} φ_i (v_i − φ_iᵀ θ̂_{m−1})                 the step            (8)
//! Γ_m⁻¹ = λ Γ_{m−1}⁻¹ + Σ_{i∈α(m)} φ_i φ_iᵀ                                 the information     (9)
//! Π_m⁻¹ = λ Γ_{m−1}⁻¹ + Σ_{i∈α(m)} φ_i φ_iᵀ,   Γ_m = ε⁻¹ G(ε Π_m)            the same, bounded   (10)
//! G(x)  = λ⁻¹ (x − (1 − λ) x²)                                                                   (11)
//! ```
//!
//! θ is P × 1 with all parameters of the plant, Γ is P × P without the noise variance. For the
//! printing errors of the paper (the exponent, the sign of v, the interval α(m), the λ of (10))
//! this file follows docs/errata.md. It allocates and inverts as the formulas do and serves as a
//! reference for tests: [`BlockEstimator`](super::BlockEstimator) with
//! [`EstimatorOptions::paper`](super::EstimatorOptions::paper) computes the same; use that one.

use super::{Residuals, Structure};
use nalgebra::{DMatrix, DVector};

/// Which equation gives the covariance of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CedroRule {
    /// (9): forgets, and grows without limit if nothing is excited.
    Plain,
    /// (10) with (11) as printed: forgets twice and exceeds its bound.
    AsPrinted,
    /// (10) with (11), but without the λ of (10): Γ ≤ ε⁻¹ holds.
    Corrected,
}

/// A matrix that the recursion must invert is not positive definite: the block, λ or ε are not
/// finite, or not positive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("expected a positive definite information matrix, got one that has no Cholesky factor")]
pub struct NotPositiveDefinite;

/// θ̂_m and Γ_m⁻¹ after m blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct CedroRecursion {
    /// θ̂_m, P × 1.
    pub theta: DVector<f64>,
    /// Γ_m⁻¹, P × P.
    pub information: DMatrix<f64>,
    lambda: f64,
    epsilon: f64,
    rule: CedroRule,
}

impl CedroRecursion {
    /// θ̂₀ and Γ₀⁻¹ = ε I; λ in (0, 1], with (11) in [½, 1]; ε > 0.
    pub fn new(theta_start: &[f64], lambda: f64, epsilon: f64, rule: CedroRule) -> Self {
        let params = theta_start.len();
        Self {
            theta: DVector::from_column_slice(theta_start),
            information: epsilon * DMatrix::identity(params, params), // Γ₀⁻¹ = ε I, below (9)
            lambda,
            epsilon,
            rule,
        }
    }

    /// Takes block m: the rows of all equations of the plant, each a function f_n of its own.
    ///
    /// # Errors
    /// A matrix cannot be inverted; θ̂ and Γ⁻¹ are then as before.
    pub fn update<R: Residuals>(&mut self, structure: &Structure, block: &R) -> Result<(), NotPositiveDefinite> {
        let params = self.theta.len();
        let mut gram = DMatrix::zeros(params, params);
        let mut score = DVector::zeros(params);
        for (phi, v) in linear_forms(structure, block, &self.theta) {
            gram += &phi * phi.transpose(); // Σ φ φᵀ of (9) and (10)
            score += &phi * (v - phi.dot(&self.theta)); // Σ φ (v − φᵀ θ̂) of (8)
        }
        let covariance = match self.rule {
            CedroRule::Plain => inverse(self.lambda * &self.information + gram)?, // (9)
            CedroRule::AsPrinted => self.bounded(inverse(self.lambda * &self.information + gram)?), // (10)
            CedroRule::Corrected => self.bounded(inverse(&self.information + gram)?), // (10) without its λ
        };
        self.information = inverse(covariance.clone())?;
        self.theta += covariance * score; // (8)
        Ok(())
    }

    /// Γ from Π.
    fn bounded(&self, pi: DMatrix<f64>) -> DMatrix<f64> {
        let x = self.epsilon * pi;
        let g = (&x - (1.0 - self.lambda) * &x * &x) / self.lambda; // (11)
        g / self.epsilon // (10), second line
    }
}

/// J_m(θ) of all blocks so far, in order; what the recursion with (9) minimises if f is linear in
/// θ.
pub fn cedro_cost<R: Residuals>(
    structure: &Structure,
    blocks: &[R],
    theta: &DVector<f64>,
    start: &CedroRecursion,
) -> f64 {
    let m = blocks.len() as i32;
    let from_start = &start.theta - theta;
    let of_start = from_start.dot(&(&start.information * &from_start));
    let blocks = blocks.iter().zip(1..).map(|(block, j)| {
        let squares: f64 = residuals(structure, block, theta).map(|(_, f)| f * f).sum();
        start.lambda.powi(m - j) * squares
    });
    blocks.sum::<f64>() + start.lambda.powi(m) * of_start // (6); (2) if blocks have one row
}

/// φ_n and v_n of each row at θ̂.
fn linear_forms<R: Residuals>(
    structure: &Structure,
    block: &R,
    theta_hat: &DVector<f64>,
) -> impl Iterator<Item = (DVector<f64>, f64)> {
    residuals(structure, block, theta_hat).map(move |(phi, f)| {
        let v = f + phi.dot(theta_hat); // (7)
        (phi, v)
    })
}

/// φ_n = −∂f_n/∂θ over all parameters, and f_n(θ).
fn residuals<R: Residuals>(
    structure: &Structure,
    block: &R,
    theta: &DVector<f64>,
) -> impl Iterator<Item = (DVector<f64>, f64)> {
    let equations = structure.equations.iter().enumerate();
    equations.flat_map(move |(equation, own)| {
        (0..block.len()).map(move |n| {
            let mut phi = DVector::zeros(structure.params);
            let f = block.row(equation, n, theta.as_slice(), &mut phi.as_mut_slice()[own.clone()]); // (5)
            (phi, f)
        })
    })
}

fn inverse(matrix: DMatrix<f64>) -> Result<DMatrix<f64>, NotPositiveDefinite> {
    Ok(matrix.cholesky().ok_or(NotPositiveDefinite)?.inverse())
}
