//! Estimation from the rows of a robot, (1) to (4) of [`identify`](super::identify).

use super::estimate::Estimate;
use super::flange::Flange;
use super::friction_walk::FrictionWalk;
use super::identify_options::IdentifyOptions;
use super::information::{Information, Solver};
use super::levels::MisfitLevels;
use super::model::{RobotModel, RobotParameter};
use super::offset_drift::{DriftTerm, Origin};
use super::open_block::OpenBlock;
use super::past::Past;
use super::payload::Payload;
use super::recent::PendingRows;
use super::recent_blocks::RecentBlocks;
use super::spatial::BodyParameters;
use super::sums::JointSums;
use super::unmodelled::{LeftOutTerm, Unmodelled};

/// Length of a slice \[s\]: the period of the test for changes.
pub(super) const SLICE_S: f64 = 0.25;
/// Number of slices kept separate.
const SLICES: usize = 8;
/// Duration of the rows kept \[s\]: those of the slices and of the open one.
const KEPT_S: f64 = (SLICES + 4) as f64 * SLICE_S;
/// Iterations of (1) and (2) per block while settling.
const ITERATIONS: usize = 4;
/// Blocks after which the estimate gives the mass matrix better than the URDF.
pub(super) const TRIED: usize = 3;
/// Rows per parameter above which residuals show the noise.
pub(super) const ROWS_PER_PARAMETER: f64 = 2.0;

/// What the rows of a robot depend on, in the order of θ: the parameters of the arm, then those of
/// the payload if one is estimated, then the terms that the model leaves out, then the slopes of
/// the offsets.
#[derive(Debug, Clone)]
pub(super) struct Arm {
    pub model: RobotModel,
    /// The same model, with additional columns for the terms and the slopes.
    pub wide: RobotModel,
    /// Those of the arm and of the payload.
    pub parameters: Vec<RobotParameter>,
}

/// The part of θ after the parameters.
pub(super) struct Beyond {
    pub terms: Vec<LeftOutTerm>,
    pub drifts: Vec<DriftTerm>,
    /// Number of parameters and terms, and the same with the slopes.
    pub n: usize,
    pub acting: usize,
}

impl Beyond {
    /// The parameters that are the zeros of the encoders; `None` for a joint that does not turn.
    pub fn zeros(&self, joints: usize) -> Vec<Option<[usize; 1]>> {
        let zero = |joint| {
            let is_zero = |term: &&LeftOutTerm| term.what == Unmodelled::Zero { joint };
            self.terms.iter().find(is_zero).map(|term| [term.index])
        };
        (0..joints).map(zero).collect()
    }
}

impl Arm {
    /// Of this model, with or without a payload, and what it leaves out.
    pub fn new(model: RobotModel, payload: Option<&Payload>) -> (Self, Beyond) {
        let mut parameters = model.parameters().to_vec();
        parameters.extend(payload.into_iter().flat_map(Payload::parameters));
        let (wide, terms, drifts) = model.with_left_out(parameters.len());
        let n = parameters.len() + terms.len();
        let beyond = Beyond {
            acting: n + drifts.len(),
            n,
            terms,
            drifts,
        };
        let arm = Self {
            model,
            wide,
            parameters,
        };
        (arm, beyond)
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.model.robot().len()
    }

    /// Sums without rows, per joint.
    pub fn empty_sums(&self) -> Vec<JointSums> {
        (0..self.joints())
            .map(|joint| JointSums::new(self.wide.columns(joint)))
            .collect()
    }

    /// Λ₀ and Λ₀ θ₀ without a payload.
    fn prior(&self, beyond: &Beyond) -> Information {
        let mut prior = Information::new(beyond.n);
        for (i, parameter) in self.model.parameters().iter().enumerate() {
            prior.set_prior(i, parameter.nominal, parameter.scale);
        }
        for term in &beyond.terms {
            prior.set_prior(term.index, 0.0, term.scale);
        }
        prior
    }
}

/// Estimates the parameters from rows; allocates only at the start.
#[derive(Debug, Clone)]
pub(super) struct Learner {
    pub arm: Arm,
    pub options: IdentifyOptions,
    pub flange: Flange,
    pub open: OpenBlock,
    pub pending: PendingRows,
    pub recent: RecentBlocks,
    pub levels: MisfitLevels,
    pub past: Past,
    pub estimate: Estimate,
    pub friction: FrictionWalk,
    /// Workspace: information on the parameters, and its solution.
    pub system: Information,
    pub solver: Solver,
    /// Blocks so far.
    pub blocks: usize,
    /// Time of the newest sample since the start, without that between recordings \[s\].
    pub now_s: f64,
}

