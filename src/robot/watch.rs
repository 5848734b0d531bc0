//! Test for changes: after each slice, the last slices are compared with the estimate before them,
//! see [`change`](super::change).

use super::change::{ChangeCause, Extra, RobotChange, Suspect};
use super::gain_columns::GainColumns;
use super::identify::RobotIdentifier;
use super::learning::learn;
use super::offset_drift::Origin;
use super::recent::RowRing;
use super::sums::JointSums;
use super::watch_room::Watch;
use crate::model::MAX_JOINTS;

/// Number of slices compared with the estimate before them.
const WINDOW: usize = 4;
/// Number of slices before a change can be distinguished from what is still unknown. An earlier
/// payload is partly attributed to the arm.
pub(super) const LEARNT: usize = 8;
/// ln of the Bayes factor above which the machine has changed: a factor of 10⁸.
pub(super) const ALARM: f64 = 18.0;
/// ln of the Bayes factor by which a payload must exceed friction of one joint, and by which it may
/// fall short of friction of all joints.
const CLEAR: f64 = 5.0;
const BROAD: f64 = 10.0;
/// The same relative to the gain of friction of all joints, because rows during the change fit
/// neither.
const SHARE: f64 = 0.15;
/// Largest number of slices to distinguish them; the first is always awaited, because a joint that
/// starts to move vibrates for a moment.
const DOUBTS: usize = 4;
/// Smallest size of a friction parameter, relative to its prior.
const FRICTION_SIZE: f64 = 0.02;
/// ln of the Bayes factor above which the flange is not empty.
const CARRIES: f64 = 3.0;
/// Time span of a row including the velocities in its window, in windows.
const REACH: f64 = 1.5;
/// Residuals after a change above this many σ_j f_j are not explained.
const UNEXPLAINED: f64 = 6.0;
/// Standard deviation of a gain's relative change, and of an encoder's slip \[rad\].
const GAIN_STD: f64 = 0.1;
const SLIP_STD: [f64; 1] = [0.05];

