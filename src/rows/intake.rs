//! Converts incoming samples to samples on a uniform grid.
//!
//! Windows are sums over samples one period h apart. A stream with exactly such time stamps passes
//! unchanged, bit for bit. Otherwise (a log at 10 and 12 ms, a driver that reads when it is
//! scheduled) the signals are taken as valid at their stamps, and grid values are computed from
//! them:
//!
//! - **positions** from the polynomial of degree 5 through the six nearest samples, three on either
//!   side;
//! - **a held input** as its mean over the grid's cell, which is exactly what a window's weights
//!   need;
//! - **a continuous input** on the straight line between its neighbours.
//!
//! Samples a distance s h apart carry the information of 1/s samples per grid value, so the
//! variance of a grid value is multiplied by s. A row averages over many of them, so the
//! correlation of neighbours cancels.
//!
//! # Holes
//! Up to [`BRIDGED`] lost samples in a row are bridged: here only by a straight line; `repair.rs`
//! refines this once the samples after the hole have arrived. A longer hole, or time that goes
//! back, begins a new stretch that no window crosses.

use super::kernel::InputTiming;
use super::polynomial::{MOST, weights};
use crate::model::{JointSample, MAX_JOINTS};

/// Largest number of lost samples in a row that is bridged.
pub(super) const BRIDGED: usize = 5;
/// Deviation of a stamp from the grid that counts as rounding or as clock rate: this share of a
/// period plus a few nanoseconds.
const RATE: f64 = 2e-5;
const ROUNDING_NS: f64 = 2.0;
/// Samples from which a grid value is computed.
const STENCIL: usize = 6;
/// Samples kept, and size of the buffer: they are moved to the front from time to time.
const KEPT: usize = 12;
const ROOM: usize = 4 * KEPT;

/// An incoming sample, at `x` periods on the grid.
#[derive(Debug, Clone, Copy)]
struct Raw {
    x: f64,
    t_ns: u64,
    q: [f64; MAX_JOINTS],
    u: [f64; MAX_JOINTS],
}

/// A sample on the grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct GridSample {
    pub number: i64,
    pub t_ns: u64,
    pub q: [f64; MAX_JOINTS],
    pub u: [f64; MAX_JOINTS],
    /// It is the first of an uninterrupted stretch.
    pub first: bool,
    /// It was lost and has been interpolated.
    pub lost: bool,
    /// Factor on the variance of its noise.
    pub gain: f64,
}

/// Converts samples to the grid, see the head of this file.
#[derive(Debug, Clone)]
pub(super) struct Intake {
    period_ns: f64,
    timing: InputTiming,
    joints: usize,
    /// The first `len` are in use; the last [`KEPT`] of these are needed.
    raw: [Raw; ROOM],
    len: usize,
    /// The next grid number to be returned.
    next: i64,
    first: bool,
}

