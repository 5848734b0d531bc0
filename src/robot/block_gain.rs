//! How much a block alone informs about each parameter.

use super::information::Information;
use super::learning::Learner;

/// Smallest size of a parameter for its excitation, relative to its prior.
const SMALLEST_SIZE: f64 = 1e-3;

/// Workspace for the excitation of the parameters.
#[derive(Debug, Clone)]
pub(super) struct BlockGain {
    information: Information,
    covariance: Vec<f64>,
    /// Sizes of the parameters.
    size: Vec<f64>,
}

impl BlockGain {
    /// For n parameters and terms.
    pub fn new(n: usize) -> Self {
        Self {
            information: Information::new(n),
            covariance: vec![0.0; n * n],
            size: vec![0.0; n],
        }
    }

    /// Writes the share of the variance of each parameter, known to within its size, that the open
    /// block alone would remove.
    pub fn measure(&mut self, learner: &mut Learner, excitation: &mut [f64]) {
        let (theta, n) = (learner.estimate.theta(), learner.estimate.n());
        self.information.clear();
        for (joint, sums) in learner.open.sums().iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let weight = learner.levels.weight(joint);
            learner.flange.learn(sums, weight, &mut self.information);
        }
        for (i, parameter) in learner.arm.parameters.iter().enumerate() {
            self.size[i] = theta[i].abs().max(SMALLEST_SIZE * parameter.scale);
            self.information.matrix[i * n + i] += self.size[i].powi(-2);
        }
        let fixed = learner.estimate.fixed();
        let solved = learner
            .solver
            .covariance(&self.information, fixed, &mut self.covariance);
        for (i, excitation) in excitation.iter_mut().enumerate() {
            let left = self.covariance[i * n + i] / self.size[i].powi(2);
            *excitation = match solved && !fixed[i] {
                true => (1.0 - left).clamp(0.0, 1.0),
                false => 0.0,
            };
        }
    }
}
