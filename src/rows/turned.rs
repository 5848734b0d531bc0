//! Sine and cosine of an angle that changes little from sample to sample.
//!
//! ```text
//! sin(q + δ) = sin q cos δ + cos q sin δ        cos(q + δ) = cos q cos δ − sin q sin δ
//! ```
//!
//! with the series of sin δ and cos δ up to δ⁵. The library's functions took a tenth of the time of
//! a block.

/// The angle, its sine and its cosine.
#[derive(Debug, Default)]
pub(super) struct Turned {
    q: f64,
    sine: f64,
    cosine: f64,
    steps: usize,
}

impl Turned {
    /// Steps after which the library's functions remove accumulated rounding.
    const STEPS: usize = 64;
    /// Largest step \[rad\]: δ⁶/6! is 2e-11 there.
    const LARGEST: f64 = 0.05;

    #[inline]
    pub fn to(&mut self, q: f64) -> (f64, f64) {
        let step = q - self.q;
        self.q = q;
        if self.steps == 0 || !(step.abs() <= Self::LARGEST) {
            (self.sine, self.cosine) = q.sin_cos();
            self.steps = Self::STEPS;
        } else {
            let square = step * step;
            let sine = step * (1.0 - square / 6.0 * (1.0 - square / 20.0));
            let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0);
            (self.sine, self.cosine) = (
                self.sine * cosine + self.cosine * sine,
                self.cosine * cosine - self.sine * sine,
            );
            self.steps -= 1;
        }
        (self.sine, self.cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_an_angle_that_turns_has_the_sine_of_the_library() {
        let mut turned = Turned::default();
        // slow, fast, jumps and a wide swing; NaN does not affect later values
        for k in 0..4000 {
            let t = f64::from(k);
            let q = 3.0 * (2e-3 * t).sin() + 0.04 * t + if k > 1000 { 2.0 } else { 0.0 };
            let q = if k == 2000 { f64::NAN } else { q };
            let (sine, cosine) = turned.to(q);
            // 64 steps of δ⁶/6! at δ = 0.046
            let limit = 64.0 * 0.046_f64.powi(6) / 720.0;
            let off = (sine - q.sin()).abs().max((cosine - q.cos()).abs());
            assert!(off <= limit || q.is_nan(), "{k}: {off}");
        }
    }
}
