//! Topic `status`: the identifier's state, counters, timing and real-time settings.

use super::estimate::State;
use super::table::message;
use super::text::{put_text, text_of};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

/// Bytes of [`LastError::text`].
pub const ERROR_TEXT: usize = 112;

/// Flags of a [`Status`].
pub mod status_flags {
    /// The identifier began from a checkpoint.
    pub const WARM: u32 = 1 << 0;
    /// A command has stopped the estimation.
    pub const PAUSED: u32 = 1 << 1;
    /// A stream is open, but no sample has come for a second or more.
    pub const SILENT: u32 = 1 << 2;
    /// Commands have changed tunables, or fixed or freed parameters.
    pub const COMMANDED: u32 = 1 << 3;
    /// Checkpoints are written.
    pub const CHECKPOINTS: u32 = 1 << 4;
    /// The stream is a replay: the next stream continues from the state before it.
    pub const REPLAY: u32 = 1 << 5;
}

message! {
    /// What was wrong with a stream, counted since it began.
    ///
    /// Each refused sample counts in [`Status::rejected`] and in one of the fields from
    /// `duplicates` to `frozen`.
    #[derive(Eq)]
    pub struct StreamFaults = "ThetabusStreamFaultsV3" {
        gaps: u64, One, "", "Holes in seq; missing counts the samples in them";
        duplicates: u64, One, "", "Samples that came twice";
        reordered: u64, One, "", "Samples that came after their successor";
        clock_jumps: u64, One, "", "Samples whose time does not follow from the one before";
        wrong_joints: u64, One, "", "Samples with another number of joints";
        wrong_signals: u64, One, "", "Samples without a signal that is needed";
        not_finite: u64, One, "", "Samples with NaN, infinity, or a number that no machine has";
        saturated: u64, One, "", "Samples whose input lies at the limit of its measurement";
        frozen: u64, One, "", "Samples of a signal that does not move although it must";
        blocks_held: u64, One, "", "Blocks left out because of saturated or frozen signals";
    }
}

impl StreamFaults {
    /// Counts a refused sample, unless the reason is no fault of the stream.
    pub fn count(&mut self, reason: ErrorCode) {
        let count = match reason {
            ErrorCode::Duplicate => &mut self.duplicates,
            ErrorCode::Reordered => &mut self.reordered,
            ErrorCode::ClockJump => &mut self.clock_jumps,
            ErrorCode::WrongJoints => &mut self.wrong_joints,
            ErrorCode::WrongSignals => &mut self.wrong_signals,
            ErrorCode::NotFinite => &mut self.not_finite,
            ErrorCode::Saturated => &mut self.saturated,
            ErrorCode::Frozen => &mut self.frozen,
            _ => return,
        };
        *count += 1;
    }
}

/// Why samples were refused, in words.
impl fmt::Display for StreamFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds = [
            (self.duplicates, "came twice"),
            (self.reordered, "came after their successors"),
            (self.clock_jumps, "have a time that does not follow from the one before"),
            (self.wrong_joints, "have another number of joints"),
            (self.wrong_signals, "lack a signal that is needed"),
            (self.not_finite, "hold NaN, infinity, or a number that no machine has"),
            (self.saturated, "have an input at the limit of its measurement"),
            (
                self.frozen,
                "have a signal that does not move although it must, or only every few samples",
            ),
        ];
        let mut between = "";
        for (count, what) in kinds.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, "{between}{count} {what}")?;
            between = ", ";
        }
        Ok(())
    }
}

message! {
    /// Durations of one activity since the process began.
    #[derive(Eq)]
    pub struct Timing = "ThetabusTimingV3" {
        count: u64, One, "", "How often";
        mean_ns: u64, One, "ns", "Mean";
        p99_ns: u64, One, "ns", "99 of 100 took at most this, to 1/16";
        max_ns: u64, One, "ns", "Longest";
    }
}

