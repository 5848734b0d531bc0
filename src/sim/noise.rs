//! Seeded random numbers whose bytes never change.
//!
//! ChaCha is fully specified; the conversion of its words to numbers is written here, so no release
//! of another crate can change a recorded experiment.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::f64::consts::TAU;

/// One stream of random numbers.
#[derive(Debug, Clone)]
pub(super) struct Noise(ChaCha8Rng);

impl Noise {
    /// Stream of the noise on the measured input.
    pub const INPUT: u64 = 0x100;
    /// Stream of the spikes on the measured input.
    pub const SPIKES: u64 = 0x101;
    /// Stream of the noise on measured positions.
    pub const POSITION: u64 = 0x102;
    /// Stream of the sampling jitter.
    pub const JITTER: u64 = 0x103;
    /// Stream of lost samples.
    pub const LOSSES: u64 = 0x104;
    /// Stream of the spikes on measured positions.
    pub const POSITION_SPIKES: u64 = 0x105;
    /// Stream of irregular sample instants.
    pub const INSTANTS: u64 = 0x106;
    /// Stream of the first fault; each has its own.
    pub const FAULTS: u64 = 0x1000;

    /// Stream of the setpoint of a joint.
    pub fn setpoint_stream(joint: usize) -> u64 {
        joint as u64
    }

    /// Streams of one seed are independent of each other.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Uniform in [0, 1): 53 bits of one word.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (-53f64).exp2()
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Standard normal by the Box-Muller transform, two words each.
    pub fn normal(&mut self) -> f64 {
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }
}
