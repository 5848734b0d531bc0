//! Flow control for the estimates of a lockstep run.
//!
//! The topic `estimate` never waits for a reader, which is right for a real machine. In lockstep
//! nothing may be lost, and short blocks at full speed give thousands of estimates a second. So the
//! required reader sends a receipt for each by an event, and the publisher keeps fewer in transit
//! than a queue holds.

use super::topic::latched;
use super::{Bus, BusError, Listener, Notifier, Topic};
use iceoryx2::port::listener::ListenerWaitError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Largest number of estimates in transit.
const WINDOW: u64 = (latched::BUFFER * 3 / 4) as u64;
/// How often a wait checks whether the process was asked to stop.
const POLL: Duration = Duration::from_millis(20);

/// The reader's end.
#[derive(Debug)]
pub(super) struct Receipts(Notifier);

impl Receipts {
    pub(super) fn new(bus: &Bus, topic: Topic) -> Result<Self, BusError> {
        bus.receipts(topic)?
            .notifier_builder()
            .create()
            .map(Self)
            .map_err(|e| bus.topic_error(topic, format!("cannot give receipts: {e:?}")))
    }

    pub(super) fn give(&self) {
        // The publisher's wait has a limit, so a lost receipt only costs time.
        let _ = self.0.notify();
    }
}

/// The publisher's end.
#[derive(Debug)]
pub(super) struct ReceiptBook {
    listener: Listener,
    on_the_way: u64,
    limit: Duration,
    stop: Arc<AtomicBool>,
    given_up: bool,
}

impl ReceiptBook {
    pub(super) fn new(bus: &Bus, topic: Topic, limit: Duration, stop: Arc<AtomicBool>) -> Result<Self, BusError> {
        let listener = bus
            .receipts(topic)?
            .listener_builder()
            .create()
            .map_err(|e| bus.topic_error(topic, format!("cannot take receipts: {e:?}")))?;
        Ok(Self {
            listener,
            on_the_way: 0,
            limit,
            stop,
            given_up: false,
        })
    }

    /// Waits until one more may be in transit, then counts it. A reader that stays silent past the
    /// limit is not awaited again.
    pub(super) fn before_send(&mut self) -> Result<(), BusError> {
        if self.given_up {
            return Ok(());
        }
        if self.on_the_way >= WINDOW {
            let start = Instant::now();
            while self.on_the_way >= WINDOW && !self.stop.load(Ordering::Relaxed) {
                self.collect()?;
                if start.elapsed() > self.limit {
                    self.given_up = true;
                    tracing::warn!(
                        limit_s = self.limit.as_secs_f64(),
                        "lockstep: the reader of the estimates is stuck, it is not waited for any more and may lose some"
                    );
                    break;
                }
            }
        }
        self.on_the_way += 1;
        Ok(())
    }

    fn collect(&mut self) -> Result<(), BusError> {
        let mut count = 0;
        match self.listener.timed_wait(|event| count += event.count, POLL) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {
                self.on_the_way = self.on_the_way.saturating_sub(count);
                Ok(())
            }
            Err(e) => Err(BusError::Transfer {
                topic: Topic::Estimate,
                action: "waiting for receipts",
                cause: format!("{e:?}"),
            }),
        }
    }
}
