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

use super::block_scatter_room::BlockScatter;
use super::change::RobotChange;
use super::drive_gain_room::DriveGains;
use super::error::{IdentifyError, SampleFault};
use super::explained::RecentRows;
use super::figures::BlockFigures;
use super::friction_drift::FrictionDrift;
use super::identify_options::IdentifyOptions;
use super::impossible_room::Impossibles;
use super::information::{Information, Solver};
use super::jump::Jumps;
use super::left_out_room::LeftOut;
use super::levels::LevelRing;
use super::model::{RobotModel, RobotParameter};
use super::offset_drift::{OffsetDrift, Origin};
use super::payload::Payload;
use super::recent::{RowRing, SliceRing};
use super::rows::WeakRows;
use super::state::RobotSample;
use super::sums::JointSums;
use super::torque_counts::TorqueCounts;
use super::urdf_prior::UrdfPrior;
use super::velocity_ratio::VelocityRatios;
use super::watch_room::Watch;

/// Number of blocks in (3).
const RECENT: usize = 32;
/// Prior value of f_j², and its weight in blocks.
const ASSUMED_INFLATION: (f64, f64) = (9.0, 2.0);
/// Iterations of (1) and (2) per block while settling.
const ITERATIONS: usize = 4;
/// Blocks after which the estimate gives the mass matrix better than the URDF.
pub(super) const TRIED: usize = 3;
/// Length of a slice \[s\]: the period of the test for changes.
const SLICE_S: f64 = 0.25;
/// Number of slices kept separate.
const SLICES: usize = 8;
/// Duration of the rows kept \[s\]: those of the slices and of the open one.
const KEPT_S: f64 = (SLICES + 4) as f64 * SLICE_S;

/// Identifies a robot on line; allocates only at the start.
#[derive(Debug, Clone)]
pub struct RobotIdentifier {
    pub(super) model: RobotModel,
    /// The same model, with additional columns for the friction terms that it leaves out.
    pub(super) wide: RobotModel,
    pub(super) left_out: Option<LeftOut>,
    pub(super) block_scatter: Option<BlockScatter>,
    pub(super) drift: FrictionDrift,
    pub(super) offset_drift: OffsetDrift,
    pub(super) counts: TorqueCounts,
    pub(super) options: IdentifyOptions,
    pub(super) rows: WeakRows,
    pub(super) jumps: Jumps,
    pub(super) parameters: Vec<RobotParameter>,
    pub(super) payload: Option<Payload>,
    /// True while the flange carries a payload.
    pub(super) is_loaded: bool,
    pub(super) slice: Vec<JointSums>,
    pub(super) slice_end: Option<f64>,
    pub(super) slice_begin: f64,
    pub(super) block: Vec<JointSums>,
    /// Number of separate slices that belong to the open block.
    pub(super) block_slices: usize,
    /// Slices since the start.
    pub(super) slices: usize,
    pub(super) total: Vec<JointSums>,
    pub(super) all: Vec<JointSums>,
    /// The sums without the last slices.
    pub(super) older: Vec<JointSums>,
    pub(super) pending: SliceRing,
    pub(super) ring: RowRing,
    pub(super) recent: Vec<Vec<JointSums>>,
    pub(super) recent_blocks: usize,
    /// Prior values of f_j², and their weight in blocks.
    pub(super) assumed: (Vec<f64>, f64),
    pub(super) blocks: usize,
    pub(super) block_end: Option<f64>,
    /// True after the sums have been condensed into `committed`.
    pub(super) condensed: bool,
    /// The information without `pending`, once it is condensed.
    pub(super) committed: Information,
    /// The information including `pending`.
    pub(super) system: Information,
    pub(super) solver: Solver,
    pub(super) theta: Vec<f64>,
    /// The parameters of an arm that is equivalent to arm and payload together, then the slopes of
    /// the offsets.
    pub(super) effective: Vec<f64>,
    pub(super) before: Vec<f64>,
    pub(super) covariance: Vec<f64>,
    /// Fixed parameters; includes those of the payload while there is none.
    pub(super) fixed: Vec<bool>,
    pub(super) frictions: Vec<usize>,
    pub(super) carried: Vec<usize>,
    pub(super) walk: Vec<f64>,
    pub(super) torque_std: Vec<f64>,
    pub(super) inflation: Vec<f64>,
    pub(super) levels: LevelRing,
    pub(super) watch: Option<Watch>,
    /// The change found in the open block or in the last one.
    pub(super) change: Option<RobotChange>,
    pub(super) figures: BlockFigures,
    pub(super) recent_rows: RecentRows,
    pub(super) velocity_ratios: VelocityRatios,
    pub(super) urdf_prior: Option<UrdfPrior>,
    pub(super) impossibles: Impossibles,
    pub(super) gains: Option<DriveGains>,
    pub(super) gain: Information,
    pub(super) size: Vec<f64>,
    /// Bias of the estimates by errors of the positions.
    pub(super) bias: Vec<f64>,
    /// θ of the mass matrix in that bias: the URDF's at first.
    pub(super) of_mass: Vec<f64>,
}

