//! What an [inquiry](super::inquiry) works with, taken at the start.

use super::change::Suspect;
use super::information::Information;
use super::sums::JointSums;
use std::fmt;

/// Slices after which a drive or an encoder that was named stays so.
const FINAL: usize = 40;
/// Slices that it takes at most to see another change.
const LEANS: usize = 4;

/// Why nothing that is known of a robot may be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RobotDoubt {
    /// The machine has changed, and a drive or an encoder may be the cause.
    Unclear,
    /// Torques that a drive reports, or all of them, are another multiple of the true ones.
    Gain {
        /// The joint, counted from 0; `None` for all joints alike.
        joint: Option<usize>,
        /// What they are too large by, as a part of themselves.
        by: f64,
    },
    /// An encoder has another zero than before.
    Slip {
        /// The joint, counted from 0.
        joint: usize,
        /// What it shows too much \[rad\].
        by: f64,
    },
}

impl fmt::Display for RobotDoubt {
    /// Rounded, so that the words change only with the matter.
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

/// A change with all that has come since.
#[derive(Debug, Clone)]
pub(super) struct Inquiry {
    /// What is said of it; `None` while there is no inquiry.
    pub doubt: Option<RobotDoubt>,
    /// The likeliest drive or encoder.
    pub suspect: Suspect,
    /// What was known before it.
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
    /// After the last slices, whether friction or a payload was clear but for the time; oldest
    /// first.
    pub leans: [bool; LEANS],
}

impl Inquiry {
    /// Room for it.
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

    /// True while there is one.
    pub fn is_open(&self) -> bool {
        self.doubt.is_some()
    }

    /// True while its outcome may still change.
    pub fn is_pending(&self) -> bool {
        self.doubt == Some(RobotDoubt::Unclear) || self.is_open() && self.slices < FINAL
    }

    /// True if another change may begin an inquiry: this one was about friction or a payload
    /// before the other came.
    pub fn gives_way(&self) -> bool {
        !self.is_open() || self.is_pending() && self.leans[0]
    }

    /// Takes rows.
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
