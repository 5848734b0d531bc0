//! The last seconds of the joints' signals, thinned out for display.

use crate::messages::{Sample, signals};
use crate::model::MAX_JOINTS;
use std::collections::VecDeque;

/// Stream time kept \[ns\].
const SPAN_NS: u64 = 10_000_000_000;
/// Smallest time between two points \[ns\].
const STEP_NS: u64 = 25_000_000;

/// The signals of one instant; only the first joints of each array are used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalPoint {
    /// Stream time \[ns\].
    pub t_ns: u64,
    /// Position \[rad or m\]; `NaN` if it is not measured.
    pub position: [f64; MAX_JOINTS],
    /// Commanded position \[rad or m\]; `NaN` if it is not known.
    pub setpoint: [f64; MAX_JOINTS],
    /// Input, in the drive's unit; `NaN` if it is not measured.
    pub input: [f64; MAX_JOINTS],
    /// The input that the model predicts with the estimate of the blocks before, in the drive's
    /// unit; `NaN` if it is not known.
    pub predicted: [f64; MAX_JOINTS],
}

/// The last seconds.
#[derive(Debug, Clone, Default)]
pub struct Signals {
    points: VecDeque<SignalPoint>,
    stream_id: u64,
}

impl Signals {
    /// The points of the last seconds, oldest first.
    pub fn points(&self) -> impl DoubleEndedIterator<Item = &SignalPoint> + ExactSizeIterator {
        self.points.iter()
    }

    /// The points after this stream time.
    pub fn after(&self, t_ns: u64) -> impl ExactSizeIterator<Item = &SignalPoint> {
        let from = self.points.partition_point(|point| point.t_ns <= t_ns);
        self.points.range(from..)
    }

    /// Takes a sample; calls `predicted` for its input only if the sample is kept.
    pub(super) fn push(&mut self, sample: &Sample, predicted: impl FnOnce() -> [f64; MAX_JOINTS]) {
        let last = self.points.back().map(|point| point.t_ns);
        if self.stream_id != sample.stream_id || last.is_some_and(|last| sample.t_ns < last) {
            self.stream_id = sample.stream_id;
            self.points.clear();
        } else if last.is_some_and(|last| sample.t_ns - last < STEP_NS) {
            return;
        }
        let signal = |bit: u32, values: [f64; MAX_JOINTS]| match sample.signals & bit {
            0 => [f64::NAN; MAX_JOINTS],
            _ => values,
        };
        self.points.push_back(SignalPoint {
            t_ns: sample.t_ns,
            position: signal(signals::Q, sample.q),
            setpoint: signal(signals::SETPOINT, sample.setpoint),
            input: signal(signals::INPUT, sample.input),
            predicted: predicted(),
        });
        while self.points.front().is_some_and(|p| sample.t_ns - p.t_ns > SPAN_NS) {
            self.points.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::JointSample;

    #[test]
    fn prop_an_hour_at_a_kilohertz_leaves_ten_seconds_and_a_new_stream_begins_anew() {
        let mut signals = Signals::default();
        for seq in 0..3_600_000_u64 {
            let joints = JointSample::default();
            signals.push(&Sample::new(7, seq, seq * 1_000_000, 1, signals::Q, &joints), || {
                [2.0; MAX_JOINTS]
            });
            assert!(signals.points().len() <= 401);
        }
        let last = signals.points().next_back().copied();
        assert!(last.is_some_and(|p| p.position[0] == 0.0 && p.input[0].is_nan() && p.predicted[0] == 2.0));
        assert_eq!(signals.after(last.unwrap().t_ns - 2 * STEP_NS).len(), 2);
        signals.push(&Sample::new(8, 0, 0, 1, signals::Q, &JointSample::default()), || {
            [f64::NAN; MAX_JOINTS]
        });
        assert_eq!(signals.points().len(), 1);
    }
}
