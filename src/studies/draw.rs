//! Random numbers of the distributions that machines are drawn from.

use crate::random::Random;

/// A sequence of them, from its seed.
pub(super) struct Draw(pub Random);

impl Draw {
    /// Evenly between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.uniform()
    }

    /// Evenly on a logarithmic scale.
    pub fn log(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// One of these.
    pub fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.0.uniform() * choices.len() as f64) as usize]
    }

    /// True in this share of the cases.
    #[cfg(feature = "robot")]
    pub fn chance(&mut self, share: f64) -> bool {
        self.0.uniform() < share
    }
}
