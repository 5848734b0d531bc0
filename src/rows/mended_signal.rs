//! A signal whose lost and wrong samples are replaced from their neighbours.
//!
//! **Lost samples.** Positions come from the polynomial of degree 5 nearest to five samples on
//! either side; inputs from one of degree 3 if the input is smooth there, else from the straight
//! line across the hole.
//!
//! # Weights
//! A replaced sample x̂_k = Σ w_kj x_j carries the noise of its neighbours a second time. A row
//! weights neighbours nearly equally, c_j ≈ c, so n replaced samples in a row add Σ_j (1 + W_j)² −
//! 1, W_j = Σ_k w_kj, to the sum of squares: 2 n + Σ W_j² instead of n. The error of the polynomial
//! is added; it is estimated by its distance to the polynomial of a lower degree. Errors within a
//! hole have one sign and add up, so the variance of each counts n times.

use super::neighbours::{Neighbours, SIDE};
use super::polynomial::MOST;
use std::ops::Range;

/// Quality of a signal's samples, per buffer position.
#[derive(Debug, Clone)]
pub(super) struct MendedSignal {
    /// True for a sample that was lost or wrong and has been replaced.
    pub bad: Vec<bool>,
    /// Factor on the noise variance of a sample.
    pub factor: Vec<f64>,
    /// Variance added to that.
    pub extra: Vec<f64>,
}

impl MendedSignal {
    /// An unmodified signal, in buffers of `capacity`.
    pub fn new(capacity: usize) -> Self {
        Self {
            bad: vec![false; capacity],
            factor: vec![1.0; capacity],
            extra: vec![0.0; capacity],
        }
    }

    /// Makes `from..len` the first samples; true if any of them has been replaced.
    pub fn keep(&mut self, from: usize, len: usize) -> bool {
        let kept = len - from;
        self.bad.copy_within(from..len, 0);
        self.factor.copy_within(from..len, 0);
        self.extra.copy_within(from..len, 0);
        self.bad[kept..].fill(false);
        self.factor[kept..].fill(1.0);
        self.extra[kept..].fill(0.0);
        (0..kept).any(|k| self.bad[k] || self.factor[k] != 1.0 || self.extra[k] != 0.0)
    }

    /// Variance of a sample whose noise has the variance `own`.
    pub fn variance(&self, at: usize, own: f64) -> f64 {
        own * self.factor[at] + self.extra[at]
    }

    /// Start of the run of bad samples that contains `at`, within the stretch; `at` itself if it is
    /// good.
    pub fn begin_of_run(&self, mut at: usize, stretch: &Range<usize>) -> usize {
        while at > stretch.start && at < stretch.end && self.bad[at] && self.bad[at - 1] {
            at -= 1;
        }
        at
    }

    /// The first run of bad samples in a range.
    pub fn first_run(&self, range: Range<usize>) -> Option<Range<usize>> {
        let first = range.clone().find(|&k| self.bad[k])?;
        let end = (first..range.end).find(|&k| !self.bad[k]).unwrap_or(range.end);
        Some(first..end)
    }

    /// Replaces the positions of a run by the polynomial of their neighbours.
    pub fn bridge_position(&mut self, x: &mut [f64], stretch: &Range<usize>, run: Range<usize>) {
        let around = Neighbours::new(x, |k| !self.bad[k], stretch, &run, (SIDE, SIDE));
        if around.count == 0 {
            return;
        }
        let degree = around.degree(5);
        let missed = self.bridge(x, &run, &around, degree, degree.saturating_sub(2));
        let n = run.len() as f64;
        self.extra[run].fill(n * missed * missed);
    }

    /// Replaces a run by the polynomial of `degree`, and sets the factors of its samples. Returns
    /// the largest distance to the polynomial of the degree `lower`.
    fn bridge(&mut self, x: &mut [f64], run: &Range<usize>, around: &Neighbours, degree: usize, lower: usize) -> f64 {
        let n = run.len() as f64;
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        let (mut w, mut total, mut missed) = ([0.0; MOST], [0.0; MOST], 0.0f64);
        for k in run.clone() {
            let other = around.at(lower, k as f64 - origin, &mut w);
            x[k] = around.at(degree, k as f64 - origin, &mut w);
            total.iter_mut().zip(&w).for_each(|(sum, w)| *sum += w);
            missed = missed.max((x[k] - other).abs());
        }
        let squares: f64 = total.iter().map(|w| w * w).sum();
        self.factor[run.clone()].fill(2.0 + squares / n);
        missed
    }

    /// Replaces the inputs of a run: by a polynomial if the neighbours lie on one, else by the
    /// straight line across.
    pub fn bridge_input(&mut self, x: &mut [f64], stretch: &Range<usize>, run: Range<usize>, std: f64) {
        let around = Neighbours::new(x, |k| !self.bad[k], stretch, &run, (SIDE, SIDE));
        if around.count == 0 {
            return;
        }
        let n = run.len() as f64;
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        let degree = around.degree(3);
        let mut w = [0.0; MOST];
        let mut sum = 0.0;
        for k in 0..around.count {
            sum += (around.values[k] - around.at(degree, around.nodes[k], &mut w)).powi(2);
        }
        let misfit = (sum / around.count.saturating_sub(degree + 1).max(1) as f64).sqrt();
        let whole = around.left >= 3 && around.right() >= 3;
        if whole && misfit <= 3.0 * std {
            let missed = self.bridge(x, &run, &around, degree, 1);
            // a fifth: the cubic removes most of the line's error
            self.extra[run].fill(n * (0.2 * missed).powi(2));
            return;
        }
        // the nearest neighbour on either side
        let (left, right) = (0, around.left);
        if around.left == 0 || around.right() == 0 {
            // neighbours on one side only: the value of the nearest
            let value = around.values[0];
            for k in run {
                x[k] = value;
                self.factor[k] = 2.0 + n;
                self.extra[k] = n * misfit * misfit;
            }
            return;
        }
        // a held input may have jumped anywhere in the hole with equal probability, so the line is
        // the best estimate
        let (a, b) = (around.values[left], around.values[right]);
        let (t_a, t_b) = (around.nodes[left], around.nodes[right]);
        // change of the input from sample to sample without jumps
        let step = |k: usize, other: usize| (around.values[k] - around.values[other]).abs();
        let quiet = match (around.left > 1, around.right() > 1) {
            (true, true) => step(left, left + 1).min(step(right, right + 1)),
            _ => misfit,
        };
        for k in run {
            let share = (k as f64 - origin - t_a) / (t_b - t_a);
            x[k] = a + share * (b - a);
            self.factor[k] = 2.0 + n;
            self.extra[k] = n * (share * (1.0 - share) * (b - a).powi(2) + quiet * quiet);
        }
    }
}
