//! One pass over a robot's samples: rows, blocks, and estimates with standard deviations.
//!
//! With A_j, b_j the sums of joint j's rows, Λ₀ and θ₀ the prior, per block of time:
//!
//! ```text
//! Λ = Λ₀ + Σ_j A_j / (f_j σ_j)²,      Λ θ̂ = Λ₀ θ₀ + Σ_j b_j / (f_j σ_j)²                     (1)
//! σ_j² = Σ (τ − x·θ̂)² / (rows − k_j)                                                         (2)
//! e = Fᵀ(τ − X θ̂) over one block,     f_j² = mean of eᵀ (FᵀF)⁻¹ e / (k_j σ_j²) over blocks    (3)
//! P ← P + Q per block                                                                        (4)
//! ```
//!
//! On arms the misfit of friction dominates the noise and is correlated over seconds, so the rows
//! carry less information than their number suggests. F are the k_j friction columns of a joint:
//! with uncorrelated rows e has the covariance σ² FᵀF and f_j is 1; a misfit that keeps its sign
//! through a block increases f_j. This is the block-wise sandwich estimator, reduced to one factor
//! per joint so that a few blocks suffice; it also covers the overlap of the windows. f_j enters
//! the weights, so the covariance P = Λ⁻¹ needs no later correction.
//!
//! At first, (1)–(3) are iterated over all data so far, because the A_j are kept per joint. After
//! `settle_blocks` blocks they are condensed into Λ and, with a friction walk, (4) lets friction
//! follow its temperature: Q is (`friction_walk` · size)² per second, for friction only. Until then
//! the offsets of the torques have a slope, see [`offset_drift`](super::offset_drift).
//!
//! With a payload (`IdentifyOptions::payload`) the last two seconds are kept separate from the
//! estimate: `watch.rs` tests whether the machine has changed, and data after a change are used for
//! the changed machine.
//!
//! Sources: H. White, Econometrica 48 (1980); K.-Y. Liang, S. Zeger, Biometrika 73 (1986), with
//! time blocks as clusters.

use super::allowances::Allowances;
use super::block_gain::BlockGain;
use super::change::RobotChange;
use super::error::{IdentifyError, SampleFault};
use super::explained::RecentRows;
use super::figures::BlockFigures;
use super::identify_options::IdentifyOptions;
use super::intervals::Intervals;
use super::learning::{Arm, Learner, SLICE_S, TRIED};
use super::model::RobotModel;
use super::model_checks::ModelChecks;
use super::payload::Payload;
use super::rows::WeakRows;
use super::signal_checks::SignalChecks;
use super::spatial::BodyParameters;
use super::state::RobotSample;
use super::watch::Watch;
use super::window_review::review_windows;

/// Identifies a robot on line; allocates only at the start.
#[derive(Debug, Clone)]
pub struct RobotIdentifier {
    pub(super) rows: WeakRows,
    slices: Intervals,
    blocks: Intervals,
    pub(super) learner: Learner,
    /// `None` if no payload is estimated.
    pub(super) watch: Option<Watch>,
    pub(super) allowances: Allowances,
    pub(super) signals: SignalChecks,
    pub(super) checks: ModelChecks,
    pub(super) recent_rows: RecentRows,
    pub(super) figures: BlockFigures,
    gain: BlockGain,
    /// The change found in the open block or in the last one.
    pub(super) change: Option<RobotChange>,
}

impl RobotIdentifier {
    /// An identifier for a model; it starts from the URDF's values.
    ///
    /// # Errors
    /// If the options are invalid.
    pub fn new(model: RobotModel, options: IdentifyOptions) -> Result<Self, IdentifyError> {
        options.validate()?;
        let payload = options.payload.then(|| Payload::new(&model));
        let (arm, beyond) = Arm::new(model, payload.as_ref());
        let columns: Vec<usize> = (0..arm.joints()).map(|joint| arm.wide.columns(joint).len()).collect();
        let rows = options.rows(&arm.wide)?;
        let recent_rows = RecentRows::new(&options.windows, options.block_s, &columns);
        let figures = BlockFigures::new(arm.parameters.len());
        let slices = Intervals::new(SLICE_S);
        let blocks = Intervals::new(options.block_s);
        let allowances = Allowances::new(&arm, &beyond, &options);
        let checks = ModelChecks::new(&arm, &beyond, options.friction_walk > 0.0);
        let learner = Learner::new(arm, &beyond, payload, options);
        let mut identifier = Self {
            watch: learner
                .flange
                .has_payload()
                .then(|| Watch::new(&learner, beyond.zeros(learner.arm.joints()))),
            gain: BlockGain::new(beyond.n),
            signals: SignalChecks::default(),
            change: None,
            rows,
            slices,
            blocks,
            learner,
            allowances,
            checks,
            recent_rows,
            figures,
        };
        identifier.reset();
        Ok(identifier)
    }

