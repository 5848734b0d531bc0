//! The good samples around a hole, and the polynomial fitted to them.

use super::polynomial::{MOST, weights};
use std::ops::Range;

/// Neighbours on either side from which a sample is replaced.
pub(super) const SIDE: usize = 5;
/// Their largest distance in samples.
pub(super) const FAR: usize = 12;

/// Instants relative to the middle of a hole, and values, of the good samples around it; nearest
/// first, those on the left before those on the right.
pub(super) struct Neighbours {
    pub nodes: [f64; MOST],
    pub values: [f64; MOST],
    pub count: usize,
    /// Number of those on the left.
    pub left: usize,
}

impl Neighbours {
    /// The good samples around `run`, within the stretch: at most `sides` on the left and right.
    pub fn new(
        x: &[f64],
        good: impl Fn(usize) -> bool,
        stretch: &Range<usize>,
        run: &Range<usize>,
        sides: (usize, usize),
    ) -> Self {
        let mut around = Self {
            nodes: [0.0; MOST],
            values: [0.0; MOST],
            count: 0,
            left: 0,
        };
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        let before = (run.start.saturating_sub(FAR).max(stretch.start)..run.start).rev();
        let behind = run.end..(run.end + FAR).min(stretch.end);
        for k in before.filter(|&k| good(k)).take(sides.0) {
            around.push(k as f64 - origin, x[k]);
        }
        around.left = around.count;
        for k in behind.filter(|&k| good(k)).take(sides.1) {
            around.push(k as f64 - origin, x[k]);
        }
        around
    }

    fn push(&mut self, node: f64, value: f64) {
        (self.nodes[self.count], self.values[self.count]) = (node, value);
        self.count += 1;
    }

    /// Number of those on the right.
    pub fn right(&self) -> usize {
        self.count - self.left
    }

    /// The fitted polynomial at an instant; writes its weights to `w`.
    pub fn at(&self, degree: usize, instant: f64, w: &mut [f64; MOST]) -> f64 {
        weights(&self.nodes[..self.count], degree, instant, w);
        self.values[..self.count].iter().zip(w.iter()).map(|(x, w)| x * w).sum()
    }

    /// Largest distance of the samples themselves from the polynomial.
    pub fn misfit(&self, degree: usize) -> f64 {
        let mut w = [0.0; MOST];
        (0..self.count)
            .map(|k| (self.values[k] - self.at(degree, self.nodes[k], &mut w)).abs())
            .fold(0.0, f64::max)
    }

    /// Largest degree, at most `most`, that both sides determine without extrapolating from one.
    pub fn degree(&self, most: usize) -> usize {
        match self.left.min(self.right()) {
            0 => usize::from(self.count > 1),
            fewer => (2 * fewer - 1).min(most),
        }
    }
}
