//! Where messages of a remote robot go: its topics on the bus.

use crate::error::GatewayError;
use crate::incoming::Incoming;
use crate::out::Counted;
use crate::remote_robot::RETRY_AFTER;
use crate::silence::Silence;
use crate::tally::{Numbers, Tally};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, BusError, Delivery, Latched, Publisher, Role, RoleLock, SamplePublisher};
use thetabus::messages::Sample;

/// A topic of which the bus keeps the last message.
pub struct TopicPort<T: Latched> {
    port: Publisher<T>,
    /// What this port has passed on; the tally also knows what an earlier one has.
    numbers: Numbers,
}

impl<T: Latched + Counted> TopicPort<T> {
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        Ok(Self {
            port: Publisher::new(bus)?,
            numbers: Numbers::default(),
        })
    }

    pub fn take(&mut self, tally: &mut Tally, message: &Incoming, body: &T) -> Result<(), BusError> {
        tally.count(message, body.counted());
        match self.numbers.admit(&message.envelope) {
            Some(_) => self.port.send(body),
            None => Ok(()),
        }
    }

    pub fn serve_late_joiners(&mut self) -> Result<(), BusError> {
        self.port.serve_late_joiners()
    }
}

/// The samples of a robot: its topic is made when the first one comes, and given back with the
/// plant's role when none have come for long.
pub enum Samples {
    /// None have come, or they were given back.
    None,
    /// Another program is the plant; tried again later.
    Refused { since: Instant },
    /// They are passed on.
    Port(Box<SamplePort>),
}

/// The topic of samples, and the role of who may publish there.
pub struct SamplePort {
    port: SamplePublisher,
    heard: Instant,
    _role: RoleLock,
}

impl Samples {
    /// Passes a sample on and counts it; one for which there is no topic is not carried.
    pub fn take(&mut self, tally: &mut Tally, message: &Incoming, sample: &Sample, bus: &Bus) -> Result<(), BusError> {
        let now = Instant::now();
        let is_due = match self {
            Self::None => true,
            Self::Refused { since } => now.duration_since(*since) >= RETRY_AFTER,
            Self::Port(_) => false,
        };
        if is_due {
            match SamplePort::new(bus, now) {
                Ok(port) => *self = Self::Port(Box::new(port)),
                Err(e) => {
                    if matches!(self, Self::None) {
                        tracing::error!(robot = bus.robot(), "samples cannot come in: {e}");
                    }
                    *self = Self::Refused { since: now };
                }
            }
        }
        let Self::Port(samples) = self else { return Ok(()) };
        samples.heard = now;
        if tally.count(message, sample.counted()) {
            samples.port.send(sample)?;
            samples.port.wake();
        }
        Ok(())
    }

    /// Gives the topic and the role back if none have come for long; true if it did.
    pub fn give_back_if_silent(&mut self, silence: Silence, now: Instant) -> bool {
        let is_silent = matches!(self, Self::Port(samples) if silence.has_lasted(samples.heard, now));
        if is_silent {
            *self = Self::None;
        }
        is_silent
    }

    /// Does not count a time in which this process could not hear them.
    pub fn forgive(&mut self, stood: Duration) {
        if let Self::Port(samples) = self {
            samples.heard += stood;
        }
    }

    pub fn serve_late_joiners(&mut self) -> Result<(), GatewayError> {
        match self {
            Self::Port(samples) => Ok(samples.port.serve_late_joiners()?),
            Self::None | Self::Refused { .. } => Ok(()),
        }
    }
}

impl SamplePort {
    fn new(bus: &Bus, now: Instant) -> Result<Self, BusError> {
        let role = RoleLock::acquire(bus.domain(), bus.robot(), Role::Plant)?;
        let port = SamplePublisher::new(bus, Delivery::Realtime, Arc::new(AtomicBool::new(false)))?;
        Ok(Self {
            port,
            heard: now,
            _role: role,
        })
    }
}