    /// Resets: forgets all data and fixed parameters.
    pub fn reset(&mut self) {
        self.rows.reset();
        self.restart_intervals();
        self.learner.reset();
        self.watch.iter_mut().for_each(Watch::reset);
        self.allowances.reset();
        self.signals.reset();
        self.checks.reset();
        self.recent_rows.reset();
        self.figures.clear();
        self.change = None;
    }

    fn restart_intervals(&mut self) {
        self.slices.restart();
        self.blocks.restart();
    }

    /// Fixes a parameter at a value, or at its estimate. Information on it is still accumulated.
    pub fn fix(&mut self, parameter: usize, value: Option<f64>) {
        let estimate = &mut self.learner.estimate;
        estimate.fix(parameter, value.unwrap_or(estimate.theta()[parameter]));
        self.learner.past.forget_slope(parameter);
        self.solve_known();
    }

    /// Frees a fixed parameter; freeing one of the payload implies that there is a payload.
    pub fn free(&mut self, parameter: usize) {
        let learner = &mut self.learner;
        if learner.flange.owns(parameter) && !learner.flange.is_loaded() {
            learner.begin_load();
            learner.load();
            self.checks.forget_gains();
        } else {
            learner.estimate.release(parameter);
        }
        self.solve_known();
    }

    /// Declares the payload from now on, instead of detecting it: `None` for nothing, otherwise ten
    /// parameters at the flange, which are fixed. Does nothing if the payload is not among the
    /// parameters. The test for changes continues, so a contradiction of the declaration is found.
    pub fn declare_payload(&mut self, body: Option<&BodyParameters>) {
        if !self.learner.flange.has_payload() {
            return;
        }
        self.learner.declare_payload(body);
        self.checks.forget_gains();
        self.watch.iter_mut().for_each(Watch::forget_doubt);
        self.solve_known();
    }

    /// Makes friction uncertain again, as after a pause in which drives and oil change their
    /// temperature; inertial parameters keep their information.
    pub fn widen_friction(&mut self) {
        let learner = &mut self.learner;
        learner.condense();
        learner.commit_pending(learner.pending.len());
        learner.widen_friction(learner.options.friction_change);
        self.solve_known();
    }

    /// Recomputes the estimates, after the information or what is fixed has changed.
    fn solve_known(&mut self) {
        self.learner.solve_known();
        self.allowances.forget_shifts();
    }

    /// Adds a sample; true if it completes a block and the estimates are new.
    ///
    /// # Errors
    /// If the sample cannot be used; it is left out.
    pub fn push(&mut self, sample: &RobotSample) -> Result<bool, SampleFault> {
        self.take(sample)?;
        Ok(self.blocks.is_end(sample.t_s) && self.close_block())
    }

    /// Adds a sample; the caller [closes](Self::close_block) the block.
    ///
    /// # Errors
    /// If the sample cannot be used; it is left out.
    pub fn take(&mut self, sample: &RobotSample) -> Result<(), SampleFault> {
        let Learner { arm, open, pending, .. } = &mut self.learner;
        let recent_rows = &mut self.recent_rows;
        self.rows.push(&arm.wide, sample, &mut |row| {
            open.add(&row, &arm.wide);
            pending.add_row(&row);
            recent_rows.add(&row);
        })?;
        self.learner.now_s = self.rows.elapsed_s();
        self.allowances.take(sample, &self.learner);
        let (robot, windows) = (self.learner.arm.model.robot(), &self.learner.options.windows);
        let has_jumped = self.signals.take(robot, sample, windows.max_gap_s);
        if let Some(watch) = &mut self.watch {
            if has_jumped {
                watch.inquire(&mut self.learner);
            }
            if self.slices.is_end(sample.t_s) {
                self.end_slice(sample.t_s);
            }
        }
        Ok(())
    }

