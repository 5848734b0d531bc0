//! Topic `status`: what the identifier does, has seen, costs and was granted.

use super::text::{put_text, text_of};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;
use std::mem::{offset_of, size_of};

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
    /// Tunables, or what is fixed, are no longer as configured.
    pub const COMMANDED: u32 = 1 << 3;
    /// Checkpoints are written.
    pub const CHECKPOINTS: u32 = 1 << 4;
    /// The stream is a replay: the next one goes on from what was known before it.
    pub const REPLAY: u32 = 1 << 5;
}

/// What was wrong with a stream, counted since it began.
///
/// Each refused sample counts in [`Status::rejected`] and in one of the fields from `duplicates` to `frozen`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusStreamFaultsV2"))]
pub struct StreamFaults {
    /// Holes in `seq`; [`Status::missing`] counts the samples in them.
    pub gaps: u64,
    /// Samples that came twice.
    pub duplicates: u64,
    /// Samples that came after their successor.
    pub reordered: u64,
    /// Samples whose time does not follow from the one before.
    pub clock_jumps: u64,
    /// Samples with another number of joints.
    pub wrong_joints: u64,
    /// Samples without a signal that is needed.
    pub wrong_signals: u64,
    /// Samples with NaN, infinity, or a number that no machine has.
    pub not_finite: u64,
    /// Samples whose input lies at the limit of its measurement.
    pub saturated: u64,
    /// Samples of a signal that does not move although it must.
    pub frozen: u64,
    /// Blocks that were left out because of `saturated` or `frozen`.
    pub blocks_held: u64,
}

impl StreamFaults {
    /// Counts a refused sample; a reason that is no fault of the stream is counted nowhere.
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
            (self.frozen, "have a signal that does not move although it must"),
        ];
        let mut between = "";
        for (count, what) in kinds.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, "{between}{count} {what}")?;
            between = ", ";
        }
        Ok(())
    }
}

/// How long something took, since the process began.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusTimingV2"))]
pub struct Timing {
    /// How often.
    pub count: u64,
    /// Mean \[ns\].
    pub mean_ns: u64,
    /// 99 of 100 took at most this \[ns\], to 1/16.
    pub p99_ns: u64,
    /// Longest \[ns\].
    pub max_ns: u64,
}

/// The process, its files and its commands. Times are of CLOCK_MONOTONIC.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusProcessV2"))]
pub struct ProcessStatus {
    /// When the program began \[ns\].
    pub started_ns: u64,
    /// When its first sample had been processed \[ns\]; 0 before.
    pub first_sample_ns: u64,
    /// Memory in use (resident set) \[bytes\]; 0 where it is not known.
    pub resident_bytes: u64,
    /// For how long no sample has come \[ns\], while a stream is open.
    pub silent_ns: u64,
    /// How often a stream was silent for a second or more.
    pub pauses: u64,
    /// Commands that took effect.
    pub commands: u64,
    /// Requests that were refused.
    pub refused: u64,
    /// Checkpoints written.
    pub checkpoints: u64,
    /// Checkpoints that could not be written, or were found unusable.
    pub checkpoints_failed: u64,
    /// Samples that a recorder has told it lost.
    pub recorder_missing: u64,
}

/// Real-time settings that the system granted.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusRealtimeV2"))]
pub struct RealtimeStatus {
    /// Scheduling policy: 0 the system's default, 1 SCHED_FIFO, 2 SCHED_RR.
    pub policy: u32,
    /// Priority of SCHED_FIFO and SCHED_RR, 1 to 99.
    pub priority: u32,
    /// Bit i: may run on CPU i of the first 64; 0 where no choice was made.
    pub affinity: u64,
    /// 1 where memory is locked.
    pub memory_locked: u32,
    /// What was asked for and refused: bit 0 priority, 1 affinity, 2 memory.
    pub refused: u32,
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
    /// A signal that is needed is not there.
    WrongSignals = 6,
    /// NaN, infinity, or a number that no machine has.
    NotFinite = 7,
    /// An input at the limit of its measurement.
    Saturated = 8,
    /// A signal that does not move although it must.
    Frozen = 9,
    /// No sample for a second or more.
    Silent = 10,
    /// A block that cannot be evaluated at θ̂.
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
    /// The residuals speak for a term that the model lacks.
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
            Self::Frozen => "a signal does not move although it must",
            Self::Silent => "no sample has come for a second or more",
            Self::NotEvaluable => "a block cannot be evaluated at the estimate",
            Self::CheckpointUnused => "a checkpoint was not used",
            Self::CheckpointFailed => "a checkpoint could not be written",
            Self::Refused => "a request was refused",
            Self::Realtime => "a real-time setting was refused",
            Self::Recorder => "a recorder loses samples",
            Self::Misfit => "the residuals speak for a term that the model lacks",
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

/// The last thing that went wrong; it stays until something else does.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusLastErrorV2"))]
pub struct LastError {
    /// [`ErrorCode`].
    pub code: u32,
    /// Zero.
    pub pad: u32,
    /// `seq` of the sample that it happened at.
    pub seq: u64,
    /// UTF-8, filled up with zeros.
    pub text: [u8; ERROR_TEXT],
}

impl LastError {
    /// An error with its code's own words.
    pub fn new(code: ErrorCode, seq: u64) -> Self {
        Self::with_text(code, seq, code.describe())
    }

