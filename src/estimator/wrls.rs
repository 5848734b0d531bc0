//! Weighted recursive least squares, sample by sample, for models linear in θ.
//!
//! ```text
//! θ̂_n = θ̂_{n−1} + Γ_n φ_n (v_n − φ_nᵀ θ̂_{n−1})                      (3)
//! Γ_n⁻¹ = λ Γ_{n−1}⁻¹ + φ_n φ_nᵀ                                    (4)
//! ```
//!
//! minimises Σ λ^(n−i) (v_i − φ_iᵀθ)² + λⁿ (θ − θ̂₀)ᵀ Γ₀⁻¹ (θ − θ̂₀), which is (2) with its weight
//! corrected. `v` is the signal of (1), `φ` the regressor, `λ` the forgetting factor per sample, Γ
//! the covariance without the noise variance.
//!
//! The matrix inversion lemma makes (4) a rank-one update of Γ without inversion. Written out as P
//! ← (P − k (P x)ᵀ)/λ it loses symmetry: each step divides the skew part by λ, so that rounding
//! grows like λ⁻ⁿ. Here Γ = U D Uᵀ is kept as a unit upper triangular U and a diagonal D, updated
//! by Bierman's algorithm (Factorization Methods for Discrete Sequential Estimation, 1977, section
//! V): symmetric by construction, D stays positive because each of its steps multiplies by a
//! positive ratio, and no square roots. Potter's square root costs roots and n² more operations; an
//! information square root needs a back-substitution for every θ̂.

/// Why a [`Wrls`] cannot start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WrlsError {
    /// No parameters, or a start value that is not finite.
    #[error("theta_start: expected at least one value, all finite")]
    Start,
    /// λ outside (0, 1].
    #[error("forgetting_factor: expected a number in (0, 1], got {0}")]
    ForgettingFactor(f64),
    /// ε not positive and finite.
    #[error("information_floor: expected a finite number above 0, got {0}")]
    InformationFloor(f64),
}

/// The recursion (3), (4) in UD form.
#[derive(Debug, Clone)]
pub struct Wrls {
    theta: Vec<f64>,
    forgetting_factor: f64,
    // row-major, unit upper triangular; the diagonal is not read
    upper: Vec<f64>,
    diagonal: Vec<f64>,
    // without excitation D grows by 1/λ per sample; this limit stops it long before overflow
    limit: f64,
    f: Vec<f64>,
    gain: Vec<f64>,
}

impl Wrls {
    /// Largest growth of the covariance of an unexcited direction, relative to the initial one.
    pub const GROWTH_LIMIT: f64 = 1e20;

    /// Starts at `theta_start` with Γ₀ = I/ε, ε = `information_floor` > 0 and λ =
    /// `forgetting_factor` in (0, 1].
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn new(theta_start: &[f64], forgetting_factor: f64, information_floor: f64) -> Result<Self, WrlsError> {
        let n = theta_start.len();
        if n == 0 || theta_start.iter().any(|v| !v.is_finite()) {
            return Err(WrlsError::Start);
        }
        if !(forgetting_factor > 0.0 && forgetting_factor <= 1.0) {
            return Err(WrlsError::ForgettingFactor(forgetting_factor));
        }
        if !(information_floor > 0.0 && information_floor.is_finite()) {
            return Err(WrlsError::InformationFloor(information_floor));
        }
        Ok(Self {
            theta: theta_start.to_vec(),
            forgetting_factor,
            upper: vec![0.0; n * n],
            diagonal: vec![1.0 / information_floor; n],
            limit: Self::GROWTH_LIMIT / information_floor,
            f: vec![0.0; n],
            gain: vec![0.0; n],
        })
    }

    /// Takes one sample: φ (P numbers) and v. Returns the innovation v − φᵀθ̂ before the update.
    ///
    /// A sample that is not finite, or so large that the arithmetic overflows, is refused: `None`,
    /// and nothing changes.
    pub fn update(&mut self, regressor: &[f64], v: f64) -> Option<f64> {
        let n = self.theta.len();
        assert_eq!(regressor.len(), n, "one regressor entry per parameter");
        // (1) at θ̂: v − φᵀ θ̂
        let innovation = v - regressor.iter().zip(&self.theta).map(|(x, t)| x * t).sum::<f64>();
        for j in (0..n).rev() {
            let above: f64 = (0..j).map(|i| self.upper[i * n + j] * regressor[i]).sum();
            self.f[j] = regressor[j] + above; // f = Uᵀ φ
        }
        let total: f64 = self.f.iter().zip(&self.diagonal).map(|(f, d)| f * f * d).sum();
        if !(innovation.is_finite() && total.is_finite()) {
            return None;
        }
        let lambda = self.forgetting_factor;
        let mut alpha = lambda;
        for j in 0..n {
            let fj = self.f[j];
            let vj = self.diagonal[j] * fj;
            let next = alpha + fj * vj; // ends as λ + φᵀ Γ φ
            let p = -fj / alpha;
            self.diagonal[j] = (self.diagonal[j] * (alpha / next) / lambda).min(self.limit); // (4), by the inversion lemma
            for i in 0..j {
                let u = self.upper[i * n + j];
                self.upper[i * n + j] = u + self.gain[i] * p;
                self.gain[i] += u * vj;
            }
            self.gain[j] = vj;
            alpha = next;
        }
        for (theta, gain) in self.theta.iter_mut().zip(&self.gain) {
            *theta += gain / alpha * innovation; // (3)
        }
        Some(innovation)
    }

