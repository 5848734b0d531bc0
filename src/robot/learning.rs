//! Processing of a block: weights (2) and (3), estimates (1), the random walk of friction (4) of
//! [`identify`](super::identify).

use super::block_scatter_room::BlockScatter;
use super::identify::RobotIdentifier;
use super::information::{Information, Solver};
use super::left_out_room::LeftOut;
use super::model::RobotModel;
use super::offset_drift::{Offsets, Origin};
use super::payload::Payload;
use super::spatial::BodyParameters;
use super::sums::JointSums;
use std::ops::Range;

/// Weight, in blocks, of f_j² from before a change.
const KEPT_INFLATION: f64 = 8.0;
/// Averaging time of σ_j² after settling, in blocks.
const FOLLOWED_BLOCKS: f64 = 20.0;
/// Smallest σ_j relative to the joint's mean torque, because a perfect simulation has no residual.
pub(super) const SMALLEST_STD: f64 = 1e-9;
/// The same while a joint has hardly more rows than its share of the parameters, so that almost any
/// data fit.
const UNTRIED_STD: f64 = 0.02;
/// Rows per parameter above which residuals show the noise.
pub(super) const ROWS_PER_PARAMETER: f64 = 2.0;
/// Smallest size of a parameter for its excitation, relative to its prior.
const SMALLEST_SIZE: f64 = 1e-3;

