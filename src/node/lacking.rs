//! Status text for a refused sample: the missing signal, its joint, and settings that would work
//! with the signals present.

use crate::messages::{ERROR_TEXT, ErrorCode, FixedText, LastError, SIGNALS, Sample, signals};
use crate::model::MAX_JOINTS;
use std::fmt::{self, Write as _};

/// A step of the identifier allocates nothing.
type Words = FixedText<ERROR_TEXT>;

/// The names of the signals in a mask, `none` for an empty one.
struct Names(u32);

impl fmt::Display for Names {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut between = "";
        for signal in SIGNALS.iter().filter(|signal| self.0 & signal.flag != 0) {
            write!(f, "{between}{}", signal.name)?;
            between = ", ";
        }
        f.write_str(if between.is_empty() { "none" } else { "" })
    }
}

/// For a sample `seq` that has the signals `has` of those `needed`.
pub(super) fn signal(seq: u64, needed: u32, has: u32) -> LastError {
    const DERIVATIVES: u32 = signals::DQ | signals::DDQ | signals::DDDQ;
    let lacks = needed & !has;
    let mut words = Words::default();
    // Parts that no longer fit are left out as a whole; the most important comes first.
    let _ = write!(words, "the sample lacks {} and has {}", Names(lacks), Names(has));
    let all = |mask: u32| has & mask == mask;
    if lacks & !DERIVATIVES == 0 && all(signals::Q | signals::INPUT) {
        words.push_whole("; identifier.rows = \"projected\" does without");
    } else if lacks == signals::INPUT && all(signals::SETPOINT | signals::DQ) {
        words.push_whole("; identifier.input = \"controller\" does without");
    }
    LastError::with_text(ErrorCode::WrongSignals, seq, words.as_str())
}

/// For a sample with a needed signal that is not a number or is implausibly large: beyond `limit`
/// of the signal.
pub(super) fn number(sample: &Sample, needed: u32, joints: usize, limit: impl Fn(u32) -> f64) -> LastError {
    let mut words = Words::default();
    let arrays = SIGNALS.iter().zip(sample.arrays());
    for (signal, values) in arrays.filter(|(signal, _)| needed & signal.flag != 0) {
        let most = limit(signal.flag);
        // NaN also counts as bad
        let bad = values[..joints.min(MAX_JOINTS)].iter().position(|v| !(v.abs() <= most));
        if let Some(joint) = bad {
            let value = values[joint];
            let _ = write!(words, "{} of joint {} is {value:e}", signal.name, joint + 1);
            if value.is_finite() {
                let _ = write!(words, ", expected at most {most:e}");
            }
            return LastError::with_text(ErrorCode::NotFinite, sample.seq, words.as_str());
        }
    }
    LastError::new(ErrorCode::NotFinite, sample.seq)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::JointSample;

    #[test]
    fn fault_the_words_name_the_signals_that_are_missing_and_what_does_without() {
        let pointwise = signals::Q | signals::DQ | signals::DDQ | signals::DDDQ | signals::INPUT;
        let encoder = signals::Q | signals::SETPOINT | signals::INPUT;
        assert_eq!(
            signal(5, pointwise, encoder).words(),
            "the sample lacks dq, ddq, dddq and has q, setpoint, input; identifier.rows = \"projected\" does without"
        );
        assert_eq!(
            signal(
                5,
                signals::Q | signals::DQ | signals::INPUT,
                signals::Q | signals::DQ | signals::SETPOINT
            )
            .words(),
            "the sample lacks input and has q, dq, setpoint; identifier.input = \"controller\" does without"
        );
        assert_eq!(signal(5, signals::Q, 0).words(), "the sample lacks q and has none");
        // every pair of masks gives a complete text that fits
        for needed in 1..64 {
            for has in 0..64 {
                let words = signal(0, needed, has);
                assert!(words.words().starts_with("the sample lacks "), "{}", words.words());
                assert!(!words.words().ends_with("does"), "{}", words.words());
            }
        }
    }

    #[test]
    fn fault_the_words_name_signal_and_joint_of_a_number_that_is_none() {
        let mut joints = JointSample::default();
        joints.ddq[1] = f64::NAN;
        joints.q[0] = -3e10;
        let sample = Sample::new(1, 7, 0, 2, signals::ALL, &joints);
        let limit = |_| 1e9;
        let words = |needed, joints| number(&sample, needed, joints, limit).words().to_owned();
        assert_eq!(words(signals::ALL, 2), "q of joint 1 is -3e10, expected at most 1e9");
        assert_eq!(words(signals::DDQ, 2), "ddq of joint 2 is NaN");
        assert_eq!(number(&sample, signals::DDQ, 2, limit).seq, 7);
    }
}
