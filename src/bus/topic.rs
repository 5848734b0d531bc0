//! Names and sizes of the topics: the contract with every other program on the bus.

use crate::messages::{Description, Estimate, Journal, MachineCommand, Sample, Status};
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

/// A topic of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Topic {
    /// [`Sample`]s from the plant.
    Sample,
    /// [`Estimate`]s from the identifier.
    Estimate,
    /// [`Status`] of the identifier.
    Status,
    /// [`Description`] of what is identified.
    Description,
    /// [`Journal`] of the commands that took effect.
    Journal,
    /// Requests to the identifier.
    Control,
    /// [`MachineCommand`]s of a controller to the machine.
    Command,
}

impl Topic {
    /// The last part of the service name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Estimate => "estimate",
            Self::Status => "status",
            Self::Description => "description",
            Self::Journal => "journal",
            Self::Control => "control",
            Self::Command => "command",
        }
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What stays readable after it was sent: a late joiner gets the last one at once.
pub trait Latched: ZeroCopySend + fmt::Debug + Copy + 'static {
    /// Its topic.
    const TOPIC: Topic;
    /// How many of the last messages a late joiner gets.
    const HISTORY: usize = latched::HISTORY;
    /// How many messages a reader may be behind.
    const BUFFER: usize = latched::BUFFER;
    /// Whether a message wakes its readers; they look once per tick if it does not.
    const WAKES: bool = true;
}

impl Latched for Estimate {
    const TOPIC: Topic = Topic::Estimate;
}

impl Latched for Status {
    const TOPIC: Topic = Topic::Status;
    const WAKES: bool = false;
}

impl Latched for Description {
    const TOPIC: Topic = Topic::Description;
    // 40 KB each, and only the last one says anything
    const BUFFER: usize = 1;
    const WAKES: bool = false;
}

impl Latched for MachineCommand {
    const TOPIC: Topic = Topic::Command;
    // the newest one counts
    const BUFFER: usize = 16;
}

impl Latched for Journal {
    const TOPIC: Topic = Topic::Journal;
    const HISTORY: usize = latched::BUFFER;
    const WAKES: bool = false;
}

/// Sizes of `sample`; how many subscribers there can be, and the buffer in real time, is in
/// [`Limits`](super::Limits).
pub(super) mod sample {
    use super::Sample;

    pub const MAX_PUBLISHERS: usize = 1;
    pub const MAX_BORROWED: usize = 2;
    /// Realtime: what a consumer gets that connects later, 256 ms at 1 kHz.
    pub const HISTORY: usize = 256;
    /// Lockstep: the publisher waits, so this needs only to bridge the scheduler's pauses; small
    /// enough to stay in the cache.
    pub const LOCKSTEP_BUFFER: usize = 1024;
    /// Bytes of a publisher's data segment at worst.
    pub const fn segment_bytes(subscribers: usize, buffer: usize) -> u64 {
        // Headers and alignment take less than 128 bytes.
        (chunks(subscribers, buffer) * (size_of::<Sample>() + 128)) as u64
    }
    /// Bytes of the connection of a publisher and a subscriber at worst: a word per place in the
    /// queues to and fro, a byte per sample that may be on loan, and a page for what describes it.
    pub const fn connection_bytes(subscribers: usize, buffer: usize) -> u64 {
        (2 * 8 * (buffer + MAX_BORROWED + 2) + chunks(subscribers, buffer) + 4096) as u64
    }
    const fn chunks(subscribers: usize, buffer: usize) -> usize {
        subscribers * (buffer + MAX_BORROWED) + HISTORY + 2
    }
}

/// Sizes of `control`.
pub(super) mod control {
    use crate::messages::{Request, Response};

    pub const MAX_CLIENTS: usize = 8;
    pub const MAX_NODES: usize = 12;
    /// iceoryx2's own limits: responses that a client holds, messages that a port fills at a time.
    const BORROWED_AND_LOANED: usize = 4;
    /// Bytes of the server's data segment at worst: each client has a request under way, and one
    /// that it has dropped.
    pub const fn server_bytes() -> u64 {
        (2 * MAX_CLIENTS * (1 + BORROWED_AND_LOANED) * (size_of::<Response>() + 128)) as u64
    }
    /// Bytes of a client's data segment at worst.
    pub const fn client_bytes() -> u64 {
        ((2 + BORROWED_AND_LOANED) * (size_of::<Request>() + 128)) as u64
    }
}

/// Sizes of `estimate`, `status`, `description` and `journal`.
pub(super) mod latched {
    pub const MAX_PUBLISHERS: usize = 2;
    pub const BUFFER: usize = 64;
    pub const HISTORY: usize = 1;
    pub const MAX_BORROWED: usize = 2;
    /// Bytes of a publisher's data segment at worst, for so many subscribers with this buffer,
    /// messages of this size and so many of them for late joiners.
    pub const fn segment_bytes(subscribers: usize, buffer: usize, message: usize, history: usize) -> u64 {
        ((subscribers * (buffer + MAX_BORROWED) + history + 2) * (message + 128)) as u64
    }
}
