//! The size of a parameter: what a change of 100 % means.
//!
//! ```text
//! size_i = max(|θ_i|, standard deviation of the start value, s_i)                                   (a)
//! s_i    = 0.1 max over the blocks of √(θᵀSθ / S_ii),  S = Σ φφᵀ over the rows of a block           (b)
//! ```
//!
//! A mass is known if it is known to a few per cent of itself. That says nothing of an offset,
//! which may be zero: known to a millivolt, it would be unknown to any share of itself. A parameter
//! whose start value and its standard deviation are zero has no size of its own. It then has the
//! one of (b), with which it makes a tenth of the signal of its equation.

use super::equation::EquationState;
use super::linalg::dot;
use super::pass::Sums;
use super::persist::Visit;
use super::prior::ParameterPrior;

/// Share of the signal in (b).
const SHARE: f64 = 0.1;

/// Sizes of the parameters of a group.
#[derive(Debug, Clone)]
pub struct Sizes {
    /// Standard deviation of each start value.
    stated: Vec<f64>,
    /// Parameters without a size of their own.
    without: Vec<bool>,
    /// s of (b); 0 for all others.
    from_signal: Vec<f64>,
}

impl Sizes {
    /// Those of the start values.
    pub fn new(priors: &[ParameterPrior]) -> Self {
        let without = |p: &ParameterPrior| p.start == 0.0 && p.std == 0.0 && !p.fixed;
        Self {
            stated: priors.iter().map(|p| p.std).collect(),
            without: priors.iter().map(without).collect(),
            from_signal: vec![0.0; priors.len()],
        }
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.from_signal);
    }

    /// (a) of parameter i with this value; above 0.
    pub fn of(&self, i: usize, value: f64) -> f64 {
        let size = self.own(i, value).max(self.stated[i]);
        if size > 0.0 { size } else { 1.0 }
    }

    /// The same without the start value, which may be far from the parameter's; ≥ 0.
    pub fn own(&self, i: usize, value: f64) -> f64 {
        value.abs().max(self.from_signal[i])
    }

    /// Standard deviation of the start value of parameter i.
    pub fn stated(&self, i: usize) -> f64 {
        self.stated[i]
    }

    /// (b) with the sums `at` of a block at θ; `theta` is the group's.
    pub fn learn(&mut self, equations: &[EquationState], at: &[Sums], theta: &[f64]) {
        if !self.without.contains(&true) {
            return;
        }
        for (e, sums) in equations.iter().zip(at) {
            let p = sums.params;
            let theta = &theta[e.offset..e.offset + p];
            let row = |i: usize| &sums.gram[i * p..(i + 1) * p];
            let signal: f64 = (0..p).map(|i| theta[i] * dot(row(i), theta)).sum();
            for i in (0..p).filter(|&i| self.without[e.offset + i]) {
                let size = SHARE * (signal / sums.gram[i * p + i]).sqrt();
                let largest = &mut self.from_signal[e.offset + i];
                if size.is_finite() && size > *largest {
                    *largest = size;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::EstimatorOptions;

    /// A group of one equation, v = a x + o, with the sums of a block in which x is ±1 and v has
    /// the root mean square √(a² + o²).
    fn learnt(priors: &[ParameterPrior], blocks: &[[f64; 2]]) -> Sizes {
        let options = EstimatorOptions::recommended(priors.iter().copied(), 1);
        let equation = [EquationState::new(0, 0..2, &(0..2), &options)];
        let mut sizes = Sizes::new(priors);
        for theta in blocks {
            let mut sums = Sums::new(2);
            sums.gram = vec![100.0, 0.0, 0.0, 100.0];
            sizes.learn(&equation, &[sums], theta);
        }
        sizes
    }

    #[test]
    fn prop_an_offset_is_measured_by_a_tenth_of_the_largest_signal() {
        let priors = [ParameterPrior::new(2.0), ParameterPrior::new(0.0)];
        let sizes = learnt(&priors, &[[3.0, 4.0], [1.0, 0.0]]);
        assert!((sizes.of(1, 0.0) - 0.5).abs() < 1e-12);
        assert!((sizes.own(1, 0.2) - 0.5).abs() < 1e-12);
        assert_eq!(sizes.of(1, -0.7), 0.7);
    }

    #[test]
    fn prop_a_parameter_with_a_start_value_is_measured_by_itself() {
        let priors = [ParameterPrior::new(2.0), ParameterPrior::new(0.0).std(0.1)];
        let sizes = learnt(&priors, &[[3.0, 4.0]]);
        assert_eq!((sizes.of(0, 3.0), sizes.own(0, 3.0)), (3.0, 3.0));
        assert_eq!((sizes.of(0, 1.0), sizes.own(0, 1.0)), (2.0, 1.0));
        assert_eq!((sizes.of(1, 0.01), sizes.own(1, 0.01)), (0.1, 0.01));
    }

    #[test]
    fn prop_without_data_no_size_is_zero() {
        let sizes = learnt(&[ParameterPrior::new(0.0); 2], &[]);
        assert_eq!(sizes.of(0, 0.0), 1.0);
    }
}
