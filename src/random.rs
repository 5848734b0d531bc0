//! SplitMix64: the same sequence on every machine and in every version.

/// 2⁶⁴ over the golden ratio: the step from one state to the next.
pub(crate) const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Makes a random number of a state.
pub(crate) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A sequence of random numbers, from its seed.
#[derive(Debug, Clone)]
pub(crate) struct Random(pub u64);

impl Random {
    /// Uniform in [0, 1): 53 bits.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        (mix(self.0) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [−limit, limit).
    #[cfg(feature = "robot")]
    pub fn within(&mut self, limit: f64) -> f64 {
        limit * (2.0 * self.uniform() - 1.0)
    }

    /// Standard normal by the Box-Muller transform.
    #[cfg(feature = "robot")]
    pub fn normal(&mut self) -> f64 {
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_sequence_is_that_of_the_published_generator() {
        // G. Steele, D. Lea, C. Flood, OOPSLA 2014, from the seed 0
        let first = 0xe220_a839_7b1d_cdaf_u64;
        assert_eq!(mix(GOLDEN), first);
        assert_eq!(Random(0).uniform(), (first >> 11) as f64 * (-53f64).exp2());
    }
}
