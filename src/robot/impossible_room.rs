//! Impossible estimates, and workspace for the test of [`impossible`](super::impossible).

use crate::model::MAX_JOINTS;

/// An impossible estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Impossible {
    /// The inertia at this joint is negative; counted from 0.
    Inertia(usize),
    /// This parameter is negative.
    Parameter(usize),
}

/// The impossible estimates found, and the workspace of the test.
#[derive(Debug, Clone)]
pub(super) struct Impossibles {
    pub inertias: [bool; MAX_JOINTS],
    pub parameter: Option<usize>,
    /// r_j over the columns of a joint.
    pub row: Vec<f64>,
}

impl Impossibles {
    /// Workspace for joints of up to `columns` columns.
    pub fn new(columns: usize) -> Self {
        Self {
            inertias: [false; MAX_JOINTS],
            parameter: None,
            row: vec![0.0; columns],
        }
    }

    /// Clears the results.
    pub fn clear(&mut self) {
        (self.inertias, self.parameter) = ([false; MAX_JOINTS], None);
    }
}
