//! Tests whether the estimates fundamentally contradict the URDF, by
//! [`urdf_prior`](super::urdf_prior).

use super::identify::RobotIdentifier;
use super::urdf_prior::UrdfContradiction;

/// Relative standard deviation of the inertias in a correct URDF.
const INERTIAS: f64 = 0.5;

impl RobotIdentifier {
    /// A gravity or a zero that contradicts the URDF, if the moments show one: no moment may then
    /// be used.
    pub fn contradiction(&self) -> Option<UrdfContradiction> {
        self.urdf_prior.as_ref().and_then(|prior| prior.found)
    }

    /// Tests the moments after a block.
    pub(super) fn look_at_urdf(&mut self) {
        let Some(mut prior) = self.urdf_prior.take() else {
            return;
        };
        let k = prior.indices.len();
        for (a, &i) in prior.indices.iter().enumerate() {
            prior.estimate[a] = self.theta[i];
            for (b, &j) in prior.indices.iter().enumerate() {
                // without (6) of left_out.rs, which would allow for the zero that is sought
                prior.covariance[a * k + b] = self.covariance[i * self.theta.len() + j];
            }
        }
        let (mut along, mut square) = (0.0, f64::MIN_POSITIVE);
        for &i in &prior.inertias {
            let nominal = self.parameters[i].nominal;
            let variance = self.covariance(i, i) + (INERTIAS * nominal).powi(2);
            if variance > 0.0 {
                along += self.theta[i] * nominal / variance;
                square += nominal * nominal / variance;
            }
        }
        prior.test(along / square);
        self.urdf_prior = Some(prior);
    }
}