impl RobotIdentifier {
    /// Ends the open slice: adds it to the block, keeps it separate, and tests whether the machine
    /// has changed.
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
            self.slices += 1;
            let kept = self.pending.push(self.slice_begin);
            self.block_slices += 1;
            for (kept, sums) in kept.sums.iter_mut().zip(&self.slice) {
                kept.copy_from(sums);
            }
            self.add_to_inquiry();
            self.test_for_change(now_s);
            self.inquire();
        }
        self.slice.iter_mut().for_each(JointSums::clear);
    }

    fn test_for_change(&mut self, now_s: f64) {
        let doubt = self.watch.as_ref().map_or(0, |watch| watch.doubt);
        let slices = self.pending.len().min(WINDOW + doubt);
        if self.blocks == 0 || self.slices < LEARNT || !self.has_enough_rows() {
            return;
        }
        let Some(mut watch) = self.watch.take() else { return };
        let mut found = None;
        if self.prepare(&mut watch, slices)
            && let Some((suspect, slices)) = self.judge(&mut watch, slices)
            && self.prepare(&mut watch, slices)
            && self.fit(&mut watch, suspect)
        {
            found = Some(suspect);
        }
        self.watch = Some(watch);
        if let Some(suspect) = found {
            self.take_over(suspect, now_s);
        }
    }

    /// Prepares the comparison of the last slices with the estimate before them; false if that
    /// cannot be solved.
    fn prepare(&mut self, watch: &mut Watch, slices: usize) -> bool {
        let older = self.pending.len().saturating_sub(slices);
        let now = self.now();
        self.assemble_older(older, now);
        watch.theta.copy_from_slice(&self.theta);
        if !self.solver.solve(&self.system, &self.fixed, &mut watch.theta) {
            return false;
        }
        self.effective_of(&watch.theta, now, &mut watch.effective);
        for (joint, window) in watch.window.iter_mut().enumerate() {
            window.clear();
            for age in older..self.pending.len() {
                window.add(&self.pending.get(age).sums[joint]);
            }
        }
        self.weigh_window(watch);
        self.set_friction_std(watch);
        watch.evidence.begin(&self.system, &watch.data, &self.fixed)
    }

    /// Sets the standard deviation of a sudden change of friction.
    pub(super) fn set_friction_std(&self, watch: &mut Watch) {
        for (std, &i) in watch.friction_std.iter_mut().zip(&self.frictions) {
            *std = self.options.friction_change * watch.theta[i].abs().max(FRICTION_SIZE * self.parameters()[i].scale);
        }
    }

    /// The parameters of an arm that is equivalent to these parameters with offsets at `origin`.
    pub(super) fn effective_of(&self, theta: &[f64], origin: Origin, out: &mut [f64]) {
        self.effective_if(self.is_loaded, theta, out);
        self.offset_drift.add_to(out, origin);
    }

    /// The same with or without a payload, and without slopes of the offsets.
    pub(super) fn effective_if(&self, is_loaded: bool, theta: &[f64], out: &mut [f64]) {
        out[theta.len()..].fill(0.0);
        match self.payload.as_ref().filter(|_| is_loaded) {
            Some(payload) => payload.effective(theta, out),
            None => out[..theta.len()].copy_from_slice(theta),
        }
    }

    /// Converts the sums of the window to information on the error of the estimate before it.
    fn weigh_window(&mut self, watch: &mut Watch) {
        let mut weight = [0.0; MAX_JOINTS];
        for (joint, weight) in weight.iter_mut().enumerate().take(watch.window.len()) {
            *weight = self.weight(joint);
        }
        self.weigh_rows(watch, &weight, self.is_loaded);
    }

    /// The same with these weights of the joints' rows, with or without a payload.
    pub(super) fn weigh_rows(&mut self, watch: &mut Watch, weight: &[f64; MAX_JOINTS], is_loaded: bool) {
        let Watch {
            window,
            data,
            gains,
            effective,
            ..
        } = watch;
        data.clear();
        gains.clear();
        for (joint, sums) in window.iter_mut().enumerate().filter(|(_, sums)| sums.rows > 0) {
            sums.shift(effective);
            let load = self.payload.as_mut().filter(|_| is_loaded);
            learn(sums, weight[joint], load, data);
            let load = self.payload.as_ref().filter(|_| is_loaded);
            gains.take(joint, sums, effective, weight[joint], load);
        }
    }

    /// The columns of a suspect; `std` are the standard deviations of friction.
    pub(super) fn extra<'a>(&'a self, suspect: Suspect, std: &'a [f64], gains: &'a GainColumns) -> Extra<'a> {
        match (suspect, &self.payload) {
            (Suspect::Payload, Some(payload)) => Extra::Payload(payload),
            (Suspect::Payload, None) => Extra::Nothing,
            (Suspect::Friction(None), _) => Extra::Parameters(&self.frictions, std),
            (Suspect::Friction(Some(joint)), _) => {
                let first: usize = (0..joint).map(|j| self.model.friction_of(j).len()).sum();
                let own = first..first + self.model.friction_of(joint).len();
                Extra::Parameters(&self.frictions[own.clone()], &std[own])
            }
            (Suspect::Gain(joint), _) => Extra::Column(gains.of(joint), GAIN_STD),
            (Suspect::Slip(joint), _) => {
                let zero = self.left_out.as_ref().and_then(|left_out| left_out.zero(joint));
                zero.map_or(Extra::Nothing, |index| Extra::Parameters(index, &SLIP_STD))
            }
        }
    }

    /// ln of the Bayes factor of a suspect on the last [prepared](Self::prepare) window.
    pub(super) fn gain(&self, watch: &mut Watch, suspect: Suspect) -> Option<f64> {
        let extra = self.extra(suspect, &watch.friction_std, &watch.gains);
        watch.evidence.gain(&watch.data, extra)
    }

    /// The numbers of slices that give the largest gain for a payload and for friction, with the
    /// gains: a window that begins before the change fits neither well.
    fn clearest(&mut self, watch: &mut Watch) -> [(f64, usize); 2] {
        let mut best = [(f64::NEG_INFINITY, 1); 2];
        for slices in 1..=self.pending.len() {
            if !self.prepare(watch, slices) {
                continue;
            }
            for (best, suspect) in best.iter_mut().zip([Suspect::Payload, Suspect::Friction(None)]) {
                if let Some(gain) = self.gain(watch, suspect)
                    && gain > best.0
                {
                    *best = (gain, slices);
                }
            }
        }
        best
    }

    /// The suspect that the last slices indicate, once that is clear, and their number.
    fn judge(&mut self, watch: &mut Watch, slices: usize) -> Option<(Suspect, usize)> {
        let payload = self.gain(watch, Suspect::Payload)?;
        if payload.max(self.gain(watch, Suspect::Friction(None))?) < ALARM {
            watch.doubt = 0;
            self.suspect_drives(watch, slices);
            return None;
        }
        watch.doubt += 1;
        if watch.doubt == 1 {
            return None;
        }
        let [(of_payload, loaded), (of_all, rubbed)] = self.clearest(watch);
        // A sudden change of friction is at one joint; at all joints friction changes slowly.
        let (mut of_one, mut one) = (f64::NEG_INFINITY, 0);
        let joints = match self.prepare(watch, rubbed) {
            true => watch.window.len(),
            false => 0,
        };
        for joint in 0..joints {
            if let Some(gain) = self.gain(watch, Suspect::Friction(Some(joint)))
                && gain > of_one
            {
                (of_one, one) = (gain, joint);
            }
        }
        let is_payload = of_payload > of_one + CLEAR && of_payload > of_all - BROAD.max(SHARE * of_all);
        let is_friction = of_one.max(of_all) > of_payload + CLEAR;
        if !(is_payload || is_friction || watch.doubt > DOUBTS) {
            return None;
        }
        watch.doubt = 0;
        Some(match is_payload {
            true => (Suspect::Payload, loaded),
            false => (Suspect::Friction((of_one > of_all).then_some(one)), rubbed),
        })
    }

    /// Estimates the machine in the window as if this suspect had changed. Returns false and keeps
    /// the previous estimate if it cannot be solved.
    fn fit(&self, watch: &mut Watch, suspect: Suspect) -> bool {
        let extra = self.extra(suspect, &watch.friction_std, &watch.gains);
        let fitted = watch.evidence.weigh(&self.system, &watch.data, &self.fixed, extra);
        if fitted.is_none() {
            return false;
        }
        // The step from the previous estimate, as a step of the arm's parameters.
        self.effective_if(self.is_loaded, &watch.evidence.delta, &mut watch.changed);
        extra.add(&watch.evidence.extra, &mut watch.changed);
        for (changed, effective) in watch.changed.iter_mut().zip(&watch.effective) {
            *changed += effective;
        }
        true
    }

    /// Adopts a change: data before its instant are used for the old machine, data after it for the
    /// changed one.
    fn take_over(&mut self, suspect: Suspect, now_s: f64) {
        let Some(mut watch) = self.watch.take() else { return };
        let begin = self.pending.get(0).begin_s;
        self.restore_levels(begin);
        let half = 0.5 * REACH * self.options.windows.length_s;
        let t_s = self.find_instant(&mut watch, suspect, begin, half);
        // the rows refer to the old machine
        for (changed, effective) in watch.changed.iter_mut().zip(&watch.effective) {
            *changed -= effective;
        }
        let is_explained = self.fits_window(&watch);
        let cause = match suspect {
            _ if !is_explained => ChangeCause::Unexplained,
            Suspect::Payload => ChangeCause::Payload,
            _ => ChangeCause::Friction,
        };
        self.condense();
        self.pending.clear();
        self.block_slices = usize::from(is_explained);
        self.sum_up(&mut watch.window, |t| t >= begin && t < t_s - half);
        for joint in 0..watch.window.len() {
            if watch.window[joint].rows > 0 {
                let weight = self.weight(joint);
                let load = self.payload.as_mut().filter(|_| self.is_loaded);
                learn(&watch.window[joint], weight, load, &mut self.committed);
            }
        }
        let inquires = is_explained && watch.inquiry.gives_way();
        if inquires {
            self.system.copy_from(&self.committed);
            self.begin_inquiry(&mut watch);
        }
        if is_explained {
            let kept = self.pending.push(t_s);
            let mut sums = std::mem::take(&mut kept.sums);
            self.sum_up(&mut sums, |t| t >= t_s + half);
            if inquires {
                watch.inquiry.take(&sums);
            }
            self.pending.replace_newest(sums);
        }
        match cause {
            ChangeCause::Payload => {
                self.widen(self.options.payload_friction);
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

    /// Restores the noise levels of before `begin`: blocks since then were compared with the old
    /// machine.
    fn restore_levels(&mut self, begin: f64) {
        if let Some(levels) = self.levels.before(begin) {
            let joints = self.torque_std.len();
            self.torque_std.copy_from_slice(&levels.torque_std[..joints]);
            self.inflation.copy_from_slice(&levels.inflation[..joints]);
        }
    }

    /// The instant of a change after `begin`; fits the machine to the rows that begin after it.
    /// A window reaches `half` to either side.
    fn find_instant(&mut self, watch: &mut Watch, suspect: Suspect, begin: f64, half: f64) -> f64 {
        let mut t_s = begin;
        // twice, because windows that contain both machines spoil the first fit
        for _ in 0..2 {
            t_s = locate(
                &self.ring,
                begin,
                &watch.effective,
                &watch.changed,
                &self.torque_std,
                |j| self.wide.columns(j),
            );
            self.sum_up(&mut watch.window, |t| t >= t_s + half);
            self.weigh_window(watch);
            self.fit(watch, suspect);
        }
        t_s
    }

    /// True if the rows of the window fit the machine with the difference in `changed`.
    fn fits_window(&self, watch: &Watch) -> bool {
        watch.window.iter().enumerate().all(|(j, sums)| {
            let level = self.torque_std[j] * self.inflation[j];
            let allowed = (UNEXPLAINED * level).powi(2) * sums.rows as f64;
            sums.residual_square(&watch.changed) <= allowed
        })
    }

    /// Changes or removes the payload.
    fn change_payload(&mut self, watch: &mut Watch) {
        let was_loaded = self.is_loaded;
        if was_loaded {
            self.marginalise_payload();
        }
        self.unload();
        if was_loaded {
            // Test whether there is any payload.
            let now = self.now();
            self.assemble_older(0, now);
            watch.theta.copy_from_slice(&self.theta);
            if self.solver.solve(&self.system, &self.fixed, &mut watch.theta) {
                self.effective_of(&watch.theta, now, &mut watch.effective);
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

    /// Sums of the rows for whose time `wanted` is true.
    fn sum_up(&self, sums: &mut [JointSums], wanted: impl Fn(f64) -> bool) {
        sums.iter_mut().for_each(JointSums::clear);
        for age in 0..self.ring.len() {
            let (at, instant) = self.ring.get(age);
            if !wanted(instant.t_s) {
                continue;
            }
            for (j, sums) in sums.iter_mut().enumerate() {
                if instant.torque[j].is_finite() {
                    let row = self.ring.regressor(at, j, self.wide.columns(j).len());
                    sums.add_row(row, instant.torque[j]);
                }
            }
        }
        sums.iter_mut().for_each(JointSums::mirror);
    }
}

/// (3): the instant at which residuals with `before` become larger than those with `behind`.
fn locate<'a>(
    ring: &RowRing,
    begin: f64,
    before: &[f64],
    behind: &[f64],
    std: &[f64],
    columns: impl Fn(usize) -> &'a [usize],
) -> f64 {
    let (mut cost, mut least, mut t_s) = (0.0, 0.0, begin);
    // The instant before it, if the best boundary so far lies after that one.
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
