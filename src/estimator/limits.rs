//! Which parameters of a group are free, and the bounds of their values.

use super::persist::Visit;
use super::prior::ParameterPrior;

/// The limits of the parameters of a group, which are counted from 0 here.
#[derive(Debug, Clone)]
pub struct Limits {
    fixed: Vec<bool>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Limits {
    /// Those of the options.
    pub fn new(priors: &[ParameterPrior]) -> Self {
        Self {
            fixed: priors.iter().map(|p| p.fixed).collect(),
            lower: priors.iter().map(|p| p.lower).collect(),
            upper: priors.iter().map(|p| p.upper).collect(),
        }
    }

    /// What goes from block to block; bounds never change.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.fixed.iter_mut().for_each(|fixed| v.flag(fixed));
    }

    /// Fixes or frees parameter i.
    pub fn set_fixed(&mut self, i: usize, fixed: bool) {
        self.fixed[i] = fixed;
    }

    /// True for each fixed parameter.
    pub fn fixed(&self) -> &[bool] {
        &self.fixed
    }

    /// True if parameter i is free.
    pub fn is_free(&self, i: usize) -> bool {
        !self.fixed[i]
    }

    /// The free parameters.
    pub fn free(&self) -> impl Iterator<Item = usize> + Clone {
        (0..self.fixed.len()).filter(|&i| !self.fixed[i])
    }

    /// The value within the bounds of parameter i that is nearest to `value`.
    pub fn clamp(&self, i: usize, value: f64) -> f64 {
        value.clamp(self.lower[i], self.upper[i])
    }

    /// How far parameter i may fall and rise from `value`.
    pub fn reach(&self, i: usize, value: f64) -> (f64, f64) {
        (self.lower[i] - value, self.upper[i] - value)
    }

    /// True if parameter i cannot be negative.
    pub fn is_never_negative(&self, i: usize) -> bool {
        self.lower[i] >= 0.0
    }

    /// True if `value` is less than `margin` from a bound of parameter i, or beyond it.
    pub fn is_near_bound(&self, i: usize, value: f64, margin: f64) -> bool {
        value - self.lower[i] < margin || self.upper[i] - value < margin
    }

    /// True if `value` is beyond a bound of parameter i by more than `allowance`.
    pub fn is_beyond_bound(&self, i: usize, value: f64, allowance: f64) -> bool {
        value < self.lower[i] - allowance || value > self.upper[i] + allowance
    }

    /// True if all values are within their bounds.
    pub fn allow(&self, theta: &[f64]) -> bool {
        let bounds = self.lower.iter().zip(&self.upper);
        theta.iter().zip(bounds).all(|(t, (l, u))| (*l..=*u).contains(t))
    }
}
