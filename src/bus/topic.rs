//! Names and sizes of the topics: the contract with every other program on the bus.

use crate::messages::{Estimate, Journal, Sample, Status};
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
    /// [`Journal`] of the commands that took effect.
    Journal,
    /// Requests to the identifier.
    Control,
}

impl Topic {
    /// The last part of the service name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Estimate => "estimate",
            Self::Status => "status",
            Self::Journal => "journal",
            Self::Control => "control",
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
    /// Whether a message wakes its readers; they look once per tick where it does not.
    const WAKES: bool = true;
}

impl Latched for Estimate {
    const TOPIC: Topic = Topic::Estimate;
}

impl Latched for Status {
    const TOPIC: Topic = Topic::Status;
    const WAKES: bool = false;
}

impl Latched for Journal {
    const TOPIC: Topic = Topic::Journal;
    const HISTORY: usize = latched::BUFFER;
    const WAKES: bool = false;
}

/// Sizes of `sample`.
pub(super) mod sample {
    use super::Sample;

    pub const MAX_PUBLISHERS: usize = 1;
    pub const MAX_SUBSCRIBERS: usize = 4;
    pub const MAX_NODES: usize = 16;
    pub const MAX_BORROWED: usize = 2;
    /// Realtime: 8 s at 1 kHz for a consumer that was held up.
    pub const REALTIME_BUFFER: usize = 8192;
    /// Lockstep: the publisher waits, so this needs only to bridge the scheduler's pauses; small enough to stay in the cache.
    pub const LOCKSTEP_BUFFER: usize = 1024;
    /// Bytes of a publisher's data segment at worst.
    pub const fn segment_bytes(buffer: usize) -> u64 {
        // Headers and alignment take less than 128 bytes.
        (chunks(buffer) * (size_of::<Sample>() + 128)) as u64
    }
    /// Bytes of the connection of a publisher and a subscriber at worst: a word per place in the queues to and fro, a byte per
    /// sample that may be on loan, and a page for what describes it.
    pub const fn connection_bytes(buffer: usize) -> u64 {
        (2 * 8 * (buffer + MAX_BORROWED + 2) + chunks(buffer) + 4096) as u64
    }
    const fn chunks(buffer: usize) -> usize {
        MAX_SUBSCRIBERS * (buffer + MAX_BORROWED) + 2
    }
}

/// Sizes of `control`.
pub(super) mod control {
    use crate::messages::{Request, Response};

    pub const MAX_CLIENTS: usize = 8;
    pub const MAX_NODES: usize = 12;
    /// iceoryx2's own limits: responses that a client holds, messages that a port fills at a time.
    const BORROWED_AND_LOANED: usize = 4;
    /// Bytes of the server's data segment at worst: each client has a request under way, and one that it has dropped.
    pub const fn server_bytes() -> u64 {
        (2 * MAX_CLIENTS * (1 + BORROWED_AND_LOANED) * (size_of::<Response>() + 128)) as u64
    }
    /// Bytes of a client's data segment at worst.
    pub const fn client_bytes() -> u64 {
        ((2 + BORROWED_AND_LOANED) * (size_of::<Request>() + 128)) as u64
    }
}

/// Sizes of `estimate`, `status` and `journal`.
pub(super) mod latched {
    pub const MAX_PUBLISHERS: usize = 2;
    pub const MAX_SUBSCRIBERS: usize = 16;
    pub const MAX_NODES: usize = 20;
    pub const BUFFER: usize = 64;
    pub const HISTORY: usize = 1;
    pub const MAX_BORROWED: usize = 2;
    /// Bytes of a publisher's data segment at worst, for messages of this size and so many of them for late joiners.
    pub const fn segment_bytes(message: usize, history: usize) -> u64 {
        ((MAX_SUBSCRIBERS * (BUFFER + MAX_BORROWED) + history + 2) * (message + 128)) as u64
    }
}
