//! Single wrong and lost samples, made good before they enter a window.
//!
//! A sample stands in five windows and more, so a wrong one must be judged before it is projected: behind that nothing is left of it but five
//! wrong rows. Two things are made good, each over five samples in a row at most:
//!
//! **Lost samples.** Positions come from the polynomial of degree 5 nearest to five samples on either side; inputs from one of degree 3 where the
//! input is smooth there, else from the straight line across the hole.
//!
//! **Spikes.** r_k = x_k − (15 (x_{k−1} + x_{k+1}) − 6 (x_{k−2} + x_{k+2}) + x_{k−3} + x_{k+3})/20 is the sixth difference over −20: next to nothing
//! of a motion, 1.52 σ of white noise, and all of a spike. Where it exceeds eight standard deviations, known or taken from its median, the samples
//! that lie off the robust trend of their neighbours are left out, and are spikes where what remains on *both* sides is one smooth curve that
//! they are far off: six times as far as any of its own samples. At a step of a setpoint the two sides do not fit to one curve, a saturated
//! input has no single samples, and noise of any size fits itself. A signal with more than 5 % of spikes has none: that is its nature.
//!
//! Beside a step a curve through two samples on its side and five on the other decides. What stands right at a step and does not belong to its own side's
//! curve may be a spike or a part of the step: it stays, and its variance is raised by the square of its distance.
//!
//! An input that answers to a position may jump for one sample because the position did: a count of an encoder, or a spike of it that
//! the controller saw, too. With a count the input is believed, with a spike it is kept and its variance raised by the square of its jump.
//!
//! # Weights
//! A sample x̂_k = Σ w_kj x_j that is made from its neighbours carries their noise once more. A row weighs neighbours nearly alike, c_j ≈ c, so n such
//! samples in a row add Σ_j (1 + W_j)² − 1, W_j = Σ_k w_kj, to the sum of squares: 2 n + Σ W_j², in place of n. To that comes what the
//! polynomial misses, for which its distance to the polynomial of a lower degree stands. Errors within a hole have one sign, so
//! they add up: the variance of each counts for all n.

use super::polynomial::{MOST, weights};
use std::ops::Range;

/// Neighbours on either side that a sample is made from, and how far away they may be.
const SIDE: usize = 5;
const FAR: usize = 12;
/// Neighbours on the side of a step that is near.
const NEAR: usize = 2;
/// Standard deviations that a spike is off at least, and multiples of what its neighbours are off their curve.
const SPIKE: f64 = 8.0;
const CLEAR: f64 = 6.0;
/// Standard deviation of r for white noise of 1: √924/20.
const GAIN: f64 = 1.52;
/// Wrong samples in a row that can be told from a pulse.
const RUN: usize = 3;
/// Samples on either side among which counts are looked for that the input answered to.
const AROUND: usize = 500;
/// Longest stretch of large r that is looked into.
const CLUSTER: usize = 40;
/// A sample whose neighbours behind it are not all there is made good again with the next block.
const LAG: usize = FAR + 4;

/// What kind of signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Position,
    Input,
}

/// State of one signal, per position of the buffers.
#[derive(Debug, Clone)]
struct Signal {
    bad: Vec<bool>,
    factor: Vec<f64>,
    extra: Vec<f64>,
}

/// What is known of the samples beside their values.
#[derive(Debug, Clone)]
pub(super) struct Repair {
    /// Positions of the joints, then inputs.
    signals: [Vec<Signal>; 2],
    /// False while every sample is as it came.
    touched: bool,
    /// Samples before this one are made good for good.
    done: usize,
    replaced: u32,
    /// Where uninterrupted stretches begin.
    starts: Vec<usize>,
    /// Samples whose position is another now.
    changed: Vec<(usize, usize)>,
    scratch: Vec<f64>,
    marked: Vec<usize>,
}

impl Repair {
    pub fn new(joints: usize, capacity: usize) -> Self {
        let signal = Signal {
            bad: vec![false; capacity],
            factor: vec![1.0; capacity],
            extra: vec![0.0; capacity],
        };
        Self {
            signals: [vec![signal.clone(); joints], vec![signal; joints]],
            touched: false,
            done: 0,
            replaced: 0,
            starts: Vec::with_capacity(capacity),
            changed: Vec::with_capacity(joints * capacity),
            scratch: Vec::with_capacity(capacity),
            marked: Vec::with_capacity(capacity),
        }
    }

