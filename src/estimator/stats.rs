//! Tail probabilities of the F and χ² distributions, for the tests on a block.
//!
//! ```text
//! P(F > x) = I_{d₂/(d₂ + d₁x)}(d₂/2, d₁/2)        I: regularised incomplete beta function
//! ```
//!
//! by Lentz's continued fraction (NIST Digital Library of Mathematical Functions, 8.17.22); χ² is
//! the limit of many d₂. No table of quantiles is used, because the degrees of freedom change with
//! every lost sample.

/// ln Γ(x) for x > 0, Lanczos's approximation (g = 7, nine terms), 15 digits.
fn ln_gamma(x: f64) -> f64 {
    const C: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let t = x + 7.5;
    let sum = C
        .iter()
        .enumerate()
        .skip(1)
        .fold(C[0], |s, (i, c)| s + c / (x + i as f64));
    0.5 * (2.0 * std::f64::consts::PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// Regularised incomplete beta function I_x(a, b).
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    // the continued fraction converges fast on this side
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (1.0 - x).ln()).exp() / a;
    let tiny = 1e-300;
    let guard = |v: f64| if v.abs() < tiny { tiny } else { v };
    let (mut c, mut d) = (1.0, 1.0 / guard(1.0 - (a + b) * x / (a + 1.0)));
    let mut h = d;
    for m in 1..500 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / guard(1.0 + even * d);
        c = guard(1.0 + even / c);
        h *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / guard(1.0 + odd * d);
        c = guard(1.0 + odd / c);
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-14 {
            break;
        }
    }
    (front * h).clamp(0.0, 1.0)
}

/// P(F > x) with d₁ and d₂ degrees of freedom, both positive.
pub fn f_tail(x: f64, d1: f64, d2: f64) -> f64 {
    if !(x > 0.0) {
        return 1.0;
    }
    incomplete_beta(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_tails_agree_with_closed_forms_and_tables() {
        // d₁ = 2: P = (1 + 2x/d₂)^(−d₂/2)
        for (x, d2) in [(0.5, 10.0f64), (3.0, 7.0), (12.0, 1895.0)] {
            let want = (1.0 + 2.0 * x / d2).powf(-d2 / 2.0);
            assert!((f_tail(x, 2.0, d2) / want - 1.0).abs() < 1e-9, "{x} {d2}");
        }
        // d₁ = d₂ = 1: P = 1 − (2/π) atan √x
        let want = 1.0 - 2.0 / std::f64::consts::PI * 2f64.sqrt().atan();
        assert!((f_tail(2.0, 1.0, 1.0) - want).abs() < 1e-12);
        // printed quantiles: F(5, 10) at 1 % is 5.636, F(4, 1000) at 5 % is 2.381
        assert!((f_tail(5.636, 5.0, 10.0) - 0.01).abs() < 1e-5);
        assert!((f_tail(2.381, 4.0, 1000.0) - 0.05).abs() < 1e-4);
        assert_eq!(f_tail(0.0, 3.0, 4.0), 1.0);
        assert!(f_tail(1e12, 5.0, 1890.0) < 1e-300);
    }
}
