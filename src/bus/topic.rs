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

/// Messages that stay readable after sending: a late joiner gets the last one at once.
pub trait Latched: ZeroCopySend + fmt::Debug + Copy + 'static {
    /// Its topic.
    const TOPIC: Topic;
    /// How many of the last messages a late joiner gets.
    const HISTORY: usize = latched::HISTORY;
    /// How many messages a reader may lag.
    const BUFFER: usize = latched::BUFFER;
    /// Whether a message wakes its readers; otherwise they poll once per tick.
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
    // 40 KB each, and only the last one matters
    const BUFFER: usize = 1;
    const WAKES: bool = false;
}

impl Latched for MachineCommand {
    const TOPIC: Topic = Topic::Command;
    // only the newest one matters
    const BUFFER: usize = 16;
}

impl Latched for Journal {
    const TOPIC: Topic = Topic::Journal;
    const HISTORY: usize = latched::BUFFER;
    const WAKES: bool = false;
}

/// Sizes of `sample`; the numbers of subscribers and the buffer in real time are in
/// [`Limits`](super::Limits).
pub(super) mod sample {
    use super::Sample;

    pub const MAX_PUBLISHERS: usize = 1;
    pub const MAX_BORROWED: usize = 2;
    /// Realtime: samples for a consumer that connects later, 256 ms at 1 kHz.
    pub const HISTORY: usize = 256;
    /// Lockstep: the publisher waits, so this only needs to bridge pauses of the scheduler; small
    /// enough for the cache.
    pub const LOCKSTEP_BUFFER: usize = 1024;
    /// Largest size of a publisher's data segment \[bytes\].
    pub const fn segment_bytes(subscribers: usize, buffer: usize) -> u64 {
        // Headers and alignment take less than 128 bytes.
        (chunks(subscribers, buffer) * (size_of::<Sample>() + 128)) as u64
    }
    /// Largest size of the connection of a publisher and a subscriber \[bytes\]: a word per entry
    /// in the queues in both directions, a byte per sample that may be on loan, and a page for its
    /// description.
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
    /// What to say if there is no room for another client.
    pub const FULL: &str = "as many programs send commands as it has room for, 8: try again when one of them has ended";
    /// iceoryx2's own limits: responses held by a client, messages filled by a port at a time.
    const BORROWED_AND_LOANED: usize = 4;
    /// Largest size of the server's data segment \[bytes\]: each client has a pending request, and
    /// a dropped one.
    pub const fn server_bytes() -> u64 {
        (2 * MAX_CLIENTS * (1 + BORROWED_AND_LOANED) * (size_of::<Response>() + 128)) as u64
    }
    /// Largest size of a client's data segment \[bytes\].
    pub const fn client_bytes() -> u64 {
        ((2 + BORROWED_AND_LOANED) * (size_of::<Request>() + 128)) as u64
    }
}

/// Sizes of `estimate`, `status`, `description`, `journal` and `command`.
pub(super) mod latched {
    pub const MAX_PUBLISHERS: usize = 2;
    pub const BUFFER: usize = 64;
    pub const HISTORY: usize = 1;
    pub const MAX_BORROWED: usize = 2;
    /// Largest size of a publisher's data segment \[bytes\], for these numbers of subscribers,
    /// buffered messages, bytes per message, and messages for late joiners.
    pub const fn segment_bytes(subscribers: usize, buffer: usize, message: usize, history: usize) -> u64 {
        ((subscribers * (buffer + MAX_BORROWED) + history + 2) * (message + 128)) as u64
    }
}
