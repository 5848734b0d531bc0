//! All rows that are no longer pending: what the estimate is based on.
//!
//! While the estimate settles, they are kept as sums per joint, so that (1) to (3) of
//! [`identify`](super::identify) can be repeated with better weights, and offsets have slopes. Then
//! they are condensed into information, whose weights are final.

use super::flange::Flange;
use super::information::{Information, Solver};
use super::levels::MisfitLevels;
use super::offset_drift::{DriftTerm, OffsetDrift, Origin};
use super::recent::PendingRows;
use super::recent_blocks::RecentBlocks;
use super::sums::JointSums;
use crate::estimator::persist::{Load, Visit};

/// The past rows, as sums at first and as information then.
#[derive(Debug, Clone)]
pub(super) struct Past {
    /// Λ₀ and Λ₀ θ₀ without a payload.
    prior: Information,
    sums: Vec<JointSums>,
    /// The sums with those of all pending slices.
    all: Vec<JointSums>,
    /// The sums with those of some pending slices.
    older: Vec<JointSums>,
    drift: OffsetDrift,
    is_condensed: bool,
    /// Prior and rows, once they are condensed.
    information: Information,
}

impl Past {
    /// Without rows; offsets of `drifts` are constant if `is_drifting` is false.
    pub fn new(prior: Information, drifts: Vec<DriftTerm>, is_drifting: bool, empty: &[JointSums]) -> Self {
        Self {
            information: prior.clone(),
            prior,
            sums: empty.to_vec(),
            all: empty.to_vec(),
            older: empty.to_vec(),
            drift: OffsetDrift::new(drifts, is_drifting, empty),
            is_condensed: false,
        }
    }

    /// Forgets all rows.
    pub fn reset(&mut self) {
        self.sums.iter_mut().for_each(JointSums::clear);
        self.drift.reset();
        self.is_condensed = false;
    }

    /// True once the weights of past rows are final.
    pub fn is_condensed(&self) -> bool {
        self.is_condensed
    }

    /// The sums that [`sum_up`](Self::sum_up) added, which are of all rows until these are
    /// condensed.
    pub fn all(&self) -> &[JointSums] {
        &self.all
    }

    /// The information of prior and rows, once they are condensed.
    pub fn information(&self) -> &Information {
        &self.information
    }