impl RobotIdentifier {
    /// (2) and (3) over all data so far.
    pub(super) fn weigh_all(&mut self) {
        self.pending.add_to(self.pending.len(), &self.total, &mut self.all);
        for (joint, sums) in self.all.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let rows = sums.rows as f64;
            let own = self.model.friction_of(joint).len().max(1) as f64;
            let variance = sums.residual_square(&self.effective) / (rows - own).max(1.0); // (2)
            let share = self.parameters.len() as f64 / self.model.robot().len() as f64;
            let untried = (ROWS_PER_PARAMETER - self.independent(sums) / share).clamp(0.0, 1.0);
            let floor = (sums.square / rows).sqrt() * (SMALLEST_STD + UNTRIED_STD * untried);
            self.torque_std[joint] = variance.sqrt().max(floor).max(f64::MIN_POSITIVE.sqrt());
        }
        self.inflate();
    }

    /// Rows of a joint that do not overlap.
    fn independent(&self, sums: &JointSums) -> f64 {
        sums.rows as f64 * self.independent_share()
    }

    /// Share of the rows that do not overlap.
    pub(super) fn independent_share(&self) -> f64 {
        let windows = &self.options.windows;
        (windows.stride_s / windows.length_s).min(1.0)
    }

    /// True if there are enough rows to distinguish a change from what is still unknown.
    pub(super) fn has_enough_rows(&self) -> bool {
        let rows: f64 = self.all.iter().map(|sums| self.independent(sums)).sum();
        self.condensed || rows >= ROWS_PER_PARAMETER * self.parameters.len() as f64
    }

    /// (3) over the recent blocks.
    pub(super) fn inflate(&mut self) {
        for joint in 0..self.model.robot().len() {
            let friction = self.model.friction_of(joint).len();
            let (assumed, weight) = (self.assumed.0[joint], self.assumed.1);
            let (mut sum, mut count) = (assumed * weight, weight);
            for block in self.recent.iter().take(self.recent_blocks) {
                let sums = &block[joint];
                if sums.rows == 0 || friction == 0 {
                    continue;
                }
                let end = self.model.columns(joint).len();
                if let Some((square, directions)) = friction_misfit(sums, end - friction..end, &self.effective) {
                    sum += square / (directions * self.torque_std[joint].powi(2)); // (3)
                    count += 1.0;
                }
            }
            self.inflation[joint] = (sum / count).sqrt().max(1.0);
        }
    }

    /// Estimates the drift of friction from the mean, which is its estimate.
    pub(super) fn look_for_drift(&mut self) {
        self.drift.reset();
        if self.options.friction_walk == 0.0 {
            return;
        }
        for joint in 0..self.torque_std.len() {
            let own = self.model.friction_of(joint);
            let end = self.model.columns(joint).len();
            let (kept, blocks) = (self.recent.len(), self.recent_blocks);
            let last = (1..=blocks.min(kept)).map(|age| &self.recent[(blocks - age) % kept][joint]);
            let level = self.torque_std[joint] * self.inflation[joint];
            let columns = end - own.len()..end;
            self.drift.look_at(last, (columns, own), &self.effective, level);
        }
    }

    /// Estimates the effect of the torques' resolution on friction.
    pub(super) fn look_for_counts(&mut self) {
        for joint in 0..self.torque_std.len() {
            let own = self.model.friction_of(joint);
            let end = self.model.columns(joint).len();
            let blocks = self.recent.iter().take(self.recent_blocks).map(|block| &block[joint]);
            let size = |i: usize| self.parameters[i].scale;
            self.counts.look_at(joint, blocks, (end - own.len()..end, own), size);
        }
    }

    /// Drops the recent blocks, which are of another machine; keeps f_j and x_i.
    pub(super) fn forget_recent(&mut self) {
        self.recent_blocks = 0;
        self.block_scatter.iter_mut().for_each(BlockScatter::carry_over);
        for (assumed, inflation) in self.assumed.0.iter_mut().zip(&self.inflation) {
            *assumed = inflation * inflation;
        }
        self.assumed.1 = KEPT_INFLATION;
    }

    pub(super) fn weight(&self, joint: usize) -> f64 {
        weights(&self.inflation, &self.torque_std)(joint)
    }

    /// The prior and `total` as information, for the payload carried during all of it; offsets are
    /// constant if their drift is `None`.
    pub(super) fn of_total(
        model: &RobotModel,
        total: &[JointSums],
        weight: impl Fn(usize) -> f64,
        (mut load, left_out): (Option<&mut Payload>, Option<&LeftOut>),
        mut drift: Option<Offsets<'_>>,
        into: &mut Information,
    ) {
        into.clear();
        for (i, parameter) in model.parameters().iter().enumerate() {
            into.set_prior(i, parameter.nominal, parameter.scale);
        }
        if let Some(payload) = &load {
            for (i, std) in payload.indices().zip(payload.prior) {
                into.set_prior(i, 0.0, std);
            }
        }
        if let Some(left_out) = left_out {
            left_out.set_priors(into);
        }
        for (joint, sums) in total.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let sums = match &mut drift {
                Some((drift, origin, fixed)) => drift.eliminate(joint, sums, weight(joint), (*origin, fixed)),
                None => sums,
            };
            learn(sums, weight(joint), load.as_deref_mut(), into); // (1)
        }
    }

    /// (1) over all data so far.
    pub(super) fn solve_all(&mut self) {
        let weight = weights(&self.inflation, &self.torque_std);
        let load = self.payload.as_mut().filter(|_| self.is_loaded);
        let besides = (load, self.left_out.as_ref());
        let offsets = Some((&mut self.offset_drift, Origin::Mean, &self.fixed[..]));
        Self::of_total(&self.model, &self.all, weight, besides, offsets, &mut self.system);
        self.solver.solve(&self.system, &self.fixed, &mut self.theta); // (1)
        let mut effective = std::mem::take(&mut self.effective);
        self.effective_if(self.is_loaded, &self.theta, &mut effective);
        let now = (&self.fixed[..], self.rows.elapsed_s());
        self.offset_drift.estimate(&self.all, weight, now, &mut effective);
        self.effective = effective;
    }

    /// Condenses the sums into the information; the weights of past data are final from here on.
    pub(super) fn condense(&mut self) {
        if !self.condensed {
            self.condensed = true;
            let weight = weights(&self.inflation, &self.torque_std);
            let load = self.payload.as_mut().filter(|_| self.is_loaded);
            let besides = (load, self.left_out.as_ref());
            let now_s = self.rows.elapsed_s();
            let offsets = Some((&mut self.offset_drift, Origin::At(now_s), &self.fixed[..]));
            Self::of_total(&self.model, &self.total, weight, besides, offsets, &mut self.committed);
            self.offset_drift.move_offsets(&mut self.theta, now_s);
            for (joint, sums) in self.recent.iter_mut().flat_map(|block| block.iter_mut().enumerate()) {
                self.offset_drift.remove_from(joint, sums, now_s);
            }
            self.offset_drift.end();
            self.refresh_effective();
        }
    }

    /// Writes the information of the first `slices` pending slices and of all data before them to
    /// `system`, with offsets at `origin`.
    pub(super) fn assemble_older(&mut self, slices: usize, origin: Origin) {
        if !self.condensed {
            self.pending.add_to(slices, &self.total, &mut self.older);
            let weight = weights(&self.inflation, &self.torque_std);
            let load = self.payload.as_mut().filter(|_| self.is_loaded);
            let besides = (load, self.left_out.as_ref());
            let offsets = Some((&mut self.offset_drift, origin, &self.fixed[..]));
            Self::of_total(&self.model, &self.older, weight, besides, offsets, &mut self.system);
            return;
        }
        self.system.copy_from(&self.committed);
        for age in 0..slices {
            for joint in 0..self.block.len() {
                let weight = self.weight(joint);
                let sums = &self.pending.get(age).sums[joint];
                if sums.rows > 0 {
                    let load = self.payload.as_mut().filter(|_| self.is_loaded);
                    learn(sums, weight, load, &mut self.system);
                }
            }
        }
    }

    /// Writes the information with all slices to `system`, with offsets at `origin`.
    pub(super) fn assemble(&mut self, origin: Origin) {
        self.assemble_older(self.pending.len(), origin);
    }

    /// The present, for offsets.
    pub(super) fn now(&self) -> Origin {
        Origin::At(self.rows.elapsed_s())
    }

    /// Commits the oldest pending slices.
    pub(super) fn commit_pending(&mut self, count: usize) {
        for _ in 0..count {
            let Some(slice) = self.pending.pop() else { return };
            if !self.condensed {
                for (total, sums) in self.total.iter_mut().zip(&slice.sums) {
                    total.add(sums);
                }
                continue;
            }
            for (joint, sums) in slice.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
                let weight = weights(&self.inflation, &self.torque_std)(joint);
                let load = self.payload.as_mut().filter(|_| self.is_loaded);
                learn(sums, weight, load, &mut self.committed);
            }
        }
    }

    /// (4).
    pub(super) fn walk_friction(&mut self) {
        if self.options.friction_walk == 0.0 {
            return;
        }
        let n = self.theta.len();
        for (k, &i) in self.frictions.iter().enumerate() {
            let size = self.theta[i].abs().max(self.covariance[i * n + i].max(0.0).sqrt());
            let per_s = (self.options.friction_walk * size).powi(2); // (4)
            self.walk[k] = per_s.max(self.offset_drift.walk_per_s(i)) * self.options.block_s;
        }
        self.solver.walk(&mut self.committed, &self.frictions, &self.walk);
    }

    /// (1) for one more block, with σ_j followed.
    pub(super) fn follow(&mut self, changed: bool) {
        if self.payload.is_none() {
            for joint in 0..self.block.len() {
                if self.block[joint].rows > 0 {
                    let weight = self.weight(joint);
                    learn(&self.block[joint], weight, None, &mut self.committed); // (1)
                }
            }
        }
        self.solve_known();
        if changed {
            return;
        }
        for (joint, sums) in self.block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let variance = sums.residual_square(&self.effective) / sums.rows as f64;
            let kept = self.torque_std[joint].powi(2);
            let floor = (sums.square / sums.rows as f64).sqrt() * SMALLEST_STD;
            self.torque_std[joint] = (kept + (variance - kept) / FOLLOWED_BLOCKS).sqrt().max(floor);
        }
        self.inflate();
    }

    /// Allows any payload from now on and drops all information on it.
    pub(super) fn load(&mut self) {
        self.forget_gains();
        let Some(payload) = &self.payload else { return };
        self.is_loaded = true;
        for (p, i) in payload.indices().enumerate() {
            self.fixed[i] = false;
            self.committed.set_prior(i, 0.0, payload.prior[p]);
        }
    }

    /// Keeps the information on the arm when the payload is removed: all of it if the payload was
    /// declared; if it was estimated, the part that holds for any payload.
    pub(super) fn marginalise_payload(&mut self) {
        match self.carried.iter().all(|i| self.fixed[*i]) {
            true => Solver::condition(&mut self.committed, &self.carried, &self.theta),
            false => self.solver.marginalise(&mut self.committed, &self.carried),
        }
    }

    /// Commits all data so far before the payload changes. Before the first block there are no
    /// weights yet, so the part of a block is dropped instead.
    pub(super) fn begin_load(&mut self) {
        if self.blocks > 0 || self.condensed {
            self.condense();
            self.commit_pending(usize::MAX);
            return;
        }
        for sums in [&mut self.block, &mut self.slice, &mut self.total]
            .into_iter()
            .flatten()
        {
            sums.clear();
        }
        self.pending.clear();
        self.block_slices = 0;
    }

    /// Declares the payload from now on, instead of detecting it: `None` for nothing, otherwise ten
    /// parameters at the flange, which are fixed. Does nothing if the payload is not among the
    /// parameters. The test for changes continues, so a contradiction of the declaration is found.
    pub fn declare_payload(&mut self, body: Option<&BodyParameters>) {
        if self.payload.is_none() {
            return;
        }
        self.begin_load();
        if self.is_loaded && self.condensed {
            self.marginalise_payload();
        }
        self.unload();
        if let Some(body) = body {
            self.load();
            for (&i, value) in self.carried.iter().zip(body.0) {
                (self.fixed[i], self.theta[i]) = (true, value);
            }
        }
        if let Some(watch) = &mut self.watch {
            watch.doubt = 0;
        }
        self.solve_known();
    }

    /// Removes the payload.
    pub(super) fn unload(&mut self) {
        self.forget_gains();
        let Some(payload) = &self.payload else { return };
        self.is_loaded = false;
        for i in payload.indices() {
            (self.fixed[i], self.theta[i]) = (true, 0.0);
        }
    }

    pub(super) fn refresh_effective(&mut self) {
        let mut effective = std::mem::take(&mut self.effective);
        self.effective_of(&self.theta, Origin::Mean, &mut effective);
        self.effective = effective;
    }

    /// Records the excitation of each parameter by the block alone.
    pub(super) fn note_excitation(&mut self) {
        let n = self.theta.len();
        let own = self.parameters.len();
        self.gain.clear();
        for joint in 0..self.block.len() {
            if self.block[joint].rows > 0 {
                let weight = self.weight(joint);
                let load = self.payload.as_mut().filter(|_| self.is_loaded);
                learn(&self.block[joint], weight, load, &mut self.gain);
            }
        }
        for i in 0..own {
            self.size[i] = self.theta[i].abs().max(SMALLEST_SIZE * self.parameters[i].scale);
            self.gain.matrix[i * n + i] += self.size[i].powi(-2);
        }
        self.figures
            .of_gain(&mut self.solver, &self.gain, &self.fixed, &self.size);
    }
}

