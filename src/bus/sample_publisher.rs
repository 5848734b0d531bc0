//! Publishing samples, in real time or in lockstep.
//!
//! In lockstep a full queue makes the publisher wait. Three situations must not make it wait
//! forever or lose a sample:
//! - A consumer that died: its queue stays full until it is cleaned up, so this port cleans up
//!   while it waits.
//! - A consumer that is stuck: it is cut off after the limit, and counted.
//! - A consumer that has registered but not yet connected, because it started before this
//!   publisher: once its queue is full, iceoryx2 drops the sample and only reports one receiver
//!   less.
//!
//! A sample that did not reach every consumer is sent again with the header flag `RESENT`;
//! consumers that already have it drop it.

use super::memory;
use super::topic::sample;
use super::{Bus, BusError, IDLE_TICK, Notifier, PubSubService, PublisherPort, Topic, monotonic_ns};
use crate::messages::{Header, SCHEMA_VERSION, Sample, header_flags};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, BackpressureInfo, SendError};
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, ipc};
use iceoryx2::service::port_factory::PortFactory as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::warn;

/// How long one attempt waits for a full queue before the port checks for dead consumers.
const ATTEMPT: Duration = Duration::from_millis(50);
/// Pause between attempts if an attempt does not wait by itself.
const PAUSE: Duration = Duration::from_millis(1);
/// Time limit for consumers once this process was asked to stop.
const STOPPING_LIMIT: Duration = Duration::from_secs(2);

/// What happens when a consumer does not keep up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// A live machine: never waits; a consumer that lags by more than the buffer loses the oldest
    /// samples.
    Realtime,
    /// Simulation and replay: the publisher waits, nothing is lost.
    Lockstep {
        /// Consumers that must be attached.
        consumers: usize,
        /// Time limit for missing or stuck consumers.
        limit: Duration,
    },
}

impl Delivery {
    /// Its name in configuration files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Realtime => "realtime",
            Self::Lockstep { .. } => "lockstep",
        }
    }
}

/// How waiting for consumers ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attached {
    /// All required consumers are attached.
    Yes,
    /// The process was asked to stop.
    Stopped,
}

/// What lockstep could not deliver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loss {
    /// Consumers cut off because they were stuck.
    pub cut_off: u64,
    /// Consumers that left and were not replaced in time.
    pub left: u64,
}

impl Loss {
    /// True if nothing was lost.
    pub fn is_none(self) -> bool {
        self == Self::default()
    }
}

/// State shared by the backpressure handler and the port.
#[derive(Debug, Default)]
struct Pressure {
    /// Ports that are cut off.
    cut: Vec<u128>,
    /// Port whose queue was full in the last attempt.
    full: Option<u128>,
}

/// Publishes [`Sample`]s.
#[derive(Debug)]
pub struct SamplePublisher {
    notifier: Notifier,
    port: PublisherPort<Sample>,
    service: PubSubService<Sample>,
    bus: Bus,
    delivery: Delivery,
    stop: Arc<AtomicBool>,
    pressure: Arc<Mutex<Pressure>>,
    /// Number of required consumers; decreases if one leaves for good.
    required: usize,
    /// Number of subscribers that never connected and were abandoned.
    given_up: usize,
    loss: Loss,
}

