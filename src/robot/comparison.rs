//! Comparison of rows with the estimate before them, by (1) and (2') of [`change`](super::change).

use super::change::{Evidence, Extra, Suspect};
use super::gain_columns::GainColumns;
use super::information::Information;
use super::learning::Learner;
use super::levels::MisfitLevels;
use super::spatial::BODY_PARAMETERS;
use super::sums::JointSums;
use crate::model::MAX_JOINTS;

/// Smallest size of a friction parameter, relative to its prior.
const FRICTION_SIZE: f64 = 0.02;
/// Standard deviation of a gain's relative change, and of an encoder's slip \[rad\].
const GAIN_STD: f64 = 0.1;
const SLIP_STD: [f64; 1] = [0.05];

/// What is known of the machine before a change.
#[derive(Debug, Clone)]
pub(super) struct Before {
    pub known: Information,
    pub theta: Vec<f64>,
    effective: Vec<f64>,
    pub fixed: Vec<bool>,
    pub was_loaded: bool,
    /// σ_j f_j.
    level: Vec<f64>,
}

impl Before {
    /// Workspace for this many parameters, effective parameters and joints.
    pub fn new(parameters: usize, acting: usize, joints: usize) -> Self {
        Self {
            known: Information::new(parameters),
            theta: vec![0.0; parameters],
            effective: vec![0.0; acting],
            fixed: vec![false; parameters],
            was_loaded: false,
            level: vec![0.0; joints],
        }
    }

    /// Keeps what the information in `system` tells; false if it cannot be solved.
    pub fn keep(&mut self, learner: &mut Learner) -> bool {
        self.known.copy_from(&learner.system);
        self.theta.copy_from_slice(learner.estimate.theta());
        self.fixed.copy_from_slice(learner.estimate.fixed());
        if !learner.solver.solve(&self.known, &self.fixed, &mut self.theta) {
            return false;
        }
        self.was_loaded = learner.flange.is_loaded();
        for (joint, level) in self.level.iter_mut().enumerate() {
            *level = learner.levels.level(joint);
        }
        learner.effective_of(&self.theta, learner.now(), &mut self.effective);
        true
    }

    /// True if the same parameters are fixed now, and the payload has not come or gone.
    pub fn is_of_present(&self, learner: &Learner) -> bool {
        self.was_loaded == learner.flange.is_loaded() && self.fixed == learner.estimate.fixed()
    }
}

/// The columns of what may have changed.
#[derive(Debug, Clone)]
struct Suspects {
    /// Standard deviations of a sudden change of friction.
    friction_std: Vec<f64>,
    gains: GainColumns,
    /// The parameter that is the zero of a joint's encoder.
    zeros: Vec<Option<[usize; 1]>>,
}

impl Suspects {
    fn of<'a>(&'a self, suspect: Suspect, learner: &'a Learner) -> Extra<'a> {
        let (friction, std) = (learner.friction.parameters(), &self.friction_std);
        match suspect {
            Suspect::Payload => learner.flange.payload().map_or(Extra::Nothing, Extra::Payload),
            Suspect::Friction(None) => Extra::Parameters(friction, std),
            Suspect::Friction(Some(joint)) => {
                let own = learner.friction.of_joint(joint);
                Extra::Parameters(&friction[own.clone()], &std[own])
            }
            Suspect::Gain(joint) => Extra::Column(self.gains.of(joint), GAIN_STD),
            Suspect::Slip(joint) => match &self.zeros[joint] {
                Some(index) => Extra::Parameters(index, &SLIP_STD),
                None => Extra::Nothing,
            },
        }
    }

    /// Sets the standard deviations of a sudden change of friction from this estimate.
    fn set_friction_std(&mut self, theta: &[f64], learner: &Learner) {
        for (std, &i) in self.friction_std.iter_mut().zip(learner.friction.parameters()) {
            let least = FRICTION_SIZE * learner.arm.parameters[i].scale;
            *std = learner.options.friction_change * theta[i].abs().max(least);
        }
    }
}

/// Rows, and the estimate before them.
#[derive(Debug, Clone)]
pub(super) struct Comparison {
    evidence: Evidence,
    /// Sums of the rows, with the gradient at the estimate before them.
    window: Vec<JointSums>,
    /// The same as information.
    data: Information,
    /// The estimate before: all parameters, and as an equivalent arm.
    theta: Vec<f64>,
    effective: Vec<f64>,
    /// The changed machine as an equivalent arm.
    changed: Vec<f64>,
    suspects: Suspects,
}

