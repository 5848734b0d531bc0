//! From zenoh's threads to the one of the bus.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use zenoh::sample::SampleKind;

/// Largest number of messages that wait: 8 s of samples of one robot at 1 kHz.
const INBOX: usize = 8192;

/// What zenoh's threads have for this one.
pub enum Event {
    Message {
        key: String,
        payload: Vec<u8>,
        envelope: Vec<u8>,
        is_live: bool,
    },
    Alive {
        key: String,
    },
    Gone {
        key: String,
    },
}

/// Hands events over and counts those for which there is no room.
#[derive(Clone)]
pub struct Inbox {
    events: SyncSender<Event>,
    dropped: Arc<AtomicU64>,
}

impl Inbox {
    /// Both ends.
    pub fn new() -> (Self, Receiver<Event>) {
        let (events, taken) = sync_channel(INBOX);
        let dropped = Arc::default();
        (Self { events, dropped }, taken)
    }

    /// How many events had no room.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    pub fn put(&self, event: Event) {
        if self.events.try_send(event).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub fn sample(&self, sample: &zenoh::sample::Sample, is_live: bool) {
        if sample.kind() == SampleKind::Put {
            self.put(Event::Message {
                key: sample.key_expr().as_str().to_owned(),
                payload: sample.payload().to_bytes().into_owned(),
                envelope: sample
                    .attachment()
                    .map_or_else(Vec::new, |bytes| bytes.to_bytes().into_owned()),
                is_live,
            });
        }
    }
}
