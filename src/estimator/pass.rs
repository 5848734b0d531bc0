//! One pass over the rows of a block: the sums that a Gauss–Newton step needs.
//!
//! ```text
//! S = Σ w φφᵀ    g = Σ w φ f    cost = Σ ρ(f)       rows divided by the equation's noise_std
//! ```
//!
//! This is where the time goes: 1900 rows of two equations several times per block. Up to eight
//! parameters per equation, which covers the arm and the servo axis, the sums live in arrays whose
//! size the compiler knows.

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
    /// Σ ρ(f), which is Σ f² if nothing is an outlier.
    pub cost: f64,
    /// Σ Σ_i (φ_i θ_i)²: the size of the terms that f is the difference of.
    pub size: f64,
    /// Rows treated as outliers.
    pub outliers: usize,
    /// Rows that are used.
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

    /// True if every sum is a finite number.
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
    pub fn at(self, f: f64) -> (f64, f64, bool) {
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

/// Which rows are summed, and how.
#[derive(Debug, Clone)]
pub struct Pass {
    /// The equation.
    pub equation: usize,
    /// Its rows.
    pub range: Range<usize>,
    /// Its parameters among all.
    pub own: Range<usize>,
    /// Its noise_std.
    pub divisor: f64,
    /// Its loss.
    pub loss: Loss,
}

/// Rows of any kind. The estimator is built once for all of them and calls them through a table;
/// the sums, which are most of its work, are built for each kind.
pub trait Summable: Residuals {
    /// Writes the sums of a pass at θ.
    fn sum(&self, pass: &Pass, theta: &[f64], sums: &mut Sums);
}

impl<R: Residuals> Summable for R {
    fn sum(&self, pass: &Pass, theta: &[f64], sums: &mut Sums) {
        // The plain loss has loops of its own, without branches, of each length that equations
        // have.
        macro_rules! sized {
            ($($n:literal)*) => {
                match (pass.own.len(), pass.loss) {
                    $(($n, Loss::Square) => fixed::<R, $n>(self, pass, theta, sums),)*
                    _ => general(self, pass, theta, sums),
                }
            };
        }
        sized!(1 2 3 4 5 6 7 8);
    }
}

fn fixed<R: Residuals, const N: usize>(rows: &R, pass: &Pass, theta: &[f64], sums: &mut Sums) {
    let (equation, range) = (pass.equation, pass.range.clone());
    // rows go in LANES at a time, so that each product of two regressor entries is one vector
    // operation
    let mut gram = [[[0.0; LANES]; N]; N];
    let mut score = [[0.0; LANES]; N];
    let mut cost = [0.0; LANES];
    let inverse = 1.0 / pass.divisor;
    let count = used(rows, equation, range.clone());
    let mut start = range.start;
    while start < range.end {
        let lanes = LANES.min(range.end - start);
        let mut phi = [[0.0; LANES]; N];
        let mut f = [0.0; LANES];
        for lane in 0..lanes {
            let mut regressor = [0.0; N];
            f[lane] = rows.row(equation, start + lane, theta, &mut regressor) * inverse;
            for i in 0..N {
                phi[i][lane] = regressor[i] * inverse;
            }
        }
        for lane in 0..LANES {
            cost[lane] += f[lane] * f[lane]; // Σ f² of (6)
        }
        for i in 0..N {
            for lane in 0..LANES {
                score[i][lane] += phi[i][lane] * f[lane]; // Σ φ f of (8)
            }
            for j in 0..=i {
                for lane in 0..LANES {
                    gram[i][j][lane] += phi[i][lane] * phi[j][lane]; // Σ φ φᵀ of (9)
                }
            }
        }
        start += LANES;
    }
    let sum = |lanes: [f64; LANES]| lanes.iter().sum::<f64>();
    for i in 0..N {
        sums.score[i] = sum(score[i]);
        for j in 0..=i {
            let v = sum(gram[i][j]);
            sums.gram[i * N + j] = v;
            sums.gram[j * N + i] = v;
        }
    }
    (sums.cost, sums.outliers, sums.rows) = (sum(cost), 0, count);
    sums.size = size(N, &sums.gram, &theta[pass.own.clone()]);
}

/// Number of rows of an equation that are used.
pub fn used(rows: &(impl Residuals + ?Sized), equation: usize, range: Range<usize>) -> usize {
    range.filter(|&index| rows.is_used(equation, index)).count()
}

/// Rows that are summed side by side.
const LANES: usize = 4;

fn size(n: usize, gram: &[f64], theta: &[f64]) -> f64 {
    (0..n).map(|i| gram[i * n + i] * theta[i] * theta[i]).sum()
}

fn general(rows: &impl Residuals, pass: &Pass, theta: &[f64], sums: &mut Sums) {
    let (equation, range, divisor) = (pass.equation, pass.range.clone(), pass.divisor);
    let n = pass.own.len();
    let mut buffer = [0.0; super::MAX_PARAMS];
    let phi = &mut buffer[..n];
    sums.gram.fill(0.0);
    sums.score.fill(0.0);
    (sums.cost, sums.outliers, sums.rows) = (0.0, 0, used(rows, equation, range.clone()));
    for index in range {
        let f = rows.row(equation, index, theta, phi) / divisor;
        phi.iter_mut().for_each(|x| *x /= divisor);
        let (rho, weight, outlier) = pass.loss.at(f);
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
    sums.size = size(n, &sums.gram, &theta[pass.own.clone()]);
}