impl SamplePublisher {
    /// Creates the topic; `stop` shortens every wait once it is set.
    ///
    /// # Errors
    /// If there is no memory for the topic, or it cannot be opened.
    pub fn new(bus: &Bus, delivery: Delivery, stop: Arc<AtomicBool>) -> Result<Self, BusError> {
        let limits = bus.domain().limits();
        let (buffer, required) = match delivery {
            Delivery::Realtime => (limits.sample_buffer, 0),
            Delivery::Lockstep { consumers, .. } => (sample::LOCKSTEP_BUFFER, consumers),
        };
        let subscribers = limits.sample_subscribers;
        let needed = sample::segment_bytes(subscribers, buffer)
            + subscribers as u64 * sample::connection_bytes(subscribers, buffer);
        memory::check(bus, Topic::Sample, needed + memory::SPARE)?;
        let service = bus.create_sample(delivery == Delivery::Realtime, buffer)?;
        // Consumers of an ended publisher release the topic within an idle tick and then connect to
        // this one from the start.
        let start = Instant::now();
        while service.dynamic_config().number_of_subscribers() > 0 && start.elapsed() < 3 * IDLE_TICK {
            std::thread::sleep(PAUSE);
        }
        let claim = memory::claim(bus, Topic::Sample, needed)?;
        let pressure = Arc::new(Mutex::new(Pressure::default()));
        let handler = pressure.clone();
        let port = service
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(move |info: &BackpressureInfo| {
                let mut pressure = handler.lock().unwrap_or_else(PoisonError::into_inner);
                if pressure.cut.contains(&info.receiver_port_id) {
                    BackpressureAction::DiscardData
                } else if info.elapsed_time > ATTEMPT {
                    pressure.full = Some(info.receiver_port_id);
                    BackpressureAction::DiscardDataAndFail
                } else {
                    BackpressureAction::Retry
                }
            })
            .create()
            .map_err(|e| {
                bus.topic_error(
                    Topic::Sample,
                    format!("cannot publish: {e:?}; is another program publishing?"),
                )
            })?;
        let notifier = bus
            .event(Topic::Sample)?
            .notifier_builder()
            .create()
            .map_err(|e| bus.topic_error(Topic::Sample, format!("cannot wake consumers: {e:?}")))?;
        claim.take()?;
        // Processes that wait for the topic check at once.
        let _ = notifier.notify();
        Ok(Self {
            notifier,
            port,
            service,
            bus: bus.clone(),
            delivery,
            stop,
            pressure,
            required,
            given_up: 0,
            loss: Loss::default(),
        })
    }

    /// Subscribers of the topic now.
    pub fn attached(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Losses so far.
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// In lockstep: waits for the consumers, and fails if they do not attach within the limit.
    ///
    /// # Errors
    /// If they do not attach within the limit, or the bus fails.
    pub fn wait_for_consumers(&mut self) -> Result<Attached, BusError> {
        let Delivery::Lockstep { consumers, limit } = self.delivery else {
            return Ok(Attached::Yes);
        };
        let start = Instant::now();
        let mut logged = false;
        while self.attached() < consumers {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Attached::Stopped);
            }
            if start.elapsed() > limit {
                return Err(BusError::NoConsumers {
                    topic: Topic::Sample,
                    robot: self.bus.robot().into(),
                    domain: self.bus.domain().name().into(),
                    attached: self.attached(),
                    expected: consumers,
                    limit_s: limit.as_secs_f64(),
                });
            }
            if !logged && start.elapsed() > Duration::from_secs(1) {
                logged = true;
                tracing::info!(
                    attached = self.attached(),
                    expected = consumers,
                    limit_s = limit.as_secs_f64(),
                    "lockstep: waiting for consumers of the samples"
                );
            }
            // Wakes consumers that wait for the topic to appear.
            self.wake();
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(Attached::Yes)
    }

    /// Waits for `consumers` before the first sample, in any delivery mode, for at most `limit`.
    pub fn hold_for(&mut self, consumers: usize, limit: Duration) {
        let start = Instant::now();
        while self.attached() < consumers && start.elapsed() < limit && !self.stop.load(Ordering::Relaxed) {
            self.wake();
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Sends a copy. In real time it never waits; in lockstep it returns when every consumer has it
    /// or was abandoned.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn send(&mut self, message: &Sample) -> Result<(), BusError> {
        let sent = self.attempt(message, 0)?;
        match self.delivery {
            Delivery::Realtime => Ok(()),
            Delivery::Lockstep { limit, .. } => {
                if self.complete(sent) {
                    Ok(())
                } else {
                    self.insist(message, limit)
                }
            }
        }
    }

    /// Wakes the consumers, after one or more samples; required before a pause.
    pub fn wake(&mut self) {
        // A consumer that could not be woken checks its queue within an idle tick.
        let _ = self.notifier.notify();
    }

    /// Stays for two ticks after the last sample, so that a consumer that has just attached can map
    /// the queue while its publisher is alive.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn linger(&mut self) -> Result<(), BusError> {
        let start = Instant::now();
        while start.elapsed() < 2 * IDLE_TICK {
            self.serve_late_joiners()?;
            self.wake();
            std::thread::sleep(IDLE_TICK / 4);
        }
        Ok(())
    }

    /// Connects to consumers that have joined since; call it once per [`IDLE_TICK`].
    ///
    /// # Errors
    /// If the bus fails.
    pub fn serve_late_joiners(&mut self) -> Result<(), BusError> {
        self.port
            .update_connections()
            .map_err(|e| transfer("connecting to late joiners", &e))
    }

