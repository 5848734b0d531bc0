//! Finds the cause of a change from all rows since: a drive or an encoder, or friction or payload.
//!
//! In the first second a changed drive gain, or an encoder that slips, resembles friction or a
//! payload: each can imitate the other's torques during half a second of motion. So a change is
//! *adopted* as `watch.rs` finds it, and an inquiry begins. It keeps the information from before
//! the change and accumulates every row since. After each slice it compares (2') of
//! [`change`](super::change) over all these rows between the suspects:
//!
//! ```text
//! o = max gain_E over payload, friction of one joint, of all joints                            (1)
//! b = max gain_E over the gain of a drive, of all drives alike, the zero of an encoder         (2)
//! o > b + CLEAR, and residuals of it ≤ EXPLAINED f_j σ_j:   the adopted change stays           (3)
//! b > o + CLEAR:                                            a drive or an encoder              (4)
//! o, b < NOTHING:                                           nothing has changed                (5)
//! o, b < NOTHING and gain_b < REFUTED in the last rows:     the fault has ended                (6)
//! ```
//!
//! It waits for [`LEAST`] slices, unless a payload explains much more than (2). Until (3), (5) or
//! (6) holds, and after (4) until (6) or a reset, nothing may be used: a changed gain scales
//! everything learnt afterwards, and a later mass would be estimated against the old arm. After (6)
//! the information from before is restored. The columns are those of `gain_columns.rs`, and the
//! derivatives of the weight with respect to a position.
//!
//! The result of (4) is reviewed for ten seconds, because without a reversal friction of a joint
//! explains the rows as well as a gain. Another change begins another inquiry if this one only
//! lacked slices; otherwise neither becomes clear.
//!
//! A gain or a zero that changes too little to raise a suspicion of friction or payload opens an
//! inquiry by itself. A slip that is a jump is found at once by `jump.rs` and also opens one.

use super::change::Suspect;
use super::identify::RobotIdentifier;
use super::inquiry_room::RobotDoubt;
use super::sums::JointSums;
use super::watch::ALARM;
use super::watch_room::Watch;
use crate::model::MAX_JOINTS;

/// ln of the Bayes factor required between the two kinds of causes.
const CLEAR: f64 = 10.0;
/// Below it, nothing has changed.
const NOTHING: f64 = 3.0;
/// The same relative to the gain of a payload, before there are [`LEAST`] slices.
const SHARE: f64 = 0.1;
/// ln of the Bayes factor below which the rows refute a change: they would have shown a seventh of
/// its prior standard deviation.
const REFUTED: f64 = -2.0;
/// Smallest number of slices, and the number of last slices in (6).
const LEAST: usize = 8;
/// Largest credible relative change of a gain: a load on a vertical axis also scales its force, to
/// a tenth or to three times. Beyond this the cause stays unclear.
const CREDIBLE: f64 = 0.5;
/// Smallest relative change of a gain that is named: a smaller one stands for something else, such
/// as elastic joints, and the cause stays unclear.
const NOTABLE: f64 = 0.02;
/// Largest slip that is named \[rad\]: a larger one would be seen as a jump of the position.
const UNSEEN_RAD: f64 = 0.1;
/// Residuals above this many f_j σ_j are not explained.
const EXPLAINED: f64 = 3.0;

impl RobotIdentifier {
    /// Why nothing may be used: a drive or an encoder has changed, or might have. `None` if there
    /// is no such doubt.
    pub fn doubt(&self) -> Option<RobotDoubt> {
        let inquired = || self.watch.as_ref()?.inquiry.doubt;
        self.jumps.found().or_else(inquired)
    }

    /// Begins an inquiry with the information in `system` as that before the change, and no rows.
    pub(super) fn begin_inquiry(&mut self, watch: &mut Watch) {
        let inquiry = &mut watch.inquiry;
        inquiry.known.copy_from(&self.system);
        inquiry.theta.copy_from_slice(&self.theta);
        inquiry.fixed.copy_from_slice(&self.fixed);
        if !self.solver.solve(&inquiry.known, &inquiry.fixed, &mut inquiry.theta) {
            return;
        }
        inquiry.was_loaded = self.is_loaded;
        for (joint, level) in inquiry.level.iter_mut().enumerate() {
            *level = self.torque_std[joint] * self.inflation[joint];
        }
        inquiry.sums.iter_mut().for_each(JointSums::clear);
        inquiry.last.iter_mut().for_each(JointSums::clear);
        inquiry.slices = 0;
        inquiry.leans.fill(false);
        inquiry.doubt = Some(RobotDoubt::Unclear);
        let inquiry = &mut watch.inquiry;
        self.effective_of(&inquiry.theta, self.now(), &mut inquiry.effective);
    }

