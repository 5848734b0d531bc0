//! The watch over changes: after each slice the last ones are held against what was known before, see [`change`](super::change).

use super::change::{ChangeCause, Extra, RobotChange};
use super::identify::{RobotIdentifier, learn};
use super::recent::RowRing;
use super::sums::JointSums;

/// Slices that are held against what was known before them.
const WINDOW: usize = 4;
/// Blocks that are learnt before a change can be told from what is not known yet.
const LEARNT_BLOCKS: usize = 5;
/// ln of the Bayes factor from which on the machine has changed: a factor of 10⁸ …
const ALARM: f64 = 18.0;
/// … by which a payload must be likelier than friction of one joint, and by how much less than friction of all joints it may be.
const CLEAR: f64 = 5.0;
const BROAD: f64 = 10.0;
/// Slices that it may take to tell them apart; the first is always waited for, for a joint that sets off shakes for a moment.
const DOUBTS: usize = 4;
/// Least size of a friction parameter, as a part of its prior.
const FRICTION_SIZE: f64 = 0.02;
/// ln of the Bayes factor above which the flange is not empty.
const CARRIES: f64 = 3.0;
/// Residuals behind a change beyond so many σ_j f_j are not explained.
const UNEXPLAINED: f64 = 3.0;
/// A change of the payload shakes friction, too: the standard deviation of that, as a part of its size.
const SHAKEN: f64 = 0.05;

impl RobotIdentifier {
    /// Ends the slice that is open: adds it to the block, keeps it apart, and looks whether the machine is still the same.
    pub(super) fn end_slice(&mut self, now_s: f64) {
        if self.slice.iter().all(|sums| sums.rows == 0) {
            return;
        }
        for (sums, block) in self.slice.iter_mut().zip(&mut self.block) {
            sums.mirror();
            block.add(sums);
        }
        if self.payload.is_some() {
            if self.pending.is_full() {
                self.commit_pending(1);
            }
            let kept = self.pending.push(self.slice_begin);
            self.block_slices += 1;
            for (kept, sums) in kept.sums.iter_mut().zip(&self.slice) {
                kept.copy_from(sums);
            }
            self.look(now_s);
        }
        self.slice.iter_mut().for_each(JointSums::clear);
    }

    fn look(&mut self, now_s: f64) {
        let doubt = self.watch.as_ref().map_or(0, |watch| watch.doubt);
        let slices = self.pending.len().min(WINDOW + doubt);
        if self.blocks < LEARNT_BLOCKS {
            return;
        }
        let older = self.pending.len() - slices;
        self.assemble_older(older);
        let Some(mut watch) = self.watch.take() else { return };
        watch.theta.copy_from_slice(&self.theta);
        watch.begin_s = self.pending.get(older).begin_s;
        let found = if self.solver.solve(&self.system, &self.fixed, &mut watch.theta) {
            self.effective_of(&watch.theta, &mut watch.effective);
            for (joint, window) in watch.window.iter_mut().enumerate() {
                window.clear();
                for age in older..self.pending.len() {
                    window.add(&self.pending.get(age).sums[joint]);
                }
            }
            self.weigh_window(&mut watch);
            self.judge(&mut watch)
        } else {
            None
        };
        self.watch = Some(watch);
        if let Some(cause) = found {
            self.take_over(cause, now_s);
        }
    }

    /// What acts as these parameters do, as parameters of the arm.
    fn effective_of(&self, theta: &[f64], out: &mut [f64]) {
        match self.payload.as_ref().filter(|_| self.is_loaded) {
            Some(payload) => payload.effective(theta, out),
            None => out.copy_from_slice(&theta[..out.len()]),
        }
    }

    /// Turns the sums of the window into information about the error of what was known before.
    fn weigh_window(&mut self, watch: &mut super::watch_room::Watch) {
        watch.data.clear();
        for joint in 0..watch.window.len() {
            if watch.window[joint].rows > 0 {
                watch.window[joint].shift(&watch.effective);
                let weight = self.weight(joint);
                let load = self.payload.as_mut().filter(|_| self.is_loaded);
                learn(&watch.window[joint], weight, load, &mut watch.data);
            }
        }
    }

