//! Receiving samples from the present publisher.

use super::memory;
use super::strangers::ForeignSchemas;
use super::subscriber::{listener, no_place, wait};
use super::topic::sample;
use super::{Bus, BusError, IDLE_TICK, Listener, PubSubService, SubscriberPort, Topic};
use crate::messages::{Sample, header_flags};
use iceoryx2::service::port_factory::PortFactory as _;
use std::time::{Duration, Instant};

/// Receives [`Sample`]s.
///
/// Only the publisher creates the service, because it chooses the delivery mode. The subscriber
/// opens it when it exists, in any mode, and releases it when the publisher has ended, so that the
/// next one may choose again.
#[derive(Debug)]
pub struct SampleSubscriber {
    bus: Bus,
    /// `None` for a polled subscriber.
    listener: Option<Listener>,
    connection: Option<Connection>,
    /// True if a lack of shared memory has been reported.
    is_told: bool,
    /// stream_id and seq of the last sample passed on.
    last: Option<(u64, u64)>,
    schemas: ForeignSchemas,
}

#[derive(Debug)]
struct Connection {
    port: SubscriberPort<Sample>,
    service: PubSubService<Sample>,
}

impl SampleSubscriber {
    /// Prepares to receive; connects now if there is a publisher, otherwise later.
    ///
    /// # Errors
    /// If there is no memory or no place for another subscriber, or the topic cannot be opened.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        let claim = memory::claim(bus, Topic::Sample, 0)?;
        let listener = listener(bus, Topic::Sample)?;
        claim.take()?;
        Self::with(bus, Some(listener))
    }

    /// The same for a subscriber that polls and needs no wake-up, which saves the publisher a
    /// system call per sample.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn polled(bus: &Bus) -> Result<Self, BusError> {
        Self::with(bus, None)
    }

    fn with(bus: &Bus, listener: Option<Listener>) -> Result<Self, BusError> {
        let mut this = Self {
            bus: bus.clone(),
            listener,
            connection: None,
            is_told: false,
            last: None,
            schemas: ForeignSchemas::default(),
        };
        this.connect()?;
        Ok(this)
    }

    /// True while connected to the topic.
    pub fn is_connected(&self) -> bool {
        self.connection.is_some()
    }

    /// Connects when a publisher has appeared, and disconnects when it has disappeared; call it
    /// once per [`IDLE_TICK`](super::IDLE_TICK), with an empty queue.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn refresh(&mut self) -> Result<(), BusError> {
        match &self.connection {
            Some(connection) if connection.service.dynamic_config().number_of_publishers() == 0 => {
                // Since the queue was checked, a publisher may have sent its last samples and
                // ended.
                let waiting = connection.port.has_samples().map_err(|e| receiving(&e))?;
                if !waiting {
                    self.connection = None;
                }
            }
            Some(_) => {}
            None => match self.connect() {
                // A running process continues, and connects when there is memory.
                Err(e @ BusError::SharedMemory { .. }) => {
                    if !self.is_told {
                        tracing::error!("not connected to the samples: {e}");
                    }
                    self.is_told = true;
                }
                connected => {
                    connected?;
                    self.is_told = false;
                }
            },
        }
        Ok(())
    }

    /// Connects if there is a publisher.
    fn connect(&mut self) -> Result<(), BusError> {
        let Some(service) = self.bus.open_sample()? else {
            return Ok(());
        };
        // Subscribing after the publisher exists connects both ends at once; before it, samples
        // could be lost.
        if service.dynamic_config().number_of_publishers() == 0 {
            return Ok(());
        }
        let settings = service.static_config();
        let bytes = sample::connection_bytes(settings.max_subscribers(), settings.subscriber_max_buffer_size());
        let claim = memory::claim(&self.bus, Topic::Sample, bytes)?;
        let port = service.subscriber_builder().create().map_err(|e| {
            self.bus
                .topic_error(Topic::Sample, no_place(&e, "bus.max_sample_subscribers"))
        })?;
        claim.take()?;
        self.connection = Some(Connection { port, service });
        Ok(())
    }

    /// Waits until a sample may be there; at most `timeout`. Signals end the wait early. A
    /// [polled](Self::polled) one sleeps.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), BusError> {
        match &self.listener {
            Some(listener) => wait(listener, Topic::Sample, timeout),
            None => {
                std::thread::sleep(timeout);
                Ok(())
            }
        }
    }

    /// Number of ignored messages of another schema.
    pub fn left_out(&self) -> u64 {
        self.schemas.count()
    }

    /// Passes the samples that have arrived to `take`, at most `limit`; returns their number.
    ///
    /// A sample that was sent again, because another consumer missed it, is passed on only once.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn drain(&mut self, limit: usize, mut take: impl FnMut(&Sample)) -> Result<usize, BusError> {
        self.drain_timed(limit, |sample, _| take(sample))
    }

    /// As [`drain`](Self::drain), with the time of sending \[ns of CLOCK_MONOTONIC\] of each
    /// sample.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn drain_timed(&mut self, limit: usize, mut take: impl FnMut(&Sample, u64)) -> Result<usize, BusError> {
        let Some(connection) = &self.connection else {
            return Ok(0);
        };
        for count in 0..limit {
            let Some(message) = connection.port.receive().map_err(|e| receiving(&e))? else {
                return Ok(count);
            };
            if !self.schemas.admits(Topic::Sample, message.user_header().schema) {
                continue;
            }
            let sample = message.payload();
            let place = Some((sample.stream_id, sample.seq));
            if message.user_header().flags & header_flags::RESENT != 0 && place == self.last {
                continue;
            }
            self.last = place;
            take(sample, message.user_header().sent_ns);
        }
        Ok(limit)
    }

    /// Waits for the next sample, at most for `limit`; returns a copy with the time of sending \[ns
    /// of CLOCK_MONOTONIC\], `None` past the limit. [Connects](Self::refresh) if needed.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn next(&mut self, limit: Duration) -> Result<Option<(Sample, u64)>, BusError> {
        let start = Instant::now();
        let mut found = None;
        loop {
            let seen = self.drain_timed(1, |sample, sent_ns| found = Some((*sample, sent_ns)))?;
            if found.is_some() {
                return Ok(found);
            }
            if seen > 0 {
                // one that this reader ignores
                continue;
            }
            self.refresh()?;
            let left = limit.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            self.wait(left.min(IDLE_TICK))?;
        }
    }
}

fn receiving(cause: &dyn std::fmt::Debug) -> BusError {
    BusError::Transfer {
        topic: Topic::Sample,
        action: "receiving",
        cause: format!("{cause:?}"),
    }
}
