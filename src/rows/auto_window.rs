//! Projected rows whose window length is chosen from the signals and reviewed regularly.
//!
//! ```text
//! T_c = T₀, T₀/2, T₀/4, … ≥ max(25 ms, 20 h), ≤ 2000 h    T₀ = 200 ms, or 160 h if 20 h is more than that
//! T   = the T_c that is nearest to 1.3/f_b by its ratio, f_b the bandwidth of the fastest joint (`advice.rs`)
//! ```
//!
//! A block of rows for each length is allocated at the start; one of them is in use. The first
//! block of samples that shows motion chooses the length, before any estimate is made from it.
//! After that every joint is checked once in [`REVIEW`] blocks, and a length that two reviews in a
//! row advise takes over at the border of a block. Its first windows begin there, because rows of
//! different lengths cannot be mixed. With a single length this is simply that block of rows.
//!
//! Strides are min(T_c/5, the configured one). 20 samples in a window resolve its bump; windows
//! longer than 200 ms hardly add information if the stride is short (docs/method.md, section 16a).
//! A machine that is sampled at less than 100 Hz is slow, and so is its motion: windows, strides
//! and the velocity filter then grow with it. A short filter leaves noise σ in the velocity v,
//! which a term v³ shows as v³ + 3 σ² v on average, whatever the number of samples.

use super::advice::{FEWEST_WINDOW_SAMPLES, Spectrum};
use super::projected::{ProjectedBlock, ProjectedError, ProjectedOptions};
use super::suspect::Suspect;
use super::{FirstBlocks, SampleBlock};
use crate::estimator::{Residuals, SuspectRows};
use crate::model::{JointSample, MAX_JOINTS, Plant, SharedPlant};
use std::sync::Arc;

/// Longest and shortest window \[s\], if the sample period permits.
const LONGEST_S: f64 = 0.2;
const SHORTEST_S: f64 = 0.025;
/// The most samples in a window.
const MOST_WINDOW_SAMPLES: f64 = 2000.0;
/// The longest length over the shortest, if 20 samples are longer than [`LONGEST_S`].
const LONGER: f64 = 8.0;
/// Least half width of the velocity filter there, a quarter of 20 samples: a time such as 8 ms is
/// less than a sample.
const SLOW_HALF_WIDTH: usize = 5;
/// Initial length, until something moves \[s\].
const FIRST_S: f64 = 0.1;
/// Blocks from one review to the next.
const REVIEW: u32 = 8;
/// Largest number of samples for the bandwidth: some seconds suffice, and more cost time.
const LOOK: usize = 2048;

/// Projected rows with a fixed window length, or with one chosen to fit the motion.
#[derive(Debug, Clone)]
pub struct AutoWindowBlock {
    /// One per length, the longest first.
    blocks: Vec<ProjectedBlock>,
    active: usize,
    /// Samples of the open block, until the first choice; none with one length.
    kept: Vec<(u64, JointSample)>,
    chosen: bool,
    spectrum: Spectrum,
    /// Blocks since the last review, and the highest bandwidth of the joints checked since \[Hz\].
    since: u32,
    fastest_hz: f64,
    /// The length that the last review advised.
    advised: usize,
    /// The length in use from the next border on.
    next: usize,
}

impl ProjectedOptions {
    /// The same options for another window length, with stride and velocity filter limited to suit
    /// it. If 20 samples are longer than 200 ms, both are those of a window of 20 samples, and grow
    /// with the window.
    #[must_use]
    pub fn with_window(&self, window_s: f64) -> Self {
        let period_s = self.sample_period_s;
        let quarter = (0.25 * window_s / period_s) as usize;
        let shortest_s = FEWEST_WINDOW_SAMPLES * period_s;
        let (times, least) = match shortest_s > LONGEST_S {
            true => ((window_s / shortest_s).max(1.0), SLOW_HALF_WIDTH),
            false => (1.0, 0),
        };
        let half_width = times * self.velocity_half_width.max(least) as f64;
        Self {
            window_s,
            stride_s: (times * self.stride_s.max(period_s)).min(0.2 * window_s).max(period_s),
            velocity_half_width: (half_width.round() as usize).min(quarter.max(3)),
            ..*self
        }
    }
}

/// The lengths from which [`AutoWindowBlock::chosen`] chooses at a sample period \[s\], longest
/// first; at least one.
pub fn auto_window_lengths(sample_period_s: f64) -> impl Iterator<Item = f64> {
    let fewest = FEWEST_WINDOW_SAMPLES * sample_period_s;
    let wanted = if fewest > LONGEST_S { LONGER * fewest } else { LONGEST_S };
    let halvings = (wanted / (MOST_WINDOW_SAMPLES * sample_period_s) - 1e-9).log2().ceil();
    let longest = wanted * (-halvings.max(0.0)).exp2();
    let shortest = SHORTEST_S.max(fewest).min(longest);
    std::iter::successors(Some(longest), |length| Some(0.5 * length))
        .take_while(move |length| *length >= shortest * (1.0 - 1e-9))
}

