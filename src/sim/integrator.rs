//! The classic Runge-Kutta method of order 4 with a fixed step.

use std::array::from_fn;

/// One step of ẋ = f(s, x) from x(0) to x(h); `s` runs from 0 to 1 over the step.
///
/// The local error is O(h⁵), the global one O(h⁴), if f is smooth within the step: place jumps of f
/// between steps.
#[inline]
pub fn rk4_step<const N: usize>(x: &[f64; N], h: f64, mut f: impl FnMut(f64, &[f64; N]) -> [f64; N]) -> [f64; N] {
    let k1 = f(0.0, x);
    let k2 = f(0.5, &from_fn(|i| x[i] + 0.5 * h * k1[i]));
    let k3 = f(0.5, &from_fn(|i| x[i] + 0.5 * h * k2[i]));
    let k4 = f(1.0, &from_fn(|i| x[i] + h * k3[i]));
    from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}