    /// Begins an inquiry if a gain or a zero explains the last prepared window of `slices` slices.
    pub(super) fn suspect_drives(&mut self, watch: &mut Watch, slices: usize) {
        let is_strange = self.broken(watch).is_some_and(|(_, gain)| gain > ALARM);
        watch.strange = if is_strange { watch.strange + 1 } else { 0 };
        // a joint that starts to move vibrates for a moment
        if watch.strange < 2 || watch.inquiry.is_open() {
            return;
        }
        self.begin_inquiry(watch);
        for age in self.pending.len() - slices..self.pending.len() {
            watch.inquiry.take(&self.pending.get(age).sums);
        }
    }

    /// Adds the last slice to the inquiry, if one is open.
    pub(super) fn add_to_inquiry(&mut self) {
        if let Some(watch) = self.watch.as_mut().filter(|watch| watch.inquiry.is_open()) {
            watch.inquiry.take(&self.slice);
        }
    }

    /// (1) to (6).
    pub(super) fn inquire(&mut self) {
        let Some(mut watch) = self.watch.take() else { return };
        let doubt = watch.inquiry.doubt;
        if watch.inquiry.is_pending() {
            watch.inquiry.doubt = self.outcome(&mut watch);
        }
        if doubt.is_some() && watch.inquiry.slices.is_multiple_of(LEAST) {
            if watch.inquiry.is_open() && self.is_over(&mut watch) {
                watch.inquiry.doubt = None; // (6)
                self.restore(&watch);
            }
            watch.inquiry.last.iter_mut().for_each(JointSums::clear);
        }
        self.watch = Some(watch);
    }

    /// (1) to (5) over all rows since the change.
    fn outcome(&mut self, watch: &mut Watch) -> Option<RobotDoubt> {
        let unclear = Some(RobotDoubt::Unclear);
        if !self.prepare_inquiry(watch, false) {
            return unclear;
        }
        let (Some((ordinary, o)), Some((broken, b))) = (self.ordinary(watch), self.broken(watch)) else {
            return unclear;
        };
        watch.inquiry.suspect = broken;
        let is_late = watch.inquiry.slices >= LEAST;
        if is_late && o.max(b) < NOTHING {
            return None; // (5)
        }
        watch.inquiry.leans.rotate_left(1);
        if let Some(lean) = watch.inquiry.leans.last_mut() {
            *lean = o > b + CLEAR;
        }
        let is_heavy = ordinary == Suspect::Payload && o > b + SHARE * o;
        if o > b + CLEAR && (is_late || is_heavy) && self.is_explained(watch, ordinary) {
            return None; // (3)
        }
        if !(is_late && b > o + CLEAR) {
            return unclear;
        }
        self.weigh_suspect(watch, broken)?; // (4)
        let by = watch.evidence.extra[0];
        match broken {
            Suspect::Slip(joint) if by.abs() < UNSEEN_RAD => Some(RobotDoubt::Slip { joint, by }),
            Suspect::Gain(joint) if (NOTABLE..CREDIBLE).contains(&by.abs()) => Some(RobotDoubt::Gain { joint, by }),
            _ => unclear,
        }
    }

    /// (6).
    fn is_over(&mut self, watch: &mut Watch) -> bool {
        let suspect = watch.inquiry.suspect;
        if !self.prepare_inquiry(watch, true) {
            return false;
        }
        let least = [self.ordinary(watch), self.broken(watch)].map(|best| best.is_some_and(|(_, gain)| gain < NOTHING));
        least == [true; 2] && self.gain(watch, suspect).is_some_and(|gain| gain < REFUTED)
    }

    /// Restores the information from before the change, if the payload is the same.
    fn restore(&mut self, watch: &Watch) {
        let inquiry = &watch.inquiry;
        if inquiry.was_loaded != self.is_loaded || inquiry.fixed != self.fixed {
            return;
        }
        if !self.condensed {
            self.offset_drift.end();
        }
        self.condensed = true;
        self.committed.copy_from(&inquiry.known);
        self.pending.clear();
        self.block_slices = 0;
        self.forget_recent();
        self.solve_known();
    }

