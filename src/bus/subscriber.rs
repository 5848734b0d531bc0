//! Subscribing to estimates and status.

use super::memory;
use super::receipts::Receipts;
use super::strangers::{ForeignSchemas, Speaker};
use super::{Bus, BusError, IDLE_TICK, Latched, Listener, PubSubService, SubscriberPort, Topic};
use iceoryx2::port::listener::Listener as ListenerPort;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::ipc;
use std::time::{Duration, Instant};

/// Polling period on a topic whose messages do not wake readers.
const LOOK: Duration = Duration::from_millis(5);

/// Receives [`Latched`] messages, including the last one before it joined. Works in any starting
/// order.
#[derive(Debug)]
pub struct Subscriber<T: Latched> {
    listener: Option<Listener>,
    port: SubscriberPort<T>,
    service: PubSubService<T>,
    bus: Bus,
    receipts: Option<Receipts>,
    schemas: ForeignSchemas,
    speaker: Speaker,
}

impl<T: Latched> Subscriber<T> {
    /// Subscribes, whether or not there is a publisher yet.
    ///
    /// # Errors
    /// If there is no memory or no place for another subscriber, or the topic cannot be opened.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        let claim = memory::claim(bus, T::TOPIC, 0)?;
        let listener = match T::WAKES {
            false => None,
            true => Some(listener(bus, T::TOPIC)?),
        };
        let service = bus.latched::<T>()?;
        let port = service
            .subscriber_builder()
            .create()
            .map_err(|e| bus.topic_error(T::TOPIC, no_place(&e, "bus.max_estimate_subscribers")))?;
        claim.take()?;
        Ok(Self {
            listener,
            port,
            service,
            bus: bus.clone(),
            receipts: None,
            schemas: ForeignSchemas::default(),
            speaker: Speaker::default(),
        })
    }

    /// From now on acknowledges each received message; for the one reader that the publisher [waits
    /// for](super::Publisher::await_receipts).
    ///
    /// # Errors
    /// If the topic of the receipts cannot be opened.
    pub fn give_receipts(&mut self, bus: &Bus) -> Result<(), BusError> {
        self.receipts = Some(Receipts::new(bus, T::TOPIC)?);
        Ok(())
    }

    /// Waits until a message may be there; at most `timeout`. Signals end the wait early.
    ///
    /// Status does not wake readers: there this is a pause of length `timeout`.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), BusError> {
        match &self.listener {
            Some(listener) => wait(listener, T::TOPIC, timeout),
            None => {
                std::thread::sleep(timeout);
                Ok(())
            }
        }
    }

    /// Number of ignored messages: of another schema, or of a second publisher besides the
    /// identifier.
    pub fn left_out(&self) -> u64 {
        self.schemas.count().saturating_add(self.speaker.count())
    }

    /// Passes all messages that have arrived to `take`; returns their number.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn drain(&mut self, mut take: impl FnMut(&T)) -> Result<usize, BusError> {
        self.drain_timed(|message, _| take(message))
    }

    /// As [`drain`](Self::drain), with the time of sending \[ns of CLOCK_MONOTONIC\] of each
    /// message.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn drain_timed(&mut self, mut take: impl FnMut(&T, u64)) -> Result<usize, BusError> {
        let mut count = 0;
        while self.take_one(&mut take)? {
            count += 1;
        }
        Ok(count)
    }

    /// Waits for the next message, at most for `limit`; returns a copy with the time of sending
    /// \[ns of CLOCK_MONOTONIC\], `None` past the limit.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn next(&mut self, limit: Duration) -> Result<Option<(T, u64)>, BusError> {
        let start = Instant::now();
        let mut found = None;
        loop {
            if self.take_one(&mut |message: &T, sent_ns| found = Some((*message, sent_ns)))? {
                return Ok(found);
            }
            let left = limit.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            self.wait(left.min(if T::WAKES { IDLE_TICK } else { LOOK }))?;
        }
    }

    /// Passes on one message for this reader; false if none is left.
    fn take_one(&mut self, take: &mut impl FnMut(&T, u64)) -> Result<bool, BusError> {
        loop {
            let message = self.port.receive().map_err(|e| BusError::Transfer {
                topic: T::TOPIC,
                action: "receiving",
                cause: format!("{e:?}"),
            })?;
            let Some(message) = message else { return Ok(false) };
            let publisher = message.header().publisher_id().value();
            if !self.schemas.admits(T::TOPIC, message.user_header().schema)
                || !self.speaker.admits(&self.bus, &self.service, publisher)
            {
                continue;
            }
            take(message.payload(), message.user_header().sent_ns);
            if let Some(receipts) = &self.receipts {
                receipts.give();
            }
            return Ok(true);
        }
    }
}

/// Why a subscriber cannot be created; `key` sets the largest number.
pub(super) fn no_place(error: &SubscriberCreateError, key: &str) -> String {
    match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => format!(
            "it has as many subscribers as it was made for: stop one of them, or raise {key} and start the programs of this robot anew"
        ),
        other => format!("cannot subscribe: {other:?}"),
    }
}

pub(super) fn listener(bus: &Bus, topic: Topic) -> Result<Listener, BusError> {
    bus.event(topic)?
        .listener_builder()
        .create()
        .map_err(|e| bus.topic_error(topic, format!("cannot listen: {e:?}")))
}

/// Waits on an event; a signal, including SIGCONT, is not a failure but ends the wait.
pub(super) fn wait(listener: &ListenerPort<ipc::Service>, topic: Topic, timeout: Duration) -> Result<(), BusError> {
    use iceoryx2::port::listener::ListenerWaitError::InterruptSignal;
    // The socket treats a timeout of zero as infinite.
    let waited = match timeout.is_zero() {
        true => listener.try_wait(|_| {}),
        false => listener.timed_wait(|_| {}, timeout),
    };
    match waited {
        Ok(_) | Err(InterruptSignal) => Ok(()),
        Err(e) => Err(BusError::Transfer {
            topic,
            action: "waiting",
            cause: format!("{e:?}"),
        }),
    }
}