    /// One attempt: the number of consumers reached, `None` if a queue stayed full.
    fn attempt(&mut self, message: &Sample, flags: u32) -> Result<Option<usize>, BusError> {
        let mut loan = self.port.loan_uninit().map_err(|e| transfer("sending", &e))?;
        *loan.user_header_mut() = Header {
            schema: SCHEMA_VERSION,
            flags,
            sent_ns: monotonic_ns(),
        };
        match loan.write_payload(*message).send() {
            Ok(reached) => Ok(Some(reached)),
            Err(SendError::UnableToDeliver) => Ok(None),
            Err(e) => Err(transfer("sending", &e)),
        }
    }

    /// True if every required consumer has it.
    fn complete(&self, sent: Option<usize>) -> bool {
        sent.is_some_and(|reached| reached >= self.required && reached + self.not_counted() >= self.attached())
    }

    /// Number of attached subscribers that need not be reached.
    fn not_counted(&self) -> usize {
        if self.loss.cut_off == 0 {
            return 0;
        }
        let pressure = self.pressure.lock().unwrap_or_else(PoisonError::into_inner);
        let mut cut = 0;
        self.service.dynamic_config().list_subscribers(|details| {
            cut += usize::from(pressure.cut.contains(&details.subscriber_id.value()));
            CallbackProgression::Continue
        });
        cut + self.given_up
    }

    /// Repeats a sample until every consumer has it or the limit has passed.
    fn insist(&mut self, message: &Sample, limit: Duration) -> Result<(), BusError> {
        let mut start = Instant::now();
        let mut logged = false;
        loop {
            // Frees the queues of the dead.
            self.bus.clean_up_dead();
            self.serve_late_joiners()?;
            self.wake();
            let sent = self.attempt(message, header_flags::RESENT)?;
            if self.complete(sent) {
                return Ok(());
            }
            let stopping = self.stop.load(Ordering::Relaxed);
            let patience = if stopping { limit.min(STOPPING_LIMIT) } else { limit };
            if start.elapsed() > patience {
                self.give_up(sent, patience);
                start = Instant::now();
            } else if !logged && start.elapsed() > Duration::from_secs(1) {
                logged = true;
                warn!(
                    seq = message.seq,
                    attached = self.attached(),
                    required = self.required,
                    limit_s = limit.as_secs_f64(),
                    "lockstep: waiting for a consumer of the samples that is missing or stuck"
                );
            }
            if sent.is_some() {
                std::thread::sleep(PAUSE);
            }
        }
    }

    /// Continues without the consumers that block the others.
    fn give_up(&mut self, sent: Option<usize>, patience: Duration) {
        let patience_s = patience.as_secs_f64();
        let Some(reached) = sent else {
            let mut pressure = self.pressure.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(id) = pressure.full.take() {
                pressure.cut.push(id);
                drop(pressure);
                self.loss.cut_off += 1;
                warn!(
                    pid = self.pid_of(id),
                    patience_s, "lockstep: a consumer is stuck, it gets no more samples"
                );
            }
            return;
        };
        if reached + self.not_counted() < self.attached() {
            let silent = self.attached() - reached - self.not_counted();
            self.given_up += silent;
            self.loss.cut_off += silent as u64;
            warn!(
                consumers = silent,
                patience_s, "lockstep: consumers attached but never listened, they are not waited for"
            );
        }
        if reached < self.required {
            self.loss.left += (self.required - reached) as u64;
            warn!(
                consumers = self.required - reached,
                patience_s, "lockstep: consumers left, going on without them"
            );
            self.required = reached;
        }
    }

    fn pid_of(&self, port: u128) -> Option<i64> {
        let mut pid = None;
        self.service.dynamic_config().list_subscribers(|details| {
            if details.subscriber_id.value() == port {
                pid = details
                    .node_id
                    .pid::<ipc::Service>()
                    .ok()
                    .map(|pid| i64::from(pid.value()));
                CallbackProgression::Stop
            } else {
                CallbackProgression::Continue
            }
        });
        pid
    }
}

fn transfer(action: &'static str, cause: &dyn std::fmt::Debug) -> BusError {
    BusError::Transfer {
        topic: Topic::Sample,
        action,
        cause: format!("{cause:?}"),
    }
}

// Late joiners must be served within the consumers' own tick.
const _: () = assert!(ATTEMPT.as_millis() <= IDLE_TICK.as_millis());