    /// Prepares the comparison of all rows since, or of the last ones, with the information from
    /// before; false if that cannot be solved.
    fn prepare_inquiry(&mut self, watch: &mut Watch, last: bool) -> bool {
        let inquiry = &watch.inquiry;
        watch.theta.copy_from_slice(&inquiry.theta);
        watch.effective.copy_from_slice(&inquiry.effective);
        let sums = if last { &inquiry.last } else { &inquiry.sums };
        for (window, sums) in watch.window.iter_mut().zip(sums) {
            window.copy_from(sums);
        }
        let mut weight = [0.0; MAX_JOINTS];
        for (weight, level) in weight.iter_mut().zip(&inquiry.level) {
            *weight = level.powi(-2);
        }
        let was_loaded = inquiry.was_loaded;
        self.weigh_rows(watch, &weight, was_loaded);
        self.set_friction_std(watch);
        watch
            .evidence
            .begin(&watch.inquiry.known, &watch.data, &watch.inquiry.fixed)
    }

    /// Swaps the present state with that before the change; false if there was none. `system` then
    /// holds the information from before.
    pub(super) fn swap_with_before(&mut self) -> bool {
        let Some(watch) = self.watch.as_mut().filter(|watch| watch.inquiry.is_open()) else {
            return false;
        };
        let inquiry = &mut watch.inquiry;
        self.system.copy_from(&inquiry.known);
        std::mem::swap(&mut self.theta, &mut inquiry.theta);
        std::mem::swap(&mut self.fixed, &mut inquiry.fixed);
        std::mem::swap(&mut self.is_loaded, &mut inquiry.was_loaded);
        true
    }

    /// Begins an inquiry if an encoder has jumped.
    pub(super) fn inquire_after_jump(&mut self) {
        let Some(mut watch) = self.watch.take() else { return };
        if !watch.inquiry.is_open() && self.blocks > 0 {
            self.assemble(self.now());
            self.begin_inquiry(&mut watch);
        }
        self.watch = Some(watch);
    }

    /// The likeliest of these suspects on the last prepared rows.
    fn likeliest(&self, watch: &mut Watch, suspects: impl Iterator<Item = Suspect>) -> Option<(Suspect, f64)> {
        let mut best: Option<(Suspect, f64)> = None;
        for suspect in suspects {
            if let Some(gain) = self.gain(watch, suspect)
                && best.is_none_or(|(_, most)| gain > most)
            {
                best = Some((suspect, gain));
            }
        }
        best
    }

    /// (1).
    fn ordinary(&self, watch: &mut Watch) -> Option<(Suspect, f64)> {
        let one = (0..self.torque_std.len()).map(|joint| Suspect::Friction(Some(joint)));
        self.likeliest(
            watch,
            [Suspect::Payload, Suspect::Friction(None)].into_iter().chain(one),
        )
    }

    /// (2).
    fn broken(&self, watch: &mut Watch) -> Option<(Suspect, f64)> {
        let joints = 0..self.torque_std.len();
        let turns = joints.clone().filter(|&joint| self.model.robot().joints[joint].turns);
        let one = joints.map(|joint| Suspect::Gain(Some(joint)));
        let all = [Suspect::Gain(None)].into_iter().chain(one);
        self.likeliest(watch, all.chain(turns.map(Suspect::Slip)))
    }

    /// δ and x of a suspect on the last prepared rows, in `watch.evidence`.
    fn weigh_suspect(&self, watch: &mut Watch, suspect: Suspect) -> Option<f64> {
        let extra = self.extra(suspect, &watch.friction_std, &watch.gains);
        let inquiry = &watch.inquiry;
        watch.evidence.weigh(&inquiry.known, &watch.data, &inquiry.fixed, extra)
    }

    /// True if the residuals with this suspect are no larger than usual.
    fn is_explained(&self, watch: &mut Watch, suspect: Suspect) -> bool {
        if self.weigh_suspect(watch, suspect).is_none() {
            return false;
        }
        let Watch { evidence, changed, .. } = watch;
        self.effective_if(watch.inquiry.was_loaded, &evidence.delta, changed);
        let extra = self.extra(suspect, &watch.friction_std, &watch.gains);
        extra.add(&evidence.extra, changed);
        // the origin of the sums is the estimate from before
        watch.window.iter().zip(&watch.inquiry.level).all(|(sums, level)| {
            let allowed = (EXPLAINED * level).powi(2) * sums.rows as f64;
            sums.residual_square(changed) <= allowed
        })
    }
}