message! {
    /// The process, its files and its commands. Times are of CLOCK_MONOTONIC.
    #[derive(Eq)]
    pub struct ProcessStatus = "ThetabusProcessV3" {
        started_ns: u64, One, "ns", "When the program began";
        first_sample_ns: u64, One, "ns", "When its first sample had been processed; 0 before";
        resident_bytes: u64, One, "bytes", "Memory in use (resident set); 0 if it is not known";
        silent_ns: u64, One, "ns", "For how long no sample has come, while a stream is open";
        pauses: u64, One, "", "How often a stream was silent for a second or more";
        commands: u64, One, "", "Commands that took effect";
        refused: u64, One, "", "Requests that were refused";
        checkpoints: u64, One, "", "Checkpoints written";
        checkpoints_failed: u64, One, "", "Checkpoints that could not be written, or were found unusable";
        recorder_missing: u64, One, "", "Samples lost by recorders, as reported by them";
    }
}

message! {
    /// Real-time settings that the system granted.
    #[derive(Eq)]
    pub struct RealtimeStatus = "ThetabusRealtimeV3" {
        policy: u32, One, "", "Scheduling policy: 0 the system's default, 1 SCHED_FIFO, 2 SCHED_RR";
        priority: u32, One, "", "Priority of SCHED_FIFO and SCHED_RR, 1 to 99";
        affinity: u64, One, "", "Bit i: may run on CPU i of the first 64; 0 if no choice was made";
        memory_locked: u32, One, "", "1 if memory is locked";
        refused: u32, One, "", "What was asked for and refused: bit 0 priority, 1 affinity, 2 memory";
    }
}

/// What went wrong last.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ErrorCode {
    /// Nothing yet.
    #[default]
    None = 0,
    /// Samples are missing.
    Gap = 1,
    /// A sample came twice.
    Duplicate = 2,
    /// A sample came too late.
    Reordered = 3,
    /// A sample's time does not follow from the one before.
    ClockJump = 4,
    /// Another number of joints.
    WrongJoints = 5,
    /// A required signal is missing.
    WrongSignals = 6,
    /// NaN, infinity, or an implausibly large number.
    NotFinite = 7,
    /// An input at the limit of its measurement.
    Saturated = 8,
    /// A signal that does not move although it must.
    Frozen = 9,
    /// No sample for a second or more.
    Silent = 10,
    /// A block whose rows cannot be evaluated at θ̂.
    NotEvaluable = 11,
    /// A checkpoint was found and not used.
    CheckpointUnused = 12,
    /// A checkpoint could not be written.
    CheckpointFailed = 13,
    /// A request was refused.
    Refused = 14,
    /// A real-time setting was refused by the system.
    Realtime = 15,
    /// A recorder loses samples.
    Recorder = 16,
    /// The residuals indicate a term that is missing in the model.
    Misfit = 17,
}

impl ErrorCode {
    /// What happened, in a few words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Gap => "samples are missing",
            Self::Duplicate => "a sample came twice",
            Self::Reordered => "a sample came after its successor",
            Self::ClockJump => "a sample's time does not follow from the one before",
            Self::WrongJoints => "a sample has another number of joints",
            Self::WrongSignals => "a sample lacks a signal that is needed",
            Self::NotFinite => "a sample holds NaN, infinity, or a number that no machine has",
            Self::Saturated => "an input lies at the limit of its measurement",
            Self::Frozen => "a signal does not move although it must, or only every few samples",
            Self::Silent => "no sample has come for a second or more",
            Self::NotEvaluable => "a block cannot be evaluated at the estimate",
            Self::CheckpointUnused => "a checkpoint was not used",
            Self::CheckpointFailed => "a checkpoint could not be written",
            Self::Refused => "a request was refused",
            Self::Realtime => "a real-time setting was refused",
            Self::Recorder => "a recorder loses samples",
            Self::Misfit => "the residuals indicate a term that is missing in the model",
        }
    }

    /// The code with this wire value; `None` for a value that this schema does not have.
    pub fn from_wire(value: u32) -> Option<Self> {
        const ALL: [ErrorCode; 18] = [
            ErrorCode::None,
            ErrorCode::Gap,
            ErrorCode::Duplicate,
            ErrorCode::Reordered,
            ErrorCode::ClockJump,
            ErrorCode::WrongJoints,
            ErrorCode::WrongSignals,
            ErrorCode::NotFinite,
            ErrorCode::Saturated,
            ErrorCode::Frozen,
            ErrorCode::Silent,
            ErrorCode::NotEvaluable,
            ErrorCode::CheckpointUnused,
            ErrorCode::CheckpointFailed,
            ErrorCode::Refused,
            ErrorCode::Realtime,
            ErrorCode::Recorder,
            ErrorCode::Misfit,
        ];
        ALL.get(value as usize).copied()
    }
}

