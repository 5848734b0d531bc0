//! iceoryx2 alone: a message and an event to another process and back, without this library's
//! layers; the baseline of `thetabus bench`.

use super::subscriber::wait;
use super::{Bus, BusError, Listener, Notifier, PubSubService, PublisherPort, SubscriberPort, Topic, monotonic_ns};
use crate::messages::{Header, SCHEMA_VERSION, Sample};
use std::time::{Duration, Instant};

/// Which end this is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Sends first.
    Near,
    /// Sends back.
    Far,
}

/// One end: a publisher with its event, and a subscriber with its own.
#[derive(Debug)]
pub struct BareLink {
    port: PublisherPort<Sample>,
    wake: Notifier,
    listener: Listener,
    inbox: SubscriberPort<Sample>,
    _services: [PubSubService<Sample>; 2],
}

impl BareLink {
    /// Opens both directions; the first process creates them.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn new(bus: &Bus, end: End) -> Result<Self, BusError> {
        let (to, from) = match end {
            End::Near => ("ping", "pong"),
            End::Far => ("pong", "ping"),
        };
        let failed = |e: &dyn std::fmt::Debug| bus.topic_error(Topic::Sample, format!("cannot be measured: {e:?}"));
        let (out, wakes) = bus.bare(to)?;
        let (back, woken) = bus.bare(from)?;
        Ok(Self {
            port: out.publisher_builder().create().map_err(|e| failed(&e))?,
            wake: wakes.notifier_builder().create().map_err(|e| failed(&e))?,
            listener: woken.listener_builder().create().map_err(|e| failed(&e))?,
            inbox: back.subscriber_builder().create().map_err(|e| failed(&e))?,
            _services: [out, back],
        })
    }

    /// Sends and wakes.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn send(&mut self, message: &Sample) -> Result<(), BusError> {
        let failed = |cause: String| BusError::Transfer {
            topic: Topic::Sample,
            action: "sending",
            cause,
        };
        let mut loan = self.port.loan_uninit().map_err(|e| failed(format!("{e:?}")))?;
        *loan.user_header_mut() = Header {
            schema: SCHEMA_VERSION,
            flags: 0,
            sent_ns: monotonic_ns(),
        };
        loan.write_payload(*message)
            .send()
            .map_err(|e| failed(format!("{e:?}")))?;
        let _ = self.wake.notify();
        Ok(())
    }

    /// The next message and its transit time \[ns\], `None` past the limit.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<(Sample, u64)>, BusError> {
        let start = Instant::now();
        loop {
            let message = self.inbox.receive().map_err(|e| BusError::Transfer {
                topic: Topic::Sample,
                action: "receiving",
                cause: format!("{e:?}"),
            })?;
            if let Some(message) = message {
                let under_way = monotonic_ns().saturating_sub(message.user_header().sent_ns);
                return Ok(Some((*message.payload(), under_way)));
            }
            let left = limit.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            wait(&self.listener, Topic::Sample, left)?;
        }
    }
}
