//! Off-line least squares: a whole record at once, with equal weights.
//!
//! ```text
//! θ̂ = argmin Σ_e Σ_n f_n(θ)²,     linearised as in (7): minimise ‖f − Φ δ‖, Φ the stacked φᵀ
//! ```
//!
//! Each linear problem is solved by Householder QR with column pivoting of the column-scaled Φ (Golub and Van Loan, Matrix
//! Computations, 4th ed., section 5.4.2). Unlike the Gram matrix of the on-line estimators it does not square the condition
//! number, and its diagonal shows the rank. A deficient problem gets the basic solution: parameters that the data do not
//! determine beside the others keep their start value, and nothing becomes NaN.

use super::Residuals;
use super::Structure;
use super::options::EstimatorError;

/// The answer of [`batch_least_squares`].
#[derive(Debug, Clone, PartialEq)]
pub struct BatchReport {
    /// θ̂, all parameters.
    pub theta: Vec<f64>,
    /// Standard deviation from the residuals, `inf` for what the data do not determine.
    pub theta_std: Vec<f64>,
    /// Number of parameters, or combinations of them, that the data determine.
    pub rank: usize,
    /// Root mean square of the residual over all rows and equations.
    pub residual_rms: f64,
    /// Linearisations made.
    pub iterations: usize,
    /// False where the iterations ran out before the step became small.
    pub converged: bool,
}

/// Diagonal entries of R below this share of the first are rounding: some hundred units of it for thousands of rows.
const RANK_TOLERANCE: f64 = 1e-11;

/// Minimises the sum of squares over all rows from `theta_start`, by at most `max_iterations` linearisations; one is enough
/// for models linear in θ. A step that does not lower the cost is halved.
///
/// # Errors
/// Where `theta_start` has the wrong length, or it, a residual or a regressor at it is not finite.
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
            let dof = stack.rows.saturating_sub(solution.rank).max(1) as f64;
            report.theta_std = solution.unit_variance.iter().map(|v| (v * cost / dof).sqrt()).collect();
            break;
        }
        report.iterations += 1;
        let start = theta.clone();
        let mut fraction = 1.0;
        let mut accepted = false;
        for _ in 0..30 {
            for (i, t) in theta.iter_mut().enumerate() {
                *t = start[i] + fraction * solution.step[i];
            }
            let candidate = stack.fill(structure, rows, &theta);
            if candidate <= cost * (1.0 + 1e-12) {
                cost = candidate;
                accepted = true;
                break;
            }
            fraction *= 0.5;
        }
        if !accepted {
            // at rounding: keep the best
            theta = start;
            cost = stack.fill(structure, rows, &theta);
            let solution = stack.solve();
            let dof = stack.rows.saturating_sub(solution.rank).max(1) as f64;
            report.theta_std = solution.unit_variance.iter().map(|v| (v * cost / dof).sqrt()).collect();
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

struct Solution {
    step: Vec<f64>,
    unit_variance: Vec<f64>,
    rank: usize,
}

/// Φ, column by column, and f.
struct Stack {
    params: usize,
    rows: usize,
    columns: Vec<Vec<f64>>,
    rhs: Vec<f64>,
}

impl Stack {
    fn new(structure: &Structure, len: usize) -> Self {
        let rows = len * structure.equations.len();
        Self {
            params: structure.params,
            rows,
            columns: vec![vec![0.0; rows]; structure.params],
            rhs: vec![0.0; rows],
        }
    }

    /// Fills both at θ and returns Σ f².
    fn fill<R: Residuals>(&mut self, structure: &Structure, rows: &R, theta: &[f64]) -> f64 {
        self.columns.iter_mut().for_each(|c| c.fill(0.0));
        let mut phi = vec![0.0; self.params];
        let mut cost = 0.0;
        for (e, own) in structure.equations.iter().enumerate() {
            for index in 0..rows.len() {
                let at = e * rows.len() + index;
                let f = rows.row(e, index, theta, &mut phi[..own.len()]);
                self.rhs[at] = f;
                cost += f * f;
                for (x, i) in phi.iter().zip(own.clone()) {
                    self.columns[i][at] = *x;
                    if !x.is_finite() {
                        cost = f64::NAN;
                    }
                }
            }
        }
        cost
    }

    fn solve(&self) -> Solution {
        let p = self.params;
        let m = self.rows;
        let mut a = self.columns.clone();
        let mut b = self.rhs.clone();
        let scale: Vec<f64> = a.iter().map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
        for (column, s) in a.iter_mut().zip(&scale) {
            if *s > 0.0 {
                column.iter_mut().for_each(|v| *v /= s);
            }
        }
        let mut order: Vec<usize> = (0..p).collect();
        let mut rank = 0;
        let mut first = 0.0;
        for k in 0..p.min(m) {
            let norm = |c: &[f64]| c[k..].iter().map(|v| v * v).sum::<f64>().sqrt();
            let mut best = k;
            for j in k + 1..p {
                if norm(&a[j]) > norm(&a[best]) {
                    best = j;
                }
            }
            a.swap(k, best);
            order.swap(k, best);
            let length = norm(&a[k]);
            if k == 0 {
                first = length;
            }
            if !(length > RANK_TOLERANCE * first) || length == 0.0 {
                break;
            }
            rank += 1;
            // the reflection that maps the column to −sign(a_kk)·length·e_k
            let mut v = a[k][k..].to_vec();
            let alpha = if v[0] > 0.0 { -length } else { length };
            v[0] -= alpha;
            let vv: f64 = v.iter().map(|x| x * x).sum();
            let reflect = |c: &mut [f64]| {
                let s = 2.0 * v.iter().zip(&c[k..]).map(|(x, y)| x * y).sum::<f64>() / vv;
                c[k..].iter_mut().zip(&v).for_each(|(y, x)| *y -= s * x);
            };
            a[k..].iter_mut().for_each(|c| reflect(c));
            reflect(&mut b);
        }
        // basic solution R₁₁ x = b₁ and the diagonal of (R₁₁ᵀR₁₁)⁻¹
        let back = |rhs: &mut [f64]| {
            for i in (0..rank).rev() {
                for j in i + 1..rank {
                    rhs[i] -= a[j][i] * rhs[j];
                }
                rhs[i] /= a[i][i];
            }
        };
        let mut x = b[..rank.min(b.len())].to_vec();
        back(&mut x);
        let mut step = vec![0.0; p];
        let mut unit_variance = vec![f64::INFINITY; p];
        for i in 0..rank {
            step[order[i]] = x[i] / scale[order[i]];
            unit_variance[order[i]] = 0.0;
        }
        for k in 0..rank {
            let mut e = vec![0.0; rank];
            e[k] = 1.0;
            back(&mut e);
            for i in 0..rank {
                unit_variance[order[i]] += (e[i] / scale[order[i]]).powi(2);
            }
        }
        if rank < p {
            // a parameter is determined only if no undetermined column is a combination that includes it
            for j in rank..p {
                let mut c: Vec<f64> = (0..rank).map(|i| a[j][i]).collect();
                back(&mut c);
                for i in 0..rank {
                    if c[i].abs() > 1e-8 {
                        unit_variance[order[i]] = f64::INFINITY;
                    }
                }
            }
        }
        Solution {
            step,
            unit_variance,
            rank,
        }
    }
}
