//! A first θ from the rows alone, independent of the configured start.
//!
//! ```text
//! f = y − Σ_m β_m z_m          one coefficient per monomial μ_m(θ) ∈ {θ_i, θ_i θ_j}: linear, one minimum
//! θ_i = β_m for μ_m = θ_i,     θ_i = β_m/θ_j for μ_m = θ_i θ_j
//! ```
//!
//! Products of parameters give the cost of a block more than one minimum: with encoders of 13 bits
//! and smooth motion, an arm with a tenth of the true length and ten times the true inductance fits
//! to within three standard deviations of the noise. The minimum that Gauss-Newton finds depends on
//! the start. With a separate coefficient for each monomial the problem is linear and has one
//! minimum; θ follows from the best-known coefficients, and serves as a second start besides the
//! configured one.
//!
//! Source of the overparametrised start: E.-W. Bai, An optimal two-stage identification algorithm
//! for Hammerstein-Wiener nonlinear systems, Automatica 34 (1998).

use super::theta_polynomial::{Monomial, Polynomial};
use crate::estimator::{BlockEstimator, EstimatorOptions, ParameterPrior, Residuals, Structure, starts};
use std::ops::Range;

/// Rows of all equations with a coefficient per monomial.
pub(super) struct Linear<'a, F> {
    /// Number of rows.
    pub rows: usize,
    /// Residual with the monomial 1 only, and the factors of the others: (equation, row, factors) →
    /// residual.
    pub row: F,
    /// Coefficients of each equation.
    pub ranges: &'a [Range<usize>],
}

impl<F: Fn(usize, usize, &mut [f64]) -> f64> Residuals for Linear<'_, F> {
    fn len(&self) -> usize {
        self.rows
    }

    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let y = (self.row)(equation, index, regressor);
        let beta = &theta[self.ranges[equation].clone()];
        y - regressor.iter().zip(beta).map(|(z, b)| z * b).sum::<f64>()
    }
}

/// Finds a start, with its workspace.
#[derive(Debug, Clone)]
pub(super) struct StartFinder {
    /// Monomials other than 1 of all equations, in the order of the coefficients.
    monomials: Vec<Monomial>,
    ranges: Vec<Range<usize>>,
    estimator: BlockEstimator,
    theta: Vec<f64>,
    /// Relative standard deviation of each parameter; infinite if unknown.
    relative: Vec<f64>,
}

impl StartFinder {
    /// A finder for equations that are polynomials of `params` parameters with products in them;
    /// `None` for others, which have one minimum or no monomials.
    pub fn new(equations: &[Option<Polynomial>], params: usize) -> Option<Self> {
        let mut monomials = Vec::new();
        let mut ranges = Vec::new();
        for polynomial in equations {
            let own = polynomial.as_ref()?.monomials.iter().copied();
            let start = monomials.len();
            monomials.extend(own.filter(|m| *m != Monomial::One));
            ranges.push(start..monomials.len());
        }
        if !monomials.iter().any(|m| matches!(m, Monomial::Product(..))) || ranges.iter().any(Range::is_empty) {
            return None;
        }
        let structure = Structure {
            params: monomials.len(),
            equations: ranges.clone(),
        };
        let mut options = EstimatorOptions::recommended(vec![0.0; monomials.len()], ranges.len());
        options.change_detection = None;
        Some(Self {
            estimator: BlockEstimator::new(structure, options).ok()?,
            monomials,
            ranges,
            theta: vec![0.0; params],
            relative: vec![f64::INFINITY; params],
        })
    }

    /// Fits the coefficients to the rows and computes θ from them, within its bounds; parameters
    /// that they do not determine keep their start value. `row` writes the factors of the monomials
    /// other than 1 and returns the residual without them.
    pub fn find(
        &mut self,
        rows: usize,
        row: impl Fn(usize, usize, &mut [f64]) -> f64,
        priors: &[ParameterPrior],
    ) -> &[f64] {
        let zero = [0.0; crate::estimator::MAX_PARAMS];
        self.estimator.restart(&zero[..self.monomials.len()]);
        let ranges = &self.ranges;
        let report = self.estimator.update(&Linear { rows, row, ranges });
        starts(priors, &mut self.theta);
        self.relative.fill(f64::INFINITY);
        // the best-known parameter first: each one found resolves the products that contain it
        for _ in 0..self.theta.len() {
            let mut best: Option<(f64, usize, f64)> = None;
            for (k, monomial) in self.monomials.iter().enumerate() {
                let (beta, std) = (report.theta[k], report.theta_std[k]);
                let own = std / beta.abs();
                let mut offer = |i: usize, value: f64, relative: f64| {
                    let fits = value.is_finite() && priors[i].allows(value);
                    let better = best.is_none_or(|(least, ..)| relative < least);
                    if fits && relative < 1.0 && better && self.relative[i].is_infinite() {
                        best = Some((relative, i, value));
                    }
                };
                match *monomial {
                    Monomial::One => {}
                    Monomial::Linear(i) => offer(i, beta, own),
                    Monomial::Product(i, j) if i == j => offer(i, beta.max(0.0).sqrt(), 0.5 * own),
                    Monomial::Product(i, j) => {
                        offer(i, beta / self.theta[j], own.hypot(self.relative[j]));
                        offer(j, beta / self.theta[i], own.hypot(self.relative[i]));
                    }
                }
            }
            let Some((relative, i, value)) = best else { break };
            (self.relative[i], self.theta[i]) = (relative, value);
        }
        &self.theta
    }
}