impl Learner {
    /// Without rows; `payload` is `None` if none is estimated.
    pub fn new(arm: Arm, beyond: &Beyond, payload: Option<Payload>, options: IdentifyOptions) -> Self {
        let empty = arm.empty_sums();
        let (slices, windows) = match payload {
            Some(_) => (SLICES, (KEPT_S / options.windows.stride_s).ceil() as usize + 1),
            None => (0, 0),
        };
        let kept_blocks = (SLICES as f64 * SLICE_S / options.block_s).ceil() as usize + 1;
        let is_drifting = options.friction_walk > 0.0;
        Self {
            flange: Flange::new(payload.map(|payload| payload.over_columns(beyond.acting))),
            open: OpenBlock::new(beyond.acting, &empty),
            pending: PendingRows::new(slices, windows, &empty),
            recent: RecentBlocks::new(&empty),
            levels: MisfitLevels::new(empty.len(), kept_blocks),
            past: Past::new(arm.prior(beyond), beyond.drifts.clone(), is_drifting, &empty),
            estimate: Estimate::new(&arm.parameters, beyond.n, beyond.acting),
            friction: FrictionWalk::new(&arm.model, options.friction_walk),
            system: Information::new(beyond.n),
            solver: Solver::new(beyond.n),
            blocks: 0,
            now_s: 0.0,
            arm,
            options,
        }
    }

    /// Forgets all data and fixed parameters.
    pub fn reset(&mut self) {
        self.open.clear();
        self.pending.reset();
        self.recent.clear();
        self.levels.reset();
        self.past.reset();
        self.flange.unload();
        (self.blocks, self.now_s) = (0, 0.0);
        self.estimate.reset(&self.flange, &self.past);
        self.open.set_mass(self.estimate.effective());
    }

    /// Drops all blocks so far; levels and estimate stay.
    pub fn forget_blocks(&mut self) {
        self.open.clear();
        self.pending.clear_recording();
        self.recent.clear();
        self.past.reset();
        self.blocks = 0;
        self.estimate.refresh_effective(&self.flange, &self.past);
    }

    /// Forgets the recent blocks, which are of another machine, but not their levels.
    pub fn forget_recent(&mut self) {
        self.recent.clear();
        self.levels.carry_over();
    }

    /// Share of the rows that do not overlap.
    pub fn independent_share(&self) -> f64 {
        let windows = &self.options.windows;
        (windows.stride_s / windows.length_s).min(1.0)
    }

    /// Rows of a joint that do not overlap.
    fn independent(&self, sums: &JointSums) -> f64 {
        sums.rows as f64 * self.independent_share()
    }

    /// True if there are enough rows to distinguish a change from what is still unknown.
    pub fn has_enough_rows(&self) -> bool {
        let rows: f64 = self.past.all().iter().map(|sums| self.independent(sums)).sum();
        self.past.is_condensed() || rows >= ROWS_PER_PARAMETER * self.arm.parameters.len() as f64
    }

    /// The present, for offsets.
    pub fn now(&self) -> Origin {
        Origin::At(self.now_s)
    }

    /// The parameters of an arm that is equivalent to these parameters with offsets at `origin`.
    pub fn effective_of(&self, theta: &[f64], origin: Origin, out: &mut [f64]) {
        self.flange.effective(theta, out);
        self.past.add_slopes(out, origin);
    }

    /// The same with the slopes of the offsets that belong to these parameters.
    pub fn effective_with(&self, theta: &[f64], out: &mut [f64]) {
        self.flange.effective(theta, out);
        self.past.refit_slopes(&self.levels, self.estimate.fixed(), out);
    }

    /// Estimates with the open block: from all rows so far, or, once they are condensed, from their
    /// information. `changed` is true if the machine has changed within it.
    pub fn learn_block(&mut self, changed: bool) {
        if self.past.is_condensed() {
            let time_s = self.options.block_s;
            self.friction
                .advance(&self.estimate, time_s, &mut self.past, &mut self.solver);
            self.add_open();
            self.solve_known();
            if !changed {
                self.levels.follow_std(self.open.sums(), self.estimate.effective());
                self.learn_inflation();
            }
            return;
        }
        self.add_open();
        for _ in 0..ITERATIONS {
            self.learn_levels();
            self.solve_all();
        }
        self.estimate.solve_covariance(&mut self.solver, &self.system);
    }

    /// Adds the open block to the past, unless its slices are pending.
    fn add_open(&mut self) {
        if !self.flange.has_payload() {
            self.past.add(self.open.sums(), &self.levels, &mut self.flange);
        }
    }

