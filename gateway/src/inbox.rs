//! From zenoh's threads to the one of the bus.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use zenoh::sample::SampleKind;

/// Largest number of messages that wait: 8 s of samples of one robot at 1 kHz.
const INBOX: usize = 8192;
/// Largest number of bytes in them: the descriptions of a thousand robots at once.
const BYTES: usize = 64 << 20;
/// The longest message, a description, has 45 kB. One that is longer cannot be read, and is not kept.
const LONGEST: usize = 64 << 10;
/// Shortest time between two lines about messages that were dropped.
const TOLD_EVERY: Duration = Duration::from_secs(10);

/// A message as zenoh's threads have it.
pub struct Message {
    pub key: String,
    /// Empty if it is too long to be read.
    pub payload: Vec<u8>,
    /// How long the payload was.
    pub came: usize,
    pub envelope: Vec<u8>,
    pub is_live: bool,
}

/// What became of a robot's liveliness token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    Alive,
    Gone,
}

/// What both ends share.
#[derive(Debug, Default)]
struct Shared {
    /// Bytes that wait.
    bytes: AtomicUsize,
    dropped: AtomicU64,
    /// The last word about each token: never dropped, because it comes once. zenoh itself keeps as
    /// many.
    tokens: Mutex<BTreeMap<String, Presence>>,
}

/// The end of zenoh's threads: hands messages over, and counts those for which there is no room.
#[derive(Clone)]
pub struct Inbox {
    messages: SyncSender<Message>,
    shared: Arc<Shared>,
}

impl Inbox {
    /// Both ends.
    pub fn new() -> (Self, Outbox) {
        let (messages, taken) = sync_channel(INBOX);
        let shared = Arc::<Shared>::default();
        let outbox = Outbox {
            messages: taken,
            shared: shared.clone(),
        };
        (Self { messages, shared }, outbox)
    }

    /// A message of the network.
    pub fn sample(&self, sample: &zenoh::sample::Sample, is_live: bool) {
        if sample.kind() != SampleKind::Put {
            return;
        }
        let payload = sample.payload();
        let envelope = sample.attachment().filter(|bytes| bytes.len() <= LONGEST);
        self.put(Message {
            key: sample.key_expr().as_str().to_owned(),
            came: payload.len(),
            payload: match payload.len() {
                ..=LONGEST => payload.to_bytes().into_owned(),
                _ => Vec::new(),
            },
            envelope: envelope.map_or_else(Vec::new, |bytes| bytes.to_bytes().into_owned()),
            is_live,
        });
    }