    /// Notes how the sample at `at` came about.
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
        let kept = len - from;
        for signal in self.signals.iter_mut().flatten() {
            signal.bad.copy_within(from..len, 0);
            signal.factor.copy_within(from..len, 0);
            signal.extra.copy_within(from..len, 0);
            signal.bad[kept..].fill(false);
            signal.factor[kept..].fill(1.0);
            signal.extra[kept..].fill(0.0);
            self.touched |= (0..kept).any(|k| signal.bad[k] || signal.factor[k] != 1.0 || signal.extra[k] != 0.0);
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.clear(0, 0);
        self.starts.clear();
        self.done = 0;
    }

    /// Samples replaced in this block because they were spikes, each signal counted.
    pub fn replaced(&self) -> u32 {
        self.replaced
    }

    /// False while every sample is as it came.
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

    /// True for a sample that is not as it was measured.
    pub fn is_made(&self, kind: Kind, joint: usize, at: usize) -> bool {
        self.touched && self.signals[kind as usize][joint].bad[at]
    }

    /// Variance of a sample whose noise has the variance `own`.
    pub fn variance(&self, kind: Kind, joint: usize, at: usize, own: f64) -> f64 {
        let signal = &self.signals[kind as usize][joint];
        own * signal.factor[at] + signal.extra[at]
    }

    /// Gives the samples of a signal whose variance is not `own`, and by how much.
    pub fn surplus(&self, kind: Kind, joint: usize, len: usize, own: f64, out: &mut Vec<(usize, f64)>) {
        out.clear();
        if self.touched {
            let all = (0..len).map(|at| (at, self.variance(kind, joint, at, own) - own));
            out.extend(all.filter(|(_, surplus)| *surplus != 0.0));
        }
    }

    /// Looks for spikes and makes them and the lost samples of one joint good. `std` are the standard deviations of position and input, as far as they are
    /// known, `count` is that of the encoder.
    pub fn mend(&mut self, joint: usize, q: &mut [f64], u: &mut [f64], std: [f64; 2], count: f64) {
        let len = q.len();
        let from = self.done;
        for index in 0..self.starts.len() {
            let start = self.starts[index];
            let end = self.starts.get(index + 1).copied().unwrap_or(len);
            let stretch = start..end;
            let [positions, inputs] = &mut self.signals;
            let (position, input) = (&mut positions[joint], &mut inputs[joint]);
            let (scratch, marked) = (&mut self.scratch, &mut self.marked);
            find_spikes(q, position, stretch.clone(), from, std[0], scratch, marked, |_| {
                Answer::None
            });
            let mut found = marked.len();
            let seen = &*position;
            let doubted = find_spikes(u, input, stretch.clone(), from, std[1], scratch, marked, |k| {
                answers(q, u, seen, &stretch, k, count)
            });
            found += marked.len();
            self.replaced = self.replaced.saturating_add(found as u32);
            self.touched |= found > 0 || doubted;
            if !self.touched {
                continue;
            }
            let changed = &mut self.changed;
            for_each_run(&position.bad, from..end, start, |run| {
                bridge_position(
                    q,
                    &position.bad,
                    &stretch,
                    run.clone(),
                    &mut position.factor,
                    &mut position.extra,
                );
                changed.push((run.start, run.end));
            });
            for_each_run(&input.bad, from..end, start, |run| {
                bridge_input(
                    u,
                    &input.bad,
                    &stretch,
                    run,
                    std[1],
                    &mut input.factor,
                    &mut input.extra,
                );
            });
        }
    }

    /// Ends the repairs of a block of `len` samples.
    pub fn finish(&mut self, len: usize) {
        self.done = len.saturating_sub(LAG);
    }
}

/// How an input's jump goes with the position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    /// It does not.
    None,
    /// To a count of the encoder: it is as real as that.
    Count,
    /// To a spike, if the controller saw it.
    Spike,
}

