//! Workspace of the test for changes, allocated at the start.

use super::change::{Evidence, RobotChange};
use super::gain_columns::GainColumns;
use super::information::Information;
use super::inquiry_room::Inquiry;
use super::sums::JointSums;

/// State and workspace of the test.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    pub evidence: Evidence,
    /// Sums of the last slices, with the gradient at the estimate before them.
    pub window: Vec<JointSums>,
    /// The same as information.
    pub data: Information,
    /// The estimate before: all parameters, and as an equivalent arm.
    pub theta: Vec<f64>,
    pub effective: Vec<f64>,
    /// The changed machine as an equivalent arm.
    pub changed: Vec<f64>,
    /// Indices of the friction's parameters and the standard deviations of their change.
    pub friction_std: Vec<f64>,
    /// Columns of the drives' gains.
    pub gains: GainColumns,
    /// Slices since a change was first suspected without a clear cause.
    pub doubt: usize,
    /// Slices in a row that a drive or an encoder explains.
    pub strange: usize,
    /// The change whose cause is still sought.
    pub inquiry: Inquiry,
    /// The change found since the block began.
    pub found: Option<RobotChange>,
}

impl Watch {
    pub fn new(parameters: usize, arm: usize, frictions: usize, empty: &[JointSums]) -> Self {
        Self {
            evidence: Evidence::new(parameters, frictions.max(super::spatial::BODY_PARAMETERS)),
            window: empty.to_vec(),
            data: Information::new(parameters),
            theta: vec![0.0; parameters],
            effective: vec![0.0; arm],
            changed: vec![0.0; arm],
            friction_std: vec![0.0; frictions],
            gains: GainColumns::new(empty.len(), parameters),
            doubt: 0,
            strange: 0,
            inquiry: Inquiry::new(parameters, arm, empty),
            found: None,
        }
    }
}
