//! Publishing estimates and status.

use super::memory;
use super::receipts::ReceiptBook;
use super::topic::latched;
use super::{Bus, BusError, Latched, Notifier, PubSubService, PublisherPort, monotonic_ns};
use crate::messages::{Header, SCHEMA_VERSION};
use iceoryx2::port::update_connections::UpdateConnections;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Publishes [`Latched`] messages: never waits, and keeps the last one for late joiners.
#[derive(Debug)]
pub struct Publisher<T: Latched> {
    notifier: Option<Notifier>,
    port: PublisherPort<T>,
    service: PubSubService<T>,
    receipts: Option<ReceiptBook>,
}

/// Largest number of bytes that a publisher needs.
pub(super) const fn bytes_of<T: Latched>(subscribers: usize) -> u64 {
    latched::segment_bytes(subscribers, T::BUFFER, size_of::<T>(), T::HISTORY)
}

impl<T: Latched> Publisher<T> {
    /// Becomes a publisher of the topic.
    ///
    /// # Errors
    /// If there is no memory for the topic, or it cannot be opened.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        let claim = memory::claim(bus, T::TOPIC, bytes_of::<T>(bus.domain().limits().estimate_subscribers))?;
        let service = bus.latched::<T>()?;
        let port = service
            .publisher_builder()
            .max_loaned_samples(2)
            .create()
            .map_err(|e| bus.topic_error(T::TOPIC, format!("cannot publish: {e:?}")))?;
        let notifier = match T::WAKES {
            false => None,
            true => Some(
                bus.event(T::TOPIC)?
                    .notifier_builder()
                    .create()
                    .map_err(|e| bus.topic_error(T::TOPIC, format!("cannot wake consumers: {e:?}")))?,
            ),
        };
        claim.take()?;
        Ok(Self {
            notifier,
            port,
            service,
            receipts: None,
        })
    }

    /// From now on keeps fewer messages in transit than a queue holds, by the receipts of the one
    /// reader that [gives them](super::Subscriber::give_receipts): for runs in which nothing may be
    /// lost. A reader silent for `limit` is not awaited again, and none is once `stop` is set.
    ///
    /// # Errors
    /// If the topic of the receipts cannot be opened.
    pub fn await_receipts(&mut self, bus: &Bus, limit: Duration, stop: Arc<AtomicBool>) -> Result<(), BusError> {
        self.receipts = Some(ReceiptBook::new(bus, T::TOPIC, limit, stop)?);
        Ok(())
    }

    /// Sends a copy and wakes the consumers. Never waits for them, unless receipts are awaited.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn send(&mut self, message: &T) -> Result<(), BusError> {
        if let Some(receipts) = &mut self.receipts {
            receipts.before_send()?;
        }
        let transfer = |cause: String| BusError::Transfer {
            topic: T::TOPIC,
            action: "sending",
            cause,
        };
        let mut loan = self.port.loan_uninit().map_err(|e| transfer(format!("{e:?}")))?;
        *loan.user_header_mut() = Header {
            schema: SCHEMA_VERSION,
            flags: 0,
            sent_ns: monotonic_ns(),
        };
        loan.write_payload(*message)
            .send()
            .map_err(|e| transfer(format!("{e:?}")))?;
        if let Some(notifier) = &self.notifier {
            // A consumer that could not be woken checks its queue within an idle tick.
            let _ = notifier.notify();
        }
        Ok(())
    }

    /// Sends the last message to subscribers that have joined since; call it once per
    /// [`IDLE_TICK`](super::IDLE_TICK).
    ///
    /// # Errors
    /// If the bus fails.
    pub fn serve_late_joiners(&mut self) -> Result<(), BusError> {
        self.port.update_connections().map_err(|e| BusError::Transfer {
            topic: T::TOPIC,
            action: "connecting to late joiners",
            cause: format!("{e:?}"),
        })
    }

    /// Number of subscribers now.
    pub fn subscribers(&self) -> usize {
        use iceoryx2::service::port_factory::PortFactory as _;
        self.service.dynamic_config().number_of_subscribers()
    }
}
