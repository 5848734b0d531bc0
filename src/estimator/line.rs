//! A drifting plant: parameters that move along a straight line within the block.
//!
//! ```text
//! θ(s) = c + v s,   s = −½ … ½ over the block
//! minimise Σ_e Σ f_n(θ(s_n))²/σ_e² + (c − v/2 − θ̄)ᵀ C⁻¹ (c − v/2 − θ̄) + Σ_i (v_i − v̄_i)²/V_i
//! ```
//!
//! by Gauss–Newton over (c, v), each row at its own θ. Fitting a constant to a drifting block does
//! not merely lag: the drift of a well-excited parameter leaks into poorly excited ones, amplified
//! a hundredfold. The estimate is the line's end, c + v/2.

use super::equation::{EquationState, TINY};
use super::linalg::{Cholesky, dot};
use super::pass::Summable;
use super::persist::Visit;
use std::ops::Range;

/// The prior of a line.
#[derive(Debug, Clone, Copy)]
pub struct LinePrior<'a> {
    /// θ̄, where the line is expected to start.
    pub start: &'a [f64],
    /// C⁻¹, n × n.
    pub start_information: &'a [f64],
    /// v̄.
    pub slope: &'a [f64],
    /// V.
    pub slope_variance: &'a [f64],
}

/// A line with its covariance, and the workspace to fit it.
#[derive(Debug, Clone)]
pub struct LineFit {
    n: usize,
    /// c.
    pub middle: Vec<f64>,
    /// v.
    pub slope: Vec<f64>,
    /// χ² of the fit relative to its prior, with at most 2n degrees of freedom if the line
    /// continues as expected.
    pub surprise: f64,
    /// Covariance of (c, v), 2n × 2n.
    pub covariance: Vec<f64>,
    /// Σ f² per equation of the group, without outliers.
    pub costs: Vec<f64>,
    pub outliers: Vec<usize>,
    matrix: Vec<f64>,
    vector: Vec<f64>,
    delta: Vec<f64>,
    theta: Vec<f64>,
    regressor: Vec<f64>,
    factor: Cholesky,
}

impl LineFit {
    /// Gauss–Newton converges quadratically from the constant fit; the fourth step is at rounding.
    const ITERATIONS: usize = 4;

    /// Workspace for a group of n of all `params` parameters and `equations` equations.
    pub fn new(n: usize, params: usize, equations: usize) -> Self {
        let m = 2 * n;
        Self {
            n,
            middle: vec![0.0; n],
            slope: vec![0.0; n],
            surprise: 0.0,
            covariance: vec![0.0; m * m],
            costs: vec![0.0; equations],
            outliers: vec![0; equations],
            matrix: vec![0.0; m * m],
            vector: vec![0.0; m],
            delta: vec![0.0; m],
            theta: vec![0.0; params],
            regressor: vec![0.0; n],
            factor: Cholesky::new(m),
        }
    }

