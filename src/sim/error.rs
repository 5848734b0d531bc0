//! Errors of a simulation's options, and the checks that report them.

/// A value that a simulation cannot work with.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}{}: expected {expected}, got {got}", .joint.map(|j| format!(" of joint {}", j + 1)).unwrap_or_default())]
pub struct SimError {
    /// Name of the value: a path of fields of [`SimOptions`](super::SimOptions).
    pub field: &'static str,
    /// Its joint, counted from 0, if there are several.
    pub joint: Option<usize>,
    /// What was expected.
    pub expected: String,
    /// What was given.
    pub got: String,
}

impl SimError {
    pub(super) fn new(field: &'static str, expected: impl ToString, got: impl ToString) -> Self {
        Self {
            field,
            joint: None,
            expected: expected.to_string(),
            got: got.to_string(),
        }
    }

    pub(super) fn of_joint(mut self, joint: usize) -> Self {
        self.joint = Some(joint);
        self
    }
}

pub(super) fn finite(field: &'static str, value: f64) -> Result<(), SimError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(SimError::new(field, "a finite number", value))
    }
}

pub(super) fn positive(field: &'static str, value: f64) -> Result<(), SimError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(SimError::new(field, "a number above 0", value))
    }
}

pub(super) fn not_negative(field: &'static str, value: f64) -> Result<(), SimError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(SimError::new(field, "0 or above", value))
    }
}

pub(super) fn in_range(field: &'static str, value: f64, low: f64, high: f64) -> Result<(), SimError> {
    if value >= low && value <= high {
        Ok(())
    } else {
        Err(SimError::new(field, format!("{low} to {high}"), value))
    }
}