/// The length that [`AutoWindowBlock::chosen`] begins with, until something moves \[s\].
pub fn auto_window_first(sample_period_s: f64) -> f64 {
    let distance = |length: &f64| (length / FIRST_S).ln().abs();
    let first = auto_window_lengths(sample_period_s).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    first.unwrap_or(FIRST_S)
}

impl AutoWindowBlock {
    /// Rows with the window, stride and velocity filter of `options`.
    ///
    /// # Errors
    /// As [`ProjectedBlock::new`].
    pub fn fixed(
        plant: impl Plant + Send + Sync + 'static,
        options: ProjectedOptions,
        block_len: usize,
    ) -> Result<Self, ProjectedError> {
        let block = ProjectedBlock::new(plant, options, block_len)?;
        Ok(Self {
            blocks: vec![block],
            active: 0,
            kept: Vec::new(),
            chosen: true,
            spectrum: Spectrum::new(0),
            since: 0,
            fastest_hz: 0.0,
            advised: 0,
            next: 0,
        })
    }

    /// Rows whose window is chosen. `options.window_s` is ignored; stride and velocity filter of
    /// the options are upper limits. Only this call allocates.
    ///
    /// # Errors
    /// As [`ProjectedBlock::new`].
    pub fn chosen(
        plant: impl Plant + Send + Sync + 'static,
        options: ProjectedOptions,
        block_len: usize,
    ) -> Result<Self, ProjectedError> {
        let plant: SharedPlant = Arc::new(plant);
        let period_s = options.sample_period_s;
        let blocks = auto_window_lengths(period_s)
            .map(|window_s| ProjectedBlock::shared(plant.clone(), options.with_window(window_s), block_len))
            .collect::<Result<Vec<_>, _>>()?;
        let first = nearest(&blocks, FIRST_S);
        Ok(Self {
            blocks,
            active: first,
            kept: Vec::with_capacity(FirstBlocks::room(block_len)),
            chosen: false,
            spectrum: Spectrum::new(LOOK),
            since: 0,
            fastest_hz: 0.0,
            advised: first,
            next: first,
        })
    }

    /// The same with these start values, instead of the plant's, for the weights of the first
    /// block.
    ///
    /// # Errors
    /// If there is not exactly one finite value within its bounds per parameter.
    pub fn starting_at(mut self, theta: &[f64]) -> Result<Self, ProjectedError> {
        self.blocks = self
            .blocks
            .into_iter()
            .map(|block| block.starting_at(theta))
            .collect::<Result<_, _>>()?;
        Ok(self)
    }

    fn own(&self) -> &ProjectedBlock {
        &self.blocks[self.active]
    }

    /// Computes the bandwidth of `joint` from the prepared block.
    fn look(&mut self, joint: usize) {
        let block = &self.blocks[self.active];
        let (q, variance) = block.positions(joint);
        if let Some(advice) = self.spectrum.advise(q, block.options().sample_period_s, variance) {
            self.fastest_hz = self.fastest_hz.max(advice.bandwidth_hz);
        }
    }

    /// The length for the motion since the last call; the one in use if there was no motion.
    fn advice(&mut self) -> usize {
        let fastest_hz = std::mem::take(&mut self.fastest_hz);
        match fastest_hz > 0.0 {
            true => nearest(&self.blocks, 1.3 / fastest_hz),
            false => self.active,
        }
    }

    /// The first choice: makes the samples of the open block into rows of the length that they
    /// advise.
    fn choose(&mut self, theta: &[f64]) {
        for joint in 0..self.own().plant().joints().min(MAX_JOINTS) {
            self.look(joint);
        }
        if self.fastest_hz > 0.0 {
            self.chosen = true;
            let best = self.advice();
            if best != self.active {
                (self.active, self.advised, self.next) = (best, best, best);
                let block = &mut self.blocks[best];
                for (t_ns, sample) in &self.kept {
                    // all blocks have the same capacity
                    let _ = block.push(*t_ns, sample);
                }
                block.prepare(theta);
            }
        }
        self.kept.clear();
    }

    /// Checks one joint per block; after the last one, decides which length takes over.
    fn review(&mut self) {
        let joints = self.own().plant().joints() as u32;
        self.since += 1;
        let turn = self.since.saturating_sub(REVIEW.saturating_sub(joints));
        if turn >= 1 {
            self.look((turn - 1) as usize);
        }
        if turn >= joints {
            self.since = 0;
            let advised = self.advice();
            // a single review may have seen unusual motion
            self.next = if advised == self.advised { advised } else { self.active };
            self.advised = advised;
        }
    }
}

