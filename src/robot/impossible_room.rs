//! What has come out as no machine has it, and room for the test of
//! [`impossible`](super::impossible).

use crate::model::MAX_JOINTS;

/// What no machine has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Impossible {
    /// The inertia at this joint is negative; counted from 0.
    Inertia(usize),
    /// This parameter is negative.
    Parameter(usize),
}

/// What has been found, and room to look for it.
#[derive(Debug, Clone)]
pub(super) struct Impossibles {
    pub inertias: [bool; MAX_JOINTS],
    pub parameter: Option<usize>,
    /// r_j over the columns of a joint.
    pub row: Vec<f64>,
}

impl Impossibles {
    /// Room for joints of up to so many columns.
    pub fn new(columns: usize) -> Self {
        Self {
            inertias: [false; MAX_JOINTS],
            parameter: None,
            row: vec![0.0; columns],
        }
    }

    /// Forgets what was found.
    pub fn clear(&mut self) {
        (self.inertias, self.parameter) = ([false; MAX_JOINTS], None);
    }
}
