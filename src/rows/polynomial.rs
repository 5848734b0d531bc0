//! The polynomial that interpolates or fits a few samples at arbitrary instants, as weights on
//! them.
//!
//! ```text
//! x̂(s) = Σ_j w_j x(t_j), w_j = Σ_m p_m(s) p_m(t_j)/‖p_m‖²        p_{m+1}(t) = (t − a_m) p_m(t) − b_m p_{m−1}(t)
//! ```
//!
//! p_m are the polynomials that are orthogonal over the samples, from their three-term recurrence:
//! G. E. Forsythe, Generation and Use of Orthogonal Polynomials for Data-Fitting, J. SIAM 5, 1957.
//! With as many samples as coefficients it interpolates, with more it is the least squares fit.

/// Largest number of samples of a polynomial.
pub(super) const MOST: usize = 16;

/// Writes the weights of samples at the instants `nodes`, all different and at most [`MOST`], that
/// give the fitted polynomial of `degree` at `at`. The degree is reduced to what the samples
/// determine. For accuracy, use instants near 0, in sample periods.
pub(super) fn weights(nodes: &[f64], degree: usize, at: f64, w: &mut [f64; MOST]) {
    let n = nodes.len().min(MOST);
    let degree = degree.min(n.saturating_sub(1));
    w.fill(0.0);
    let (mut p, mut before) = ([1.0; MOST], [0.0; MOST]);
    let (mut p_at, mut before_at) = (1.0, 0.0);
    let mut norm_before = 1.0;
    for m in 0..=degree {
        let norm: f64 = p[..n].iter().map(|v| v * v).sum();
        if !(norm > 0.0) {
            return;
        }
        for j in 0..n {
            w[j] += p_at * p[j] / norm;
        }
        let a = (0..n).map(|j| nodes[j] * p[j] * p[j]).sum::<f64>() / norm;
        let b = if m == 0 { 0.0 } else { norm / norm_before };
        for j in 0..n {
            (p[j], before[j]) = ((nodes[j] - a) * p[j] - b * before[j], p[j]);
        }
        (p_at, before_at) = ((at - a) * p_at - b * before_at, p_at);
        norm_before = norm;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_polynomials_come_out_exactly_at_irregular_instants() {
        let nodes = [-5.0, -3.9, -3.0, -1.1, -0.4, 1.0, 2.0, 3.3, 4.1, 5.6];
        for degree in 0..=5 {
            for at in [-0.7, 0.0, 0.31, 4.9] {
                let mut w = [0.0; MOST];
                weights(&nodes, degree, at, &mut w);
                for m in 0..=degree as i32 {
                    let got: f64 = nodes.iter().zip(&w).map(|(t, w)| w * t.powi(m)).sum();
                    // powers up to 5.6⁵, rounded a few dozen times
                    assert!((got - at.powi(m)).abs() < 1e-10, "{degree} {at} {m}: {got}");
                }
            }
        }
    }

    #[test]
    fn prop_a_polynomial_through_its_samples_gives_them_back() {
        let nodes = [-2.0, -1.0, 0.4, 1.0, 2.2, 3.0];
        for (k, at) in nodes.into_iter().enumerate() {
            let mut w = [0.0; MOST];
            weights(&nodes, 5, at, &mut w);
            for j in 0..nodes.len() {
                assert!((w[j] - f64::from(u8::from(j == k))).abs() < 1e-11);
            }
        }
    }
}
