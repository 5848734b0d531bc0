//! A resonance between the joint and its position sensor, as from a soft coupling or a flexible
//! tip.
//!
//! ```text
//! y″ + 2 ζ ω y′ + ω² y = ω² q
//! ```
//!
//! q true position, y sensed position, ω = 2π f \[rad/s\], ζ damping ratio. The sensor does not act
//! on the machine, so θ is not affected.

use super::integrator::rk4_step;
use std::f64::consts::TAU;

/// The filter of one joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Resonance {
    omega: f64,
    damping: f64,
    state: Option<[f64; 2]>,
}

impl Resonance {
    pub fn new(frequency_hz: f64, damping: f64) -> Self {
        Self {
            omega: TAU * frequency_hz,
            damping,
            state: None,
        }
    }

    /// y, y′ and y″ now, from the true position; at rest there at first.
    pub fn output(&mut self, q: f64) -> [f64; 3] {
        let [y, dy] = *self.state.get_or_insert([q, 0.0]);
        [y, dy, self.acceleration(q, y, dy)]
    }

    fn acceleration(&self, q: f64, y: f64, dy: f64) -> f64 {
        self.omega * (self.omega * (q - y) - 2.0 * self.damping * dy)
    }

    /// Advances by `h` seconds, in which q and q̇ go from `from` to `to` along the cubic through
    /// both, whose error is O(h⁴).
    pub fn advance(&mut self, from: [f64; 2], to: [f64; 2], h: f64) {
        let Some(mut state) = self.state else { return };
        // 0.1 rad of the oscillation per step: local error 0.1⁵/120.
        let steps = (h * self.omega / 0.1).ceil().max(1.0);
        let step_s = h / steps;
        for step in 0..steps as usize {
            state = rk4_step(&state, step_s, |fraction, &[y, dy]| {
                let s = (step as f64 + fraction) / steps;
                let (s2, s3) = (s * s, s * s * s);
                let q = (2.0 * s3 - 3.0 * s2 + 1.0) * from[0]
                    + (s3 - 2.0 * s2 + s) * h * from[1]
                    + (3.0 * s2 - 2.0 * s3) * to[0]
                    + (s3 - s2) * h * to[1];
                [dy, self.acceleration(q, y, dy)]
            });
        }
        self.state = Some(state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_sine_comes_out_with_the_gain_and_phase_of_the_transfer_function() {
        let (frequency_hz, damping, h) = (40.0, 0.1, 0.001);
        for at_hz in [1.0, 13.0, 35.0] {
            let (w, w0) = (TAU * at_hz, TAU * frequency_hz);
            let q = |t: f64| [(w * t).sin(), w * (w * t).cos()];
            let mut resonance = Resonance::new(frequency_hz, damping);
            let _start = resonance.output(0.0);
            // H = ω₀²/(ω₀² − ω² + 2iζω₀ω)
            let (re, im) = (w0 * w0 - w * w, 2.0 * damping * w0 * w);
            let size = w0 * w0 / re.hypot(im);
            let phase = -im.atan2(re);
            for k in 0..2000 {
                let t = f64::from(k) * h;
                resonance.advance(q(t), q(t + h), h);
                // The initial transient decays as exp(−ζω₀t): 1e-9 after 0.83 s.
                if k > 1000 {
                    let expected = size * (w * (t + h) + phase).sin();
                    let [y, _, _] = resonance.output(q(t + h)[0]);
                    // The cubic's error is (ωh)⁴/384, twice as much at 35 Hz with a gain of 3.6.
                    let tolerance = 1e-8 + 3.6 * 2.0 * (w * h).powi(4) / 384.0;
                    assert!((y - expected).abs() < tolerance, "{at_hz} Hz: {y}, expected {expected}");
                }
            }
        }
    }
}