/// The block whose window has the smallest ratio to a length.
fn nearest(blocks: &[ProjectedBlock], window_s: f64) -> usize {
    let distance = |block: &ProjectedBlock| (block.options().window_s / window_s).ln().abs();
    let better = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
    let all = blocks.iter().map(distance).enumerate();
    all.min_by(better).map_or(0, |(index, _)| index)
}

impl Residuals for AutoWindowBlock {
    fn len(&self) -> usize {
        self.own().len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.own().row(equation, index, theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        self.own().span(index)
    }

    fn is_used(&self, equation: usize, index: usize) -> bool {
        self.own().is_used(equation, index)
    }

    fn tail(&self, equation: usize, k: usize, theta: &[f64]) -> Option<f64> {
        self.own().tail(equation, k, theta)
    }

    fn products(&self) -> &[(usize, usize)] {
        self.own().products()
    }

    fn sensor_variance(&self, equation: usize) -> Option<f64> {
        self.own().sensor_variance(equation)
    }

    fn suspect_rows(&self) -> &dyn SuspectRows {
        self.own().suspect_rows()
    }

    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.own().row_forward(equation, index, theta, regressor)
    }

    fn start(&self) -> Option<&[f64]> {
        self.own().start()
    }
}

impl SampleBlock for AutoWindowBlock {
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        if !self.chosen && self.kept.len() < self.kept.capacity() {
            self.kept.push((t_ns, *sample));
        }
        self.blocks[self.active].push(t_ns, sample)
    }

    fn prepare(&mut self, theta: &[f64]) {
        self.blocks[self.active].prepare(theta);
        if !self.chosen {
            self.choose(theta);
        } else if self.blocks.len() > 1 {
            self.review();
        }
    }

    fn enable_scale_columns(&mut self, enabled: bool) {
        self.blocks[self.active].enable_scale_columns(enabled);
    }

    fn replaced(&self) -> u32 {
        self.own().replaced()
    }

    fn suspect(&self, index: usize) -> Option<Suspect<'_>> {
        self.own().suspect(index)
    }

    fn window_s(&self) -> Option<f64> {
        Some(self.own().options().window_s)
    }

    fn clear(&mut self) {
        self.kept.clear();
        if self.next == self.active {
            self.blocks[self.active].clear();
            return;
        }
        // the old block drops its samples before the new one takes its first
        let (from, to) = (self.active, self.next);
        let [old, new] = match self.blocks.get_disjoint_mut([from, to]) {
            Ok(pair) => pair,
            Err(_) => return,
        };
        new.reset();
        new.take_over(old);
        old.reset();
        self.active = to;
    }

    fn reset(&mut self) {
        self.kept.clear();
        (self.since, self.fastest_hz) = (0, 0.0);
        self.next = self.active;
        self.blocks[self.active].reset();
    }

    fn forget_theta(&mut self) {
        self.blocks.iter_mut().for_each(ProjectedBlock::forget_theta);
    }

    fn first_blocks(&self) -> FirstBlocks {
        self.own().first_blocks()
    }

    fn know_theta(&mut self) {
        self.blocks.iter_mut().for_each(ProjectedBlock::know_theta);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_lengths_resolve_their_bump_at_every_sample_rate() {
        for (period_s, expected) in [
            (1e-5, &[0.0125][..]),
            (5e-5, &[0.1, 0.05, 0.025]),
            (1e-4, &[0.2, 0.1, 0.05, 0.025]),
            (0.5e-3, &[0.2, 0.1, 0.05, 0.025]),
            (1e-3, &[0.2, 0.1, 0.05, 0.025]),
            (2e-3, &[0.2, 0.1, 0.05]),
            (0.01, &[0.2]),
            (0.02, &[3.2, 1.6, 0.8, 0.4]),
            (0.1, &[16.0, 8.0, 4.0, 2.0]),
        ] {
            assert_eq!(
                auto_window_lengths(period_s).collect::<Vec<_>>(),
                expected,
                "{period_s}"
            );
            for window_s in auto_window_lengths(period_s) {
                let options = ProjectedOptions {
                    sample_period_s: period_s,
                    velocity_half_width: 10,
                    ..ProjectedOptions::recommended()
                };
                let own = options.with_window(window_s);
                own.validate().unwrap();
                assert!(own.window_s / period_s > FEWEST_WINDOW_SAMPLES - 1e-6);
                if period_s > 0.01 {
                    assert_eq!(own.velocity_half_width, (0.25 * window_s / period_s).round() as usize);
                }
                let most = 0.02_f64.max(0.05 * window_s);
                assert!(own.stride_s <= most + 1e-12, "{period_s} {window_s}: {}", own.stride_s);
            }
        }
    }
}
