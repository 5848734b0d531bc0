//! What the motion of an off-line run says about the configured windows.

use crate::config::Config;
use crate::messages::Sample;
use crate::rows::{RowForm, window_advice_at};

/// Samples that the advice is taken from.
const ENOUGH: usize = 20_000;

/// Keeps the positions of the first samples.
pub(super) struct Advisor {
    period_s: f64,
    window_s: Option<f64>,
    /// The identifier chooses it.
    auto: bool,
    joints: usize,
    /// Time stamps \[ns\] and positions of each joint.
    positions: Vec<Vec<(u64, f64)>>,
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
                kept.push((sample.t_ns, q));
            }
        }
    }

    /// One line, if windows are used and something moved; `in_force` is the window at the end.
    pub(super) fn line(&self, in_force: Option<f64>) -> Option<String> {
        let window_s = in_force.or(self.window_s)?;
        let advices = self.positions.iter();
        let advices = advices.filter_map(|samples| window_advice_at(samples, self.period_s));
        let fastest = advices.max_by(|a, b| a.bandwidth_hz.total_cmp(&b.bandwidth_hz))?;
        if self.auto {
            return Some(format!(
                "the motion reaches {:.1} Hz; identifier.projected.window_s = \"auto\" has chosen {:.0} ms",
                fastest.bandwidth_hz,
                1e3 * window_s
            ));
        }
        let [advised_ms, ms] = [fastest.window_s, window_s].map(|length_s| 1e3 * length_s);
        let ratio = window_s / fastest.window_s;
        let verdict = match (0.499..2.001).contains(&ratio) {
            _ if fastest.shortest && ratio < 0.999 => "estimates of shorter windows can be wrong",
            true => "within a factor of two, which is near enough",
            false => "a length nearer to that tells more",
        };
        let resolved = match fastest.shortest {
            true => format!(
                "too fast for any windows; the shortest that are sound are those of {advised_ms:.0} ms, 20 samples"
            ),
            false => format!("which windows of {advised_ms:.0} ms resolve"),
        };
        Some(format!(
            "the motion reaches {:.1} Hz, {resolved}; identifier.projected.window_s is {ms:.0} ms: {verdict}",
            fastest.bandwidth_hz
        ))
    }
}