impl RobotIdentifier {
    /// An identifier for a model; it starts from the URDF's values.
    ///
    /// # Errors
    /// If the options are invalid.
    pub fn new(model: RobotModel, options: IdentifyOptions) -> Result<Self, IdentifyError> {
        options.validate()?;
        let joints = model.robot().len();
        let mut payload = options.payload.then(|| Payload::new(&model));
        let mut parameters = model.parameters().to_vec();
        let arm = parameters.len();
        parameters.extend(payload.iter().flat_map(Payload::parameters));
        let (wide, terms, drifts) = model.with_left_out(parameters.len());
        let n = parameters.len() + terms.len();
        // parameters that affect rows
        let acting = n + drifts.len();
        payload = payload.map(|payload| payload.over_columns(acting));
        let columns: Vec<usize> = (0..joints).map(|i| wide.columns(i).len()).collect();
        let empty: Vec<JointSums> = (0..joints).map(|i| JointSums::new(wide.columns(i))).collect();
        let frictions: Vec<usize> = (0..joints).flat_map(|i| model.friction_of(i)).collect();
        let windows = match options.payload {
            true => (KEPT_S / options.windows.stride_s).ceil() as usize + 1,
            false => 0,
        };
        let is_drifting = options.friction_walk > 0.0;
        let mut identifier = Self {
            gains: Some(DriveGains::new(&model, &wide, drifts.clone(), (is_drifting, acting))),
            rows: options.rows(&wide)?,
            bias: vec![0.0; n],
            of_mass: vec![0.0; acting],
            jumps: Jumps::default(),
            is_loaded: false,
            slice_end: None,
            slice_begin: 0.0,
            slice: empty.clone(),
            total: empty.clone(),
            all: empty.clone(),
            older: empty.clone(),
            offset_drift: OffsetDrift::new(drifts, is_drifting, &empty),
            block_scatter: Some(BlockScatter::new(parameters.len(), n, acting, RECENT, &empty)),
            pending: SliceRing::new(if options.payload { SLICES } else { 0 }, &empty),
            ring: RowRing::new(windows, &columns),
            recent: vec![empty.clone(); RECENT],
            recent_blocks: 0,
            assumed: (vec![0.0; joints], 0.0),
            watch: payload.as_ref().map(|_| Watch::new(n, acting, frictions.len(), &empty)),
            block: empty,
            blocks: 0,
            block_end: None,
            condensed: false,
            committed: Information::new(n),
            system: Information::new(n),
            solver: Solver::new(n),
            theta: vec![0.0; n],
            effective: vec![0.0; acting],
            before: vec![0.0; acting],
            covariance: vec![0.0; n * n],
            fixed: vec![false; n],
            walk: vec![0.0; frictions.len()],
            frictions,
            carried: payload.iter().flat_map(|payload| payload.indices()).collect(),
            block_slices: 0,
            slices: 0,
            torque_std: vec![0.0; joints],
            inflation: vec![0.0; joints],
            levels: LevelRing::new((SLICES as f64 * SLICE_S / options.block_s).ceil() as usize + 1),
            change: None,
            figures: BlockFigures::new(parameters.len(), n),
            velocity_ratios: VelocityRatios::default(),
            recent_rows: RecentRows::new(&options.windows, options.block_s, &columns),
            drift: FrictionDrift::new(arm),
            counts: TorqueCounts::new(arm),
            left_out: (!terms.is_empty()).then(|| LeftOut::new(terms, (options.zero_rad, options.delay_s), n, acting)),
            wide,
            urdf_prior: Some(UrdfPrior::new(&model)),
            impossibles: Impossibles::new(columns.iter().copied().max().unwrap_or(0)),
            gain: Information::new(n),
            size: vec![0.0; n],
            parameters,
            payload,
            model,
            options,
        };
        identifier.reset();
        Ok(identifier)
    }

