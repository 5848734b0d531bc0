//! The function G of (10) that keeps the covariance bounded.
//!
//! ```text
//! Γ = ε⁻¹ G(ε Π),    x ≤ G(x) ≤ 1 on [0, 1],    G(1) = 1,    G′(0) = 1/λ
//! ```
//!
//! G acts on the eigenvalues of εΠ. Near 0, where information is plentiful, it is the straight line
//! x/λ: exponential forgetting. 1 is a fixed point: with Π⁻¹ = εI nothing is left to forget, hence
//! Γ⁻¹ ≥ εI always.
//!
//! The estimators carry information, not covariance, so each G also has a closed form Π⁻¹ → Γ⁻¹
//! without eigenvectors.

use super::linalg::Cholesky;

/// A function G of (10), for one λ.
pub trait CovarianceBound {
    /// G(x) for x in [0, 1].
    fn value(&self, x: f64) -> f64;
    /// Γ⁻¹ from Π⁻¹ (n × n, row-major, symmetric positive definite) in place, with ε the floor;
    /// `work` has n² entries.
    ///
    /// Returns false and changes nothing if Π⁻¹ is not sufficiently positive definite for G.
    fn information(&self, n: usize, floor: f64, matrix: &mut [f64], factor: &mut Factor, work: &mut [f64]) -> bool;
}

/// Workspace for the factors that a [`CovarianceBound`] may need.
#[derive(Debug, Clone)]
pub struct Factor(Cholesky);

impl Factor {
    /// Workspace for problems up to n × n.
    pub fn new(n: usize) -> Self {
        Self(Cholesky::new(n))
    }
}

/// G(x) = (x − (1 − λ) x²)/λ: (11). Stays within [x, 1] for λ ≥ ½.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Polynomial {
    /// λ in [½, 1].
    pub forgetting_factor: f64,
}

impl CovarianceBound for Polynomial {
    fn value(&self, x: f64) -> f64 {
        (x - (1.0 - self.forgetting_factor) * x * x) / self.forgetting_factor // (11)
    }

    fn information(&self, n: usize, floor: f64, matrix: &mut [f64], factor: &mut Factor, work: &mut [f64]) -> bool {
        // an eigenvalue p of Π⁻¹ becomes λ p²/(p − c) = λ (p + c + c²/(p − c)) with c = (1 − λ) ε:
        // the first two terms are exact for large p, and the third only matters near the floor
        let lambda = self.forgetting_factor;
        let c = (1.0 - lambda) * floor;
        if c == 0.0 {
            return true;
        }
        let inverse = &mut work[..n * n];
        inverse.copy_from_slice(&matrix[..n * n]);
        for i in 0..n {
            inverse[i * n + i] -= c;
        }
        if !factor.0.factor(n, inverse) {
            return false;
        }
        factor.0.inverse(inverse);
        for (m, inv) in matrix.iter_mut().zip(inverse.iter()) {
            *m = lambda * (*m + c * c * inv); // (11) on the eigenvalues of Γ⁻¹
        }
        for i in 0..n {
            matrix[i * n + i] += lambda * c;
        }
        true
    }
}

/// G(x) = x/(λ + (1 − λ) x): within [x, 1] for every λ in (0, 1].
///
/// Its matrix form is the simplest of all, Γ⁻¹ = λ Π⁻¹ + (1 − λ) ε I.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rational {
    /// λ in (0, 1].
    pub forgetting_factor: f64,
}

impl CovarianceBound for Rational {
    fn value(&self, x: f64) -> f64 {
        x / (self.forgetting_factor + (1.0 - self.forgetting_factor) * x)
    }

    fn information(&self, n: usize, floor: f64, matrix: &mut [f64], _: &mut Factor, _: &mut [f64]) -> bool {
        for m in matrix[..n * n].iter_mut() {
            *m *= self.forgetting_factor;
        }
        for i in 0..n {
            matrix[i * n + i] += (1.0 - self.forgetting_factor) * floor;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::linalg::Eigen;
    use super::*;

    fn check_function(g: &dyn CovarianceBound, lambda: f64) {
        for k in 0..=1000 {
            let x = k as f64 / 1000.0;
            let y = g.value(x);
            // one rounding of a number below 1
            assert!(y >= x - 2e-16 && y <= 1.0 + 2e-16, "λ {lambda}: G({x}) = {y}");
        }
        assert!((g.value(1.0) - 1.0).abs() < 2e-16);
        // G(h)/h = 1/λ + O(h/λ²), and λ ≥ 0.05 here
        assert!((g.value(1e-10) / 1e-10 * lambda - 1.0).abs() < 1e-8);
    }

    #[test]
    fn val_every_bound_lies_between_x_and_one() {
        for lambda in [0.5, 0.7, 0.9, 0.95, 0.99, 1.0] {
            check_function(
                &Polynomial {
                    forgetting_factor: lambda,
                },
                lambda,
            );
            check_function(
                &Rational {
                    forgetting_factor: lambda,
                },
                lambda,
            );
        }
        check_function(
            &Rational {
                forgetting_factor: 0.05,
            },
            0.05,
        );
        // why λ < ½ is refused with (11): its maximum, at x = 1/(2(1 − λ)) < 1, exceeds 1
        assert!(Polynomial { forgetting_factor: 0.4 }.value(1.0 / 1.2) > 1.0);
    }

    fn check_matrix(g: &dyn CovarianceBound) {
        let n = 3;
        let floor = 0.01;
        let pi_inverse = [0.9, 0.2, -0.1, 0.2, 0.3, 0.05, -0.1, 0.05, 0.2];
        let mut closed = pi_inverse;
        let mut work = vec![0.0; n * n];
        assert!(g.information(n, floor, &mut closed, &mut Factor::new(n), &mut work));
        let mut eigen = Eigen::new(n);
        eigen.decompose(n, &pi_inverse);
        for i in 0..n {
            for j in 0..n {
                let spectral: f64 = (0..n)
                    .map(|k| {
                        let information = floor / g.value(floor / eigen.values[k]);
                        eigen.vectors[i * n + k] * information * eigen.vectors[j * n + k]
                    })
                    .sum();
                // rounding of numbers below 1, some ten operations each
                assert!((spectral - closed[i * n + j]).abs() < 1e-14, "{i} {j}");
            }
        }
    }

    #[test]
    fn val_closed_matrix_form_is_the_spectral_one() {
        for lambda in [0.5, 0.9, 0.99] {
            check_matrix(&Polynomial {
                forgetting_factor: lambda,
            });
            check_matrix(&Rational {
                forgetting_factor: lambda,
            });
        }
    }
}
