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

use super::identify::{RobotIdentifier, TRIED};
use super::impossible_room::Impossible;
use super::left_out_room::LeftOutCause;

/// Standard deviations below 0 that refute the model, and below which the refutation ends.
const SURE: f64 = 5.0;
const AGAIN: f64 = 2.0;
/// The links' inertia is tested if it is at least this share of the joint's.
const MATTERS: f64 = 0.2;

impl RobotIdentifier {
    /// The first impossible estimate: the model does not describe the machine.
    pub fn impossible(&self) -> Option<Impossible> {
        let inertia = self.impossibles.inertias.iter().position(|negative| *negative);
        let inertia = inertia.map(Impossible::Inertia);
        inertia.or(self.impossibles.parameter.map(Impossible::Parameter))
    }

    /// True if a wrong sign is likelier than a term left out of the model. Springs and delays
    /// resemble it, and missing Coulomb friction also makes inertias negative.
    pub fn is_sign_likelier(&self) -> bool {
        let is_vague = |cause: LeftOutCause| cause.what.is_one_of_many();
        matches!(self.impossible(), Some(Impossible::Inertia(_))) && self.left_out_cause().is_none_or(is_vague)
    }

    /// Tests the estimates after a block.
    pub(super) fn look_for_impossibles(&mut self) {
        let mut row = std::mem::take(&mut self.impossibles.row);
        // the first blocks after a change may still be attributed to another cause
        let joints = if self.recent_blocks < TRIED {
            0
        } else {
            self.model.robot().len()
        };
        for joint in 0..joints {
            let least = if self.impossibles.inertias[joint] { AGAIN } else { SURE };
            self.impossibles.inertias[joint] = self.has_negative_inertia(joint, least, &mut row);
        }
        self.impossibles.row = row;
        let found = self.impossibles.parameter;
        let least = |i: usize| if found == Some(i) { AGAIN } else { SURE };
        let refuted = |i: &usize| {
            let range = self.parameters[*i].range;
            !self.fixed[*i] && range.refutes(self.theta[*i], least(*i) * self.theta_std(*i)) // (3)
        };
        self.impossibles.parameter = (0..self.parameters.len()).find(refuted);
    }

    /// (2) with this number of standard deviations.
    fn has_negative_inertia(&self, joint: usize, least: f64, row: &mut [f64]) -> bool {
        let columns = self.block[joint].columns_below(self.theta.len());
        let row = &mut row[..columns.len()];
        row.fill(0.0);
        self.wide
            .add_inertia_row(self.rows.regressors(), (joint, joint), 1.0, row);
        let along = |row: &[f64]| -> f64 { row.iter().zip(columns).map(|(x, &k)| x * self.theta[k]).sum() };
        let is_surely = |inertia: f64, row: &[f64]| inertia < 0.0 && inertia < -least * self.std_along(columns, row); // (2)
        let whole = along(row); // (1)
        if is_surely(whole, row) {
            return true;
        }
        let Some(rotor) = self.wide.rotor_column(joint) else {
            return false;
        };
        row[rotor] = 0.0;
        let links = along(row);
        links < -MATTERS * whole.abs() && is_surely(links, row)
    }

    /// Standard deviation of a sum of these parameters with these factors.
    fn std_along(&self, columns: &[usize], factors: &[f64]) -> f64 {
        let n = self.theta.len();
        let mut variance = 0.0;
        for (x, &i) in factors.iter().zip(columns).filter(|(x, _)| **x != 0.0) {
            let row = &self.covariance[i * n..(i + 1) * n];
            variance += x * columns.iter().zip(factors).map(|(&k, y)| row[k] * y).sum::<f64>(); // (1)
        }
        let along = |shift: &[f64]| -> f64 { columns.iter().zip(factors).map(|(&k, y)| shift[k] * y).sum() };
        variance += along(&self.bias).powi(2);
        let shifts = self.left_out.iter().flat_map(|left_out| left_out.errors(n));
        variance += shifts.map(|shift| along(shift).powi(2)).sum::<f64>();
        variance.max(0.0).sqrt()
    }
}
