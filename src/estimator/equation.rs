//! An equation of a group: its noise, its residuals, and what it adds to the normal equations.
//!
//! σ_e² is the residuals' sum of squares over their degrees of freedom, rows less tr(K S_e), both
//! forgotten with λ: with a strong prior, a block uses less than one degree of freedom per
//! parameter. It never falls below the floor of the options.

use super::options::{EstimatorOptions, Outliers};
use super::pass::{Loss, Pass, Summable, Sums};
use super::persist::Visit;
use std::ops::Range;

/// Lower limit of noise variances, which serve as divisors.
pub const TINY: f64 = 1e-200;

/// Largest surprise of a block in the mean, so that a block with a change does not dominate it.
const LARGEST: f64 = 10.0;

/// An equation as its group sees it.
#[derive(Debug, Clone)]
pub struct EquationState {
    /// Index in the structure.
    pub index: usize,
    /// Its parameters among all.
    pub parameters: Range<usize>,
    /// Its first parameter in the group.
    pub offset: usize,
    pub divisor: f64,
    pub floor: f64,
    /// Exponentially weighted sum of squares of the residuals, and its degrees of freedom.
    spread: f64,
    pub freedom: f64,
    /// Noise variance of the divided rows: learnt, and never below the floor.
    pub variance: f64,
    /// Σ f² at θ̄, and its number of rows.
    pub innovation: (f64, usize),
    /// Mean square by which innovations exceeded residuals in the last blocks, in noise variances.
    pub surprise: f64,
    /// Robust standard deviation of the residuals, and the loss that follows from it.
    pub scale: f64,
    pub loss: Loss,
    /// Covariance caused by this equation's noise of unit variance, n × n.
    pub noise_covariance: Vec<f64>,
}

impl EquationState {
    /// The pass over the rows of `range`.
    pub fn pass(&self, range: Range<usize>) -> Pass {
        Pass {
            equation: self.index,
            range,
            parameters: self.parameters.clone(),
            divisor: self.divisor,
            loss: self.loss,
        }
    }

