//! Finds physically impossible estimates: negative friction, payload or inertia.
//!
//! ```text
//! m_j = r_j·θ̂,    var m_j = r_jᵀ P r_j,    r_j the row of M_jj(q) at the newest sample            (1)
//! refuted if m_j < −SURE std m_j, for M with the rotors and for that of the links alone         (2)
//! refuted if θ̂_i < −SURE σ_i, for a parameter that is positive                                  (3)
//! ```
//!
//! A torque, a position or an axis of the wrong sign may leave little residual: with the sign of
//! joint 2's torque wrong, the estimated weight of a six-axis arm is reversed, fits to within a
//! percent of the torque's power, and would count as known. But the inertia is reversed too. At a
//! coupled joint the rotor's parameter hides this, so the links are also tested separately if they
//! are a relevant part of the whole.
//!
//! A refutation holds until the value is within [`AGAIN`] of 0, because the wrong sign persists
//! after the part of the motion that shows it.

use super::allowances::Allowances;
use super::impossible_room::{Impossible, Impossibles};
use super::learning::{Learner, TRIED};
use super::regressor::EnergyRegressors;

/// Standard deviations below 0 that refute the model, and below which the refutation ends.
const SURE: f64 = 5.0;
const AGAIN: f64 = 2.0;
/// The links' inertia is tested if it is at least this share of the joint's.
const MATTERS: f64 = 0.2;

impl Impossibles {
    /// The first impossible estimate.
    pub fn first(&self) -> Option<Impossible> {
        let inertia = self.inertias.iter().position(|negative| *negative);
        let inertia = inertia.map(Impossible::Inertia);
        inertia.or(self.parameter.map(Impossible::Parameter))
    }

    /// Tests the estimates after a block; `newest` are the regressors at the newest sample.
    pub fn look_at_block(&mut self, learner: &Learner, allowances: &Allowances, newest: &EnergyRegressors) {
        // the first blocks after a change may still be attributed to another cause
        let joints = match learner.recent.count() {
            0..TRIED => 0,
            _ => learner.arm.joints(),
        };
        for joint in 0..joints {
            let least = if self.inertias[joint] { AGAIN } else { SURE };
            let std = |columns: &[usize], factors: &[f64]| allowances.std_along(learner, columns, factors);
            self.inertias[joint] = self.has_negative_inertia(joint, least, (learner, newest), std);
        }
        let found = self.parameter;
        let least = |i: usize| if found == Some(i) { AGAIN } else { SURE };
        let refuted = |i: &usize| {
            let range = learner.arm.parameters[*i].range;
            let std = allowances.std(learner, *i);
            range.refutes(learner.estimate.theta()[*i], least(*i) * std) // (3)
        };
        self.parameter = learner.estimate.free().find(refuted);
    }

    /// (2) with this number of standard deviations; `std` is that of a sum of parameters with
    /// factors.
    fn has_negative_inertia(
        &mut self,
        joint: usize,
        least: f64,
        (learner, newest): (&Learner, &EnergyRegressors),
        std: impl Fn(&[usize], &[f64]) -> f64,
    ) -> bool {
        let theta = learner.estimate.theta();
        let wide = &learner.arm.wide;
        let columns = learner.open.sums()[joint].columns_below(theta.len());
        let row = &mut self.row[..columns.len()];
        row.fill(0.0);
        wide.add_inertia_row(newest, (joint, joint), 1.0, row);
        let along = |row: &[f64]| -> f64 { row.iter().zip(columns).map(|(x, &k)| x * theta[k]).sum() };
        let is_surely = |inertia: f64, row: &[f64]| inertia < 0.0 && inertia < -least * std(columns, row); // (2)
        let whole = along(row); // (1)
        if is_surely(whole, row) {
            return true;
        }
        let Some(rotor) = wide.rotor_column(joint) else {
            return false;
        };
        row[rotor] = 0.0;
        let links = along(row);
        links < -MATTERS * whole.abs() && is_surely(links, row)
    }
}