    /// Ends the open slice, and tests whether the machine has changed.
    fn end_slice(&mut self, now_s: f64) {
        if self.learner.end_slice() {
            if let Some(watch) = &mut self.watch {
                let adopted = watch.look_at_slice(&mut self.learner, now_s);
                if adopted.machine {
                    self.allowances.carry_over();
                }
                if adopted.payload {
                    self.checks.forget_gains();
                }
            }
            self.learner.open.clear_slice();
        }
    }

    /// Ends a recording and uses its last, shorter block. The next sample begins a new recording.
    pub fn end_of_recording(&mut self) -> bool {
        self.rows.restart();
        self.signals.restart();
        self.restart_intervals();
        let closed = self.close_block();
        self.recent_rows.clear();
        closed
    }

    /// Restarts the windows with the next sample, and drops the data since the last block.
    pub fn discard_block(&mut self) {
        self.rows.restart();
        self.signals.restart();
        self.recent_rows.clear();
        self.learner.open.clear();
        self.learner.pending.drop_block();
    }

    /// Restarts the windows with the next sample, because samples were lost.
    pub fn restart_windows(&mut self) {
        self.rows.restart();
        self.signals.restart();
        self.recent_rows.clear();
        self.learner.commit_pending(self.learner.pending.len());
        self.learner.pending.end_rows();
        self.slices.restart();
    }

    /// Updates the estimates with the block; returns false and changes nothing if it has no rows.
    pub fn close_block(&mut self) -> bool {
        let last_s = self.learner.pending.rows().last_s();
        let t_s = last_s.unwrap_or(self.learner.open.slice_begin_s());
        self.end_slice(t_s);
        self.change = self.watch.as_mut().and_then(Watch::take_found);
        if self.learner.open.is_empty() {
            return false;
        }
        let changed = self.change.is_some();
        self.learn_block(t_s, changed);
        if changed {
            self.recent_rows.clear();
        } else {
            self.look_at_misfit();
        }
        let newest = self.rows.regressors();
        self.checks.look_at_signs(&self.learner, &self.allowances, newest);
        self.gain.measure(&mut self.learner, &mut self.figures.excitation);
        if self.learner.blocks >= TRIED {
            self.learner.open.set_mass(self.learner.estimate.effective());
        }
        // last, because it moves the offsets that the tests above look at
        if self.learner.blocks >= self.learner.options.settle_blocks {
            self.learner.condense();
        }
        self.review_windows();
        self.learner.pending.end_block();
        self.learner.open.clear_sums();
        true
    }

    /// Estimates with the block, which ends at `t_s`.
    fn learn_block(&mut self, t_s: f64, changed: bool) {
        let (learner, figures) = (&mut self.learner, &mut self.figures);
        learner.blocks += 1;
        // before the first block there are no estimates
        if learner.blocks > 1 {
            learner.levels.keep(t_s);
        }
        if !changed {
            learner.recent.push(learner.open.sums());
        }
        let (before, windows) = (learner.estimate.effective(), &learner.options.windows);
        figures.of_innovation(learner.open.sums(), before, learner.levels.std(), windows);
        learner.learn_block(changed);
        self.allowances.forget_shifts();
        figures.of_residual(learner.open.sums(), learner.estimate.effective());
    }

    /// Looks for what the model lacks in the residuals of a block of an unchanged machine.
    fn look_at_misfit(&mut self) {
        let (learner, figures) = (&self.learner, &mut self.figures);
        let (recent, explained) = (&mut figures.recent, &mut figures.explained);
        let block = (learner.open.sums(), learner.estimate.effective());
        self.recent_rows.explain(block, learner.levels.std(), recent, explained);
        self.allowances.look_at_misfit(learner);
        let tests_gains = !learner.flange.is_loaded() && self.doubt().is_none();
        let learner = &self.learner;
        self.checks.look_at_misfit(learner, &self.allowances, tests_gains);
        self.allowances.look_at_friction(learner);
    }

    /// Lengthens the windows if errors of the velocities require it.
    fn review_windows(&mut self) {
        if !self.learner.options.lengthens {
            return;
        }
        if let Some(longer) = review_windows(self.rows.motion(), &self.learner) {
            self.learner.options.windows = longer.windows;
            self.rows.set_windows(longer.windows);
            self.recent_rows.set_windows(&longer.windows);
            if longer.drops_blocks {
                self.restart_intervals();
                self.recent_rows.clear();
                self.learner.forget_blocks();
                self.checks.forget_gains();
            }
        }
    }
}