    fn put(&self, message: Message) {
        let bytes = message.len();
        let is_room = self.shared.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes <= BYTES;
        if !is_room || self.messages.try_send(message).is_err() {
            self.shared.bytes.fetch_sub(bytes, Ordering::Relaxed);
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A robot's token has come or gone.
    pub fn token(&self, key: String, presence: Presence) {
        let mut tokens = self.shared.tokens.lock().unwrap_or_else(PoisonError::into_inner);
        tokens.insert(key, presence);
    }
}

impl Message {
    fn len(&self) -> usize {
        self.key.len() + self.payload.len() + self.envelope.len()
    }
}

/// The end of the bus's thread.
pub struct Outbox {
    messages: Receiver<Message>,
    shared: Arc<Shared>,
}

impl Outbox {
    /// The next message; waits for it for so long.
    pub fn wait(&self, limit: Duration) -> Result<Message, RecvTimeoutError> {
        let message = self.messages.recv_timeout(limit)?;
        self.shared.bytes.fetch_sub(message.len(), Ordering::Relaxed);
        Ok(message)
    }

    /// The next message, if there is one.
    pub fn next(&self) -> Result<Message, TryRecvError> {
        let message = self.messages.try_recv()?;
        self.shared.bytes.fetch_sub(message.len(), Ordering::Relaxed);
        Ok(message)
    }

    /// Tokens that have come or gone since the last call.
    pub fn tokens(&self) -> BTreeMap<String, Presence> {
        std::mem::take(&mut *self.shared.tokens.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How many messages had no room.
    pub fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }
}

/// What the log has told of messages that had no room.
#[derive(Debug, Default)]
pub struct Overflow {
    told: u64,
    last: Option<Instant>,
    /// The count when it last grew, and when that was, until there is room again.
    growing: Option<(u64, Instant)>,
}

/// What there is to do about messages that had no room.
#[derive(Debug, PartialEq, Eq)]
pub enum Word {
    Nothing,
    /// Tell of so many more.
    Tell(u64),
    /// There is room again: no message was dropped for [`TOLD_EVERY`], and the log has counted all
    /// that were.
    Over,
}

impl Overflow {
    /// Tells at once when it begins, and while it lasts every [`TOLD_EVERY`].
    pub fn word(&mut self, dropped: u64, now: Instant) -> Word {
        if self.growing.map_or(self.told, |(count, _)| count) < dropped {
            self.growing = Some((dropped, now));
        }
        let is_quiet = |since: Option<Instant>| since.is_none_or(|since| now.duration_since(since) >= TOLD_EVERY);
        if dropped > self.told && is_quiet(self.last) {
            let more = dropped - self.told;
            (self.told, self.last) = (dropped, Some(now));
            return Word::Tell(more);
        }
        match self.growing {
            Some((_, since)) if dropped == self.told && is_quiet(Some(since)) => {
                self.growing = None;
                Word::Over
            }
            _ => Word::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: usize) -> Message {
        Message {
            key: String::new(),
            payload: vec![0; bytes],
            came: bytes,
            envelope: Vec::new(),
            is_live: true,
        }
    }

    #[test]
    fn fault_messages_that_wait_fill_the_inbox_by_number_or_by_bytes_and_no_more_memory() {
        for (bytes, room) in [(10, INBOX), (LONGEST, BYTES / LONGEST)] {
            let (inbox, outbox) = Inbox::new();
            (0..room + 3).for_each(|_| inbox.put(message(bytes)));
            assert_eq!(outbox.dropped(), 3, "{bytes}");
            while outbox.next().is_ok() {}
            assert_eq!(inbox.shared.bytes.load(Ordering::Relaxed), 0);
            inbox.put(message(bytes));
            assert!(outbox.wait(Duration::ZERO).is_ok() && outbox.dropped() == 3);
        }
    }

    #[test]
    fn prop_tokens_come_even_if_the_inbox_is_full_and_the_last_word_counts() {
        let (inbox, outbox) = Inbox::new();
        (0..=INBOX).for_each(|_| inbox.put(message(0)));
        inbox.token("a".to_owned(), Presence::Gone);
        inbox.token("b".to_owned(), Presence::Alive);
        inbox.token("a".to_owned(), Presence::Alive);
        let all = [("a".to_owned(), Presence::Alive), ("b".to_owned(), Presence::Alive)];
        assert_eq!(outbox.tokens(), all.into());
        assert!(outbox.tokens().is_empty());
    }

    #[test]
    fn prop_a_full_inbox_is_told_when_it_begins_and_not_often_and_to_the_last_message() {
        let (mut overflow, start) = (Overflow::default(), Instant::now());
        let mut told = Vec::new();
        for tenth in 0..600_u32 {
            let now = start + tenth * Duration::from_millis(100);
            // Ten in each tenth of a second from 2 s to 15 s, and one at 40 s.
            let dropped = 10 * u64::from(tenth.clamp(20, 150) - 20) + u64::from(tenth >= 400);
            match overflow.word(dropped, now) {
                Word::Nothing => {}
                word => told.push((tenth, word)),
            }
        }
        let expected = [
            (21, Word::Tell(10)),
            (121, Word::Tell(1000)),
            (221, Word::Tell(290)),
            (250, Word::Over),
            (400, Word::Tell(1)),
            (500, Word::Over),
        ];
        assert_eq!(told, expected);
    }
}
