//! A Butterworth low-pass filter, applied forwards and backwards: no delay, twice the attenuation.
//!
//! The analog prototype of order N has the poles p_k = e^{iπ(2k+N+1)/2N}; with the cut-off
//! prewarped, w = tan(π f/2), and s = (1 − z⁻¹)/(1 + z⁻¹),
//!
//! ```text
//! 1/(s²/w² + a s/w + 1),  a = −2 Re p_k:   b = w²/(1 + a w + w²) · (1, 2, 1)                   (1)
//! 1/(s/w + 1) for an odd order:            b = w/(1 + w) · (1, 1)                              (2)
//! ```
//!
//! Ends are continued by point reflection and each section starts at rest at the first value, as is
//! common.

/// One section b₀ + b₁ z⁻¹ + b₂ z⁻² over 1 + a₁ z⁻¹ + a₂ z⁻².
#[derive(Debug, Clone, Copy)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

/// A low pass of one order and cut-off.
#[derive(Debug, Clone)]
pub struct ZeroPhaseLowPass {
    sections: Vec<Section>,
    padding: usize,
}

impl ZeroPhaseLowPass {
    /// `cut_off` is a part of the Nyquist frequency, in (0, 1); `order` is at least 1. `None`
    /// outside.
    pub fn new(order: usize, cut_off: f64) -> Option<Self> {
        if order == 0 || !(cut_off > 0.0 && cut_off < 1.0) {
            return None;
        }
        let w = (std::f64::consts::FRAC_PI_2 * cut_off).tan();
        let mut sections: Vec<Section> = (0..order / 2)
            .map(|k| {
                let angle = std::f64::consts::PI * (2 * k + order + 1) as f64 / (2 * order) as f64;
                let a = -2.0 * angle.cos();
                let scale = 1.0 + a * w + w * w;
                let gain = w * w / scale; // (1)
                Section {
                    b: [gain, 2.0 * gain, gain],
                    a: [2.0 * (w * w - 1.0) / scale, (1.0 - a * w + w * w) / scale],
                }
            })
            .collect();
        if order % 2 == 1 {
            let gain = w / (1.0 + w); // (2)
            sections.push(Section {
                b: [gain, gain, 0.0],
                a: [(w - 1.0) / (1.0 + w), 0.0],
            });
        }
        // Several times the slowest section's memory.
        let padding = (10.0 / cut_off).ceil() as usize + 3 * order;
        Some(Self { sections, padding })
    }

    /// The filtered signal; equally spaced samples are assumed.
    pub fn apply(&self, signal: &[f64]) -> Vec<f64> {
        let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else {
            return Vec::new();
        };
        let pad = self.padding.min(signal.len() - 1);
        let mut x: Vec<f64> = (1..=pad).rev().map(|i| 2.0 * first - signal[i]).collect();
        x.extend_from_slice(signal);
        x.extend((1..=pad).map(|i| 2.0 * last - signal[signal.len() - 1 - i]));
        for _ in 0..2 {
            self.sections.iter().for_each(|section| section.run(&mut x));
            x.reverse();
        }
        x[pad..pad + signal.len()].to_vec()
    }
}

impl Section {
    /// Forwards, in transposed direct form II, from the steady state of the first value.
    fn run(&self, x: &mut [f64]) {
        let ([b0, b1, b2], [a1, a2]) = (self.b, self.a);
        // Gain 1 at rest: y = x, z₂ = b₂ x − a₂ y, z₁ = (1 − b₀) x.
        let start = x.first().copied().unwrap_or(0.0);
        let (mut z1, mut z2) = ((1.0 - b0) * start, (b2 - a2) * start);
        for value in x {
            let y = b0 * *value + z1;
            z1 = b1 * *value - a1 * y + z2;
            z2 = b2 * *value - a2 * y;
            *value = y;
        }
    }
}
