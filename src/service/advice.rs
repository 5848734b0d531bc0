//! Advice on the configured windows and their stride, from the motion of an off-line run.

use crate::config::Config;
use crate::messages::Sample;
use crate::offline::short;
use crate::rows::{FEWEST_WINDOW_SAMPLES, ProjectedOptions, RowForm, window_advice_at};

/// Number of samples used for the advice.
const ENOUGH: usize = 20_000;

/// Keeps the positions of the first samples.
pub(super) struct Advisor {
    /// `None` without windows.
    rows: Option<ProjectedOptions>,
    /// True if the identifier chooses their length.
    auto: bool,
    joints: usize,
    /// Time stamps \[ns\] and positions of each joint.
    positions: Vec<Vec<(u64, f64)>>,
}

impl Advisor {
    /// For samples of `joints` joints, at most [`crate::model::MAX_JOINTS`].
    pub(super) fn new(config: &Config, joints: usize) -> Self {
        let rows = match &config.identifier.rows {
            RowForm::Projected(rows) => Some(*rows),
            RowForm::Pointwise => None,
        };
        Self {
            rows,
            auto: config.identifier.auto_window,
            joints,
            positions: Vec::new(),
        }
    }

    pub(super) fn take(&mut self, sample: &Sample) {
        if self.rows.is_none() {
            return;
        }
        // A file may contain any number of joints; like the node, this refuses samples with a wrong
        // number.
        if sample.joints as usize != self.joints {
            return;
        }
        self.positions.resize(self.joints, Vec::new());
        for (kept, &q) in self.positions.iter_mut().zip(&sample.q) {
            if kept.len() < ENOUGH && q.is_finite() {
                kept.push((sample.t_ns, q));
            }
        }
    }

    /// One line of advice, if windows are used and something moved; `in_force` is the window at the
    /// end.
    pub(super) fn line(&self, in_force: Option<f64>) -> Option<String> {
        let rows = self.rows.as_ref()?;
        let window_s = in_force.unwrap_or(rows.window_s);
        let advices = self.positions.iter();
        let advices = advices.filter_map(|samples| window_advice_at(samples, rows.sample_period_s));
        let reached_hz = advices.map(|advice| advice.bandwidth_hz).max_by(f64::total_cmp)?;
        Some(words(rows, self.auto, window_s, reached_hz))
    }
}

/// The standard deviations with windows of 20 samples and more agree to within a third if the
/// stride is short enough: a fifth of the length, and at least two windows per period of the
/// fastest motion.
fn words(rows: &ProjectedOptions, auto: bool, window_s: f64, reached_hz: f64) -> String {
    let ms = |length_s: f64| short(1e3 * length_s);
    let reached = format!("the motion reaches {reached_hz:.1} Hz");
    if auto {
        let window = ms(window_s);
        return format!("{reached}; identifier.projected.window_s = \"auto\" has chosen {window} ms");
    }
    let (period_s, stride_s) = (rows.sample_period_s, rows.stride_s);
    let least_s = FEWEST_WINDOW_SAMPLES * period_s;
    let apart_s = (window_s / 5.0).min(0.5 / reached_hz);
    let apart_s = (apart_s / period_s + 1e-6).floor().max(1.0) * period_s;
    if window_s < least_s * (1.0 - 1e-9) {
        format!(
            "{reached}; identifier.projected.window_s is {} ms: estimates of windows of less than {} ms, {FEWEST_WINDOW_SAMPLES} samples, can be wrong",
            ms(window_s),
            ms(least_s)
        )
    } else if stride_s > apart_s * (1.0 + 1e-9) {
        format!(
            "{reached}; windows of {} ms resolve it if they are {} ms apart or less, and identifier.projected.stride_s is {} ms",
            ms(window_s),
            ms(apart_s),
            ms(stride_s)
        )
    } else {
        let (window, stride) = (ms(window_s), ms(stride_s));
        format!("{reached}, which windows of {window} ms that are {stride} ms apart resolve")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_the_advice_is_about_what_changes_the_estimates() {
        let mut rows = ProjectedOptions {
            sample_period_s: 0.001,
            ..ProjectedOptions::recommended()
        };
        // (window, stride) [ms] at 20 Hz; σ of theta_7 of config/encoder_only.toml
        for ([window_ms, stride_ms], says) in [
            ([100.0, 20.0], "resolve"),     // 4.6e-4
            ([400.0, 25.0], "resolve"),     // 4.3e-4
            ([24.0, 4.0], "resolve"),       // 5.2e-4
            ([24.0, 20.0], "4 ms apart"),   // 1.4e-2
            ([50.0, 20.0], "10 ms apart"),  // 6.5e-3
            ([400.0, 80.0], "25 ms apart"), // 5.4e-4, and mass_1 ten times
            ([12.0, 2.0], "20 ms, 20 samples"),
        ] {
            (rows.window_s, rows.stride_s) = (1e-3 * window_ms, 1e-3 * stride_ms);
            let line = words(&rows, false, rows.window_s, 20.0);
            assert!(line.contains(says), "{window_ms} {stride_ms}: {line}");
        }
        assert!(words(&rows, true, 0.05, 20.0).ends_with("has chosen 50 ms"));
    }
}
