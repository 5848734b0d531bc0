//! The state that an estimator needs to continue as if it had never stopped, visited field by field
//! in one order.
//!
//! One definition serves to count, to save and to load, so the three cannot disagree. Fields that
//! are not visited are workspace, which each block fills again. A test stops and continues
//! estimators during jumps and drifts and requires identical bits.

/// Visits the numbers and counts of a state in their order.
pub trait Visit {
    /// Real numbers; the lengths follow from structure and options.
    fn reals(&mut self, values: &mut [f64]);
    /// A count, flag or index.
    fn count(&mut self, value: &mut u64);

    /// A flag.
    fn flag(&mut self, value: &mut bool) {
        let mut count = u64::from(*value);
        self.count(&mut count);
        *value = count != 0;
    }

    /// A smaller count.
    fn small(&mut self, value: &mut u32) {
        let mut count = u64::from(*value);
        self.count(&mut count);
        *value = u32::try_from(count).unwrap_or(u32::MAX);
    }

    /// A single number.
    fn real(&mut self, value: &mut f64) {
        self.reals(std::slice::from_mut(value));
    }
}

/// Visits a symmetric n × n matrix by its lower triangle.
pub fn visit_symmetric(v: &mut impl Visit, matrix: &mut [f64], n: usize) {
    (0..n).for_each(|i| v.reals(&mut matrix[i * n..i * n + i + 1]));
    for i in 0..n {
        (0..i).for_each(|j| matrix[j * n + i] = matrix[i * n + j]);
    }
}

/// The state of an estimator and its state machine as plain lists, as in a checkpoint. The first
/// numbers are θ̂.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EstimatorState {
    /// The real numbers.
    pub reals: Vec<f64>,
    /// Counts and flags.
    pub counts: Vec<u64>,
}

/// Why a state cannot be loaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// It is of another model, or of another version of the estimator.
    #[error("expected {expected} numbers and counts, got {got}")]
    Length {
        /// Of this estimator.
        expected: usize,
        /// Of the state.
        got: usize,
    },
    /// A number is not finite.
    #[error("number {index} is not finite")]
    NotFinite {
        /// Which one.
        index: usize,
    },
    /// An estimate lies outside its bounds.
    #[error("the estimate of parameter {index} lies outside its bounds")]
    OutOfBounds {
        /// Which one, counted from 0.
        index: usize,
    },
    /// The information is not positive definite, or a variance is negative.
    #[error("the information is not positive definite, or a variance is negative")]
    NotPositive,
}

/// Saves a state; allocates only if the lists are too small.
#[derive(Debug)]
pub struct Save<'a>(pub &'a mut EstimatorState);

impl Visit for Save<'_> {
    fn reals(&mut self, values: &mut [f64]) {
        self.0.reals.extend_from_slice(values);
    }
    fn count(&mut self, value: &mut u64) {
        self.0.counts.push(*value);
    }
}

/// Loads a state.
#[derive(Debug)]
pub struct Load<'a> {
    reals: &'a [f64],
    counts: &'a [u64],
    wanted: usize,
}

impl<'a> Load<'a> {
    /// From the beginning of a state.
    pub fn new(state: &'a EstimatorState) -> Self {
        Self {
            reals: &state.reals,
            counts: &state.counts,
            wanted: 0,
        }
    }

    /// Checks that the state had exactly the right length.
    ///
    /// # Errors
    /// If it had not.
    pub fn finish(&self, state: &EstimatorState) -> Result<(), StateError> {
        let got = state.reals.len() + state.counts.len();
        if self.wanted == got && self.reals.is_empty() && self.counts.is_empty() {
            Ok(())
        } else {
            Err(StateError::Length {
                expected: self.wanted,
                got,
            })
        }
    }
}

impl Visit for Load<'_> {
    fn reals(&mut self, values: &mut [f64]) {
        self.wanted += values.len();
        if let Some((here, rest)) = self.reals.split_at_checked(values.len()) {
            values.copy_from_slice(here);
            self.reals = rest;
        }
    }
    fn count(&mut self, value: &mut u64) {
        self.wanted += 1;
        if let Some((here, rest)) = self.counts.split_first() {
            *value = *here;
            self.counts = rest;
        }
    }
}