    /// Resets: forgets all data and fixed parameters.
    pub fn reset(&mut self) {
        self.rows.reset();
        self.jumps.reset();
        self.clear_recording();
        for sums in [&mut self.block, &mut self.total].into_iter().flatten() {
            sums.clear();
        }
        (self.recent_blocks, self.blocks, self.slices, self.condensed) = (0, 0, 0, false);
        self.is_loaded = false;
        self.assumed.0.fill(ASSUMED_INFLATION.0);
        self.assumed.1 = ASSUMED_INFLATION.1;
        self.inflation.fill(ASSUMED_INFLATION.0.sqrt());
        self.torque_std.fill(0.0);
        self.levels.clear();
        self.fixed.fill(true);
        self.covariance.fill(0.0);
        self.change = None;
        if let Some(watch) = &mut self.watch {
            (watch.doubt, watch.strange, watch.inquiry.doubt) = (0, 0, None);
        }
        self.left_out.iter_mut().for_each(LeftOut::reset);
        self.block_scatter.iter_mut().for_each(BlockScatter::reset);
        self.drift.reset();
        self.offset_drift.reset();
        self.counts.reset();
        self.recent_rows.lacking.fill(false);
        self.velocity_ratios = VelocityRatios::default();
        self.impossibles.clear();
        self.gains.iter_mut().for_each(DriveGains::reset);
        self.urdf_prior.iter_mut().for_each(|prior| prior.found = None);
        self.figures.clear();
        let n = self.theta.len();
        self.theta.fill(0.0);
        for (i, parameter) in self.parameters.iter().enumerate() {
            self.theta[i] = parameter.nominal;
            let is_held = self.payload.as_ref().is_some_and(|payload| i >= payload.first);
            self.fixed[i] = is_held;
            self.covariance[i * n + i] = if is_held { 0.0 } else { parameter.scale.powi(2) };
        }
        self.refresh_effective();
        self.of_mass.copy_from_slice(&self.effective);
    }

    /// Fixes a parameter at a value, or at its estimate. Information on it is still accumulated.
    pub fn fix(&mut self, parameter: usize, value: Option<f64>) {
        self.fixed[parameter] = true;
        self.theta[parameter] = value.unwrap_or(self.theta[parameter]);
        self.offset_drift.forget(parameter);
        self.solve_known();
    }

    /// Frees a fixed parameter; freeing one of the payload implies that there is a payload.
    pub fn free(&mut self, parameter: usize) {
        let of_payload = self.payload.as_ref().is_some_and(|payload| parameter >= payload.first);
        if of_payload && !self.is_loaded {
            self.begin_load();
            self.load();
        } else {
            self.fixed[parameter] = false;
        }
        self.solve_known();
    }

    /// Recomputes θ̂ from the present information, after a parameter was fixed or freed.
    pub(super) fn solve_known(&mut self) {
        self.assemble(Origin::Mean);
        self.solver.solve(&self.system, &self.fixed, &mut self.theta);
        self.solve_covariance();
        self.refresh_effective();
        self.left_out.iter_mut().for_each(LeftOut::forget_shifts);
    }