impl Comparison {
    /// Workspace for a learner; `zeros` are the parameters that are the zeros of the encoders.
    pub fn new(learner: &Learner, zeros: Vec<Option<[usize; 1]>>) -> Self {
        let (n, acting) = (learner.estimate.n(), learner.estimate.effective().len());
        let frictions = learner.friction.parameters().len();
        let empty = learner.arm.empty_sums();
        Self {
            evidence: Evidence::new(n, frictions.max(BODY_PARAMETERS)),
            data: Information::new(n),
            theta: vec![0.0; n],
            effective: vec![0.0; acting],
            changed: vec![0.0; acting],
            suspects: Suspects {
                friction_std: vec![0.0; frictions],
                gains: GainColumns::new(empty.len(), n),
                zeros,
            },
            window: empty,
        }
    }

    /// Sums of the rows.
    pub fn window(&self) -> &[JointSums] {
        &self.window
    }

    /// Prepares the comparison of the last slices with the estimate before them; false if that
    /// cannot be solved.
    pub fn prepare(&mut self, learner: &mut Learner, slices: usize) -> bool {
        let older = learner.pending.len().saturating_sub(slices);
        if !self.estimate_before(learner, older) {
            return false;
        }
        for (joint, window) in self.window.iter_mut().enumerate() {
            window.clear();
            for age in older..learner.pending.len() {
                window.add(&learner.pending.get(age).sums[joint]);
            }
        }
        self.weigh_window(learner);
        self.suspects.set_friction_std(&self.theta, learner);
        self.evidence
            .begin(&learner.system, &self.data, learner.estimate.fixed())
    }

    /// Prepares the comparison of these rows with what was known before a change; false if that
    /// cannot be solved.
    pub fn prepare_against(&mut self, learner: &mut Learner, before: &Before, rows: &[JointSums]) -> bool {
        self.theta.copy_from_slice(&before.theta);
        self.effective.copy_from_slice(&before.effective);
        for (window, sums) in self.window.iter_mut().zip(rows) {
            window.copy_from(sums);
        }
        let mut weight = [0.0; MAX_JOINTS];
        for (weight, level) in weight.iter_mut().zip(&before.level) {
            *weight = level.powi(-2);
        }
        self.weigh_rows(learner, &weight, before.was_loaded);
        self.suspects.set_friction_std(&self.theta, learner);
        self.evidence.begin(&before.known, &self.data, &before.fixed)
    }

    /// The estimate from all data but the slices from `older` on; false if it cannot be solved.
    fn estimate_before(&mut self, learner: &mut Learner, older: usize) -> bool {
        let now = learner.now();
        learner.assemble_older(older, now);
        self.theta.copy_from_slice(learner.estimate.theta());
        let fixed = learner.estimate.fixed();
        if !learner.solver.solve(&learner.system, fixed, &mut self.theta) {
            return false;
        }
        learner.effective_of(&self.theta, now, &mut self.effective);
        true
    }

    /// Converts the sums of the window to information on the error of the estimate before it.
    fn weigh_window(&mut self, learner: &mut Learner) {
        let mut weight = [0.0; MAX_JOINTS];
        for (joint, weight) in weight.iter_mut().enumerate().take(self.window.len()) {
            *weight = learner.levels.weight(joint);
        }
        self.weigh_rows(learner, &weight, learner.flange.is_loaded());
    }

    /// The same with these weights of the joints' rows, with or without a payload.
    fn weigh_rows(&mut self, learner: &mut Learner, weight: &[f64; MAX_JOINTS], is_loaded: bool) {
        self.data.clear();
        self.suspects.gains.clear();
        for (joint, sums) in self.window.iter_mut().enumerate().filter(|(_, sums)| sums.rows > 0) {
            sums.shift(&self.effective);
            let flange = &mut learner.flange;
            flange.learn_if(is_loaded, sums, weight[joint], &mut self.data);
            let load = flange.payload_if(is_loaded);
            self.suspects
                .gains
                .take(joint, sums, &self.effective, weight[joint], load);
        }
    }

    /// ln of the Bayes factor of a suspect on the rows prepared last.
    pub fn gain(&mut self, learner: &Learner, suspect: Suspect) -> Option<f64> {
        self.evidence.gain(&self.data, self.suspects.of(suspect, learner))
    }

    /// The likeliest of these suspects on the rows prepared last, with its gain.
    pub fn likeliest(&mut self, learner: &Learner, suspects: impl Iterator<Item = Suspect>) -> Option<(Suspect, f64)> {
        let mut best: Option<(Suspect, f64)> = None;
        for suspect in suspects {
            if let Some(gain) = self.gain(learner, suspect)
                && best.is_none_or(|(_, most)| gain > most)
            {
                best = Some((suspect, gain));
            }
        }
        best
    }