    /// State kept from block to block: the last line, from which a drift continues.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.middle);
        v.reals(&mut self.slope);
        v.reals(&mut self.covariance);
    }

    /// Fits a line to the rows, starting at θ with slope 0. Returns Σ ρ(f)/σ², `None` if it cannot
    /// be fitted.
    pub fn fit(
        &mut self,
        rows: &dyn Summable,
        equations: &[EquationState],
        theta: &[f64],
        own: Range<usize>,
        fixed: &[bool],
        prior: Option<LinePrior<'_>>,
    ) -> Option<f64> {
        let (n, m) = (self.n, 2 * self.n);
        self.theta.copy_from_slice(theta);
        self.middle.copy_from_slice(&theta[own.clone()]);
        self.slope.fill(0.0);
        for iteration in 0..=Self::ITERATIONS {
            let cost = self.sums(rows, equations, own.start);
            if !cost.is_finite() {
                return None;
            }
            self.surprise = prior.map_or(0.0, |prior| self.add_prior(prior, fixed));
            for i in 0..m {
                if fixed[i % n] {
                    for j in 0..m {
                        self.matrix[i * m + j] = 0.0;
                        self.matrix[j * m + i] = 0.0;
                    }
                    self.vector[i] = 0.0;
                }
                // a small weight keeps directions without information in place
                let d = self.matrix[i * m + i];
                self.matrix[i * m + i] = if d > 0.0 { d * (1.0 + 1e-11) } else { 1.0 };
            }
            if !self.factor.factor(m, &self.matrix) {
                return None;
            }
            if iteration == Self::ITERATIONS {
                self.factor.inverse(&mut self.covariance);
                return Some(cost);
            }
            self.delta.copy_from_slice(&self.vector);
            self.factor.solve(&mut self.delta);
            for i in 0..n {
                self.middle[i] += self.delta[i];
                self.slope[i] += self.delta[n + i];
            }
        }
        None
    }

    /// Sums over the rows: the outer products of (φ, s φ), these times f, and f².
    fn sums(&mut self, rows: &dyn Summable, equations: &[EquationState], first: usize) -> f64 {
        let (n, m) = (self.n, 2 * self.n);
        let length = rows.len().max(2) as f64 - 1.0;
        self.matrix.fill(0.0);
        self.vector.fill(0.0);
        let mut total = 0.0;
        for ((e, cost), outliers) in equations.iter().zip(&mut self.costs).zip(&mut self.outliers) {
            (*cost, *outliers) = (0.0, 0);
            let variance = e.variance.max(TINY);
            let p = e.parameters.len();
            let weight = 1.0 / (e.divisor * e.divisor * variance);
            for index in 0..rows.len() {
                let s = index as f64 / length - 0.5;
                for i in 0..p {
                    let k = e.offset + i;
                    self.theta[first + k] = self.middle[k] + s * self.slope[k];
                }
                let phi = &mut self.regressor[..p];
                let f = rows.row(e.index, index, &self.theta, phi);
                let (rho, share, outlier) = e.loss.at(f / e.divisor);
                total += rho / variance;
                if outlier {
                    *outliers += 1;
                    continue;
                }
                *cost += f * f / (e.divisor * e.divisor);
                for i in 0..p {
                    let x = share * weight * phi[i];
                    let a = e.offset + i;
                    self.vector[a] += x * f;
                    self.vector[n + a] += s * x * f;
                    for j in 0..=i {
                        let (b, v) = (e.offset + j, x * phi[j]);
                        self.matrix[a * m + b] += v;
                        self.matrix[(n + a) * m + b] += s * v;
                        self.matrix[(n + a) * m + n + b] += s * s * v;
                    }
                }
            }
        }
        for a in 0..n {
            // Σ s φφᵀ is symmetric, too
            for b in 0..a {
                self.matrix[(n + b) * m + a] = self.matrix[(n + a) * m + b];
            }
        }
        for a in 0..m {
            for b in 0..a {
                self.matrix[b * m + a] = self.matrix[a * m + b];
            }
        }
        total
    }

    /// The start of the line is c − v/2; returns the cost of the prior.
    fn add_prior(&mut self, prior: LinePrior<'_>, fixed: &[bool]) -> f64 {
        let (n, m) = (self.n, 2 * self.n);
        for i in 0..n {
            self.delta[i] = self.middle[i] - 0.5 * self.slope[i] - prior.start[i];
        }
        let mut cost = 0.0;
        for i in 0..n {
            let row = &prior.start_information[i * n..(i + 1) * n];
            let pull = dot(row, &self.delta[..n]);
            cost += self.delta[i] * pull;
            self.vector[i] -= pull;
            self.vector[n + i] += 0.5 * pull;
            for j in 0..n {
                self.matrix[i * m + j] += row[j];
                self.matrix[i * m + n + j] -= 0.5 * row[j];
                self.matrix[(n + i) * m + j] -= 0.5 * row[j];
                self.matrix[(n + i) * m + n + j] += 0.25 * row[j];
            }
            let information = 1.0 / prior.slope_variance[i].max(TINY);
            let turned = self.slope[i] - prior.slope[i];
            if !fixed[i] {
                cost += information * turned * turned;
            }
            self.vector[n + i] -= information * turned;
            self.matrix[(n + i) * m + n + i] += information;
        }
        cost
    }

    /// Variance of the slope of parameter i.
    pub fn slope_variance(&self, i: usize) -> f64 {
        let (n, m) = (self.n, 2 * self.n);
        self.covariance[(n + i) * m + n + i]
    }

    /// Variance of the line's start, parameter i.
    pub fn start_variance(&self, i: usize) -> f64 {
        let (n, m) = (self.n, 2 * self.n);
        let c = |a: usize, b: usize| self.covariance[a * m + b];
        c(i, i) - c(i, n + i) + 0.25 * c(n + i, n + i)
    }

    /// Covariance of the line's end, entry (i, j).
    pub fn end_covariance(&self, i: usize, j: usize) -> f64 {
        let (n, m) = (self.n, 2 * self.n);
        let c = |a: usize, b: usize| self.covariance[a * m + b];
        c(i, j) + 0.5 * (c(i, n + j) + c(n + i, j)) + 0.25 * c(n + i, n + j)
    }
}