/// What the input at `k` may have answered to: a spike of the position, or a count that it changed by after a while. Counts are believed to have an
/// effect where many of them have: a third of those around.
fn answers(q: &[f64], u: &[f64], position: &Signal, stretch: &Range<usize>, k: usize, count: f64) -> Answer {
    let near = k.saturating_sub(2).max(stretch.start)..(k + 2).min(stretch.end);
    if near.clone().any(|i| position.bad[i]) {
        return Answer::Spike;
    }
    if !(count > 0.0) {
        return Answer::None;
    }
    let moves = |i: usize| (q[i] - q[i - 1]).abs() > 0.5 * count;
    let moving = |from: usize, to: usize| {
        let range = from.max(stretch.start + 1)..to.min(stretch.end);
        range.filter(|&i| moves(i)).count()
    };
    // a count or two among a dozen samples at rest
    let alone = |k: usize| moving(k.saturating_sub(1), k + 2) > 0 && moving(k.saturating_sub(6), k + 7) <= 3;
    if !alone(k) {
        return Answer::None;
    }
    // how far the input is off the mean of its neighbours, here and at other counts
    let off = |i: usize| (u[i] - 0.5 * (u[i - 1] + u[i + 1])).abs();
    let around = k.saturating_sub(AROUND).max(stretch.start + 2)..(k + AROUND).min(stretch.end.saturating_sub(3));
    let (mut counts, mut effects) = (0, 0);
    for i in around.filter(|i| i.abs_diff(k) > 6).filter(|&i| moves(i) && alone(i)) {
        counts += 1;
        effects += usize::from(off(i).max(off(i + 1)) > 0.3 * off(k));
    }
    if counts > 0 && 3 * effects > counts {
        Answer::Count
    } else {
        Answer::None
    }
}

fn for_each_run(bad: &[bool], range: Range<usize>, start: usize, mut run: impl FnMut(Range<usize>)) {
    let mut at = range.start.max(start);
    // a run that began before is made good as a whole
    while at > start && at < range.end && bad[at] && bad[at - 1] {
        at -= 1;
    }
    while at < range.end {
        if bad[at] {
            let end = (at..range.end).find(|&k| !bad[k]).unwrap_or(range.end);
            run(at..end);
            at = end;
        } else {
            at += 1;
        }
    }
}

/// Instants relative to the middle of a hole, and values, of the good samples around it; nearest first, those on the left before those on the right.
struct Neighbours {
    nodes: [f64; MOST],
    values: [f64; MOST],
    count: usize,
    left: usize,
}

impl Neighbours {
    /// Up to so many good samples on the left and on the right of `run` within the stretch.
    fn new(
        x: &[f64],
        good: impl Fn(usize) -> bool,
        stretch: &Range<usize>,
        run: &Range<usize>,
        sides: (usize, usize),
    ) -> Self {
        let mut own = Self {
            nodes: [0.0; MOST],
            values: [0.0; MOST],
            count: 0,
            left: 0,
        };
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        let before = (run.start.saturating_sub(FAR).max(stretch.start)..run.start).rev();
        let behind = run.end..(run.end + FAR).min(stretch.end);
        for k in before.filter(|&k| good(k)).take(sides.0) {
            own.push(k as f64 - origin, x[k]);
        }
        own.left = own.count;
        for k in behind.filter(|&k| good(k)).take(sides.1) {
            own.push(k as f64 - origin, x[k]);
        }
        own
    }

    fn push(&mut self, node: f64, value: f64) {
        (self.nodes[self.count], self.values[self.count]) = (node, value);
        self.count += 1;
    }

    fn right(&self) -> usize {
        self.count - self.left
    }

    /// The fitted polynomial at an instant; its weights go into `w`.
    fn at(&self, degree: usize, instant: f64, w: &mut [f64; MOST]) -> f64 {
        weights(&self.nodes[..self.count], degree, instant, w);
        self.values[..self.count].iter().zip(w.iter()).map(|(x, w)| x * w).sum()
    }

    /// How far the samples themselves are off the polynomial at most.
    fn misfit(&self, degree: usize) -> f64 {
        let mut w = [0.0; MOST];
        (0..self.count)
            .map(|k| (self.values[k] - self.at(degree, self.nodes[k], &mut w)).abs())
            .fold(0.0, f64::max)
    }

    /// Degree that both sides determine without one of them being extrapolated, at most `most`.
    fn degree(&self, most: usize) -> usize {
        match self.left.min(self.right()) {
            0 => usize::from(self.count > 1),
            fewer => (2 * fewer - 1).min(most),
        }
    }
}

/// Replaces the positions of a run by the polynomial of their neighbours.
fn bridge_position(
    x: &mut [f64],
    bad: &[bool],
    stretch: &Range<usize>,
    run: Range<usize>,
    factor: &mut [f64],
    extra: &mut [f64],
) {
    let around = Neighbours::new(x, |k| !bad[k], stretch, &run, (SIDE, SIDE));
    if around.count == 0 {
        return;
    }
    let degree = around.degree(5);
    let n = run.len() as f64;
    let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
    let (mut w, mut total, mut missed) = ([0.0; MOST], [0.0; MOST], 0.0f64);
    for k in run.clone() {
        let lower = around.at(degree.saturating_sub(2), k as f64 - origin, &mut w);
        x[k] = around.at(degree, k as f64 - origin, &mut w);
        total.iter_mut().zip(&w).for_each(|(sum, w)| *sum += w);
        missed = missed.max((x[k] - lower).abs());
    }
    let squares: f64 = total.iter().map(|w| w * w).sum();
    for k in run {
        factor[k] = 2.0 + squares / n;
        extra[k] = n * missed * missed;
    }
}