    /// Recomputes P from the present information. If that fails because of rounding, P becomes that
    /// before the first block, so that no value passes for known.
    fn solve_covariance(&mut self) {
        self.bias.fill(0.0);
        if self.condensed {
            self.offset_drift.forget_lag();
        }
        if self.solver.covariance(&self.system, &self.fixed, &mut self.covariance) {
            Solver::bias(&self.system, &self.covariance, &mut self.bias);
            return;
        }
        let n = self.theta.len();
        self.covariance.fill(0.0);
        for i in (0..self.parameters.len()).filter(|i| !self.fixed[*i]) {
            self.covariance[i * n + i] = self.parameters[i].scale.powi(2);
        }
    }

    /// Adds a sample; true if it completes a block and the estimates are new.
    ///
    /// # Errors
    /// If the sample cannot be used; it is left out.
    pub fn push(&mut self, sample: &RobotSample) -> Result<bool, SampleFault> {
        self.take(sample)?;
        let end = *self.block_end.get_or_insert(sample.t_s + self.options.block_s);
        if sample.t_s < end {
            return Ok(false);
        }
        // After a long pause, empty blocks are not counted.
        let next = end + self.options.block_s;
        self.block_end = Some(if next > sample.t_s {
            next
        } else {
            sample.t_s + self.options.block_s
        });
        Ok(self.close_block())
    }

    /// Adds a sample; the caller [closes](Self::close_block) the block.
    ///
    /// # Errors
    /// If the sample cannot be used; it is left out.
    pub fn take(&mut self, sample: &RobotSample) -> Result<(), SampleFault> {
        let (slice, ring, begin) = (&mut self.slice, &mut self.ring, &mut self.slice_begin);
        let recent_rows = &mut self.recent_rows;
        let (wide, of_mass) = (&self.wide, &self.of_mass);
        self.rows.push(&self.wide, sample, &mut |row| {
            if slice.iter().all(|sums| sums.rows == 0) {
                *begin = row.t_s;
            }
            slice[row.joint].add_row(row.regressor, row.torque);
            ring.add(&row);
            recent_rows.add(&row);
            slice[row.joint].add_bias(&mut |bias| row.errors.bias(wide, row.joint, of_mass, bias));
        })?;
        self.counts.take(&self.model, sample, self.options.windows.length_s);
        let max_gap_s = self.options.windows.max_gap_s;
        self.velocity_ratios.take(self.model.robot(), sample, max_gap_s);
        if self.jumps.take(self.model.robot(), sample) {
            self.inquire_after_jump();
        }
        if self.payload.is_some() {
            let end = *self.slice_end.get_or_insert(sample.t_s + SLICE_S);
            if sample.t_s >= end {
                self.slice_end = Some(if end + SLICE_S > sample.t_s { end } else { sample.t_s } + SLICE_S);
                self.end_slice(sample.t_s);
            }
        }
        Ok(())
    }

    /// Ends a recording and uses its last, shorter block. The next sample begins a new recording.
    pub fn end_of_recording(&mut self) -> bool {
        self.rows.restart();
        self.jumps.restart();
        self.velocity_ratios.restart();
        self.block_end = None;
        let closed = self.close_block();
        self.recent_rows.clear();
        self.slice_end = None;
        closed
    }

    /// Restarts the windows with the next sample, and drops the data since the last block.
    pub fn discard_block(&mut self) {
        self.rows.restart();
        self.recent_rows.clear();
        self.jumps.restart();
        self.velocity_ratios.restart();
        self.slice.iter_mut().for_each(JointSums::clear);
        self.block.iter_mut().for_each(JointSums::clear);
        self.pending.drop_newest(self.block_slices);
        self.block_slices = 0;
    }

    pub(super) fn clear_recording(&mut self) {
        self.recent_rows.clear();
        self.slice.iter_mut().for_each(JointSums::clear);
        self.pending.clear();
        self.ring.clear();
        (self.slice_end, self.block_end, self.block_slices) = (None, None, 0);
    }

