//! Converts the estimator's report to the message.

use crate::estimator::{BlockEstimator, Phase, Report, Verdict};
use crate::messages::{Estimate, MAX_DERIVED, State, estimate_flags};
use crate::model::DerivedValues;

/// The estimator's report as a message; fields of the stream are zero.
pub(super) fn message(report: &Report, verdict: Verdict) -> Estimate {
    let state = match verdict.phase {
        Phase::Collecting => State::Collecting,
        Phase::Converging => State::Converging,
        Phase::Converged => State::Converged,
        Phase::PoorlyExcited => State::PoorlyExcited,
        Phase::Changing => State::Changing,
        Phase::Degraded => State::Degraded,
        Phase::Invalid => State::Invalid,
        Phase::Misfit => State::Misfit,
    };
    let mut estimate = Estimate {
        excited: report.excited.iter().collect(),
        usable: report.usable.iter().collect(),
        fixed: report.fixed.iter().collect(),
        state: state as u32,
        use_ok: u32::from(verdict.use_ok),
        flags: if report.held.is_some() { estimate_flags::HELD } else { 0 },
        params: report.theta.len() as u32,
        equations: report.residual_rms.len() as u32,
        iterations: report.iterations,
        outliers: report.outliers,
        condition: report.condition,
        fit_probability: report.fit_probability,
        ..Estimate::EMPTY
    };
    fill(&mut estimate.innovation_rms, &report.innovation_rms);
    fill(&mut estimate.residual_rms, &report.residual_rms);
    fill(&mut estimate.fit, &report.fit);
    fill(&mut estimate.explained, &report.explained);
    fill(&mut estimate.theta, &report.theta);
    fill(&mut estimate.theta_std, &report.theta_std);
    estimate
}

/// Adds the derived values of the present estimate with their standard deviations.
pub(super) fn fill_derived(estimate: &mut Estimate, derived: &dyn DerivedValues, estimator: &BlockEstimator) {
    let covariance = |i: usize, j: usize| estimator.covariance(i, j);
    let count = derived.quantities().len().min(MAX_DERIVED);
    estimate.derived_len = count as u32;
    for index in 0..count {
        (estimate.derived[index], estimate.derived_std[index]) =
            derived.value_and_std(index, &estimator.report().theta, &covariance);
    }
}

/// Copies values to the head of a message array.
fn fill(target: &mut [f64], values: &[f64]) {
    for (target, value) in target.iter_mut().zip(values) {
        *target = *value;
    }
}