    /// (2) and (3) over all data so far.
    fn learn_levels(&mut self) {
        self.past.sum_up(&self.pending);
        let share = self.arm.parameters.len() as f64 / self.arm.joints() as f64;
        for (joint, sums) in self.past.all().iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let friction = self.arm.model.friction_of(joint).len();
            let untried = (ROWS_PER_PARAMETER - self.independent(sums) / share).clamp(0.0, 1.0);
            self.levels
                .learn_std(joint, sums, self.estimate.effective(), friction, untried);
        }
        self.learn_inflation();
    }

    fn learn_inflation(&mut self) {
        self.levels
            .learn_inflation(&self.arm.model, &self.recent, self.estimate.effective());
    }

    /// (1) over all data so far.
    fn solve_all(&mut self) {
        let Self {
            levels,
            flange,
            past,
            estimate,
            ..
        } = self;
        past.write_all(levels, flange, estimate.fixed(), &mut self.system);
        estimate.solve(&mut self.solver, &self.system); // (1)
        let now_s = self.now_s;
        estimate.renew_effective(flange, |fixed, effective| {
            past.estimate_slopes(levels, fixed, now_s, effective);
        });
    }

    /// Recomputes θ̂ and P from the present information.
    pub fn solve_known(&mut self) {
        self.assemble(Origin::Mean);
        self.estimate.solve(&mut self.solver, &self.system);
        self.past.forget_lag();
        self.estimate.solve_covariance(&mut self.solver, &self.system);
        self.estimate.refresh_effective(&self.flange, &self.past);
    }

    /// Writes the information with all slices to `system`, with offsets at `origin`.
    pub fn assemble(&mut self, origin: Origin) {
        self.assemble_older(self.pending.len(), origin);
    }

    /// The same with the first `slices` pending slices only.
    pub fn assemble_older(&mut self, slices: usize, origin: Origin) {
        let offsets = (origin, self.estimate.fixed());
        let pending = (&self.pending, slices);
        self.past
            .write(pending, &self.levels, &mut self.flange, offsets, &mut self.system);
    }

    /// Commits the oldest pending slices.
    pub fn commit_pending(&mut self, count: usize) {
        for _ in 0..count {
            let Some(slice) = self.pending.pop() else { return };
            self.past.add(&slice.sums, &self.levels, &mut self.flange);
        }
    }

    /// Ends the open slice: adds it to the block, and keeps it separate if a payload is estimated.
    /// False if it has no rows.
    pub fn end_slice(&mut self) -> bool {
        if self.open.has_empty_slice() {
            return false;
        }
        self.open.add_slice();
        if self.flange.has_payload() {
            if self.pending.is_full() {
                self.commit_pending(1);
            }
            self.pending.push(self.open.slice_begin_s(), self.open.slice());
        }
        true
    }

    /// Condenses the past: its weights are final from here on.
    pub fn condense(&mut self) {
        if !self.past.is_condensed() {
            let Self {
                levels,
                flange,
                past,
                estimate,
                recent,
                ..
            } = self;
            past.condense(levels, flange, estimate.parts_mut(), recent, self.now_s);
            estimate.refresh_effective(flange, past);
        }
    }

    /// Makes friction uncertain by this part of its size.
    pub fn widen_friction(&mut self, part: f64) {
        self.friction
            .widen(part, &self.estimate, &mut self.past, &mut self.solver);
    }

    /// Commits all data so far before the payload changes. Before the first block there are no
    /// weights yet, so the part of a block is dropped instead.
    pub fn begin_load(&mut self) {
        if self.blocks > 0 || self.past.is_condensed() {
            self.condense();
            self.commit_pending(usize::MAX);
            return;
        }
        self.open.clear();
        self.past.reset();
        self.pending.clear();
    }

    /// Allows any payload from now on and drops all information on it.
    pub fn load(&mut self) {
        self.flange.load();
        for &i in self.flange.parameters() {
            self.estimate.release(i);
        }
        self.past.allow_payload(&self.flange);
    }

    /// Removes the payload.
    pub fn unload(&mut self) {
        self.flange.unload();
        for &i in self.flange.parameters() {
            self.estimate.fix(i, 0.0);
        }
    }

    /// Keeps the information on the arm when the payload is removed.
    pub fn forget_payload(&mut self) {
        let (fixed, theta) = self.estimate.parts_mut();
        self.past.forget_payload(&mut self.solver, &self.flange, fixed, theta);
    }

    /// Declares the payload from now on: `None` for nothing, otherwise it is fixed.
    pub fn declare_payload(&mut self, body: Option<&BodyParameters>) {
        self.begin_load();
        if self.flange.is_loaded() && self.past.is_condensed() {
            self.forget_payload();
        }
        self.unload();
        if let Some(body) = body {
            self.load();
            for (&i, value) in self.flange.parameters().iter().zip(body.0) {
                self.estimate.fix(i, value);
            }
        }
    }
}
