//! Off-line least squares: a whole record at once, with equal weights.
//!
//! ```text
//! θ̂ = argmin Σ_e Σ_n f_n(θ)²,     linearised as in (7): minimise ‖f − Φ δ‖, Φ the stacked φᵀ
//! ```
//!
//! Each linear problem is solved by Householder QR with column pivoting of the column-scaled Φ
//! (Golub and Van Loan, Matrix Computations, 4th ed., section 5.4.2). Unlike the Gram matrix of the
//! on-line estimators, QR does not square the condition number, and its diagonal shows the rank. A
//! rank-deficient problem gets the basic solution: parameters that the data do not determine keep
//! their start value, and nothing becomes NaN.

use super::Residuals;
use super::Structure;
use super::options::EstimatorError;
use super::pass::used;
use nalgebra::{DMatrix, DVector, RowDVector};

/// The result of [`batch_least_squares`].
#[derive(Debug, Clone, PartialEq)]
pub struct BatchReport {
    /// θ̂, all parameters.
    pub theta: Vec<f64>,
    /// Standard deviation from the residuals, `inf` for parameters that the data do not determine.
    pub theta_std: Vec<f64>,
    /// Number of parameters, or combinations of them, that the data determine.
    pub rank: usize,
    /// Root mean square of the residual over all rows and equations.
    pub residual_rms: f64,
    /// Number of linearisations.
    pub iterations: usize,
    /// False if the iterations ran out before the step became small.
    pub converged: bool,
}

/// Diagonal entries of R below this share of the first are rounding: about a hundred rounding units
/// for thousands of rows.
const RANK_TOLERANCE: f64 = 1e-11;
/// How often a step is halved before the fit gives up.
const HALVINGS: usize = 30;

/// Minimises the sum of squares over all rows from `theta_start`, by at most `max_iterations`
/// linearisations; one is enough for models linear in θ. A step that does not lower the cost is
/// halved.
///
/// # Errors
/// If `theta_start` has the wrong length, or it, a residual or a regressor at it is not finite.
pub fn batch_least_squares<R: Residuals>(
    structure: &Structure,
    rows: &R,
    theta_start: &[f64],
    max_iterations: usize,
) -> Result<BatchReport, EstimatorError> {
    let params = structure.params;
    if theta_start.len() != params {
        return Err(EstimatorError::Length {
            option: "theta_start",
            expected: params,
            got: theta_start.len(),
        });
    }
    let mut theta = theta_start.to_vec();
    let mut stack = Stack::new(structure, rows.len());
    let left_out = |e: usize| rows.len() - used(rows, e, 0..rows.len());
    stack.rows -= (0..structure.equations.len()).map(left_out).sum::<usize>();
    let mut cost = stack.fill(structure, rows, &theta);
    if !cost.is_finite() {
        let option = "residuals at theta_start";
        return Err(EstimatorError::Value {
            option,
            expected: "finite numbers",
            got: cost,
        });
    }
    let mut report = BatchReport {
        theta: Vec::new(),
        theta_std: Vec::new(),
        rank: 0,
        residual_rms: 0.0,
        iterations: 0,
        converged: false,
    };
    loop {
        let solution = stack.solve();
        report.rank = solution.rank;
        let small = solution
            .step
            .iter()
            .zip(&theta)
            .all(|(d, t)| d.abs() <= 1e-12 * t.abs());
        if small || report.iterations == max_iterations {
            report.converged = small;
            report.theta_std = solution.standard_deviations(cost, stack.rows);
            break;
        }
        report.iterations += 1;
        if let Some(lower) = stack.descend(structure, rows, &mut theta, &solution.step, cost) {
            cost = lower;
        } else {
            // only rounding is left
            cost = stack.fill(structure, rows, &theta);
            report.theta_std = stack.solve().standard_deviations(cost, stack.rows);
            report.converged = true;
            break;
        }
    }
    report.residual_rms = if stack.rows > 0 {
        (cost / stack.rows as f64).sqrt()
    } else {
        0.0
    };
    report.theta = theta;
    Ok(report)
}

/// The solution of one linear problem.
struct Solution {
    /// δ.
    step: Vec<f64>,
    /// Variance of each parameter for residuals of variance 1.
    unit_variance: Vec<f64>,
    rank: usize,
}