    /// Equation `index` with these parameters, of those of its `group`; its noise is unknown.
    pub fn new(index: usize, parameters: Range<usize>, group: &Range<usize>, options: &EstimatorOptions) -> Self {
        let n = group.len();
        Self {
            index,
            offset: parameters.start - group.start,
            parameters,
            divisor: options.equations[index].std,
            floor: options.equations[index].floor,
            spread: 0.0,
            freedom: 0.0,
            variance: 0.0,
            innovation: (0.0, 0),
            surprise: 0.0,
            scale: 0.0,
            loss: Loss::Square,
            noise_covariance: vec![0.0; n * n],
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.real(&mut self.surprise);
        for number in [&mut self.spread, &mut self.freedom, &mut self.variance, &mut self.scale] {
            v.real(number);
        }
        v.reals(&mut self.noise_covariance);
    }

    /// Forgets the noise level and the last block.
    pub fn forget(&mut self) {
        (self.innovation, self.surprise) = ((0.0, 0), 0.0);
        (self.spread, self.freedom, self.variance, self.scale) = (0.0, 0.0, 0.0, 0.0);
    }

    /// True if no sum or variance is negative.
    pub fn is_sound(&self) -> bool {
        let n = self.noise_covariance.len().isqrt();
        let numbers = [self.spread, self.freedom, self.variance, self.scale];
        (0..n).all(|i| self.noise_covariance[i * n + i] >= 0.0) && numbers.iter().all(|v| *v >= 0.0)
    }

    /// Sets the noise variance for a block's decisions from what was learnt.
    pub fn set_variance(&mut self, sums: &Sums, options: &EstimatorOptions) {
        let learnt = if self.freedom > 0.0 {
            self.spread / self.freedom
        } else {
            0.0
        };
        self.variance = learnt.max(floor_variance(self, sums, options));
    }

    /// Sets the loss from the median of the divided residuals' magnitudes; a gate that is not
    /// `closed` is Huber's function.
    pub fn limit_outliers(&mut self, median: f64, sums: &Sums, closed: bool, options: &EstimatorOptions) {
        // the median of |f| of a normal distribution is 0.6745 σ
        self.scale = (median / 0.6745).max(floor_variance(self, sums, options).sqrt());
        self.loss = match options.outliers {
            Outliers::Gate(k) if !closed => Outliers::Huber(k).loss(self.scale),
            outliers => outliers.loss(self.scale),
        };
    }

    /// Mean square by which this block's innovation exceeds its residuals, in noise variances.
    pub fn excess(&self, sums: &Sums) -> f64 {
        let (innovation, rows) = self.innovation;
        let excess = innovation / rows.max(1) as f64 - sums.cost / sums.rows.max(1) as f64;
        (excess / self.variance.max(TINY)).max(0.0)
    }

    /// Learns the noise from residuals with sum of squares `cost`, of which the parameters took
    /// `taken` degrees of freedom. A block raises the noise variance by at most a factor of four: a
    /// larger jump is not noise, and a real one is learnt in two blocks.
    pub fn learn(&mut self, sums: &Sums, cost: f64, taken: f64, options: &EstimatorOptions) {
        let freedom = (sums.rows - sums.outliers) as f64 - taken;
        self.surprise += (1.0 - options.forgetting_factor) * (self.excess(sums).min(LARGEST) - self.surprise);
        if freedom > 1e-6 * sums.rows as f64 {
            let variance = if self.loss == Loss::Square {
                cost / freedom
            } else {
                self.scale * self.scale
            };
            let known = self.freedom > 0.0 && options.change_detection.is_some();
            let variance = if known {
                variance.min(4.0 * self.variance)
            } else {
                variance
            };
            let lambda = options.forgetting_factor;
            self.spread = lambda * self.spread + freedom * variance;
            self.freedom = lambda * self.freedom + freedom;
        }
    }
}

/// Lower limit of the noise variance.
fn floor_variance(e: &EquationState, sums: &Sums, options: &EstimatorOptions) -> f64 {
    let size = if sums.rows > 0 {
        sums.size / sums.rows as f64
    } else {
        0.0
    };
    (e.floor * e.floor).max(options.noise_floor_relative.powi(2) * size)
}

/// Sums of every equation at θ; false if something is not finite.
pub fn evaluate(
    rows: &dyn Summable,
    range: Range<usize>,
    theta: &[f64],
    equations: &[EquationState],
    sums: &mut [Sums],
) -> bool {
    let mut finite = true;
    for (e, sums) in equations.iter().zip(sums) {
        rows.sum(&e.pass(range.clone()), theta, sums);
        finite &= sums.is_finite();
    }
    finite
}

/// matrix += S_e of one equation.
pub fn add_gram(n: usize, e: &EquationState, sums: &Sums, weight: f64, matrix: &mut [f64]) {
    let p = sums.params;
    for i in 0..p {
        for j in 0..p {
            matrix[(e.offset + i) * n + e.offset + j] += weight * sums.gram[i * p + j];
        }
    }
}

/// matrix += Σ_e S_e.
pub fn add_grams(n: usize, equations: &[EquationState], sums: &[Sums], matrix: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        add_gram(n, e, sums, 1.0, matrix);
    }
}

/// gradient += Σ_e g_e.
pub fn add_scores(equations: &[EquationState], sums: &[Sums], gradient: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        add_score(e, sums, 1.0, gradient);
    }
}

/// gradient += weight g_e.
pub fn add_score(e: &EquationState, sums: &Sums, weight: f64, gradient: &mut [f64]) {
    for (g, s) in gradient[e.offset..].iter_mut().zip(&sums.score) {
        *g += weight * s;
    }
}

/// Mean noise variance of the rows in the sums.
pub fn mean_variance(equations: &[EquationState], sums: &[Sums]) -> f64 {
    let rows: f64 = sums.iter().map(|s| s.rows as f64).sum();
    let weighted = equations.iter().zip(sums).map(|(e, s)| e.variance * s.rows as f64);
    let sum: f64 = weighted.sum();
    if rows > 0.0 { sum / rows } else { 0.0 }
}

/// χ² of the residuals and its degrees of freedom, in units of the specified noise variance if
/// `noise_is_configured`, else of the learnt one; and that variance.
pub fn chi_square(equations: &[EquationState], sums: &[Sums], noise_is_configured: bool) -> (f64, f64, f64) {
    let (mut misfit, mut freedom, mut unit, mut rows) = (0.0, 0.0, 0.0, 0.0);
    for (e, sums) in equations.iter().zip(sums) {
        let variance = if noise_is_configured {
            e.floor * e.floor
        } else {
            e.variance.max(TINY)
        };
        let used = (sums.rows - sums.outliers) as f64;
        misfit += sums.cost / variance;
        freedom += used - sums.params as f64;
        unit += used * variance;
        rows += used;
    }
    (misfit, freedom.max(0.0), if rows > 0.0 { unit / rows } else { 1.0 })
}
