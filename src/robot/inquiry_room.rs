//! State and workspace of an [inquiry](super::inquiry), allocated at the start.

use super::change::Suspect;
use super::information::Information;
use super::sums::JointSums;
use std::fmt;

/// Slices after which a named drive or encoder is final.
const FINAL: usize = 40;
/// Largest number of slices needed to detect another change.
const LEANS: usize = 4;

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

/// A change with all rows since.
#[derive(Debug, Clone)]
pub(super) struct Inquiry {
    /// The present doubt; `None` while there is no inquiry.
    pub doubt: Option<RobotDoubt>,
    /// The likeliest drive or encoder.
    pub suspect: Suspect,
    /// The information before the change.
    pub known: Information,
    pub theta: Vec<f64>,
    pub effective: Vec<f64>,
    pub fixed: Vec<bool>,
    pub was_loaded: bool,
    /// σ_j f_j then.
    pub level: Vec<f64>,
    /// The rows since, and the last of them.
    pub sums: Vec<JointSums>,
    pub last: Vec<JointSums>,
    /// Slices since.
    pub slices: usize,
    /// For the last slices, whether friction or a payload was clear except for the number of
    /// slices; oldest first.
    pub leans: [bool; LEANS],
}

impl Inquiry {
    /// Workspace of an inquiry.
    pub fn new(parameters: usize, acting: usize, empty: &[JointSums]) -> Self {
        Self {
            doubt: None,
            suspect: Suspect::Gain(None),
            known: Information::new(parameters),
            theta: vec![0.0; parameters],
            effective: vec![0.0; acting],
            fixed: vec![false; parameters],
            was_loaded: false,
            level: vec![0.0; empty.len()],
            sums: empty.to_vec(),
            last: empty.to_vec(),
            slices: 0,
            leans: [false; LEANS],
        }
    }

    /// True while an inquiry is open.
    pub fn is_open(&self) -> bool {
        self.doubt.is_some()
    }

    /// True while its outcome may still change.
    pub fn is_pending(&self) -> bool {
        self.doubt == Some(RobotDoubt::Unclear) || self.is_open() && self.slices < FINAL
    }

    /// True if another change may begin an inquiry, because this one pointed to friction or a
    /// payload before the other change.
    pub fn gives_way(&self) -> bool {
        !self.is_open() || self.is_pending() && self.leans[0]
    }

    /// Adds rows.
    pub fn take(&mut self, rows: &[JointSums]) {
        self.slices += 1;
        let both = self.sums.iter_mut().zip(&mut self.last);
        for ((sums, last), rows) in both.zip(rows) {
            sums.add(rows);
            last.add(rows);
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