    /// Adds rows.
    pub fn add(&mut self, rows: &[JointSums], levels: &MisfitLevels, flange: &mut Flange) {
        if !self.is_condensed {
            self.sums.iter_mut().zip(rows).for_each(|(sums, rows)| sums.add(rows));
            return;
        }
        for (joint, sums) in rows.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            flange.learn(sums, levels.weight(joint), &mut self.information); // (1)
        }
    }

    /// Adds up the sums of all rows, those of the pending slices included.
    pub fn sum_up(&mut self, pending: &PendingRows) {
        pending.add_to(pending.len(), &self.sums, &mut self.all);
    }

    /// (1) over all rows as [summed up](Self::sum_up), with offsets at their mean.
    pub fn write_all(&mut self, levels: &MisfitLevels, flange: &mut Flange, fixed: &[bool], into: &mut Information) {
        let offsets = (&mut self.drift, Origin::Mean, fixed);
        learn(&self.prior, &self.all, (levels, flange), offsets, into);
    }

    /// (1) over these rows and the first `slices` pending slices, with offsets at `origin`.
    pub fn write(
        &mut self,
        (pending, slices): (&PendingRows, usize),
        levels: &MisfitLevels,
        flange: &mut Flange,
        (origin, fixed): (Origin, &[bool]),
        into: &mut Information,
    ) {
        if !self.is_condensed {
            pending.add_to(slices, &self.sums, &mut self.older);
            let offsets = (&mut self.drift, origin, fixed);
            learn(&self.prior, &self.older, (levels, flange), offsets, into);
            return;
        }
        into.copy_from(&self.information);
        for age in 0..slices {
            for (joint, sums) in pending.get(age).sums.iter().enumerate() {
                if sums.rows > 0 {
                    flange.learn(sums, levels.weight(joint), into);
                }
            }
        }
    }

    /// Condenses the sums: the weights of past rows are final from here on. Offsets, also those of
    /// `theta` and of the recent blocks, are then those at `now_s`.
    pub fn condense(
        &mut self,
        levels: &MisfitLevels,
        flange: &mut Flange,
        (fixed, theta): (&[bool], &mut [f64]),
        recent: &mut RecentBlocks,
        now_s: f64,
    ) {
        self.is_condensed = true;
        let offsets = (&mut self.drift, Origin::At(now_s), fixed);
        learn(
            &self.prior,
            &self.sums,
            (levels, flange),
            offsets,
            &mut self.information,
        );
        self.drift.move_offsets(theta, now_s);
        for (joint, sums) in recent.iter_mut().flat_map(|block| block.iter_mut().enumerate()) {
            self.drift.remove_from(joint, sums, now_s);
        }
        self.drift.end();
    }

    /// Replaces all rows by the information before a change.
    pub fn restore(&mut self, known: &Information) {
        if !self.is_condensed {
            self.drift.end();
        }
        self.is_condensed = true;
        self.information.copy_from(known);
    }

    /// Adds these variances of a random walk to those of the parameters q.
    pub fn walk(&mut self, solver: &mut Solver, q: &[usize], variances: &[f64]) {
        solver.walk(&mut self.information, q, variances);
    }

    /// Allows any payload.
    pub fn allow_payload(&mut self, flange: &Flange) {
        flange.allow_any(&mut self.information);
    }

    /// Keeps what holds for the arm when the payload is removed: everything if the payload was
    /// declared; if it was estimated, what holds for any payload.
    pub fn forget_payload(&mut self, solver: &mut Solver, flange: &Flange, fixed: &[bool], theta: &[f64]) {
        let payload = flange.parameters();
        match payload.iter().all(|i| fixed[*i]) {
            true => Solver::condition(&mut self.information, payload, theta),
            false => solver.marginalise(&mut self.information, payload),
        }
    }

    /// Estimates the slopes of the offsets from all rows as [summed up](Self::sum_up), and adds
    /// them to effective parameters without slopes.
    pub fn estimate_slopes(&mut self, levels: &MisfitLevels, fixed: &[bool], now_s: f64, effective: &mut [f64]) {
        let weight = |joint: usize| levels.weight(joint);
        self.drift.estimate(&self.all, weight, (fixed, now_s), effective);
    }

    /// Adds the slopes to effective parameters whose offsets are those at `origin`.
    pub fn add_slopes(&self, effective: &mut [f64], origin: Origin) {
        self.drift.add_to(effective, origin);
    }

    /// Adds the slopes that belong to other effective parameters to these.
    pub fn refit_slopes(&self, levels: &MisfitLevels, fixed: &[bool], effective: &mut [f64]) {
        if !self.is_condensed {
            let weight = |joint: usize| levels.weight(joint);
            self.drift.refit(&self.all, weight, fixed, effective);
        }
    }

    /// Adds how far the slopes change with a step of the effective parameters to the step.
    pub fn follow_slopes(&self, levels: &MisfitLevels, fixed: &[bool], step: &mut [f64]) {
        if !self.is_condensed {
            let weight = |joint: usize| levels.weight(joint);
            self.drift.follow(&self.all, weight, fixed, step);
        }
    }

    /// Forgets the slope of a parameter that becomes known, if it is an offset.
    pub fn forget_slope(&mut self, parameter: usize) {
        self.drift.forget(parameter);
    }

    /// Forgets how far offsets have drifted since the mean, if they are the present ones.
    pub fn forget_lag(&mut self) {
        if self.is_condensed {
            self.drift.forget_lag();
        }
    }

    /// Variance of a parameter by the drift of its offset.
    pub fn drift_variance(&self, parameter: usize) -> f64 {
        self.drift.variance(parameter)
    }

    /// Variance of the random walk that follows the drift of an offset, per second.
    pub fn drift_walk_per_s(&self, parameter: usize) -> f64 {
        self.drift.walk_per_s(parameter)
    }

    /// Takes the information of another process, which is condensed.
    pub fn load(&mut self, load: &mut Load<'_>) {
        self.information.visit(load);
        self.is_condensed = true;
    }

    /// Further state kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.drift.visit(v);
    }
}

/// Drifts, what their offsets are at, and the parameters whose value is known.
type Offsets<'a> = (&'a mut OffsetDrift, Origin, &'a [bool]);

/// (1) without the slopes of the offsets.
fn learn(
    prior: &Information,
    sums: &[JointSums],
    (levels, flange): (&MisfitLevels, &mut Flange),
    (drift, origin, fixed): Offsets<'_>,
    into: &mut Information,
) {
    into.copy_from(prior);
    if flange.is_loaded() {
        flange.allow_any(into);
    }
    for (joint, sums) in sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
        let weight = levels.weight(joint);
        flange.learn(drift.eliminate(joint, sums, weight, (origin, fixed)), weight, into); // (1)
    }
}
