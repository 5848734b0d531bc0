//! Finds single wrong samples of a signal and distinguishes them from motion and steps by their
//! neighbours.
//!
//! **Spikes.** r_k = x_k − (15 (x_{k−1} + x_{k+1}) − 6 (x_{k−2} + x_{k+2}) + x_{k−3} + x_{k+3})/20
//! is the sixth difference over −20: almost zero for a motion, 1.52 σ for white noise, and the full
//! size of a spike. If it exceeds eight standard deviations (known, or from its median), the
//! samples away from the robust trend of their neighbours are left out. They are spikes if the
//! remaining samples on *both* sides lie on one smooth curve from which they are far away: six
//! times as far as any of its own samples. At a step of a setpoint the two sides do not lie on one
//! curve, a saturated input has no isolated samples, and noise of any size is consistent with
//! itself. If more than 5 % of a signal look like spikes, they are its normal behaviour, and none
//! is replaced.
//!
//! Near a step, a curve through two samples on the side of the step and five on the other decides.
//! A sample directly at a step that does not lie on the curve of its own side may be a spike or
//! part of the step: it stays, and its variance is increased by the square of its distance.
//!
//! An input under feedback may jump for one sample because the position did: by an encoder count,
//! or by a spike that the controller saw too. For a count the input is accepted; for a spike it is
//! kept, and its variance is increased by the square of its jump.

use super::input_answer::Answer;
use super::mended_signal::MendedSignal;
use super::neighbours::{Neighbours, SIDE};
use super::polynomial::MOST;
use std::ops::Range;

/// Neighbours used on the side of a nearby step.
const NEAR: usize = 2;
/// Neighbours on either side from which the trend at a sample is computed.
const TREND: usize = 4;
/// Smallest distance of a spike in standard deviations, and in multiples of its neighbours'
/// distance from their curve.
const SPIKE: f64 = 8.0;
const CLEAR: f64 = 6.0;
/// Standard deviation of r for white noise of 1: √924/20.
const GAIN: f64 = 1.52;
/// Largest number of wrong samples in a row that can be distinguished from a pulse.
const RUN: usize = 3;
/// Longest stretch of large r that is examined.
const CLUSTER: usize = 40;

/// Finds spikes, with its workspace.
#[derive(Debug, Clone)]
pub(super) struct SpikeFinder {
    /// |r| of a region, and a reordered copy.
    rough: Vec<f64>,
    scratch: Vec<f64>,
    marked: Vec<usize>,
}

impl SpikeFinder {
    /// Workspace for signals of `capacity` samples.
    pub fn new(capacity: usize) -> Self {
        Self {
            rough: vec![0.0; capacity],
            scratch: Vec::with_capacity(capacity),
            marked: Vec::with_capacity(capacity),
        }
    }

    /// Number of spikes found last.
    pub fn found(&self) -> usize {
        self.marked.len()
    }

    /// Marks the spikes of a signal from `from` on as bad. `answer` gives another possible cause of
    /// a sample that looks like a spike. True if a sample was kept with increased variance.
    pub fn find(
        &mut self,
        x: &[f64],
        signal: &mut MendedSignal,
        stretch: &Range<usize>,
        from: usize,
        std: f64,
        answer: impl Fn(usize) -> Answer,
    ) -> bool {
        self.marked.clear();
        let region = (stretch.start + 3).max(from)..stretch.end.saturating_sub(3);
        if region.len() < 16 {
            return false;
        }
        let (rough, scratch) = (&mut self.rough[..region.len()], &mut self.scratch);
        roughness(x, &region, rough);
        scratch.clear();
        scratch.extend(rough.iter().step_by(5).filter(|v| **v > 0.0));
        let mut spread = GAIN * std;
        if scratch.len() >= 30 {
            let middle = scratch.len() / 2;
            let (_, median, _) = scratch.select_nth_unstable_by(middle, f64::total_cmp);
            spread = spread.max(*median / 0.6745);
        }
        if !(spread > 0.0) {
            return false;
        }
        let threshold = SPIKE * spread;
        let is_rough = |k: usize| rough[k - region.start] > threshold;
        let mut search = Search {
            x,
            rough,
            region: &region,
            signal,
            stretch,
            threshold,
            marked: &mut self.marked,
        };
        let mut doubted = false;
        let most = region.len() / 20 + 2;
        let mut k = region.start;
        while let Some(ahead) = rough[k - region.start..].iter().position(|r| !(*r <= threshold)) {
            let first = k + ahead;
            let mut last = first;
            while let Some(next) = (last + 1..(last + 4).min(region.end)).find(|&i| is_rough(i)) {
                last = next;
            }
            k = last + 1;
            if last - first >= CLUSTER {
                continue;
            }
            let cluster = first..last + 1;
            let (raised, settled) = search.judge(cluster.clone(), &answer);
            doubted |= raised;
            // an exact signal has no spikes at a step
            if !settled && std > 0.0 {
                doubted |= search.doubt_about_step(cluster);
            }
            if search.marked.len() > most {
                // so many are part of the signal
                search.unmark();
                return doubted;
            }
        }
        doubted
    }
}