    /// θ̂.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// Writes Γ, P × P and row-major, without the noise variance.
    pub fn covariance(&self, out: &mut [f64]) {
        let n = self.theta.len();
        let u = |i: usize, k: usize| if i == k { 1.0 } else { self.upper[i * n + k] };
        for i in 0..n {
            for j in i..n {
                let v = (j..n).map(|k| u(i, k) * self.diagonal[k] * u(j, k)).sum();
                out[i * n + j] = v;
                out[j * n + i] = v;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::linalg::dot;
    use super::*;

    // A deterministic, persistently exciting regressor: four incommensurate tones and a constant,
    // as unequal in size as the arm's signals, sampled so that the hundred samples of memory at λ =
    // .99 see some periods of each.
    fn regressor(k: usize) -> [f64; 5] {
        let t = k as f64 * 0.05;
        [
            300.0 * (9.7 * t).sin(),
            80.0 * (5.3 * t + 0.4).cos(),
            10.0 * (2.1 * t).sin(),
            3.0 * (13.3 * t).cos(),
            1.0 + 0.5 * (3.9 * t).sin(),
        ]
    }
    const TRUTH: [f64; 5] = [0.0043, 0.026, 0.43, -2.6, 23.0];

    // v with a deterministic disturbance in ±0.01
    fn v(k: usize, x: &[f64; 5]) -> f64 {
        let noise = ((k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        dot(x, &TRUTH) + 0.02 * noise
    }

    /// The update as many texts print it, P ← (P − k (P x)ᵀ)/λ with k = P x/(λ + xᵀP x).
    struct Textbook {
        p: Vec<f64>,
        theta: [f64; 5],
    }
    impl Textbook {
        fn update(&mut self, x: &[f64; 5], v: f64, lambda: f64) {
            let px: Vec<f64> = self.p.chunks_exact(5).map(|row| dot(row, x)).collect();
            let s = lambda + dot(x, &px);
            let e = v - dot(x, &self.theta);
            for i in 0..5 {
                let k = px[i] / s;
                self.theta[i] += k * e;
                for j in 0..5 {
                    self.p[i * 5 + j] = (self.p[i * 5 + j] - k * px[j]) / lambda;
                }
            }
        }
    }

    #[test]
    fn val_one_update_is_equation_4() {
        let mut wrls = Wrls::new(&[0.0; 5], 0.9, 0.5).expect("valid");
        let mut information = [0.0; 25];
        (0..5).for_each(|i| information[i * 6] = 0.5);
        for k in 0..20 {
            let x = regressor(k * 37);
            wrls.update(&x, v(k, &x));
            for i in 0..5 {
                for j in 0..5 {
                    information[i * 5 + j] = 0.9 * information[i * 5 + j] + x[i] * x[j];
                }
            }
        }
        let mut covariance = [0.0; 25];
        wrls.covariance(&mut covariance);
        for i in 0..5 {
            for j in 0..5 {
                let unit: f64 = (0..5).map(|k| information[i * 5 + k] * covariance[k * 5 + j]).sum();
                let want = if i == j { 1.0 } else { 0.0 };
                // the entries of the product reach 1e6 × 1e0 before they cancel to 1 or 0
                assert!((unit - want).abs() < 1e-7, "{i} {j} {unit}");
            }
        }
    }

    #[test]
    fn prop_three_million_updates_at_lambda_099_stay_finite_and_right() {
        let mut wrls = Wrls::new(&[0.0; 5], 0.99, 1e-3).expect("valid");
        for k in 0..3_000_000 {
            let x = regressor(k);
            wrls.update(&x, v(k, &x)).expect("finite");
        }
        for (got, want) in wrls.theta().iter().zip(TRUTH) {
            // the disturbance, below 0.01, against signals of at least 1 that each parameter
            // multiplies
            assert!((got - want).abs() < 0.01, "{got} {want}");
        }
    }

    #[test]
    fn val_the_textbook_form_diverges_on_the_same_data() {
        let mut textbook = Textbook {
            p: (0..25).map(|i| if i % 6 == 0 { 1e3 } else { 0.0 }).collect(),
            theta: [0.0; 5],
        };
        let mut wrls = Wrls::new(&[0.0; 5], 0.99, 1e-3).expect("valid");
        let mut broken = None;
        for k in 0..20_000 {
            let x = regressor(k);
            textbook.update(&x, v(k, &x), 0.99);
            wrls.update(&x, v(k, &x));
            let apart = textbook
                .theta
                .iter()
                .zip(wrls.theta())
                .any(|(a, b)| !((a - b).abs() < 1.0));
            if k > 1000 && apart {
                broken = Some(k);
                break;
            }
        }
        let k = broken
            .expect("the skew part grows by 1/λ a sample from 2e-16 of P, so it passes P itself by 20 000 samples");
        println!("textbook form off by more than 1 after {k} samples");
        assert!(
            k > 2_000,
            "and it needs log(1e9)/log(1/λ), some 2 000 samples, to show at all"
        );
    }

    #[test]
    fn fault_no_excitation_and_bad_samples_leave_the_estimate_alone() {
        let mut wrls = Wrls::new(&[1.0, 2.0], 0.9, 1.0).expect("valid");
        for _ in 0..100_000 {
            wrls.update(&[0.0, 0.0], 0.0);
        }
        assert_eq!(wrls.update(&[f64::NAN, 0.0], 1.0), None);
        assert_eq!(wrls.update(&[1.0, 0.0], f64::INFINITY), None);
        assert_eq!(wrls.theta(), [1.0, 2.0]);
        wrls.update(&[1.0, 0.0], 5.0).expect("finite");
        // Γ is at its limit, so the one excited parameter takes the sample as it is
        assert!((wrls.theta()[0] - 5.0).abs() < 1e-12 && wrls.theta()[1] == 2.0);
    }
}
