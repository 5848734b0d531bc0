//! Read access to a robot's identification: estimates, their standard deviations, and its settings.

use super::change::RobotChange;
use super::figures::BlockFigures;
use super::identify::RobotIdentifier;
use super::model::{RobotModel, RobotParameter};
use super::windows::WindowOptions;

impl RobotIdentifier {
    /// The model of the arm.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// The parameters θ: the arm's, then those of the payload if one is estimated.
    pub fn parameters(&self) -> &[RobotParameter] {
        &self.parameters
    }

    /// Estimates θ̂ in the order of [`parameters`](Self::parameters).
    pub fn theta(&self) -> &[f64] {
        &self.theta[..self.parameters.len()]
    }

    /// Standard deviation of one estimate; the prior's before the first block, 0 if it is fixed.
    pub fn theta_std(&self, parameter: usize) -> f64 {
        self.covariance(parameter, parameter).max(0.0).sqrt()
    }

    /// The same without the allowances for missing terms and drifts, because a mistake in the
    /// signals itself widens these.
    pub(super) fn own_std(&self, parameter: usize) -> f64 {
        self.covariance[parameter * self.theta.len() + parameter]
            .max(0.0)
            .sqrt()
    }

    /// Covariance of two estimates.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        let n = self.theta.len();
        let left_out = self.left_out.as_ref();
        let drifts = i == j && !self.fixed[i];
        let drift = match drifts {
            true => self.drift.variance(i) + self.offset_drift.variance(i) + self.counts.variance(i),
            false => 0.0,
        };
        let bias = self.bias[i] * self.bias[j]; // (2) of acceleration_noise.rs
        let scatter = |i: usize| self.block_scatter.as_ref().map_or(1.0, |scatter| scatter.factor[i]);
        let own = self.covariance[i * n + j] * scatter(i) * scatter(j); // (4) of block_scatter.rs
        own + drift + bias + left_out.map_or(0.0, |left_out| left_out.covariance(i, j, n))
    }

    /// σ_j: standard deviation of a joint's rows about their prediction \[N m or N\].
    pub fn torque_std(&self, joint: usize) -> f64 {
        self.torque_std[joint]
    }

    /// f_j: ratio of a joint's misfit over a block to that of uncorrelated rows with σ_j.
    pub fn inflation(&self, joint: usize) -> f64 {
        self.inflation[joint]
    }

    /// Blocks so far.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// The change found in the last block.
    pub fn change(&self) -> Option<RobotChange> {
        self.change
    }

    /// The windows of the rows.
    pub fn windows(&self) -> &WindowOptions {
        &self.options.windows
    }

    /// Length of the windows of the rows \[s\].
    pub fn window_s(&self) -> f64 {
        self.options.windows.length_s
    }

    /// True if a payload is estimated.
    pub fn estimates_payload(&self) -> bool {
        self.payload.is_some()
    }

    /// True while the flange carries a payload, as far as known.
    pub fn is_loaded(&self) -> bool {
        self.is_loaded
    }

    /// How well the last block was predicted and is fitted.
    pub fn figures(&self) -> &BlockFigures {
        &self.figures
    }

    /// True if a parameter is fixed.
    pub fn is_fixed(&self, parameter: usize) -> bool {
        self.fixed[parameter]
    }
}
