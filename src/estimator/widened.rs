//! Covariances of a group, widened by what its recursion does not see.
//!
//! ```text
//! P + disagreement between blocks + considered errors                clusters.rs, considered_covariance.rs
//! W + disagreement between blocks + what is not yet confirmed        relation.rs, confirmation.rs
//! ```

use super::clusters::Clusters;
use super::considered::Considered;

/// The widened covariances, n × n each.
#[derive(Debug, Clone)]
pub struct Widened {
    total: Vec<f64>,
    weights: Vec<f64>,
}

impl Widened {
    /// Those of n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            total: vec![0.0; n * n],
            weights: vec![0.0; n * n],
        }
    }

    /// P, widened.
    pub fn total(&self) -> &[f64] {
        &self.total
    }

    /// W, widened.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Takes the covariance of the recursion, `own`.
    pub fn take(&mut self, own: &[f64], clusters: &Clusters, considered: &mut Considered) {
        self.total.copy_from_slice(own);
        clusters.widen(&mut self.total);
        self.weights.copy_from_slice(&self.total);
        considered.widen_weights(&mut self.weights);
        considered.widen(&mut self.total);
    }

    /// Adds to W by how much the covariance that may be published exceeds P.
    pub fn add_unconfirmed(&mut self, published: &[f64]) {
        let widened = published.iter().zip(&self.total);
        for (v, (after, before)) in self.weights.iter_mut().zip(widened) {
            *v += after - before;
        }
    }

    /// Writes the covariance of the recursion, `own`, with what is not yet confirmed but without
    /// the considered errors, to `unconfirmed`.
    pub fn unconfirmed(&self, own: &[f64], published: &[f64], unconfirmed: &mut [f64]) {
        let published = published.iter().zip(&self.total);
        for ((v, own), (after, before)) in unconfirmed.iter_mut().zip(own).zip(published) {
            *v = own + after - before;
        }
    }
}
