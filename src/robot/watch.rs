//! Test for changes: after each slice, the last slices are compared with the estimate before them,
//! see [`change`](super::change).

use super::change::{ChangeCause, RobotChange, Suspect};
use super::comparison::Comparison;
use super::doubt::RobotDoubt;
use super::inquiry::{Inquiry, broken};
use super::learning::Learner;

/// Number of slices compared with the estimate before them.
const WINDOW: usize = 4;
/// Number of slices before a change can be distinguished from what is still unknown. An earlier
/// payload is partly attributed to the arm.
pub(super) const LEARNT: usize = 8;
/// ln of the Bayes factor above which the machine has changed: a factor of 10⁸.
const ALARM: f64 = 18.0;
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
/// ln of the Bayes factor above which the flange is not empty.
const CARRIES: f64 = 3.0;
/// Time span of a row including the velocities in its window, in windows.
const REACH: f64 = 1.5;
/// Residuals after a change above this many σ_j f_j are not explained.
const UNEXPLAINED: f64 = 6.0;

/// What the learner has adopted after a slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Adopted {
    /// True if the blocks so far are of another machine.
    pub machine: bool,
    /// True if the payload may have changed.
    pub payload: bool,
}

/// Watches whether the machine changes.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    comparison: Comparison,
    /// Slices since a change was first suspected without a clear cause.
    doubt: usize,
    /// Slices in a row that a drive or an encoder explains.
    strange: usize,
    /// The change whose cause is still sought.
    inquiry: Inquiry,
    /// The change found since the block began.
    found: Option<RobotChange>,
}

impl Watch {
    /// Workspace for a learner; `zeros` are the parameters that are the zeros of the encoders.
    pub fn new(learner: &Learner, zeros: Vec<Option<[usize; 1]>>) -> Self {
        Self {
            comparison: Comparison::new(learner, zeros),
            doubt: 0,
            strange: 0,
            inquiry: Inquiry::new(learner),
            found: None,
        }
    }

    /// Forgets every suspicion.
    pub fn reset(&mut self) {
        (self.doubt, self.strange) = (0, 0);
        self.inquiry.close();
    }

    /// Forgets the present suspicion, because the payload is declared.
    pub fn forget_doubt(&mut self) {
        self.doubt = 0;
    }

    /// Why nothing may be used.
    pub fn doubt(&self) -> Option<RobotDoubt> {
        self.inquiry.doubt()
    }

    /// The change found since the last call.
    pub fn take_found(&mut self) -> Option<RobotChange> {
        self.found.take()
    }

    /// See [`Inquiry::swap_with_before`].
    pub fn swap_with_before(&mut self, learner: &mut Learner) -> bool {
        self.inquiry.swap_with_before(learner)
    }

    /// Begins an inquiry because an encoder has jumped.
    pub fn inquire(&mut self, learner: &mut Learner) {
        if !self.inquiry.is_open() && learner.blocks > 0 {
            learner.assemble(learner.now());
            self.inquiry.begin(learner);
        }
    }

    /// Tests whether the machine has changed, after a slice.
    pub fn look_at_slice(&mut self, learner: &mut Learner, now_s: f64) -> Adopted {
        if self.inquiry.is_open() {
            self.inquiry.take(learner.open.slice());
        }
        let suspect = self.test(learner);
        let cause = suspect.map(|suspect| self.take_over(learner, suspect, now_s));
        let is_restored = self.inquiry.review(&mut self.comparison, learner);
        Adopted {
            machine: cause.is_some() || is_restored,
            payload: cause == Some(ChangeCause::Payload),
        }
    }

    /// What has changed, with the changed machine fitted in `comparison`.
    fn test(&mut self, learner: &mut Learner) -> Option<Suspect> {
        let slices = learner.pending.len().min(WINDOW + self.doubt);
        if learner.blocks == 0 || learner.pending.seen() < LEARNT || !learner.has_enough_rows() {
            return None;
        }
        if !self.comparison.prepare(learner, slices) {
            return None;
        }
        let (suspect, slices) = self.judge(learner, slices)?;
        let is_fitted = self.comparison.prepare(learner, slices) && self.comparison.fit(learner, suspect);
        is_fitted.then_some(suspect)
    }

