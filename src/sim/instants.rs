//! The instants of samples: on a grid, or irregular around it.

use super::noise::Noise;
use super::options::SimOptions;

/// Offset of each sample from its place k Δ on the grid, k = 0, 1, 2, …; time stamps show the same
/// offsets.
#[derive(Debug, Clone)]
pub struct SampleInstants {
    std_s: f64,
    limit_s: f64,
    k: u64,
    noise: Noise,
}

impl SampleInstants {
    /// The instants of a run; two instances agree.
    pub fn new(options: &SimOptions) -> Self {
        Self {
            std_s: options.sensors.stamp_jitter_s,
            // Limited, so that samples do not come close to each other or swap.
            limit_s: 0.4 * options.sample_period_s,
            k: 0,
            noise: Noise::new(options.seed, Noise::INSTANTS),
        }
    }

    /// Offset of the next sample \[ns\]; 0 for the first one, and for all without jitter.
    pub fn next_offset_ns(&mut self) -> i64 {
        let first = self.k == 0;
        self.k += 1;
        if first || self.std_s == 0.0 {
            return 0;
        }
        let offset_s = (self.std_s * self.noise.normal()).clamp(-self.limit_s, self.limit_s);
        (offset_s * 1e9).round() as i64
    }
}
