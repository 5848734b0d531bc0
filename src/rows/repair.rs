//! Repairs single wrong and lost samples before they enter a window.
//!
//! A sample is in five windows or more, so a wrong one must be found before it is projected;
//! afterwards it shows only as five wrong rows. Two faults are repaired, each over at most five
//! samples in a row:
//!
//! **Lost samples** are replaced from their neighbours (`mended_signal.rs`).
//!
//! **Spikes** are found (`spikes.rs`) and replaced in the same way.

use super::input_answer::{Answer, answers};
use super::mended_signal::MendedSignal;
use super::neighbours::FAR;
use super::spikes::SpikeFinder;
use std::ops::Range;

/// Samples at the end whose later neighbours are still missing are repaired again with the next
/// block.
const LAG: usize = FAR + 4;

/// What kind of signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Position,
    Input,
}

/// Quality of the samples.
#[derive(Debug, Clone)]
pub(super) struct Repair {
    /// Positions of the joints, then inputs.
    signals: [Vec<MendedSignal>; 2],
    /// False while every sample is unmodified.
    touched: bool,
    /// Samples before this one are final.
    done: usize,
    replaced: u32,
    /// Starts of uninterrupted stretches.
    starts: Vec<usize>,
    /// Samples whose position was changed.
    changed: Vec<(usize, usize)>,
    spikes: SpikeFinder,
}

impl Repair {
    /// Unmodified samples of `joints` joints, in buffers of `capacity`.
    pub fn new(joints: usize, capacity: usize) -> Self {
        let signal = MendedSignal::new(capacity);
        Self {
            signals: [vec![signal.clone(); joints], vec![signal; joints]],
            touched: false,
            done: 0,
            replaced: 0,
            starts: Vec::with_capacity(capacity),
            changed: Vec::with_capacity(joints * capacity),
            spikes: SpikeFinder::new(capacity),
        }
    }

    /// Records the origin of the sample at `at`.
    pub fn note(&mut self, at: usize, first: bool, lost: bool, gain: f64) {
        if first {
            self.starts.push(at);
        }
        if lost || gain != 1.0 {
            self.touched = true;
            for signal in self.signals.iter_mut().flatten() {
                (signal.bad[at], signal.factor[at]) = (lost, gain);
            }
        }
    }

    /// Forgets the samples before `from`, of `len`.
    pub fn clear(&mut self, from: usize, len: usize) {
        self.starts.clear();
        self.starts.push(0);
        self.changed.clear();
        self.done = self.done.saturating_sub(from);
        self.replaced = 0;
        if !self.touched {
            return;
        }
        self.touched = false;
        for signal in self.signals.iter_mut().flatten() {
            self.touched |= signal.keep(from, len);
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.clear(0, 0);
        self.starts.clear();
        self.done = 0;
    }

    /// Number of spikes replaced in this block, counted per signal.
    pub fn replaced(&self) -> u32 {
        self.replaced
    }

    /// False while every sample is unmodified.
    pub fn touched(&self) -> bool {
        self.touched
    }

    /// Uninterrupted stretches of `len` samples.
    pub fn stretches(&self, len: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let ends = self.starts.iter().skip(1).copied().chain([len]);
        self.starts.iter().copied().zip(ends).map(|(from, to)| from..to)
    }

    /// Samples whose positions were changed by [`mend`](Self::mend).
    pub fn changed(&self) -> &[(usize, usize)] {
        &self.changed
    }

    /// True for a replaced sample.
    pub fn is_made(&self, kind: Kind, joint: usize, at: usize) -> bool {
        self.touched && self.signals[kind as usize][joint].bad[at]
    }

    /// Variance of a sample whose noise has the variance `own`.
    pub fn variance(&self, kind: Kind, joint: usize, at: usize, own: f64) -> f64 {
        self.signals[kind as usize][joint].variance(at, own)
    }

    /// Writes the samples of a signal whose variance differs from `own`, and the difference.
    pub fn surplus(&self, kind: Kind, joint: usize, len: usize, own: f64, out: &mut Vec<(usize, f64)>) {
        out.clear();
        if self.touched {
            let all = (0..len).map(|at| (at, self.variance(kind, joint, at, own) - own));
            out.extend(all.filter(|(_, surplus)| *surplus != 0.0));
        }
    }

    /// Finds spikes, and replaces them and the lost samples of one joint. `std` are the standard
    /// deviations of position and input, as far as known; `count` is the size of the encoder's
    /// count.
    pub fn mend(&mut self, joint: usize, q: &mut [f64], u: &mut [f64], std: [f64; 2], count: f64) {
        let [positions, inputs] = &mut self.signals;
        let (position, input) = (&mut positions[joint], &mut inputs[joint]);
        for index in 0..self.starts.len() {
            let end = self.starts.get(index + 1).copied().unwrap_or(q.len());
            let stretch = self.starts[index]..end;
            let (spikes, done) = (&mut self.spikes, self.done);
            spikes.find(q, position, &stretch, done, std[0], |_| Answer::None);
            let mut found = spikes.found();
            let doubted = spikes.find(u, input, &stretch, done, std[1], |k| {
                answers(q, u, position, &stretch, k, count)
            });
            found += spikes.found();
            self.replaced = self.replaced.saturating_add(found as u32);
            self.touched |= found > 0 || doubted;
            if !self.touched {
                continue;
            }
            let from = done.max(stretch.start);
            // a run that began earlier is replaced as a whole
            let mut at = position.begin_of_run(from, &stretch);
            while let Some(run) = position.first_run(at..end) {
                at = run.end;
                self.changed.push((run.start, run.end));
                position.bridge_position(q, &stretch, run);
            }
            let mut at = input.begin_of_run(from, &stretch);
            while let Some(run) = input.first_run(at..end) {
                at = run.end;
                input.bridge_input(u, &stretch, run, std[1]);
            }
        }
    }

    /// Ends the repairs of a block of `len` samples.
    pub fn finish(&mut self, len: usize) {
        self.done = len.saturating_sub(LAG);
    }
}