    fn judge(&mut self, watch: &mut super::watch_room::Watch) -> Option<ChangeCause> {
        let (known, fixed) = (&self.system, &self.fixed);
        let payload = self.payload.as_ref()?;
        for (std, &i) in watch.friction_std.iter_mut().zip(&self.frictions) {
            *std = self.options.friction_change * watch.theta[i].abs().max(FRICTION_SIZE * self.parameters()[i].scale);
        }
        let nothing = watch.evidence.weigh(known, &watch.data, fixed, Extra::Nothing)?;
        let all = Extra::Parameters(&self.frictions, &watch.friction_std);
        let of_all = watch.evidence.weigh(known, &watch.data, fixed, all)? - nothing;
        let of_payload = watch
            .evidence
            .weigh(known, &watch.data, fixed, Extra::Payload(payload))?
            - nothing;
        if of_payload.max(of_all) < 0.0 {
            watch.doubt = 0;
            return None;
        }
        // Of what happens at once, friction changes at one joint; at all of them it does by and by.
        let (mut of_one, mut one) = (f64::NEG_INFINITY, all);
        let mut first = 0;
        for joint in 0..watch.window.len() {
            let last = first + self.model.friction_of(joint).len();
            let own = Extra::Parameters(&self.frictions[first..last], &watch.friction_std[first..last]);
            let gain = watch.evidence.weigh(known, &watch.data, fixed, own)? - nothing;
            if gain > of_one {
                (of_one, one) = (gain, own);
            }
            first = last;
        }
        if of_payload.max(of_all).max(of_one) < ALARM {
            watch.doubt = 0;
            return None;
        }
        let is_payload = of_payload > of_one + CLEAR && of_payload > of_all - BROAD;
        let is_friction = of_one.max(of_all) > of_payload + CLEAR;
        watch.doubt += 1;
        if watch.doubt == 1 || !(is_payload || is_friction || watch.doubt > DOUBTS) {
            return None;
        }
        watch.doubt = 0;
        let extra = match is_payload {
            true => Extra::Payload(payload),
            false if of_one > of_all => one,
            false => all,
        };
        watch.evidence.weigh(known, &watch.data, fixed, extra)?;
        // The step from what was known, as one of the arm's parameters.
        let arm = watch.effective.len();
        self.effective_of(&watch.evidence.delta, &mut watch.changed);
        let step = &mut watch.changed;
        extra.add(&watch.evidence.extra, step);
        let worst = watch
            .window
            .iter()
            .enumerate()
            .filter(|(_, sums)| sums.rows > 0)
            .map(|(j, sums)| {
                let level = self.torque_std[j] * self.inflation[j];
                (sums.residual_square(step) / sums.rows as f64).sqrt() / level
            })
            .fold(0.0, f64::max);
        for i in 0..arm {
            watch.changed[i] += watch.effective[i];
        }
        Some(match worst > UNEXPLAINED {
            true => ChangeCause::Unexplained,
            false if is_payload => ChangeCause::Payload,
            false => ChangeCause::Friction,
        })
    }

    /// The machine is another one from some instant on: what came before is learnt for the machine as it was, what came behind for what it is now.
    fn take_over(&mut self, cause: ChangeCause, now_s: f64) {
        let Some(mut watch) = self.watch.take() else { return };
        let begin = self.pending.get(0).begin_s;
        let t_s = locate(
            &self.ring,
            begin,
            &watch.effective,
            &watch.changed,
            &self.torque_std,
            |j| self.model.columns(j),
        );
        self.condense();
        self.pending.clear();
        self.block_slices = usize::from(cause != ChangeCause::Unexplained);
        let half = 0.5 * self.options.windows.length_s;
        // Windows that hold some of both are left out.
        let before = |t: f64| t >= begin && t < t_s - half;
        let behind = |t: f64| t >= t_s + half;
        self.sum_up(&mut watch.window, before);
        for joint in 0..watch.window.len() {
            if watch.window[joint].rows > 0 {
                let weight = self.weight(joint);
                let load = self.payload.as_mut().filter(|_| self.is_loaded);
                learn(&watch.window[joint], weight, load, &mut self.committed);
            }
        }
        if cause != ChangeCause::Unexplained {
            let kept = self.pending.push(t_s);
            let mut sums = std::mem::take(&mut kept.sums);
            self.sum_up(&mut sums, behind);
            self.pending.replace_newest(sums);
        }
        match cause {
            ChangeCause::Payload => {
                self.widen(SHAKEN);
                self.change_payload(&mut watch);
            }
            ChangeCause::Friction => self.widen(self.options.friction_change),
            ChangeCause::Unexplained => {}
        }
        self.forget_recent();
        watch.found = Some(RobotChange {
            cause,
            t_s,
            found_s: now_s,
        });
        self.watch = Some(watch);
    }

