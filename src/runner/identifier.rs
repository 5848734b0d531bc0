//! The identifier's loop.

use super::{HEARTBEAT, RunError, Shutdown, Stay, TICK};
use crate::bus::{BusError, Publisher, SampleSubscriber};
use crate::messages::{Estimate, State, Status};
use crate::node::identifier::Identifier;
use std::time::{Duration, Instant};

/// Samples taken in before the clock is looked at again.
const BATCH: usize = 1024;
/// How long the publishers stay for subscribers that have not read the end yet.
const LINGER: Duration = Duration::from_secs(5);

/// What an identifier is connected to.
#[derive(Debug)]
pub struct IdentifierPorts {
    /// Samples in.
    pub samples: SampleSubscriber,
    /// Estimates out.
    pub estimates: Publisher<Estimate>,
    /// Heartbeat out.
    pub status: Publisher<Status>,
}

/// Turns samples into estimates until asked to stop, or to the end of the first stream. A last status follows the last estimate,
/// after everything that was received has been processed.
///
/// # Errors
/// The bus fails.
pub fn run_identifier(
    node: &mut dyn Identifier,
    ports: &mut IdentifierPorts,
    stay: Stay,
    shutdown: &Shutdown,
) -> Result<(), RunError> {
    let IdentifierPorts {
        samples,
        estimates,
        status,
    } = ports;
    let mut clock = Clock::new();
    let mut end_told = false;
    let mut news = News::default();
    loop {
        samples.refresh()?;
        news.plant(samples.is_connected());
        samples.wait(TICK)?;
        // Asked before the last look into the queue: what came before the request is processed.
        let stopping = shutdown.requested();
        loop {
            let taken = take_in(node, samples, estimates)?;
            let ended = node.status().state == State::Ended as u32;
            if ended != end_told {
                end_told = ended;
                if ended {
                    status.send(&node.status())?;
                }
            }
            if clock.heartbeat_due() {
                status.send(&node.status())?;
                news.losses(&node.status());
            }
            if clock.tick_due() {
                estimates.serve_late_joiners()?;
                status.serve_late_joiners()?;
            }
            if taken < BATCH || stopping {
                break;
            }
        }
        if stopping || (end_told && stay == Stay::UntilEnd) {
            break;
        }
    }
    status.send(&node.status())?;
    news.losses(&node.status());
    linger(estimates, status, shutdown)
}

/// The step sample → estimate.
fn take_in(
    node: &mut dyn Identifier,
    samples: &mut SampleSubscriber,
    estimates: &mut Publisher<Estimate>,
) -> Result<usize, BusError> {
    let mut failure = None;
    let taken = samples.drain(BATCH, |sample| {
        node.on_sample(sample, &mut |estimate| {
            if let Err(e) = estimates.send(estimate) {
                failure = Some(e);
            }
        });
    })?;
    failure.map_or(Ok(taken), Err)
}

/// Keeps the last messages readable until a reader has had them: two ticks for anybody to connect, then until one leaves.
fn linger(
    estimates: &mut Publisher<Estimate>,
    status: &mut Publisher<Status>,
    shutdown: &Shutdown,
) -> Result<(), RunError> {
    let start = Instant::now();
    let readers = estimates.subscribers();
    loop {
        estimates.serve_late_joiners()?;
        status.serve_late_joiners()?;
        let waited = start.elapsed();
        let all_connected = waited >= 2 * TICK;
        let one_left = estimates.subscribers() < readers;
        if (all_connected && (readers == 0 || one_left || shutdown.requested())) || waited >= LINGER {
            return Ok(());
        }
        std::thread::sleep(TICK / 10);
    }
}

/// What the log tells, once per heartbeat at most and never from within the step.
#[derive(Debug, Default)]
struct News {
    connected: bool,
    stream: u64,
    missing: u64,
    rejected: u64,
}

impl News {
    fn plant(&mut self, connected: bool) {
        if connected != self.connected {
            self.connected = connected;
            tracing::info!(
                "{}",
                if connected {
                    "a plant is there"
                } else {
                    "the plant has gone"
                }
            );
        }
    }

    fn losses(&mut self, status: &Status) {
        if status.boot_id != self.stream {
            (self.stream, self.missing, self.rejected) = (status.boot_id, 0, 0);
        }
        if (status.missing, status.rejected) != (self.missing, self.rejected) {
            let missing = status.missing.saturating_sub(self.missing);
            let rejected = status.rejected.saturating_sub(self.rejected);
            tracing::warn!(
                missing,
                rejected,
                last_seq = status.last_seq,
                "samples were lost or refused"
            );
            (self.missing, self.rejected) = (status.missing, status.rejected);
        }
    }
}

/// When heartbeat and tick are due.
#[derive(Debug)]
struct Clock {
    heartbeat: Instant,
    tick: Instant,
}

impl Clock {
    /// The first heartbeat is due at once.
    fn new() -> Self {
        let now = Instant::now();
        Self {
            heartbeat: now,
            tick: now,
        }
    }

    fn heartbeat_due(&mut self) -> bool {
        due(&mut self.heartbeat, HEARTBEAT)
    }

    fn tick_due(&mut self) -> bool {
        due(&mut self.tick, TICK)
    }
}

fn due(next: &mut Instant, period: Duration) -> bool {
    let now = Instant::now();
    let is_due = now >= *next;
    if is_due {
        *next = now + period;
    }
    is_due
}