    /// The suspect that the last slices indicate, once that is clear, and their number.
    fn judge(&mut self, learner: &mut Learner, slices: usize) -> Option<(Suspect, usize)> {
        let payload = self.comparison.gain(learner, Suspect::Payload)?;
        if payload.max(self.comparison.gain(learner, Suspect::Friction(None))?) < ALARM {
            self.doubt = 0;
            self.suspect_drives(learner, slices);
            return None;
        }
        self.doubt += 1;
        if self.doubt == 1 {
            return None;
        }
        let [(of_payload, loaded), (of_all, rubbed)] = self.clearest(learner);
        // A sudden change of friction is at one joint; at all joints friction changes slowly.
        let (mut of_one, mut one) = (f64::NEG_INFINITY, Suspect::Friction(Some(0)));
        if self.comparison.prepare(learner, rubbed) {
            let joints = (0..learner.arm.joints()).map(|joint| Suspect::Friction(Some(joint)));
            if let Some((joint, gain)) = self.comparison.likeliest(learner, joints) {
                (of_one, one) = (gain, joint);
            }
        }
        let is_payload = of_payload > of_one + CLEAR && of_payload > of_all - BROAD.max(SHARE * of_all);
        let is_friction = of_one.max(of_all) > of_payload + CLEAR;
        if !(is_payload || is_friction || self.doubt > DOUBTS) {
            return None;
        }
        self.doubt = 0;
        Some(match is_payload {
            true => (Suspect::Payload, loaded),
            false if of_one > of_all => (one, rubbed),
            false => (Suspect::Friction(None), rubbed),
        })
    }

    /// The numbers of slices that give the largest gain for a payload and for friction, with the
    /// gains: a window that begins before the change fits neither well.
    fn clearest(&mut self, learner: &mut Learner) -> [(f64, usize); 2] {
        let mut best = [(f64::NEG_INFINITY, 1); 2];
        for slices in 1..=learner.pending.len() {
            if !self.comparison.prepare(learner, slices) {
                continue;
            }
            for (best, suspect) in best.iter_mut().zip([Suspect::Payload, Suspect::Friction(None)]) {
                if let Some(gain) = self.comparison.gain(learner, suspect)
                    && gain > best.0
                {
                    *best = (gain, slices);
                }
            }
        }
        best
    }

    /// Begins an inquiry if a gain or a zero explains the prepared window of `slices` slices.
    fn suspect_drives(&mut self, learner: &mut Learner, slices: usize) {
        let is_strange = broken(&mut self.comparison, learner).is_some_and(|(_, gain)| gain > ALARM);
        self.strange = if is_strange { self.strange + 1 } else { 0 };
        // a joint that starts to move vibrates for a moment
        if self.strange < 2 || self.inquiry.is_open() {
            return;
        }
        self.inquiry.begin(learner);
        for age in learner.pending.len() - slices..learner.pending.len() {
            self.inquiry.take(&learner.pending.get(age).sums);
        }
    }

    /// Adopts a change: data before its instant are used for the old machine, data after it for the
    /// changed one.
    fn take_over(&mut self, learner: &mut Learner, suspect: Suspect, now_s: f64) -> ChangeCause {
        let begin = learner.pending.get(0).begin_s;
        // blocks since then were compared with the old machine
        learner.levels.restore(begin);
        let half = 0.5 * REACH * learner.options.windows.length_s;
        let t_s = self.comparison.find_instant(learner, suspect, begin, half);
        let is_explained = self.comparison.fits_window(&learner.levels, UNEXPLAINED);
        let cause = match suspect {
            _ if !is_explained => ChangeCause::Unexplained,
            Suspect::Payload => ChangeCause::Payload,
            _ => ChangeCause::Friction,
        };
        learner.condense();
        learner.pending.clear();
        self.comparison.sum_up(learner, |t| t >= begin && t < t_s - half);
        learner
            .past
            .add(self.comparison.window(), &learner.levels, &mut learner.flange);
        if is_explained {
            self.begin_changed(learner, t_s, half);
        }
        match cause {
            ChangeCause::Payload => {
                learner.widen_friction(learner.options.payload_friction);
                self.change_payload(learner);
            }
            ChangeCause::Friction => learner.widen_friction(learner.options.friction_change),
            ChangeCause::Unexplained => {}
        }
        learner.forget_recent();
        self.found = Some(RobotChange {
            cause,
            t_s,
            found_s: now_s,
        });
        cause
    }

    /// Keeps the rows after the change as the first slice of the changed machine. An inquiry begins
    /// with them, unless one is open.
    fn begin_changed(&mut self, learner: &mut Learner, t_s: f64, half: f64) {
        let inquires = self.inquiry.gives_way();
        if inquires {
            learner.system.copy_from(learner.past.information());
            self.inquiry.begin(learner);
        }
        let slice = learner.pending.push_rows(t_s, &learner.arm.wide, |t| t >= t_s + half);
        if inquires {
            self.inquiry.take(&slice.sums);
        }
    }

    /// Changes or removes the payload.
    fn change_payload(&mut self, learner: &mut Learner) {
        let was_loaded = learner.flange.is_loaded();
        if was_loaded {
            learner.forget_payload();
        }
        learner.unload();
        let is_empty = was_loaded && self.comparison.payload_gain(learner).is_some_and(|gain| gain < CARRIES);
        if !is_empty {
            learner.load();
        }
    }
}
