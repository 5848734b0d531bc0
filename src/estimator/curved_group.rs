//! A group whose rows contain products of parameters; see `curvature.rs` for the equations.

use super::equation::EquationState;
use super::group::GroupState;
use super::options::EstimatorOptions;
use super::pass::{Summable, Sums};

/// A fit holds a parameter around its start value if the standard deviation exceeds this share of
/// the parameter.
const HELD: f64 = 0.5;

impl GroupState {
    /// Adopts the products of the rows; `theta` is θ̄, where the sums were taken. A single step per
    /// block is (8) of the paper, which uses no products.
    pub fn adopt_products(&mut self, rows: &dyn Summable, theta: &[f64], options: &EstimatorOptions) {
        if options.max_iterations == 1 {
            return self.prior.curvature.clear();
        }
        let priors = &options.parameters[self.parameters.clone()];
        let variance = self.equations.variance();
        let (equations, limits) = (self.equations.pairs(), &self.limits);
        let theta = &theta[self.parameters.clone()];
        let weight = |i: usize| {
            let diagonal = |(e, sums): (&EquationState, &Sums)| {
                let k = i.checked_sub(e.offset).filter(|&k| k < sums.params);
                k.map_or(0.0, |k| sums.gram[k * (sums.params + 1)])
            };
            let size = if limits.is_free(i) { theta[i] } else { 0.0 };
            size * size * equations.clone().map(diagonal).sum::<f64>()
        };
        self.prior.curvature.adopt(rows, self.parameters.start, weight);
        let open = |i: usize| {
            let wide = self.errors.variance(i) > (HELD * theta[i]).powi(2);
            let size = priors[i].start.abs().max(priors[i].std);
            (wide && size > 0.0).then_some(size)
        };
        self.prior.curvature.hold(variance, open);
    }

    /// Refers what was known at θ̄ to `theta`: (d).
    pub fn turn(&mut self, theta: &[f64]) {
        let own = &theta[self.parameters.clone()];
        if !self.prior.turn(own) {
            return;
        }
        let curvature = &self.prior.curvature;
        self.errors.turn(curvature);
        let noise = self.equations.noise_covariances();
        noise.for_each(|covariance| curvature.turn_covariance(covariance));
        self.considered.turn(curvature);
        self.confirmation.turn(curvature, own, self.prior.centre());
    }
}