    /// δ and x of a suspect on the rows prepared last; x. The rows refer to `known`.
    pub fn weigh(
        &mut self,
        learner: &Learner,
        (known, fixed): (&Information, &[bool]),
        suspect: Suspect,
    ) -> Option<&[f64]> {
        let extra = self.suspects.of(suspect, learner);
        self.evidence.weigh(known, &self.data, fixed, extra)?;
        Some(&self.evidence.extra)
    }

    /// How far a [weighed](Self::weigh) suspect moves the machine, in `changed`.
    fn step(&mut self, learner: &Learner, suspect: Suspect, is_loaded: bool) {
        let flange = &learner.flange;
        flange.effective_if(is_loaded, &self.evidence.delta, &mut self.changed);
        let extra = self.suspects.of(suspect, learner);
        extra.add(&self.evidence.extra, &mut self.changed);
    }

    /// Estimates the machine in the window as if this suspect had changed. Returns false and keeps
    /// the previous estimate if it cannot be solved.
    pub fn fit(&mut self, learner: &Learner, suspect: Suspect) -> bool {
        let known = (&learner.system, learner.estimate.fixed());
        if self.weigh(learner, known, suspect).is_none() {
            return false;
        }
        self.step(learner, suspect, learner.flange.is_loaded());
        for (changed, effective) in self.changed.iter_mut().zip(&self.effective) {
            *changed += effective;
        }
        true
    }

    /// The instant of a change after `begin`, from the machine [fitted](Self::fit) behind it; fits
    /// the machine to the rows that begin after it. A window reaches `half` to either side.
    pub fn find_instant(&mut self, learner: &mut Learner, suspect: Suspect, begin: f64, half: f64) -> f64 {
        let mut t_s = begin;
        // twice, because windows that contain both machines spoil the first fit
        for _ in 0..2 {
            let (rows, wide) = (learner.pending.rows(), &learner.arm.wide);
            t_s = rows.locate(wide, begin, &self.effective, &self.changed, learner.levels.std());
            rows.sum_up(wide, &mut self.window, |t| t >= t_s + half);
            self.weigh_window(learner);
            self.fit(learner, suspect);
        }
        t_s
    }

    /// True if the rows fit the [fitted](Self::fit) machine to within this many f_j σ_j.
    pub fn fits_window(&mut self, levels: &MisfitLevels, most: f64) -> bool {
        // the rows refer to the old machine
        for (changed, effective) in self.changed.iter_mut().zip(&self.effective) {
            *changed -= effective;
        }
        self.window
            .iter()
            .enumerate()
            .all(|(j, sums)| fits(sums, &self.changed, most * levels.level(j)))
    }

    /// True if a suspect explains the rows, prepared [against](Self::prepare_against) those before,
    /// to within this many f_j σ_j.
    pub fn explains(&mut self, learner: &Learner, before: &Before, suspect: Suspect, most: f64) -> bool {
        let known = (&before.known, &before.fixed[..]);
        if self.weigh(learner, known, suspect).is_none() {
            return false;
        }
        // the origin of the sums is the estimate from before
        self.step(learner, suspect, before.was_loaded);
        let mut rows = self.window.iter().zip(&before.level);
        rows.all(|(sums, level)| fits(sums, &self.changed, most * level))
    }

    /// Replaces the rows by those for whose time `wanted` is true.
    pub fn sum_up(&mut self, learner: &Learner, wanted: impl Fn(f64) -> bool) {
        let rows = learner.pending.rows();
        rows.sum_up(&learner.arm.wide, &mut self.window, wanted);
    }

    /// By how much the only pending slice is likelier with a payload than without one, as ln of the
    /// Bayes factor; the information before it knows no payload. `None` if that cannot be solved.
    pub fn payload_gain(&mut self, learner: &mut Learner) -> Option<f64> {
        if !self.estimate_before(learner, 0) {
            return None;
        }
        for (window, sums) in self.window.iter_mut().zip(&learner.pending.get(0).sums) {
            window.copy_from(sums);
        }
        self.weigh_window(learner);
        let (known, fixed) = (&learner.system, learner.estimate.fixed());
        let nothing = self.evidence.weigh(known, &self.data, fixed, Extra::Nothing);
        let payload = self.suspects.of(Suspect::Payload, learner);
        let something = self.evidence.weigh(known, &self.data, fixed, payload);
        Some(something? - nothing?)
    }
}

/// True if the residuals of these rows are below `level` on average.
fn fits(sums: &JointSums, theta: &[f64], level: f64) -> bool {
    sums.residual_square(theta) <= level.powi(2) * sums.rows as f64
}
