//! The estimates of a robot's parameters with their covariance, and which of them are fixed.

use super::flange::Flange;
use super::information::{Information, Solver};
use super::model::RobotParameter;
use super::offset_drift::Origin;
use super::past::Past;
use crate::estimator::persist::Visit;

/// θ̂ and P. The parameters come first, then the terms that the model leaves out, which are fixed at
/// 0.
#[derive(Debug, Clone)]
pub(super) struct Estimate {
    theta: Vec<f64>,
    /// The parameters of an arm that is equivalent to arm and payload together, then the slopes of
    /// the offsets.
    effective: Vec<f64>,
    covariance: Vec<f64>,
    /// Bias of θ̂ by errors of the positions.
    bias: Vec<f64>,
    /// Includes the parameters of the payload while there is none.
    fixed: Vec<bool>,
    /// Prior of the parameters: means and standard deviations.
    prior: Vec<(f64, f64)>,
}

impl Estimate {
    /// For these parameters, `n` of them and terms together; rows depend on `acting` effective
    /// parameters.
    pub fn new(parameters: &[RobotParameter], n: usize, acting: usize) -> Self {
        Self {
            theta: vec![0.0; n],
            effective: vec![0.0; acting],
            covariance: vec![0.0; n * n],
            bias: vec![0.0; n],
            fixed: vec![true; n],
            prior: parameters.iter().map(|p| (p.nominal, p.scale)).collect(),
        }
    }

    /// Returns to the prior; the parameters of the payload are fixed at 0.
    pub fn reset(&mut self, flange: &Flange, past: &Past) {
        self.theta.fill(0.0);
        self.bias.fill(0.0);
        self.fixed.fill(true);
        for (i, (mean, _)) in self.prior.iter().enumerate() {
            self.theta[i] = *mean;
            self.fixed[i] = flange.owns(i);
        }
        self.reset_covariance();
        self.refresh_effective(flange, past);
    }

    fn reset_covariance(&mut self) {
        let n = self.theta.len();
        self.covariance.fill(0.0);
        for (i, (_, std)) in self.prior.iter().enumerate().filter(|(i, _)| !self.fixed[*i]) {
            self.covariance[i * n + i] = std.powi(2);
        }
    }

    /// Number of parameters and terms.
    pub fn n(&self) -> usize {
        self.theta.len()
    }

    /// θ̂, with the terms.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The effective parameters of θ̂.
    pub fn effective(&self) -> &[f64] {
        &self.effective
    }

    /// P, with the terms.
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// A row of P.
    pub fn row(&self, i: usize) -> &[f64] {
        let n = self.theta.len();
        &self.covariance[i * n..(i + 1) * n]
    }

    /// Standard deviation by P alone.
    pub fn std(&self, i: usize) -> f64 {
        self.row(i)[i].max(0.0).sqrt()
    }

    /// Bias of θ̂ by errors of the positions.
    pub fn bias(&self) -> &[f64] {
        &self.bias
    }

    /// Which parameters are fixed; terms are.
    pub fn fixed(&self) -> &[bool] {
        &self.fixed
    }

    /// The parameters that are not fixed.
    pub fn free(&self) -> impl Iterator<Item = usize> {
        (0..self.prior.len()).filter(|i| !self.fixed[*i])
    }

    /// Fixes a parameter at a value.
    pub fn fix(&mut self, i: usize, value: f64) {
        (self.fixed[i], self.theta[i]) = (true, value);
    }

    /// Frees a parameter.
    pub fn release(&mut self, i: usize) {
        self.fixed[i] = false;
    }

    /// Solves for the free parameters; θ̂ stays if that fails because of rounding.
    pub fn solve(&mut self, solver: &mut Solver, system: &Information) {
        solver.solve(system, &self.fixed, &mut self.theta);
    }

    /// P from the present information. If that fails because of rounding, P becomes that before the
    /// first block, so that no value passes for known.
    pub fn solve_covariance(&mut self, solver: &mut Solver, system: &Information) {
        self.bias.fill(0.0);
        if self.try_covariance(solver, system) {
            Solver::bias(system, &self.covariance, &mut self.bias);
        } else {
            self.reset_covariance();
        }
    }

    /// P from the present information; false if that fails.
    pub fn try_covariance(&mut self, solver: &mut Solver, system: &Information) -> bool {
        solver.covariance(system, &self.fixed, &mut self.covariance)
    }

    /// The effective parameters of θ̂, with the slopes so far.
    pub fn refresh_effective(&mut self, flange: &Flange, past: &Past) {
        flange.effective(&self.theta, &mut self.effective);
        past.add_slopes(&mut self.effective, Origin::Mean);
    }

    /// The same with slopes by `add_slopes`.
    pub fn renew_effective(&mut self, flange: &Flange, add_slopes: impl FnOnce(&[bool], &mut [f64])) {
        flange.effective(&self.theta, &mut self.effective);
        add_slopes(&self.fixed, &mut self.effective);
    }

    /// Which parameters are fixed, and θ̂ to be changed.
    pub fn parts_mut(&mut self) -> (&[bool], &mut [f64]) {
        (&self.fixed, &mut self.theta)
    }

    /// Swaps θ̂, and which parameters are fixed; P stays.
    pub fn swap(&mut self, theta: &mut Vec<f64>, fixed: &mut Vec<bool>) {
        std::mem::swap(&mut self.theta, theta);
        std::mem::swap(&mut self.fixed, fixed);
    }

    /// θ̂ for a checkpoint.
    pub fn visit_theta(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.theta);
    }

    /// Which parameters are fixed, for a checkpoint.
    pub fn visit_fixed(&mut self, v: &mut impl Visit) {
        self.fixed.iter_mut().for_each(|fixed| v.flag(fixed));
    }
}
