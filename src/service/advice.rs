//! What the motion of an off-line run says about the configured windows.

use crate::config::Config;
use crate::messages::Sample;
use crate::rows::{RowForm, window_advice};

/// Samples that the advice is taken from.
const ENOUGH: usize = 20_000;

/// Keeps the positions of the first samples.
pub(super) struct Advisor {
    period_s: f64,
    window_s: Option<f64>,
    /// The identifier chooses it.
    auto: bool,
    joints: usize,
    positions: Vec<Vec<f64>>,
}

impl Advisor {
    /// For samples of `joints` joints, at most [`crate::model::MAX_JOINTS`].
    pub(super) fn new(config: &Config, joints: usize) -> Self {
        let window_s = match &config.identifier.rows {
            RowForm::Projected(rows) => Some(rows.window_s),
            RowForm::Pointwise => None,
        };
        Self {
            period_s: config.plant.sim.sample_period_s,
            window_s,
            auto: config.identifier.auto_window,
            joints,
            positions: Vec::new(),
        }
    }

    pub(super) fn take(&mut self, sample: &Sample) {
        if self.window_s.is_none() {
            return;
        }
        // A recorded number of joints is whatever a file says; the node refuses those samples, and
        // so does this.
        if sample.joints as usize != self.joints {
            return;
        }
        self.positions.resize(self.joints, Vec::new());
        for (kept, &q) in self.positions.iter_mut().zip(&sample.q) {
            if kept.len() < ENOUGH && q.is_finite() {
                kept.push(q);
            }
        }
    }

    /// One line, if windows are used and something moved; `in_force` is the window at the end.
    pub(super) fn line(&self, in_force: Option<f64>) -> Option<String> {
        let window_s = in_force.or(self.window_s)?;
        let advices = self.positions.iter().filter_map(|q| window_advice(q, self.period_s));
        let fastest = advices.max_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz))?;
        let verdict = match (0.5..=2.0).contains(&(window_s / fastest.window_s)) {
            true => "within a factor of two, which is near enough",
            false => "a length nearer to that tells more",
        };
        if self.auto {
            return Some(format!(
                "the motion reaches {:.1} Hz; identifier.projected.window_s = \"auto\" has chosen {:.0} ms",
                fastest.bandwidth_hz,
                1e3 * window_s
            ));
        }
        Some(format!(
            "the motion reaches {:.1} Hz, which windows of {:.0} ms resolve; identifier.projected.window_s is {:.0} ms: {verdict}",
            fastest.bandwidth_hz,
            1e3 * fastest.window_s,
            1e3 * window_s
        ))
    }
}