    /// Restarts the windows with the next sample, because samples were lost.
    pub fn restart_windows(&mut self) {
        self.rows.restart();
        self.recent_rows.clear();
        self.jumps.restart();
        self.velocity_ratios.restart();
        self.commit_pending(self.pending.len());
        self.ring.clear();
        (self.slice_end, self.block_slices) = (None, 0);
    }

    /// Makes friction uncertain again, as after a pause in which drives and oil change their
    /// temperature; inertial parameters keep their information.
    pub fn widen_friction(&mut self) {
        self.condense();
        self.commit_pending(self.pending.len());
        self.widen(self.options.friction_change);
        self.solve_known();
    }

    /// Adds (`part` · size)² to the variance of each friction parameter; its size is |θ̂| or three
    /// standard deviations, whichever is larger.
    pub(super) fn widen(&mut self, part: f64) {
        for (k, &i) in self.frictions.iter().enumerate() {
            let size = self.theta[i]
                .abs()
                .max(3.0 * self.covariance[i * self.theta.len() + i].max(0.0).sqrt());
            self.walk[k] = (part * size).powi(2);
        }
        self.solver.walk(&mut self.committed, &self.frictions, &self.walk);
    }

    /// Updates the estimates with the block; returns false and changes nothing if it has no rows.
    pub fn close_block(&mut self) -> bool {
        let t_s = self
            .ring
            .len()
            .checked_sub(1)
            .map_or(self.slice_begin, |last| self.ring.get(last).1.t_s);
        self.change = None;
        self.end_slice(t_s);
        if let Some(watch) = &mut self.watch {
            self.change = watch.found.take();
        }
        if self.block.iter().all(|sums| sums.rows == 0) {
            return false;
        }
        self.blocks += 1;
        self.before.copy_from_slice(&self.effective);
        let changed = self.change.is_some();
        // before the first block there are no estimates
        if self.blocks > 1 {
            self.levels.keep(t_s, &self.torque_std, &self.inflation);
        }
        if !changed {
            for (joint, sums) in self.block.iter().enumerate() {
                self.recent[self.recent_blocks % RECENT][joint].copy_from(sums);
            }
            self.recent_blocks += 1;
        }
        self.figures
            .of_innovation(&self.block, &self.effective, &self.torque_std, &self.options.windows);
        self.learn_block(changed);
        self.figures.of_residual(&self.block, &self.effective);
        if changed {
            self.recent_rows.clear();
        } else {
            let (recent, explained) = (&mut self.figures.recent, &mut self.figures.explained);
            let block = (&self.block[..], &self.effective[..]);
            self.recent_rows.explain(block, &self.torque_std, recent, explained);
            self.look_for_left_out();
            self.look_at_scatter();
            self.look_at_urdf();
            self.look_at_gains();
            self.look_for_drift();
            self.look_for_counts();
        }
        self.look_for_impossibles();
        self.note_excitation();
        if self.blocks >= TRIED {
            self.of_mass.copy_from_slice(&self.effective);
        }
        // last, because it moves the offsets that the tests above look at
        if self.blocks >= self.options.settle_blocks {
            self.condense();
        }
        self.review_windows();
        self.block_slices = 0;
        self.block.iter_mut().for_each(JointSums::clear);
        true
    }

    /// Estimates with the block: from all rows so far, or, once they are condensed, from their
    /// information.
    fn learn_block(&mut self, changed: bool) {
        if self.condensed {
            self.walk_friction();
            self.follow(changed);
            return;
        }
        if self.payload.is_none() {
            for (total, block) in self.total.iter_mut().zip(&self.block) {
                total.add(block);
            }
        }
        for _ in 0..ITERATIONS {
            self.weigh_all();
            self.solve_all();
        }
        self.solve_covariance();
    }

    /// Prior standard deviation of a parameter.
    pub fn prior_std(&self, parameter: usize) -> f64 {
        self.parameters[parameter].scale
    }
}