/// 1/(f_j σ_j)² of (1), for each joint.
fn weights(inflation: &[f64], torque_std: &[f64]) -> impl Fn(usize) -> f64 + Copy {
    move |joint| (inflation[joint] * torque_std[joint]).powi(-2)
}

/// Adds weight · (A, b) of a joint's rows, for a robot with or without payload.
pub(super) fn learn(sums: &JointSums, weight: f64, load: Option<&mut Payload>, into: &mut Information) {
    sums.scatter(weight, into); // (1)
    if let Some(payload) = load {
        payload.scatter(sums, weight, into);
    }
}

/// eᵀ (FᵀF)⁻¹ e over these friction columns of one block, and its number of directions.
pub(super) fn friction_misfit(sums: &JointSums, friction: Range<usize>, theta: &[f64]) -> Option<(f64, f64)> {
    const MOST: usize = 8;
    const DEPENDENT: f64 = 1e-6;
    let m = sums.columns().len();
    let first = friction.start;
    // Cholesky without square roots; a column that depends on those before it, as in a block
    // without a reversal, adds no direction.
    let mut l = [[0.0; MOST]; MOST];
    let mut d = [0.0; MOST];
    let mut e = [0.0; MOST];
    let (mut square, mut directions) = (0.0, 0.0);
    for i in 0..friction.len().min(MOST) {
        let row = &sums.gram[(first + i) * m + first..(first + i + 1) * m];
        e[i] = sums.gradient(first + i, theta);
        let mut pivot = row[i];
        for j in 0..i {
            if d[j] > 0.0 {
                let mut v = row[j];
                for k in 0..j {
                    v -= l[i][k] * l[j][k] * d[k];
                }
                l[i][j] = v / d[j];
                pivot -= l[i][j] * l[i][j] * d[j];
                e[i] -= l[i][j] * e[j];
            }
        }
        if pivot > DEPENDENT * row[i] {
            d[i] = pivot;
            square += e[i] * e[i] / pivot;
            directions += 1.0;
        }
    }
    (directions > 0.0).then_some((square, directions))
}