/// The search in one stretch of a signal.
struct Search<'a> {
    x: &'a [f64],
    /// |r| of the samples of a region.
    rough: &'a [f64],
    region: &'a Range<usize>,
    signal: &'a mut MendedSignal,
    stretch: &'a Range<usize>,
    /// r above which a sample is examined.
    threshold: f64,
    marked: &'a mut Vec<usize>,
}

impl Search<'_> {
    /// Examines a stretch of large r; returns whether a variance was increased, and whether
    /// anything other than a step was found.
    fn judge(&mut self, cluster: Range<usize>, answer: &impl Fn(usize) -> Answer) -> (bool, bool) {
        let mut suspect = [false; CLUSTER + 1];
        let mut any = false;
        for at in cluster.clone().filter(|&at| !self.signal.bad[at]) {
            let off = self.off_trend(at);
            suspect[at - cluster.start] = off > self.threshold;
            any |= off > self.threshold;
        }
        if !any {
            let largest = cluster
                .clone()
                .filter(|&at| !self.signal.bad[at])
                .max_by(|a, b| self.roughness(*a).total_cmp(&self.roughness(*b)));
            let Some(largest) = largest else {
                return (false, true);
            };
            suspect[largest - cluster.start] = true;
        }
        let is_suspect = |k: usize| cluster.contains(&k) && suspect[k - cluster.start];
        let (mut doubted, mut settled) = (false, false);
        let mut at = cluster.start;
        while at < cluster.end {
            if !is_suspect(at) {
                at += 1;
                continue;
            }
            let end = (at..cluster.end).find(|&k| !is_suspect(k)).unwrap_or(cluster.end);
            let run = at..end;
            at = end;
            if run.len() > RUN {
                continue;
            }
            let off = self.off_curve(&run, is_suspect);
            settled |= off.iter().any(|off| *off > 0.0);
            for (k, off) in run.zip(off).filter(|(_, off)| *off > 0.0) {
                match answer(k) {
                    Answer::None => {
                        self.signal.bad[k] = true;
                        self.marked.push(k);
                    }
                    Answer::Spike => {
                        self.signal.extra[k] = off * off;
                        doubted = true;
                    }
                    Answer::Count => {}
                }
            }
        }
        (doubted, settled)
    }

    /// Distance of each sample of a run from the smooth curve of its neighbours; 0 for one that is
    /// not far enough away to be a spike. A curve from few samples on one side, as near a step, is
    /// tried if the one from both sides shows none.
    fn off_curve(&self, run: &Range<usize>, is_suspect: impl Fn(usize) -> bool) -> [f64; RUN] {
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        let good = |k: usize| !self.signal.bad[k] && !is_suspect(k);
        let mut off = [0.0; RUN];
        for (left, right, degree) in [(SIDE, SIDE, 3), (SIDE, NEAR, 2), (NEAR, SIDE, 2)] {
            let around = Neighbours::new(self.x, good, self.stretch, run, (left, right));
            if around.left < left.min(3) || around.right() < right.min(3) || around.count < 6 {
                continue;
            }
            let (limit, mut w) = (self.threshold.max(CLEAR * around.misfit(degree)), [0.0; MOST]);
            for (off, k) in off.iter_mut().zip(run.clone()) {
                let distance = (self.x[k] - around.at(degree, k as f64 - origin, &mut w)).abs();
                *off = if distance > limit { distance } else { 0.0 };
            }
            if off.iter().any(|off| *off > 0.0) {
                break;
            }
        }
        off
    }

    /// Increases the variance of a sample next to a step if it does not lie on the curve of its own
    /// side: a spike there cannot be distinguished from part of the step.
    fn doubt_about_step(&mut self, cluster: Range<usize>) -> bool {
        let (x, stretch) = (self.x, self.stretch);
        let size = |k: usize| (x[k] - x[k - 1]).abs();
        let inner = cluster.start.max(stretch.start + 1)..cluster.end;
        let Some(step) = inner.max_by(|a, b| size(*a).total_cmp(&size(*b))) else {
            return false;
        };
        let mut doubted = false;
        let from = step.saturating_sub(NEAR).max(stretch.start);
        for k in from..(step + NEAR).min(stretch.end) {
            let side = if k < step {
                stretch.start..step
            } else {
                step..stretch.end
            };
            let own = Neighbours::new(x, |i| !self.signal.bad[i], &side, &(k..k + 1), (SIDE + 1, SIDE + 1));
            if own.count < SIDE || self.signal.bad[k] {
                continue;
            }
            let off = (x[k] - own.at(2, 0.0, &mut [0.0; MOST])).abs();
            if off > self.threshold.max(CLEAR * own.misfit(2)) {
                self.signal.extra[k] = off * off;
                doubted = true;
            }
        }
        doubted
    }

    /// |r| of a sample of the region.
    fn roughness(&self, k: usize) -> f64 {
        self.rough[k - self.region.start]
    }

    /// Distance of a sample from the robust straight line of its neighbours, minus their own
    /// distance from it.
    fn off_trend(&self, at: usize) -> f64 {
        let (x, stretch, bad) = (self.x, self.stretch, &self.signal.bad);
        let mut values = [0.0; 2 * TREND + 1];
        let range = at.saturating_sub(TREND).max(stretch.start)..(at + TREND + 1).min(stretch.end);
        let mut count = 0;
        for k in range.clone().skip(1).filter(|&k| !bad[k] && !bad[k - 1]) {
            values[count] = x[k] - x[k - 1];
            count += 1;
        }
        let slope = median(&mut values[..count]);
        let detrended = |k: usize| x[k] - slope * (k as f64 - at as f64);
        count = 0;
        for k in range.clone().filter(|&k| !bad[k]) {
            values[count] = detrended(k);
            count += 1;
        }
        let middle = median(&mut values[..count]);
        for value in &mut values[..count] {
            *value = (*value - middle).abs();
        }
        let spread = median(&mut values[..count]);
        let off = (x[at] - middle).abs();
        if off > 4.0 * spread { off } else { 0.0 }
    }

    /// Removes the marks.
    fn unmark(&mut self) {
        for at in self.marked.drain(..) {
            self.signal.bad[at] = false;
        }
    }
}

/// |r_k| of the samples of a region: the distance of each from the curve through its neighbours.
fn roughness(x: &[f64], region: &Range<usize>, rough: &mut [f64]) {
    // x_{k−3}, …, x_{k+3}
    let [a, b, c, d, e, f, g] = [0, 1, 2, 3, 4, 5, 6].map(|n| &x[region.start - 3 + n..][..region.len()]);
    for (k, r) in rough.iter_mut().enumerate() {
        let sum = 15.0 * (c[k] + e[k]) - 6.0 * (b[k] + f[k]) + (a[k] + g[k]);
        *r = (d[k] - 0.05 * sum).abs();
    }
}

fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