/// Replaces the inputs of a run: by a polynomial where the neighbours lie on one, else by the straight line across.
fn bridge_input(
    x: &mut [f64],
    bad: &[bool],
    stretch: &Range<usize>,
    run: Range<usize>,
    std: f64,
    factor: &mut [f64],
    extra: &mut [f64],
) {
    let around = Neighbours::new(x, |k| !bad[k], stretch, &run, (SIDE, SIDE));
    if around.count == 0 {
        return;
    }
    let n = run.len() as f64;
    let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
    let degree = around.degree(3);
    let mut w = [0.0; MOST];
    let misfit = {
        let mut sum = 0.0;
        for k in 0..around.count {
            sum += (around.values[k] - around.at(degree, around.nodes[k], &mut w)).powi(2);
        }
        (sum / around.count.saturating_sub(degree + 1).max(1) as f64).sqrt()
    };
    let whole = around.left >= 3 && around.right() >= 3;
    if whole && misfit <= 3.0 * std {
        let (mut total, mut missed) = ([0.0; MOST], 0.0f64);
        for k in run.clone() {
            let lower = around.at(1, k as f64 - origin, &mut w);
            x[k] = around.at(degree, k as f64 - origin, &mut w);
            total.iter_mut().zip(&w).for_each(|(sum, w)| *sum += w);
            missed = missed.max((x[k] - lower).abs());
        }
        let squares: f64 = total.iter().map(|w| w * w).sum();
        for k in run {
            factor[k] = 2.0 + squares / n;
            // a fifth: the cubic removes most of what the line misses
            extra[k] = n * (0.2 * missed).powi(2);
        }
        return;
    }
    let (left, last) = (0, around.left);
    if around.left == 0 || around.right() == 0 {
        // one side only: its last value, which may have changed since
        let value = around.values[0];
        for k in run {
            x[k] = value;
            factor[k] = 2.0 + n;
            extra[k] = n * misfit * misfit;
        }
        return;
    }
    // a held input may have jumped anywhere in the hole: with a probability that grows evenly, so that the line is the best guess
    let (a, b) = (around.values[left], around.values[last]);
    let (t_a, t_b) = (around.nodes[left], around.nodes[last]);
    // what the input does from sample to sample where it does not jump
    let step = |k: usize, other: usize| (around.values[k] - around.values[other]).abs();
    let quiet = match (around.left > 1, around.right() > 1) {
        (true, true) => step(0, 1).min(step(last, last + 1)),
        _ => misfit,
    };
    for k in run {
        let share = (k as f64 - origin - t_a) / (t_b - t_a);
        x[k] = a + share * (b - a);
        factor[k] = 2.0 + n;
        extra[k] = n * (share * (1.0 - share) * (b - a).powi(2) + quiet * quiet);
    }
}

/// Marks the spikes of a signal from `from` on as bad; `marked` has them then. `answer` says of one that looks like a spike what else it may be.
/// True where a sample was kept whose variance is raised.
#[allow(clippy::too_many_arguments)]
fn find_spikes(
    x: &[f64],
    signal: &mut Signal,
    stretch: Range<usize>,
    from: usize,
    std: f64,
    scratch: &mut Vec<f64>,
    marked: &mut Vec<usize>,
    answer: impl Fn(usize) -> Answer,
) -> bool {
    marked.clear();
    let region = (stretch.start + 3).max(from)..stretch.end.saturating_sub(3);
    if region.len() < 16 {
        return false;
    }
    let r = |k: usize| {
        let sum = 15.0 * (x[k - 1] + x[k + 1]) - 6.0 * (x[k - 2] + x[k + 2]) + (x[k - 3] + x[k + 3]);
        (x[k] - 0.05 * sum).abs()
    };
    scratch.clear();
    scratch.extend(region.clone().step_by(5).map(r).filter(|v| *v > 0.0));
    let mut spread = GAIN * std;
    if scratch.len() >= 30 {
        let middle = scratch.len() / 2;
        let (_, median, _) = scratch.select_nth_unstable_by(middle, f64::total_cmp);
        spread = spread.max(*median / 0.6745);
    }
    if !(spread > 0.0) {
        return false;
    }
    let mut doubted = false;
    let threshold = SPIKE * spread;
    let most = region.len() / 20 + 2;
    let mut k = region.start;
    while k < region.end {
        if r(k) <= threshold {
            k += 1;
            continue;
        }
        let (first, mut last) = (k, k);
        while let Some(next) = (last + 1..(last + 4).min(region.end)).find(|&i| r(i) > threshold) {
            last = next;
        }
        k = last + 1;
        if last - first >= CLUSTER {
            continue;
        }
        let cluster = first..last + 1;
        let (raised, settled) = judge(x, signal, &stretch, cluster.clone(), threshold, &r, marked, &answer);
        doubted |= raised;
        // what an exact signal does at a step is its own
        if !settled && std > 0.0 {
            doubted |= doubt_about_step(x, signal, &stretch, cluster, threshold);
        }
        if marked.len() > most {
            // that is no accident but the signal
            marked.drain(..).for_each(|at| signal.bad[at] = false);
            return doubted;
        }
    }
    doubted
}