message! {
    /// The last error; it stays until another one occurs.
    #[derive(Eq)]
    pub struct LastError = "ThetabusLastErrorV3" {
        /// See [`ErrorCode`].
        code: u32, One, "", "What went wrong, 0 nothing";
        pad: u32, Padding, "", "Zero";
        seq: u64, One, "", "seq of the sample that it happened at";
        text: [u8; ERROR_TEXT], Text, "", "The same in words";
    }
}

impl LastError {
    /// An error with the text of its code.
    pub fn new(code: ErrorCode, seq: u64) -> Self {
        Self::with_text(code, seq, code.describe())
    }

    /// An error with its own text, truncated if it does not fit.
    pub fn with_text(code: ErrorCode, seq: u64, words: &str) -> Self {
        let mut text = [0; ERROR_TEXT];
        put_text(&mut text, words);
        Self {
            code: code as u32,
            seq,
            text,
            ..Self::default()
        }
    }

    /// The words.
    pub fn words(&self) -> &str {
        text_of(&self.text)
    }
}

message! {
    /// Topic `status`: the identifier's heartbeat, twice a second even when nothing else happens.
    pub struct Status = "ThetabusStatusV3" {
        stream_id: u64, One, "", "stream_id of the samples, 0 before the first sample";
        accepted: u64, One, "", "Samples used since the start of the stream";
        missing: u64, One, "", "Samples lost since the start of the stream";
        rejected: u64, One, "", "Samples refused since the start of the stream";
        last_seq: u64, One, "", "seq of the last sample received";
        last_t_ns: u64, One, "ns", "Stream time of the last sample used";
        estimates: u64, One, "", "Estimates published since the start of the stream";
        last_block: u64, One, "", "Block of the last estimate published, 0 before the first";
        streams: u64, One, "", "Streams seen since this process started; one more than the publisher was restarted";
        /// See [`State`](super::State).
        state: u32, One, "", "As in the estimate; 8 ended";
        pid: u32, One, "", "Process id of the identifier";
        /// See [`status_flags`].
        flags: u32, One, "", "Bits: 0 warm, 1 paused, 2 silent, 3 commanded, 4 checkpoints, 5 replay";
        pad: u32, Padding, "", "Zero";
        faults: StreamFaults, One, "", "What was wrong with the stream";
        step: Timing, One, "", "Computing time of a sample that completes no block";
        block: Timing, One, "", "Computing time of a sample that completes a block";
        process: ProcessStatus, One, "", "The process";
        realtime: RealtimeStatus, One, "", "Real-time settings";
        fit: f64, One, "", "chi^2 of the whitened residuals of the last block over their number, the largest of any equation: 1 on average if the block fits";
        fit_probability: f64, One, "", "Probability of residuals as large as these if the model is right; below 2e-4 it is a misfit";
        condition: f64, One, "", "Condition number of the column-scaled information after the last block";
        information_ln: f64, One, "", "Sum of the logarithms of its diagonal over the free parameters: constant, but for noise, once as much is forgotten as is learnt";
        asymmetry: f64, One, "", "Largest difference across its diagonal, relative to the diagonal: 0, or the recursion loses its symmetry";
        error: LastError, One, "", "What went wrong last";
    }
}

impl Status {
    /// Why no block has given an estimate so far, if the identifier has published a reason.
    pub fn no_estimate(&self) -> Option<&str> {
        let ended_without = self.state == State::Ended as u32 && self.fit == 0.0;
        let none_yet = self.state == State::Collecting as u32 || ended_without;
        (none_yet && self.error.code == ErrorCode::NotEvaluable as u32).then(|| self.error.words())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_error_code_comes_back_from_the_wire_and_has_words_that_fit() {
        for value in 0..18 {
            let code = ErrorCode::from_wire(value).expect("a code");
            assert_eq!(code as u32, value);
            assert_eq!(LastError::new(code, 5).words(), code.describe());
        }
        assert_eq!(ErrorCode::from_wire(18), None);
    }

    #[test]
    fn prop_long_words_are_cut_between_characters() {
        let error = LastError::with_text(ErrorCode::Refused, 0, &"θ".repeat(100));
        assert_eq!(error.words(), "θ".repeat(ERROR_TEXT / 2));
    }
}