impl Intake {
    pub fn new(period_s: f64, timing: InputTiming, joints: usize) -> Self {
        let raw = Raw {
            x: 0.0,
            t_ns: 0,
            q: [0.0; MAX_JOINTS],
            u: [0.0; MAX_JOINTS],
        };
        Self {
            period_ns: period_s * 1e9,
            timing,
            joints,
            raw: [raw; ROOM],
            len: 0,
            next: 0,
            first: true,
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.len = 0;
    }

    /// Takes a sample. Returns the correction of the input of the last grid value returned, now
    /// that the time of the input's change is known.
    pub fn take(&mut self, t_ns: u64, sample: &JointSample) -> Option<[f64; MAX_JOINTS]> {
        let mut new = Raw {
            x: 0.0,
            t_ns,
            q: sample.q,
            u: sample.input,
        };
        let last = self.len.checked_sub(1).map(|at| (self.raw[at].x, self.raw[at].t_ns));
        let Some((last_x, last_ns)) = last else {
            self.begin(new, (t_ns as f64 / self.period_ns).round() as i64);
            return None;
        };
        let periods = (t_ns as f64 - last_ns as f64) / self.period_ns;
        if !(periods > 0.0 && periods < BRIDGED as f64 + 1.5) {
            // a long hole, or a clock that went back
            let number = (last_x + periods.max(1.0)).round() as i64;
            self.begin(new, number.max(self.next));
            return None;
        }
        new.x = last_x + periods;
        let on_grid = new.x.round();
        if (new.x - on_grid).abs() <= RATE * periods + ROUNDING_NS / self.period_ns && on_grid > last_x {
            new.x = on_grid;
        }
        if self.len == ROOM {
            self.raw.copy_within(ROOM - KEPT + 1.., 0);
            self.len = KEPT - 1;
        }
        self.raw[self.len] = new;
        self.len += 1;
        let share = self.next as f64 - new.x;
        let within_last = self.timing == InputTiming::Held && share > 0.0;
        within_last.then(|| {
            let last = &self.raw[self.len - 2];
            std::array::from_fn(|j| share * (new.u[j] - last.u[j]))
        })
    }

    fn begin(&mut self, mut new: Raw, number: i64) {
        new.x = number as f64;
        self.raw[0] = new;
        (self.len, self.next, self.first) = (1, number, true);
    }

    /// The next grid value that the samples so far determine.
    pub fn next(&mut self) -> Option<GridSample> {
        let raw = &self.raw[self.len.saturating_sub(KEPT)..self.len];
        let x = self.next as f64;
        // first sample at the grid instant or after it
        let behind = raw.iter().rposition(|r| r.x < x).map_or(0, |before| before + 1);
        let right = raw.get(behind)?;
        let mut grid = GridSample {
            number: self.next,
            t_ns: right.t_ns,
            q: right.q,
            u: right.u,
            first: self.first,
            lost: false,
            gain: 1.0,
        };
        if right.x == x {
            if self.timing == InputTiming::Held {
                self.hold(&raw[behind..], &mut grid.u);
            }
        } else {
            // the first sample of a stretch lies on the grid, so there is one before, unless the
            // grid is far behind
            if behind == 0 {
                self.next = right.x.ceil() as i64;
                return self.next();
            }
            self.interpolate(raw, behind, x, &mut grid)?;
        }
        self.next += 1;
        self.first = false;
        Some(grid)
    }

    /// Computes a grid value at `x`, between samples `right − 1` and `right`; `None` if it needs
    /// samples that are still to come.
    fn interpolate(&self, raw: &[Raw], right: usize, x: f64, grid: &mut GridSample) -> Option<()> {
        let (before, after) = (&raw[right - 1], &raw[right]);
        let spacing = after.x - before.x;
        let share = (x - before.x) / spacing;
        grid.t_ns = before.t_ns + ((x - before.x) * self.period_ns).round() as u64;
        let line = |a: f64, b: f64| a + share * (b - a);
        for j in 0..self.joints {
            grid.u[j] = line(before.u[j], after.u[j]);
        }
        if spacing > 1.5 {
            grid.lost = true;
            for j in 0..self.joints {
                grid.q[j] = line(before.q[j], after.q[j]);
            }
            return Some(());
        }
        let from = right - right.min(STENCIL / 2);
        let stencil = raw.get(from..from + STENCIL)?;
        let nodes: [f64; STENCIL] = std::array::from_fn(|k| stencil[k].x - x);
        let mut w = [0.0; MOST];
        weights(&nodes, STENCIL - 1, 0.0, &mut w);
        for j in 0..self.joints {
            grid.q[j] = stencil.iter().zip(&w).map(|(r, w)| w * r.q[j]).sum();
        }
        if self.timing == InputTiming::Held {
            grid.u = before.u;
            self.hold(&raw[right - 1..], &mut grid.u);
        }
        grid.gain = (nodes[STENCIL - 1] - nodes[0]) / (STENCIL - 1) as f64;
        Some(())
    }

    /// The mean of a held input over the cell that starts at the next grid instant, as far as it is
    /// known; the first of `raw` is the last sample at or before the instant.
    fn hold(&self, raw: &[Raw], u: &mut [f64; MAX_JOINTS]) {
        let end = self.next as f64 + 1.0;
        for pair in raw.windows(2) {
            let share = end - pair[1].x;
            if share <= 0.0 {
                break;
            }
            for j in 0..self.joints {
                u[j] += share * (pair[1].u[j] - pair[0].u[j]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(q: f64, u: f64) -> JointSample {
        let mut sample = JointSample::default();
        (sample.q[0], sample.input[0]) = (q, u);
        sample
    }

    /// Grid values of a stream of (t in ms, q, u).
    fn run(timing: InputTiming, stream: impl Iterator<Item = (f64, f64, f64)>) -> Vec<GridSample> {
        let mut intake = Intake::new(1e-3, timing, 1);
        let mut grid: Vec<GridSample> = Vec::new();
        for (t_ms, q, u) in stream {
            if let Some(change) = intake.take((t_ms * 1e6).round() as u64, &sample(q, u)) {
                grid.last_mut().unwrap().u[0] += change[0];
            }
            while let Some(value) = intake.next() {
                grid.push(value);
            }
        }
        grid
    }

    /// Irregular instants in ms.
    fn instants(count: usize) -> Vec<f64> {
        (0..count)
            .map(|k| k as f64 + if k == 0 { 0.0 } else { 0.2 * (2.3 * k as f64).sin() })
            .collect()
    }

    #[test]
    fn prop_samples_on_the_grid_pass_to_the_bit_and_at_once() {
        for timing in [InputTiming::Held, InputTiming::Continuous] {
            let signal = |k: usize| (k as f64, (0.1 * k as f64).sin(), (0.37 * k as f64).cos());
            let mut intake = Intake::new(1e-3, timing, 1);
            for k in 0..500 {
                let (t, q, u) = signal(k);
                // a clock that is sometimes a nanosecond off
                let t_ns = t as u64 * 1_000_000 + u64::from(k % 7 == 3);
                assert_eq!(intake.take(t_ns, &sample(q, u)), None);
                let value = intake.next().unwrap();
                assert_eq!((value.number, value.t_ns), (k as i64, t_ns));
                assert_eq!((value.q[0], value.u[0], value.gain), (q, u, 1.0));
                assert!(!value.lost && value.first == (k == 0));
                assert!(intake.next().is_none());
            }
        }
    }

    #[test]
    fn val_positions_at_irregular_stamps_come_out_on_the_grid() {
        let q = |t: f64| (0.08 * t).sin();
        let stream = instants(300).into_iter().map(|t| (t, q(t), 0.05 * t));
        let grid = run(InputTiming::Continuous, stream);
        assert!(grid.len() > 290);
        for (k, value) in grid.iter().enumerate() {
            assert_eq!(value.number, k as i64);
            // (0.08)⁶/6! · |Π (t − t_j)| ≤ 3.6e-10 · 40 of six samples up to 3.3 apart, more at the
            // start and stamps are rounded to a nanosecond, 1e-6 of a period, at a slope of 0.08
            let limit = if k < 4 { 2e-6 } else { 1e-7 };
            assert!(
                (value.q[0] - q(k as f64)).abs() < limit,
                "{k}: {}",
                value.q[0] - q(k as f64)
            );
            // stamps are rounded to a nanosecond, 1e-6 of a period
            assert!((value.u[0] - 0.05 * k as f64).abs() < 1e-7);
        }
    }

    #[test]
    fn val_a_held_input_keeps_its_integral_exactly() {
        let stamps = instants(400);
        let u = |k: usize| (0.7 * k as f64).sin() + f64::from(u8::from(k > 200));
        let stream = stamps.iter().enumerate().map(|(k, &t)| (t, 0.0, u(k)));
        let grid = run(InputTiming::Held, stream);
        for value in &grid[..390] {
            let (from, to) = (value.number as f64, value.number as f64 + 1.0);
            let mean: f64 = (0..399)
                .map(|k| u(k) * (stamps[k + 1].min(to) - stamps[k].max(from)).max(0.0))
                .sum();
            // stamps are rounded to a nanosecond, 1e-6 of a period
            assert!((value.u[0] - mean).abs() < 1e-5, "{from}: {} {mean}", value.u[0]);
        }
    }

    #[test]
    fn prop_short_holes_are_bridged_and_long_ones_begin_anew() {
        let missing = [50, 70, 71, 90, 91, 92, 93, 94, 120, 121, 122, 123, 124, 125];
        let stream = (0..200)
            .filter(|k| !missing.contains(k))
            .map(|k| (f64::from(k), 0.0, 0.0));
        let grid = run(InputTiming::Held, stream);
        let lost: Vec<i64> = grid.iter().filter(|v| v.lost).map(|v| v.number).collect();
        assert_eq!(lost, [50, 70, 71, 90, 91, 92, 93, 94]);
        let first: Vec<i64> = grid.iter().filter(|v| v.first).map(|v| v.number).collect();
        assert_eq!(first, [0, 126]);
        // a clock that goes back
        let stream = (0..20).map(|k| (if k < 10 { 100.0 } else { 50.0 } + f64::from(k), 0.0, 0.0));
        let grid = run(InputTiming::Held, stream);
        assert_eq!(grid.iter().filter(|v| v.first).count(), 2);
        assert!(grid.windows(2).all(|pair| pair[1].number == pair[0].number + 1));
    }
}