/// Looks into a stretch of large r: whether a variance was raised, and whether anything was found that is no step.
#[allow(clippy::too_many_arguments)]
fn judge(
    x: &[f64],
    signal: &mut Signal,
    stretch: &Range<usize>,
    cluster: Range<usize>,
    threshold: f64,
    r: &impl Fn(usize) -> f64,
    marked: &mut Vec<usize>,
    answer: &impl Fn(usize) -> Answer,
) -> (bool, bool) {
    let mut suspect = [false; CLUSTER + 1];
    let mut any = false;
    for at in cluster.clone().filter(|&at| !signal.bad[at]) {
        let off = off_trend(x, &signal.bad, stretch, at);
        suspect[at - cluster.start] = off > threshold;
        any |= off > threshold;
    }
    if !any {
        let largest = cluster
            .clone()
            .filter(|&at| !signal.bad[at])
            .max_by(|a, b| r(*a).total_cmp(&r(*b)));
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
        let origin = 0.5 * (run.start + run.end) as f64 - 0.5;
        // behind a step, or before it, one side has little to say
        let mut off = [0.0; RUN];
        for (left, right, degree) in [(SIDE, SIDE, 3), (SIDE, NEAR, 2), (NEAR, SIDE, 2)] {
            let good = |k: usize| !signal.bad[k] && !is_suspect(k);
            let around = Neighbours::new(x, good, stretch, &run, (left, right));
            if around.left < left.min(3) || around.right() < right.min(3) || around.count < 6 {
                continue;
            }
            let (limit, mut w) = (threshold.max(CLEAR * around.misfit(degree)), [0.0; MOST]);
            for (off, k) in off.iter_mut().zip(run.clone()) {
                let own = (x[k] - around.at(degree, k as f64 - origin, &mut w)).abs();
                *off = if own > limit { own } else { 0.0 };
            }
            if off.iter().any(|off| *off > 0.0) {
                break;
            }
        }
        settled |= off.iter().any(|off| *off > 0.0);
        for (k, off) in run.zip(off).filter(|(_, off)| *off > 0.0) {
            match answer(k) {
                Answer::None => {
                    signal.bad[k] = true;
                    marked.push(k);
                }
                Answer::Spike => {
                    signal.extra[k] = off * off;
                    doubted = true;
                }
                Answer::Count => {}
            }
        }
    }
    (doubted, settled)
}

/// Raises the variance of a sample beside a step that its own side of it does not bear out: a spike there cannot be told from a part of the step.
fn doubt_about_step(
    x: &[f64],
    signal: &mut Signal,
    stretch: &Range<usize>,
    cluster: Range<usize>,
    threshold: f64,
) -> bool {
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
        let own = Neighbours::new(x, |i| !signal.bad[i], &side, &(k..k + 1), (SIDE + 1, SIDE + 1));
        if own.count < SIDE || signal.bad[k] {
            continue;
        }
        let off = (x[k] - own.at(2, 0.0, &mut [0.0; MOST])).abs();
        if off > threshold.max(CLEAR * own.misfit(2)) {
            signal.extra[k] = off * off;
            doubted = true;
        }
    }
    doubted
}

/// How far a sample is off the robust straight line of its neighbours, less what they themselves are off it.
fn off_trend(x: &[f64], bad: &[bool], stretch: &Range<usize>, at: usize) -> f64 {
    const SIDE: usize = 4;
    let mut values = [0.0; 2 * SIDE + 1];
    let range = at.saturating_sub(SIDE).max(stretch.start)..(at + SIDE + 1).min(stretch.end);
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

fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
