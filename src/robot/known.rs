//! Read access to a robot's identification: estimates, their standard deviations, and its settings.

use super::change::RobotChange;
use super::figures::BlockFigures;
use super::identify::RobotIdentifier;
use super::model::{RobotModel, RobotParameter};
use super::windows::WindowOptions;

impl RobotIdentifier {
    /// The model of the arm.
    pub fn model(&self) -> &RobotModel {
        &self.learner.arm.model
    }

    /// The parameters θ: the arm's, then those of the payload if one is estimated.
    pub fn parameters(&self) -> &[RobotParameter] {
        &self.learner.arm.parameters
    }

    /// Estimates θ̂ in the order of [`parameters`](Self::parameters).
    pub fn theta(&self) -> &[f64] {
        &self.learner.estimate.theta()[..self.parameters().len()]
    }

    /// Standard deviation of one estimate; the prior's before the first block, 0 if it is fixed.
    pub fn theta_std(&self, parameter: usize) -> f64 {
        self.allowances.std(&self.learner, parameter)
    }

    /// Prior standard deviation of a parameter.
    pub fn prior_std(&self, parameter: usize) -> f64 {
        self.parameters()[parameter].scale
    }

    /// [`theta_std`](Self::theta_std) without the allowances for missing terms and drifts, because
    /// a mistake in the signals itself widens these.
    pub(super) fn own_std(&self, parameter: usize) -> f64 {
        self.learner.estimate.std(parameter)
    }

    /// Covariance of two estimates.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.allowances.covariance(&self.learner, i, j)
    }

    /// σ_j: standard deviation of a joint's rows about their prediction \[N m or N\].
    pub fn torque_std(&self, joint: usize) -> f64 {
        self.learner.levels.std()[joint]
    }

    /// f_j: ratio of a joint's misfit over a block to that of uncorrelated rows with σ_j.
    pub fn inflation(&self, joint: usize) -> f64 {
        self.learner.levels.inflation(joint)
    }

    /// Blocks so far.
    pub fn blocks(&self) -> usize {
        self.learner.blocks
    }

    /// The change found in the last block.
    pub fn change(&self) -> Option<RobotChange> {
        self.change
    }

    /// The windows of the rows.
    pub fn windows(&self) -> &WindowOptions {
        &self.learner.options.windows
    }

    /// Length of the windows of the rows \[s\].
    pub fn window_s(&self) -> f64 {
        self.learner.options.windows.length_s
    }

    /// True if a payload is estimated.
    pub fn estimates_payload(&self) -> bool {
        self.learner.flange.has_payload()
    }

    /// True while the flange carries a payload, as far as known.
    pub fn is_loaded(&self) -> bool {
        self.learner.flange.is_loaded()
    }

    /// How well the last block was predicted and is fitted.
    pub fn figures(&self) -> &BlockFigures {
        &self.figures
    }

    /// True if a parameter is fixed.
    pub fn is_fixed(&self, parameter: usize) -> bool {
        self.learner.estimate.fixed()[parameter]
    }
}
