//! Tracks the status of an identifier and its stream, and the flags of the next estimate.

use crate::messages::{
    ErrorCode, Estimate, LastError, State, Status, StreamFaults, estimate_flags, status_flags, stream_tag,
};

/// The status, updated by events.
pub(super) struct StatusTracker {
    pub status: Status,
    /// True while estimation is paused until a resume command.
    pub paused: bool,
    /// Flags of the next estimate.
    next_flags: u32,
}

impl StatusTracker {
    /// The status before the first sample.
    pub fn new(pid: u32) -> Self {
        Self {
            status: Status {
                pid,
                fit_probability: 1.0,
                ..Status::default()
            },
            paused: false,
            next_flags: 0,
        }
    }

    /// Begins a new stream, with counters at 0.
    pub fn begin_stream(&mut self, stream_id: u64, streams: u64) {
        self.status = Status {
            stream_id,
            streams,
            state: if self.paused { State::Paused } else { State::Collecting } as u32,
            accepted: 0,
            missing: 0,
            rejected: 0,
            last_seq: 0,
            last_t_ns: 0,
            estimates: 0,
            last_block: 0,
            fit: 0.0,
            fit_probability: 1.0,
            faults: StreamFaults::default(),
            ..self.status
        };
    }

    /// True before the first stream and after the END of one.
    pub fn is_between_streams(&self) -> bool {
        self.status.stream_id == 0 || self.is_ended()
    }

    /// Tag of the open stream; 0 between two.
    pub fn open_tag(&self) -> u32 {
        if self.is_between_streams() {
            0
        } else {
            stream_tag(self.status.stream_id)
        }
    }

    /// Counts lost samples.
    pub fn miss(&mut self, seq: u64, missing: u64) {
        self.status.missing = self.status.missing.saturating_add(missing);
        self.status.faults.gaps += 1;
        self.status.error = LastError::new(ErrorCode::Gap, seq);
    }

    /// Counts a sample that is not used.
    pub fn refuse(&mut self, seq: u64, code: ErrorCode) {
        self.status.rejected += 1;
        self.status.faults.count(code);
        self.status.error = LastError::new(code, seq);
    }

    /// Counts an estimate, sets its pending flags, and copies its state to the status.
    pub fn publish(&mut self, estimate: &mut Estimate) {
        estimate.flags |= std::mem::take(&mut self.next_flags);
        self.status.estimates += 1;
        self.status.last_block = estimate.block;
        self.status.state = estimate.state;
        self.status.fit = estimate.fit.iter().copied().fold(0.0, f64::max);
        self.status.fit_probability = estimate.fit_probability;
    }

    /// Pauses estimation.
    pub fn pause(&mut self) {
        self.paused = true;
        self.status.flags |= status_flags::PAUSED;
        if !self.is_ended() {
            self.status.state = State::Paused as u32;
        }
    }

    /// Resumes estimation.
    pub fn resume(&mut self) {
        if std::mem::take(&mut self.paused) && !self.is_ended() {
            self.status.state = State::Collecting as u32;
        }
        self.status.flags &= !status_flags::PAUSED;
    }

    /// Sets whether the identifier continued from a checkpoint.
    pub fn set_warm(&mut self, warm: bool) {
        set(&mut self.next_flags, estimate_flags::WARM, warm);
        set(&mut self.status.flags, status_flags::WARM, warm);
    }

    /// Sets whether the samples are those of a recording.
    pub fn set_replay(&mut self, replay: bool) {
        set(&mut self.status.flags, status_flags::REPLAY, replay);
    }

    /// Records that a command has changed the configuration.
    pub fn set_commanded(&mut self) {
        self.status.flags |= status_flags::COMMANDED;
    }

    /// Records that a command took effect, for the next estimate.
    pub fn count_command(&mut self) {
        self.status.process.commands += 1;
        self.next_flags |= estimate_flags::COMMANDED;
    }

    /// Restores the state before commands that ended with their stream: `paused`, if one of them
    /// changed it, and the previous flag `COMMANDED`.
    pub fn undo_commands(&mut self, paused: Option<bool>, commanded: u32) {
        if let Some(paused) = paused {
            self.paused = paused;
            set(&mut self.status.flags, status_flags::PAUSED, paused);
        }
        set(&mut self.status.flags, status_flags::COMMANDED, commanded != 0);
        // they do not affect the next stream
        self.next_flags &= !estimate_flags::COMMANDED;
    }

    fn is_ended(&self) -> bool {
        self.status.state == State::Ended as u32
    }
}

/// Sets or clears one of the flags.
fn set(flags: &mut u32, flag: u32, on: bool) {
    *flags = *flags & !flag | if on { flag } else { 0 };
}
