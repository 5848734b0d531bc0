//! One pass over the rows of a block: the sums that a Gauss–Newton step needs.
//!
//! ```text
//! S = Σ w φφᵀ    g = Σ w φ f    cost = Σ ρ(f)       rows divided by the equation's noise_std
//! ```
//!
//! Most of the time is spent here: 1900 rows of two equations, several times per block. For up to
//! eight parameters per equation, which covers the arm and the servo axis, the sums are in arrays
//! of a size known at compile time.

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
    /// Σ Σ_i (φ_i θ_i)²: the size of the terms whose sum is f.
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
    /// f² up to the limit, then linear with the slope at the limit.
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
            // a row with a reduced weight is not yet an outlier: at k = 1.345 these are 18 % of
            // clean rows
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
    pub parameters: Range<usize>,
    /// Its noise_std.
    pub divisor: f64,
    /// Its loss.
    pub loss: Loss,
}

/// Rows of any kind. The estimator is compiled once and calls them dynamically; the sums, which are
/// most of its work, are compiled for each kind.
pub trait Summable: Residuals {
    /// Writes the sums of a pass at θ.
    fn sum(&self, pass: &Pass, theta: &[f64], sums: &mut Sums);
}

impl<R: Residuals> Summable for R {
    fn sum(&self, pass: &Pass, theta: &[f64], sums: &mut Sums) {
        if pass.loss != Loss::Square || pass.parameters.len() > MOST {
            return general(self, pass, theta, sums);
        }
        sums.rows = used(self, pass.equation, pass.range.clone());
        // Only this is compiled for each kind of rows; the loops over them are compiled once.
        let (n, inverse) = (pass.parameters.len(), 1.0 / pass.divisor);
        let mut gather = |rows: Range<usize>, chunk: &mut Chunk| {
            for (at, index) in rows.enumerate() {
                let mut regressor = [0.0; MOST];
                chunk.f[at] = self.row(pass.equation, index, theta, &mut regressor[..n]) * inverse;
                for (phi, value) in chunk.phi[..n].iter_mut().zip(&regressor) {
                    phi[at] = value * inverse;
                }
            }
        };
        plain(pass, theta, sums, &mut gather);
    }
}

/// Largest number of parameters of an equation whose sums are in arrays.
const MOST: usize = 8;
/// Rows summed in parallel, so that each product of two regressor entries is one vector operation.
const LANES: usize = 4;
/// Rows that are gathered at a time.
const CHUNK: usize = 8 * LANES;

/// Rows on the way to the sums, divided by the equation's noise_std.
struct Chunk {
    phi: [[f64; CHUNK]; MOST],
    f: [f64; CHUNK],
}

/// The sums for the square loss, in branch-free loops for each number of parameters.
fn plain(pass: &Pass, theta: &[f64], sums: &mut Sums, gather: &mut dyn FnMut(Range<usize>, &mut Chunk)) {
    macro_rules! sized {
        ($($n:literal)*) => {
            match pass.parameters.len() {
                $($n => fixed::<$n>(pass, theta, sums, gather),)*
                _ => unreachable!("the caller looks at the length"),
            }
        };
    }
    sized!(0 1 2 3 4 5 6 7 8);
}

fn fixed<const N: usize>(
    pass: &Pass,
    theta: &[f64],
    sums: &mut Sums,
    gather: &mut dyn FnMut(Range<usize>, &mut Chunk),
) {
    let mut chunk = Chunk {
        phi: [[0.0; CHUNK]; MOST],
        f: [0.0; CHUNK],
    };
    let mut gram = [[[0.0; LANES]; N]; N];
    let mut score = [[0.0; LANES]; N];
    let mut cost = [0.0; LANES];
    for start in pass.range.clone().step_by(CHUNK) {
        let rows = start..pass.range.end.min(start + CHUNK);
        let count = rows.len();
        gather(rows, &mut chunk);
        // the unused lanes of the last chunk are zero
        let filled = count.next_multiple_of(LANES);
        chunk.f[count..filled].fill(0.0);
        for phi in &mut chunk.phi[..N] {
            phi[count..filled].fill(0.0);
        }
        for at in (0..filled).step_by(LANES) {
            let lanes = |values: &[f64; CHUNK]| -> [f64; LANES] { std::array::from_fn(|lane| values[at + lane]) };
            let f = lanes(&chunk.f);
            let phi: [[f64; LANES]; N] = std::array::from_fn(|i| lanes(&chunk.phi[i]));
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
        }
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
    (sums.cost, sums.outliers) = (sum(cost), 0);
    sums.size = size(N, &sums.gram, &theta[pass.parameters.clone()]);
}

/// Number of rows of an equation that are used.
pub fn used(rows: &(impl Residuals + ?Sized), equation: usize, range: Range<usize>) -> usize {
    range.filter(|&index| rows.is_used(equation, index)).count()
}

fn size(n: usize, gram: &[f64], theta: &[f64]) -> f64 {
    (0..n).map(|i| gram[i * n + i] * theta[i] * theta[i]).sum()
}

fn general(rows: &impl Residuals, pass: &Pass, theta: &[f64], sums: &mut Sums) {
    let (equation, range, divisor) = (pass.equation, pass.range.clone(), pass.divisor);
    let n = pass.parameters.len();
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
    sums.size = size(n, &sums.gram, &theta[pass.parameters.clone()]);
}
