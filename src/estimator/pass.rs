//! One pass over the rows of a block: the sums that a Gauss–Newton step needs.
//!
//! ```text
//! S = Σ w φφᵀ    g = Σ w φ f    cost = Σ ρ(f)       rows divided by the equation's noise_std
//! ```
//!
//! This is where the time goes: 1900 rows of two equations several times per block. Up to eight parameters per equation, which
//! covers the arm and the servo axis, the sums live in arrays whose size the compiler knows.

use super::Residuals;
use std::ops::Range;

/// The sums over the rows of one equation.
#[derive(Debug, Clone)]
pub struct Sums {
    /// Number of parameters p of the equation.
    pub params: usize,
    /// Σ w φφᵀ, p × p, full.
    pub gram: Vec<f64>,
    /// Σ w φ f.
    pub score: Vec<f64>,
    /// Σ ρ(f), which is Σ f² where nothing is an outlier.
    pub cost: f64,
    /// Σ (Σ_i |φ_i θ_i|)²: the size of the terms that f is the difference of.
    pub size: f64,
    /// Rows treated as outliers.
    pub outliers: usize,
    /// Rows.
    pub rows: usize,
}

impl Sums {
    /// Zero sums for an equation of `params` parameters.
    pub fn new(params: usize) -> Self {
        Self {
            params,
            gram: vec![0.0; params * params],
            score: vec![0.0; params],
            cost: 0.0,
            size: 0.0,
            outliers: 0,
            rows: 0,
        }
    }

    /// True where every sum is a finite number.
    pub fn is_finite(&self) -> bool {
        self.cost.is_finite() && self.size.is_finite() && self.gram.iter().chain(&self.score).all(|v| v.is_finite())
    }
}

/// Loss of a row: ρ(f) and the weight of its normal equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// f².
    Square,
    /// f² up to the limit, then as steep as there.
    Huber(f64),
    /// f² up to the limit, then constant.
    Gate(f64),
}

impl Loss {
    /// (ρ, weight, outlier).
    #[inline(always)]
    fn at(self, f: f64) -> (f64, f64, bool) {
        match self {
            Self::Square => (f * f, 1.0, false),
            // what pulls less is no outlier yet: at k = 1.345 these are 18 % of clean rows
            Self::Huber(limit) if f.abs() > limit => {
                (limit * (2.0 * f.abs() - limit), limit / f.abs(), f.abs() > 3.0 * limit)
            }
            Self::Gate(limit) if f.abs() > limit => (limit * limit, 0.0, true),
            Self::Huber(_) | Self::Gate(_) => (f * f, 1.0, false),
        }
    }
}

/// Sums over the rows `range` of one equation at θ. `own` is the equation's range of parameters, `divisor` its noise_std.
#[allow(clippy::too_many_arguments)]
pub fn accumulate<R: Residuals>(
    rows: &R,
    equation: usize,
    range: Range<usize>,
    theta: &[f64],
    own: Range<usize>,
    divisor: f64,
    loss: Loss,
    sums: &mut Sums,
) {
    // the plain loss is a case of its own, so that its loop carries no branch
    macro_rules! sized {
        ($($n:literal)*) => {
            match (own.len(), loss) {
                $(
                    ($n, Loss::Square) => fixed::<R, $n, false>(rows, equation, range, theta, own, divisor, loss, sums),
                    ($n, _) => fixed::<R, $n, true>(rows, equation, range, theta, own, divisor, loss, sums),
                )*
                _ => general(rows, equation, range, theta, own, divisor, loss, sums),
            }
        };
    }
    sized!(1 2 3 4 5 6 7 8);
}

#[allow(clippy::too_many_arguments)]
fn fixed<R: Residuals, const N: usize, const ROBUST: bool>(
    rows: &R,
    equation: usize,
    range: Range<usize>,
    theta: &[f64],
    own: Range<usize>,
    divisor: f64,
    loss: Loss,
    sums: &mut Sums,
) {
    let mut gram = [[0.0; N]; N];
    let mut score = [0.0; N];
    let (mut cost, mut size, mut outliers) = (0.0, 0.0, 0);
    let mut parameters = [0.0; N];
    parameters.copy_from_slice(&theta[own]);
    let inverse = 1.0 / divisor;
    let count = range.len();
    for index in range {
        let mut phi = [0.0; N];
        let f = rows.row(equation, index, theta, &mut phi) * inverse;
        let mut terms = 0.0;
        for i in 0..N {
            phi[i] *= inverse;
            terms += (phi[i] * parameters[i]).abs();
        }
        size += terms * terms;
        let mut weighted = phi;
        if ROBUST {
            let (rho, weight, outlier) = loss.at(f);
            cost += rho;
            outliers += usize::from(outlier);
            for w in &mut weighted {
                *w *= weight;
            }
        } else {
            cost += f * f;
        }
        for i in 0..N {
            score[i] += weighted[i] * f;
            for j in 0..N {
                gram[i][j] += weighted[i] * phi[j];
            }
        }
    }
    for i in 0..N {
        sums.score[i] = score[i];
        for j in 0..=i {
            // the products commute up to rounding; one triangle for both
            sums.gram[i * N + j] = gram[i][j];
            sums.gram[j * N + i] = gram[i][j];
        }
    }
    (sums.cost, sums.size, sums.outliers, sums.rows) = (cost, size, outliers, count);
}

#[allow(clippy::too_many_arguments)]
fn general<R: Residuals>(
    rows: &R,
    equation: usize,
    range: Range<usize>,
    theta: &[f64],
    own: Range<usize>,
    divisor: f64,
    loss: Loss,
    sums: &mut Sums,
) {
    let n = own.len();
    let mut buffer = [0.0; super::MAX_PARAMS];
    let phi = &mut buffer[..n];
    sums.gram.fill(0.0);
    sums.score.fill(0.0);
    (sums.cost, sums.size, sums.outliers, sums.rows) = (0.0, 0.0, 0, range.len());
    for index in range {
        let f = rows.row(equation, index, theta, phi) / divisor;
        let mut terms = 0.0;
        for (x, t) in phi.iter_mut().zip(&theta[own.clone()]) {
            *x /= divisor;
            terms += (*x * t).abs();
        }
        sums.size += terms * terms;
        let (rho, weight, outlier) = loss.at(f);
        sums.cost += rho;
        sums.outliers += usize::from(outlier);
        for i in 0..n {
            let weighted = weight * phi[i];
            sums.score[i] += weighted * f;
            for j in 0..=i {
                sums.gram[i * n + j] += weighted * phi[j];
            }
        }
    }
    for i in 0..n {
        for j in 0..i {
            sums.gram[j * n + i] = sums.gram[i * n + j];
        }
    }
}
