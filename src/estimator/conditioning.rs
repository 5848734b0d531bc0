//! Keeps information and covariance matrices within the range of double precision.

use super::linalg::{Eigen, RANK_TOLERANCE};

/// Largest condition number of the column-scaled information that double precision can represent.
pub const LARGEST_CONDITION: f64 = 0.01 / RANK_TOLERANCE;

/// Keeps a matrix positive definite to rounding and returns the condition number of its
/// column-scaled form: a block of identical samples adds 1e12 in one direction to 1e-6 in the
/// others, which rounding would erase.
pub fn repair(n: usize, matrix: &mut [f64], eigen: &mut Eigen, work: &mut [f64], scale: &mut [f64]) -> f64 {
    for i in 0..n {
        scale[i] = matrix[i * n + i].max(f64::MIN_POSITIVE).sqrt();
    }
    for i in 0..n {
        for j in 0..n {
            work[i * n + j] = matrix[i * n + j] / (scale[i] * scale[j]);
        }
    }
    eigen.decompose(n, work);
    let values = &mut eigen.values[..n];
    let largest = values.iter().fold(0.0, |a: f64, &b| a.max(b));
    let smallest = values.iter().fold(f64::INFINITY, |a: f64, &b| a.min(b));
    let least = largest / LARGEST_CONDITION;
    if smallest < least {
        values.iter_mut().for_each(|v| *v = v.max(least));
        eigen.rebuild(n, matrix, |value| value);
        rescale(n, matrix, |i| scale[i]);
    }
    if smallest > 0.0 {
        largest / smallest
    } else {
        f64::INFINITY
    }
}

/// Inverts a covariance over the parameters that are not fixed, in place; the ratio of standard
/// deviations between directions is limited to a million. Rows and columns of fixed parameters
/// become zero.
pub fn invert(n: usize, matrix: &mut [f64], fixed: &[bool], eigen: &mut Eigen, work: &mut [f64], scale: &mut [f64]) {
    for i in 0..n {
        let d = matrix[i * n + i];
        scale[i] = if fixed[i] || !(d > 0.0) { 0.0 } else { 1.0 / d.sqrt() };
    }
    for i in 0..n {
        for j in 0..n {
            let unit = if i == j { 1.0 } else { 0.0 };
            work[i * n + j] = if scale[i] > 0.0 && scale[j] > 0.0 {
                matrix[i * n + j] * scale[i] * scale[j]
            } else {
                unit
            };
        }
    }
    eigen.decompose(n, work);
    let largest = eigen.values[..n].iter().fold(0.0, |a: f64, &b| a.max(b));
    eigen.rebuild(n, matrix, |value| 1.0 / value.max(1e-12 * largest));
    rescale(n, matrix, |i| scale[i]);
}

fn rescale(n: usize, matrix: &mut [f64], scale: impl Fn(usize) -> f64) {
    for i in 0..n {
        for j in 0..n {
            matrix[i * n + j] *= scale(i) * scale(j);
        }
    }
}