    /// An error with words of its own, cut where they do not fit.
    pub fn with_text(code: ErrorCode, seq: u64, words: &str) -> Self {
        let mut text = [0; ERROR_TEXT];
        put_text(&mut text, words);
        Self {
            code: code as u32,
            pad: 0,
            seq,
            text,
        }
    }

    /// The words.
    pub fn words(&self) -> &str {
        text_of(&self.text)
    }
}

impl Default for LastError {
    /// Nothing went wrong.
    fn default() -> Self {
        Self {
            code: 0,
            pad: 0,
            seq: 0,
            text: [0; ERROR_TEXT],
        }
    }
}

/// Topic `status`: the identifier's heartbeat, twice a second even when nothing else happens.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusStatusV2"))]
pub struct Status {
    /// `boot_id` of the sample stream, 0 before the first sample.
    pub boot_id: u64,
    /// Samples used since the start of the stream.
    pub accepted: u64,
    /// Samples lost since the start of the stream.
    pub missing: u64,
    /// Samples refused since the start of the stream.
    pub rejected: u64,
    /// `seq` of the last sample received.
    pub last_seq: u64,
    /// Stream time of the last sample used \[ns\].
    pub last_t_ns: u64,
    /// Estimates published since the start of the stream.
    pub estimates: u64,
    /// Block of the last estimate published, 0 before the first.
    pub last_block: u64,
    /// Streams (values of `boot_id`) seen since this process started; one more than the publisher was restarted.
    pub streams: u64,
    /// [`State`](super::State).
    pub state: u32,
    /// Process id of the identifier.
    pub pid: u32,
    /// [`status_flags`].
    pub flags: u32,
    /// Zero.
    pub pad: u32,
    /// What was wrong with the stream.
    pub faults: StreamFaults,
    /// A sample off the bus, validated and taken into its block.
    pub step: Timing,
    /// The same for a sample that ends a block, up to its estimate.
    pub block: Timing,
    /// The process.
    pub process: ProcessStatus,
    /// Real-time settings.
    pub realtime: RealtimeStatus,
    /// Condition number of the column-scaled information after the last block.
    pub condition: f64,
    /// Σ ln Γ⁻¹ᵢᵢ over the free parameters: constant, but for noise, once as much is forgotten as is learnt.
    pub information_ln: f64,
    /// Largest |Γ⁻¹ᵢⱼ − Γ⁻¹ⱼᵢ| relative to √(Γ⁻¹ᵢᵢ Γ⁻¹ⱼⱼ): 0, or the recursion loses its symmetry.
    pub asymmetry: f64,
    /// χ² of the whitened residuals of the last block over their number, the largest of any equation: 1 on average if the block fits.
    pub fit: f64,
    /// Probability of residuals as large as these if the model is right, see [`Estimate`](super::Estimate); below 1e-4 it is a misfit.
    pub fit_probability: f64,
    /// What went wrong last.
    pub error: LastError,
}

// The layout is a contract with readers in other languages: a change here is a new schema version.
const _: () = {
    assert!(size_of::<StreamFaults>() == 80);
    assert!(size_of::<Timing>() == 32);
    assert!(size_of::<ProcessStatus>() == 80);
    assert!(size_of::<RealtimeStatus>() == 24);
    assert!(size_of::<LastError>() == 16 + ERROR_TEXT);
    assert!(offset_of!(Status, state) == 72);
    assert!(offset_of!(Status, faults) == 88);
    assert!(offset_of!(Status, step) == 168);
    assert!(offset_of!(Status, process) == 232);
    assert!(offset_of!(Status, realtime) == 312);
    assert!(offset_of!(Status, condition) == 336);
    assert!(offset_of!(Status, fit) == 360);
    assert!(offset_of!(Status, error) == 376);
    assert!(size_of::<Status>() == 504);
};

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