impl Solution {
    /// Of the parameters, with the variance of the residuals from their sum of squares `cost`.
    fn standard_deviations(&self, cost: f64, rows: usize) -> Vec<f64> {
        let freedom = rows.saturating_sub(self.rank).max(1) as f64;
        self.unit_variance.iter().map(|v| (v * cost / freedom).sqrt()).collect()
    }
}

/// Φ and f: one row per residual, one column per parameter.
struct Stack {
    rows: usize,
    regressors: DMatrix<f64>,
    residuals: DVector<f64>,
}

impl Stack {
    fn new(structure: &Structure, len: usize) -> Self {
        let rows = len * structure.equations.len();
        Self {
            rows,
            regressors: DMatrix::zeros(rows, structure.params),
            residuals: DVector::zeros(rows),
        }
    }

    /// Fills both at θ and returns Σ f², `NaN` if a number is not finite.
    fn fill<R: Residuals>(&mut self, structure: &Structure, rows: &R, theta: &[f64]) -> f64 {
        let mut phi = vec![0.0; structure.params];
        let mut finite = true;
        for (e, own) in structure.equations.iter().enumerate() {
            for index in 0..rows.len() {
                let at = e * rows.len() + index;
                self.residuals[at] = rows.row(e, index, theta, &mut phi[..own.len()]);
                for (x, i) in phi.iter().zip(own.clone()) {
                    self.regressors[(at, i)] = *x;
                    finite &= x.is_finite();
                }
            }
        }
        if finite {
            self.residuals.norm_squared()
        } else {
            f64::NAN
        }
    }

    /// Takes a step, halved until the cost is no higher than `cost`; returns the new cost. `None`
    /// if it never is: then θ keeps its value, but the stack is that of the last trial.
    fn descend<R: Residuals>(
        &mut self,
        structure: &Structure,
        rows: &R,
        theta: &mut [f64],
        step: &[f64],
        cost: f64,
    ) -> Option<f64> {
        let start = theta.to_vec();
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            for (i, t) in theta.iter_mut().enumerate() {
                *t = start[i] + fraction * step[i];
            }
            let candidate = self.fill(structure, rows, theta);
            if candidate <= cost * (1.0 + 1e-12) {
                return Some(candidate);
            }
            fraction *= 0.5;
        }
        theta.copy_from_slice(&start);
        None
    }

    fn solve(&self) -> Solution {
        let p = self.regressors.ncols();
        let mut step = vec![0.0; p];
        let mut unit_variance = vec![f64::INFINITY; p];
        // columns of length 1, so that the diagonal of R compares parameters on equal terms.
        let mut scaled = self.regressors.clone();
        let scale: Vec<f64> = scaled.column_iter().map(|c| c.norm()).collect();
        for (mut column, &s) in scaled.column_iter_mut().zip(&scale) {
            if s > 0.0 {
                column /= s;
            }
        }
        if self.rows == 0 {
            return Solution {
                step,
                unit_variance,
                rank: 0,
            };
        }
        // Φ P = Q R
        let qr = scaled.col_piv_qr();
        let r = qr.r();
        let mut rotated = self.residuals.clone();
        qr.q_tr_mul(&mut rotated);
        let mut order = RowDVector::from_fn(p, |_, j| j);
        qr.p().permute_columns(&mut order);
        let first = r[(0, 0)].abs();
        let rank = (0..r.nrows())
            .take_while(|&k| r[(k, k)].abs() > RANK_TOLERANCE * first)
            .count();
        // basic solution R₁₁ x = (Qᵀf)₁, the diagonal of (R₁₁ᵀR₁₁)⁻¹, and how the other columns
        // depend on the first ones.
        let r11 = r.view((0, 0), (rank, rank));
        let solve = |rhs: DMatrix<f64>| r11.solve_upper_triangular(&rhs).unwrap_or(rhs);
        let x = solve(DMatrix::from_column_slice(rank, 1, &rotated.as_slice()[..rank]));
        let inverse = solve(DMatrix::identity(rank, rank));
        let dependence = solve(r.view((0, rank), (rank, p - rank)).into_owned());
        for i in 0..rank {
            let parameter = order[i];
            step[parameter] = x[(i, 0)] / scale[parameter];
            // determined only if no undetermined column is a combination that includes it.
            if dependence.row(i).iter().all(|c| c.abs() <= 1e-8) {
                unit_variance[parameter] = inverse.row(i).norm_squared() / scale[parameter].powi(2);
            }
        }
        Solution {
            step,
            unit_variance,
            rank,
        }
    }
}
