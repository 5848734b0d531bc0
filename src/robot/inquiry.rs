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
use super::comparison::{Before, Comparison};
use super::doubt::RobotDoubt;
use super::learning::Learner;
use super::sums::JointSums;

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

/// Slices after which a named drive or encoder is final.
const FINAL: usize = 40;
/// Largest number of slices needed to detect another change.
const LEANS: usize = 4;

/// A change with all rows since.
#[derive(Debug, Clone)]
pub(super) struct Inquiry {
    /// The present doubt; `None` while there is no inquiry.
    doubt: Option<RobotDoubt>,
    /// The likeliest drive or encoder.
    suspect: Suspect,
    before: Before,
    /// The rows since, and the last of them.
    sums: Vec<JointSums>,
    last: Vec<JointSums>,
    /// Slices since.
    slices: usize,
    /// For the last slices, whether friction or a payload was clear except for the number of
    /// slices; oldest first.
    leans: [bool; LEANS],
}

impl Inquiry {
    /// Workspace of an inquiry.
    pub fn new(learner: &Learner) -> Self {
        let (n, acting) = (learner.estimate.n(), learner.estimate.effective().len());
        let empty = learner.arm.empty_sums();
        Self {
            doubt: None,
            suspect: Suspect::Gain(None),
            before: Before::new(n, acting, empty.len()),
            sums: empty.clone(),
            last: empty,
            slices: 0,
            leans: [false; LEANS],
        }
    }

    /// Why nothing may be used; `None` while there is no inquiry.
    pub fn doubt(&self) -> Option<RobotDoubt> {
        self.doubt
    }

    /// True while an inquiry is open.
    pub fn is_open(&self) -> bool {
        self.doubt.is_some()
    }

    /// True while its outcome may still change.
    fn is_pending(&self) -> bool {
        self.doubt == Some(RobotDoubt::Unclear) || self.is_open() && self.slices < FINAL
    }

    /// True if another change may begin an inquiry, because this one pointed to friction or a
    /// payload before the other change.
    pub fn gives_way(&self) -> bool {
        !self.is_open() || self.is_pending() && self.leans[0]
    }

    /// Ends it without an outcome.
    pub fn close(&mut self) {
        self.doubt = None;
    }

    /// Begins with the information in `system` as that before the change, and no rows.
    pub fn begin(&mut self, learner: &mut Learner) {
        if !self.before.keep(learner) {
            return;
        }
        self.sums.iter_mut().for_each(JointSums::clear);
        self.last.iter_mut().for_each(JointSums::clear);
        self.slices = 0;
        self.leans.fill(false);
        self.doubt = Some(RobotDoubt::Unclear);
    }

    /// Adds the rows of a slice.
    pub fn take(&mut self, rows: &[JointSums]) {
        self.slices += 1;
        let both = self.sums.iter_mut().zip(&mut self.last);
        for ((sums, last), rows) in both.zip(rows) {
            sums.add(rows);
            last.add(rows);
        }
    }

    /// (1) to (6) after a slice; true if the information from before is restored.
    pub fn review(&mut self, comparison: &mut Comparison, learner: &mut Learner) -> bool {
        let (was_open, mut is_restored) = (self.is_open(), false);
        if self.is_pending() {
            self.doubt = self.outcome(comparison, learner);
        }
        if was_open && self.slices.is_multiple_of(LEAST) {
            if self.is_open() && self.is_over(comparison, learner) {
                self.doubt = None; // (6)
                is_restored = self.restore(learner);
            }
            self.last.iter_mut().for_each(JointSums::clear);
        }
        is_restored
    }

    /// (1) to (5) over all rows since the change.
    fn outcome(&mut self, comparison: &mut Comparison, learner: &mut Learner) -> Option<RobotDoubt> {
        let unclear = Some(RobotDoubt::Unclear);
        if !comparison.prepare_against(learner, &self.before, &self.sums) {
            return unclear;
        }
        let (Some((ordinary, o)), Some((broken, b))) = (ordinary(comparison, learner), broken(comparison, learner))
        else {
            return unclear;
        };
        self.suspect = broken;
        let is_late = self.slices >= LEAST;
        if is_late && o.max(b) < NOTHING {
            return None; // (5)
        }
        self.leans.rotate_left(1);
        if let Some(lean) = self.leans.last_mut() {
            *lean = o > b + CLEAR;
        }
        let is_heavy = ordinary == Suspect::Payload && o > b + SHARE * o;
        if o > b + CLEAR && (is_late || is_heavy) && comparison.explains(learner, &self.before, ordinary, EXPLAINED) {
            return None; // (3)
        }
        if !(is_late && b > o + CLEAR) {
            return unclear;
        }
        let known = (&self.before.known, &self.before.fixed[..]);
        let by = comparison.weigh(learner, known, broken)?[0]; // (4)
        match broken {
            Suspect::Slip(joint) if by.abs() < UNSEEN_RAD => Some(RobotDoubt::Slip { joint, by }),
            Suspect::Gain(joint) if (NOTABLE..CREDIBLE).contains(&by.abs()) => Some(RobotDoubt::Gain { joint, by }),
            _ => unclear,
        }
    }

    /// (6).
    fn is_over(&self, comparison: &mut Comparison, learner: &mut Learner) -> bool {
        if !comparison.prepare_against(learner, &self.before, &self.last) {
            return false;
        }
        let likeliest = [ordinary(comparison, learner), broken(comparison, learner)];
        let is_nothing = |best: Option<(Suspect, f64)>| best.is_some_and(|(_, gain)| gain < NOTHING);
        let is_refuted = |gain: f64| gain < REFUTED;
        likeliest.map(is_nothing) == [true; 2] && comparison.gain(learner, self.suspect).is_some_and(is_refuted)
    }

    /// Restores the information from before the change, if the payload is the same.
    fn restore(&self, learner: &mut Learner) -> bool {
        if !self.before.is_of_present(learner) {
            return false;
        }
        learner.past.restore(&self.before.known);
        learner.pending.clear();
        learner.forget_recent();
        learner.solve_known();
        true
    }

    /// Swaps the present state with that before the change; false if there was none. `system` then
    /// holds the information from before.
    pub fn swap_with_before(&mut self, learner: &mut Learner) -> bool {
        if !self.is_open() {
            return false;
        }
        let before = &mut self.before;
        learner.system.copy_from(&before.known);
        learner.estimate.swap(&mut before.theta, &mut before.fixed);
        learner.flange.swap(&mut before.was_loaded);
        true
    }
}

/// (1).
fn ordinary(comparison: &mut Comparison, learner: &Learner) -> Option<(Suspect, f64)> {
    let one = (0..learner.arm.joints()).map(|joint| Suspect::Friction(Some(joint)));
    let all = [Suspect::Payload, Suspect::Friction(None)];
    comparison.likeliest(learner, all.into_iter().chain(one))
}

/// (2).
pub(super) fn broken(comparison: &mut Comparison, learner: &Learner) -> Option<(Suspect, f64)> {
    let joints = 0..learner.arm.joints();
    let turning = &learner.arm.model.robot().joints;
    let turns = joints.clone().filter(|&joint| turning[joint].turns);
    let one = joints.map(|joint| Suspect::Gain(Some(joint)));
    let all = [Suspect::Gain(None)].into_iter().chain(one);
    comparison.likeliest(learner, all.chain(turns.map(Suspect::Slip)))
}
