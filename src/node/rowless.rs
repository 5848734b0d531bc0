//! Status text that explains why the samples of a robot give no rows.

use crate::messages::{ERROR_TEXT, ErrorCode, FixedText, LastError};
use crate::robot::{TooFarApart, WindowOptions};
use std::fmt::Write as _;

/// The spacing of the samples of the open block, which decides whether windows can use them.
#[derive(Debug, Clone)]
pub(super) struct Spacing {
    windows: WindowOptions,
    last_s: Option<f64>,
    steps: u32,
    /// Those longer than windows bridge.
    gaps: u32,
    shortest_gap_s: f64,
}

impl Spacing {
    /// For these windows.
    pub fn new(windows: WindowOptions) -> Self {
        Self {
            windows,
            last_s: None,
            steps: 0,
            gaps: 0,
            shortest_gap_s: f64::INFINITY,
        }
    }

    /// Adds the time of a sample \[s\].
    pub fn note(&mut self, t_s: f64) {
        let step_s = self.last_s.map_or(0.0, |last_s| t_s - last_s);
        if step_s > 0.0 {
            self.steps += 1;
        }
        if step_s > self.windows.max_gap_s {
            self.gaps += 1;
            self.shortest_gap_s = self.shortest_gap_s.min(step_s);
        }
        self.last_s = Some(t_s);
    }

    /// Begins the next block.
    pub fn next_block(&mut self) {
        (self.steps, self.gaps, self.shortest_gap_s) = (0, 0, f64::INFINITY);
    }

    /// Why a block that ended with sample `seq` gave no row; `None` for a block without samples.
    pub fn reason(&self, seq: u64) -> Option<LastError> {
        let mut words = FixedText::<ERROR_TEXT>::default();
        // an error only means that the text was truncated
        let _cut = match (self.steps, 2 * self.gaps > self.steps) {
            (0, _) => return None,
            (_, true) => write!(
                words,
                "{}",
                TooFarApart::new(self.shortest_gap_s, self.windows.max_gap_s)
            ),
            (_, false) => write!(words, "no joint has moved for long enough"),
        };
        Some(LastError::with_text(ErrorCode::NotEvaluable, seq, words.as_str()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reason(period_s: f64) -> Option<String> {
        let mut spacing = Spacing::new(WindowOptions::default());
        (0..=10).for_each(|k| spacing.note(f64::from(k) * period_s));
        spacing.reason(10).map(|error| error.words().to_owned())
    }

    #[test]
    fn fault_samples_that_windows_do_not_bridge_are_told_from_a_robot_that_rests() {
        assert_eq!(
            reason(0.1).as_deref(),
            Some(
                "samples come every 0.100 s, rows bridge 0.050 s: expected window_s 1.000, max_gap_s 0.200, or a faster rate"
            )
        );
        assert_eq!(reason(0.01).as_deref(), Some("no joint has moved for long enough"));
        assert_eq!(reason(0.0), None);
    }
}
