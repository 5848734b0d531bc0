//! Workspace of a group, allocated once.

use super::conditioning::{invert, repair};
use super::linalg::{Cholesky, Eigen, gather, scatter};

/// Matrices (n × n) and vectors (n) that carry nothing from one call to the next.
#[derive(Debug, Clone)]
pub struct Workspace {
    n: usize,
    pub total: Vec<f64>,
    pub gain: Vec<f64>,
    pub transition: Vec<f64>,
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    pub gradient: Vec<f64>,
    pub offset: Vec<f64>,
    pub noise: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    pub scale: Vec<f64>,
    pub free: Vec<bool>,
    pub regressor: Vec<f64>,
    pub cholesky: Cholesky,
    pub eigen: Eigen,
}

impl Workspace {
    /// Matrices n × n and vectors n.
    pub fn new(n: usize) -> Self {
        let (matrix, vector) = (vec![0.0; n * n], vec![0.0; n]);
        Self {
            n,
            total: matrix.clone(),
            gain: matrix.clone(),
            transition: matrix.clone(),
            a: matrix.clone(),
            b: matrix,
            gradient: vector.clone(),
            offset: vector.clone(),
            noise: vector.clone(),
            lower: vector.clone(),
            upper: vector.clone(),
            scale: vector.clone(),
            free: vec![true; n],
            regressor: vector,
            cholesky: Cholesky::new(n),
            eigen: Eigen::new(n),
        }
    }

    /// Keeps `information` positive definite, see [`repair`]; returns its condition number.
    pub fn repair(&mut self, information: &mut [f64]) -> f64 {
        repair(self.n, information, &mut self.eigen, &mut self.a, &mut self.scale)
    }

    /// Inverts a covariance, see [`invert`].
    pub fn invert(&mut self, covariance: &mut [f64], fixed: &[bool]) {
        invert(self.n, covariance, fixed, &mut self.eigen, &mut self.a, &mut self.scale);
    }

    /// The same for the covariance in `gain`.
    pub fn invert_gain(&mut self, fixed: &[bool]) {
        let (eigen, a, scale) = (&mut self.eigen, &mut self.a, &mut self.scale);
        invert(self.n, &mut self.gain, fixed, eigen, a, scale);
    }

    /// Writes K to `gain`: the inverse of `information`, which is positive definite, over the
    /// parameters that are not fixed.
    pub fn invert_free(&mut self, information: &[f64], fixed: &[bool]) {
        let count = gather(self.n, information, fixed, &mut self.a);
        self.gain.fill(0.0);
        // every principal part of a positive definite matrix is positive definite
        if count > 0 && self.cholesky.factor(count, &self.a[..count * count]) {
            self.cholesky.inverse(&mut self.b[..count * count]);
            scatter(self.n, &self.b, fixed, &mut self.gain);
        }
    }
}
