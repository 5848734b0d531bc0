//! An equation of a group: its noise, its residuals, and what it adds to the normal equations.

use super::Residuals;
use super::options::EstimatorOptions;
use super::pass::{Loss, Sums, accumulate};
use std::ops::Range;

/// Noise variances are kept above this, so that they may divide.
pub const TINY: f64 = 1e-200;

/// An equation as its group sees it.
#[derive(Debug, Clone)]
pub struct EquationState {
    /// Index in the structure.
    pub index: usize,
    /// Its parameters among all.
    pub own: Range<usize>,
    /// Its first parameter in the group.
    pub offset: usize,
    pub divisor: f64,
    pub floor: f64,
    /// Forgotten sum of squares of the residuals and its degrees of freedom.
    pub spread: f64,
    pub freedom: f64,
    /// Noise variance of the divided rows: learnt, and never below the floor.
    pub variance: f64,
    /// Σ f² at θ̄ and the rows it is of.
    pub innovation: (f64, usize),
    /// Robust standard deviation of the residuals and the loss that follows from it.
    pub scale: f64,
    pub loss: Loss,
    /// Covariance caused by this equation's noise of unit variance, n × n.
    pub noise_covariance: Vec<f64>,
}

impl EquationState {
    /// Equation `index` with parameters `own`, in a group of `parameters`; nothing is known of its noise.
    pub fn new(index: usize, own: Range<usize>, parameters: &Range<usize>, options: &EstimatorOptions) -> Self {
        let n = parameters.len();
        Self {
            index,
            offset: own.start - parameters.start,
            own,
            divisor: options.noise_std[index],
            floor: options.noise_floor[index],
            spread: 0.0,
            freedom: 0.0,
            variance: 0.0,
            innovation: (0.0, 0),
            scale: 0.0,
            loss: Loss::Square,
            noise_covariance: vec![0.0; n * n],
        }
    }

    /// Learns the noise from residuals of `cost` of which the parameters took `taken` degrees of freedom. A block counts as at most four
    /// times as noisy as known so far: more is something else than noise, or is learnt in two blocks.
    pub fn learn(&mut self, sums: &Sums, cost: f64, taken: f64, options: &EstimatorOptions) {
        let freedom = (sums.rows - sums.outliers) as f64 - taken;
        if freedom > 1e-6 * sums.rows as f64 {
            let own = if self.loss == Loss::Square {
                cost / freedom
            } else {
                self.scale * self.scale
            };
            let known = self.freedom > 0.0 && options.change_detection.is_some();
            let own = if known { own.min(4.0 * self.variance) } else { own };
            let lambda = options.forgetting_factor;
            self.spread = lambda * self.spread + freedom * own;
            self.freedom = lambda * self.freedom + freedom;
        }
    }
}

/// Smallest noise variance that is believed.
pub fn floor_variance(e: &EquationState, sums: &Sums, options: &EstimatorOptions) -> f64 {
    let size = if sums.rows > 0 {
        sums.size / sums.rows as f64
    } else {
        0.0
    };
    (e.floor * e.floor).max(options.noise_floor_relative.powi(2) * size)
}

/// Sums of every equation at θ; false where something is not finite.
pub fn evaluate<R: Residuals>(
    rows: &R,
    range: Range<usize>,
    theta: &[f64],
    equations: &[EquationState],
    sums: &mut [Sums],
) -> bool {
    let mut finite = true;
    for (e, sums) in equations.iter().zip(sums) {
        accumulate(
            rows,
            e.index,
            range.clone(),
            theta,
            e.own.clone(),
            e.divisor,
            e.loss,
            sums,
        );
        finite &= sums.is_finite();
    }
    finite
}

/// matrix += S_e of one equation.
pub fn add_gram(n: usize, e: &EquationState, sums: &Sums, matrix: &mut [f64]) {
    let p = sums.params;
    for i in 0..p {
        for j in 0..p {
            matrix[(e.offset + i) * n + e.offset + j] += sums.gram[i * p + j];
        }
    }
}

/// matrix += Σ_e S_e.
pub fn add_grams(n: usize, equations: &[EquationState], sums: &[Sums], matrix: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        add_gram(n, e, sums, matrix);
    }
}

/// gradient += Σ_e g_e.
pub fn add_scores(equations: &[EquationState], sums: &[Sums], gradient: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        for (g, s) in gradient[e.offset..].iter_mut().zip(&sums.score) {
            *g += s;
        }
    }
}
