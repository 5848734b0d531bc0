//! Why nothing known about a robot may be used after a change.

use std::fmt;

/// Why nothing known about a robot may be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RobotDoubt {
    /// The machine has changed, and a drive or an encoder may be the cause.
    Unclear,
    /// The torques that one drive, or every drive, reports are scaled differently than before.
    Gain {
        /// The joint, counted from 0; `None` for all joints alike.
        joint: Option<usize>,
        /// Relative excess of the reported torques.
        by: f64,
    },
    /// An encoder has another zero than before.
    Slip {
        /// The joint, counted from 0.
        joint: usize,
        /// Error of its reading \[rad\].
        by: f64,
    },
}

impl fmt::Display for RobotDoubt {
    /// Rounded, so that the text does not change with every block.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |by: f64| (100.0 * (1.0 + by)).round();
        match *self {
            Self::Unclear => f.write_str(
                "not clear yet what has changed: friction or payload, or the gain of a drive or the zero of an encoder",
            ),
            Self::Gain { joint: None, by } => write!(
                f,
                "all drives report {} % of their torques since a change: check their gains, and begin anew",
                percent(by)
            ),
            Self::Gain { joint: Some(joint), by } => write!(
                f,
                "drive {} reports {} % of its torque since a change: check its gain, and begin anew",
                joint + 1,
                percent(by)
            ),
            Self::Slip { joint, by } => write!(
                f,
                "the encoder of joint {} has slipped by about {:+.0} mrad: check its zero, and begin anew",
                joint + 1,
                1e3 * by
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_each_doubt_has_words_that_fit_a_status() {
        let doubts = [
            RobotDoubt::Unclear,
            RobotDoubt::Gain { joint: None, by: -0.05 },
            RobotDoubt::Gain {
                joint: Some(7),
                by: -0.333,
            },
            RobotDoubt::Slip { joint: 7, by: -1.2345 },
        ];
        for doubt in doubts {
            let words = doubt.to_string();
            assert!(words.len() <= 112, "{}: {words}", words.len());
        }
        let words = RobotDoubt::Slip { joint: 1, by: 0.0204 }.to_string();
        assert!(words.contains("joint 2 has slipped by about +20 mrad"), "{words}");
    }
}
