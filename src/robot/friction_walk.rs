//! Random walk (4) of friction, see [`identify`](super::identify).

use super::estimate::Estimate;
use super::information::Solver;
use super::model::RobotModel;
use super::past::Past;
use std::ops::Range;

/// The parameters of friction, and how fast they may change.
#[derive(Debug, Clone)]
pub(super) struct FrictionWalk {
    parameters: Vec<usize>,
    /// Those of each joint.
    joints: Vec<Range<usize>>,
    /// Share of its size per √s.
    per_sqrt_s: f64,
    variances: Vec<f64>,
}

impl FrictionWalk {
    /// The friction of a model, which walks by this share of its size per √s.
    pub fn new(model: &RobotModel, per_sqrt_s: f64) -> Self {
        let mut parameters = Vec::new();
        let mut joints = Vec::new();
        for joint in 0..model.robot().len() {
            let first = parameters.len();
            parameters.extend(model.friction_of(joint));
            joints.push(first..parameters.len());
        }
        Self {
            variances: vec![0.0; parameters.len()],
            parameters,
            joints,
            per_sqrt_s,
        }
    }

    /// Indices in θ, joint by joint.
    pub fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    /// The places of a joint's among [`parameters`](Self::parameters).
    pub fn of_joint(&self, joint: usize) -> Range<usize> {
        self.joints[joint].clone()
    }

    /// True if friction may change.
    pub fn is_on(&self) -> bool {
        self.per_sqrt_s != 0.0
    }

    /// (4) over `time_s`.
    pub fn advance(&mut self, estimate: &Estimate, time_s: f64, past: &mut Past, solver: &mut Solver) {
        if !self.is_on() {
            return;
        }
        for (variance, &i) in self.variances.iter_mut().zip(&self.parameters) {
            let size = estimate.theta()[i].abs().max(estimate.std(i));
            let per_s = (self.per_sqrt_s * size).powi(2); // (4)
            *variance = per_s.max(past.drift_walk_per_s(i)) * time_s;
        }
        past.walk(solver, &self.parameters, &self.variances);
    }

    /// Adds (`part` · size)² to the variance of each; its size is |θ̂| or three standard deviations,
    /// whichever is larger.
    pub fn widen(&mut self, part: f64, estimate: &Estimate, past: &mut Past, solver: &mut Solver) {
        for (variance, &i) in self.variances.iter_mut().zip(&self.parameters) {
            let size = estimate.theta()[i].abs().max(3.0 * estimate.std(i));
            *variance = (part * size).powi(2);
        }
        past.walk(solver, &self.parameters, &self.variances);
    }
}
