//! Errors that a model leaves out, as columns beside its rows.

/// What the estimator is told of the errors that a model leaves out ("suspects"), to widen the
/// covariance by them (`considered.rs`), to name them (`score_test.rs`) and to find the cause of a
/// change (`cause_search.rs`).
pub trait SuspectRows {
    /// Number of errors: at most 1 of the whole machine and
    /// [`ERRORS_PER_EQUATION`](super::ERRORS_PER_EQUATION) of each equation; any beyond that are
    /// ignored.
    fn count(&self) -> usize;
    /// Writes d_s = ∂f/∂a_s of a row over the errors, whitened as
    /// [`Residuals::row`](super::Residuals::row) is.
    fn row(&self, equation: usize, index: usize, columns: &mut [f64]);
    /// Standard deviation of an error's amplitude; 0, the default, for an error that is tested for
    /// but does not widen the covariance.
    fn std(&self, _suspect: usize) -> f64 {
        0.0
    }
    /// Standard deviation of an error that acts exactly like a parameter, in the parameter's unit.
    /// No rows tell the two apart, so the published covariance always contains it.
    fn inseparable_std(&self, _parameter: usize) -> f64 {
        0.0
    }
    /// True for an error that can arise while the machine runs, and may be the cause of a change.
    fn is_sudden(&self, _suspect: usize) -> bool {
        false
    }
    /// True for an error that the parameters imitate, so its column is informative only after a
    /// change.
    fn is_imitated(&self, _suspect: usize) -> bool {
        false
    }
    /// True for an error that makes the parameters contradict a relation between them
    /// ([`EstimatorOptions::relations`](super::EstimatorOptions::relations)), though they describe
    /// the data.
    fn contradicts_relations(&self, _suspect: usize) -> bool {
        false
    }
    /// False for an error that is only allowed for, because likelier ones look the same.
    fn is_named(&self, _suspect: usize) -> bool {
        true
    }
    /// For a resonance, the input delay, because a resonance delays slow motion as well. The column
    /// of a resonance is the first term of a series, which holds for slow motion only
    /// (`summed_rows.rs`).
    fn lags_as(&self, _suspect: usize) -> Option<usize> {
        None
    }
    /// The relative changes of the parameters that an error of 1 is equivalent to, if it has no
    /// column of its own.
    fn imitation(&self, _suspect: usize) -> Option<&[f64]> {
        None
    }
}

/// Of rows that have no columns of errors.
pub(super) struct NoSuspects;

impl SuspectRows for NoSuspects {
    fn count(&self) -> usize {
        0
    }
    fn row(&self, _: usize, _: usize, _: &mut [f64]) {}
}