    /// Another payload, or none any more.
    fn change_payload(&mut self, watch: &mut super::watch_room::Watch) {
        let was_loaded = self.is_loaded;
        if was_loaded {
            self.marginalise_payload();
        }
        self.unload();
        if was_loaded {
            // Does it carry anything at all?
            self.assemble_older(0);
            watch.theta.copy_from_slice(&self.theta);
            if self.solver.solve(&self.system, &self.fixed, &mut watch.theta) {
                self.effective_of(&watch.theta, &mut watch.effective);
                for (window, sums) in watch.window.iter_mut().zip(&self.pending.get(0).sums) {
                    window.copy_from(sums);
                }
                self.weigh_window(watch);
                let (known, fixed) = (&self.system, &self.fixed);
                let nothing = watch.evidence.weigh(known, &watch.data, fixed, Extra::Nothing);
                let payload = self.payload.as_ref().map_or(Extra::Nothing, Extra::Payload);
                let something = watch.evidence.weigh(known, &watch.data, fixed, payload);
                if let (Some(nothing), Some(something)) = (nothing, something)
                    && something - nothing < CARRIES
                {
                    return;
                }
            }
        }
        self.load();
    }

    /// Sums of the kept rows that `wanted` picks by their time.
    fn sum_up(&self, sums: &mut [JointSums], wanted: impl Fn(f64) -> bool) {
        sums.iter_mut().for_each(JointSums::clear);
        for age in 0..self.ring.len() {
            let (at, instant) = self.ring.get(age);
            if !wanted(instant.t_s) {
                continue;
            }
            for (j, sums) in sums.iter_mut().enumerate() {
                if instant.torque[j].is_finite() {
                    let row = self.ring.regressor(at, j, self.model.columns(j).len());
                    sums.add_row(row, instant.torque[j]);
                }
            }
        }
        sums.iter_mut().for_each(JointSums::mirror);
    }
}

/// (3): the instant at which residuals by `before` become worse than those by `behind`.
fn locate<'a>(
    ring: &RowRing,
    begin: f64,
    before: &[f64],
    behind: &[f64],
    std: &[f64],
    columns: impl Fn(usize) -> &'a [usize],
) -> f64 {
    let (mut cost, mut least, mut t_s) = (0.0, 0.0, begin);
    // The instant before it, if the best border so far lies behind that one.
    let mut open: Option<f64> = None;
    for age in 0..ring.len() {
        let (at, instant) = ring.get(age);
        if instant.t_s < begin {
            continue;
        }
        if let Some(last) = open.take() {
            t_s = 0.5 * (last + instant.t_s);
        }
        for (j, std) in std.iter().enumerate() {
            if !instant.torque[j].is_finite() {
                continue;
            }
            let columns = columns(j);
            let row = ring.regressor(at, j, columns.len());
            let residual = |theta: &[f64]| -> f64 {
                let predicted: f64 = row.iter().zip(columns).map(|(x, &k)| x * theta[k]).sum();
                (instant.torque[j] - predicted) / std
            };
            cost += residual(before).powi(2) - residual(behind).powi(2); // (3)
        }
        if cost < least {
            (least, open) = (cost, Some(instant.t_s));
        }
    }
    open.unwrap_or(t_s)
}
