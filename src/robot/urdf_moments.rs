//! Tests whether the estimates fundamentally contradict the URDF, by
//! [`urdf_prior`](super::urdf_prior).

use super::allowances::Allowances;
use super::learning::Learner;
use super::urdf_prior::UrdfPrior;

/// Relative standard deviation of the inertias in a correct URDF.
const INERTIAS: f64 = 0.5;

impl UrdfPrior {
    /// Tests the moments after a block.
    pub fn look_at_block(&mut self, learner: &Learner, allowances: &Allowances) {
        let (theta, k) = (learner.estimate.theta(), self.indices.len());
        for (a, &i) in self.indices.iter().enumerate() {
            self.estimate[a] = theta[i];
            for (b, &j) in self.indices.iter().enumerate() {
                // without (6) of left_out.rs, which would allow for the zero that is sought
                self.covariance[a * k + b] = learner.estimate.row(i)[j];
            }
        }
        let (mut along, mut square) = (0.0, f64::MIN_POSITIVE);
        for &i in &self.inertias {
            let nominal = learner.arm.parameters[i].nominal;
            let variance = allowances.covariance(learner, i, i) + (INERTIAS * nominal).powi(2);
            if variance > 0.0 {
                along += theta[i] * nominal / variance;
                square += nominal * nominal / variance;
            }
        }
        self.test(along / square);
    }
}
