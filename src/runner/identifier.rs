//! The identifier's loop.

use super::desk::LoopEnd;
use super::stopwatch::Stopwatch;
use super::{HEARTBEAT, RunError, Shutdown, Stay, TICK};
use crate::bus::{BusError, Publisher, SampleSubscriber, monotonic_ns};
use crate::messages::{ErrorCode, Estimate, LastError, RealtimeStatus, State, Status, status_flags};
use crate::node::identifier::Identifier;
use std::time::{Duration, Instant};

/// Samples taken in before the clock, the desk and the signals are looked at again: each of them may be a block, and take a millisecond.
const BATCH: usize = 64;
/// How long the samples that came before the request to stop may take: beside a plant that is faster than this process they never end.
const LAST_LOOK: Duration = Duration::from_millis(200);
/// A stream without samples for this long is silent.
const SILENCE: Duration = Duration::from_secs(1);
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
    /// Commands in, figures of the process.
    pub desk: LoopEnd,
    /// When the program began, by CLOCK_MONOTONIC \[ns\].
    pub started_ns: u64,
    /// What the system granted.
    pub realtime: RealtimeStatus,
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
    let mut clock = Clock::new();
    let mut end_told = false;
    let mut news = News::default();
    let mut vitals = Vitals::new(ports.started_ns, ports.realtime);
    let mut asked: Option<Instant> = None;
    loop {
        ports.samples.refresh()?;
        news.plant(ports.samples.is_connected());
        ports.samples.wait(TICK)?;
        let stopping = loop {
            // Asked before the last look into the queue: what came before the request is processed, as far as time allows.
            let stopping = shutdown.requested();
            let taken = take_in(node, &mut ports.samples, &mut ports.estimates, &mut vitals)?;
            ports.desk.exchange(node);
            let ended = node.status().state == State::Ended as u32;
            if ended != end_told {
                end_told = ended;
                if ended {
                    ports.desk.settle(node);
                    vitals.send(node, ports)?;
                }
            }
            if clock.heartbeat_due() {
                vitals.send(node, ports)?;
                news.losses(&node.status());
                news.window(node);
                news.replay(&node.status());
            }
            if clock.tick_due() {
                ports.estimates.serve_late_joiners()?;
                ports.status.serve_late_joiners()?;
            }
            let late = stopping && asked.get_or_insert_with(Instant::now).elapsed() >= LAST_LOOK;
            if taken < BATCH || late {
                break stopping;
            }
        };
        if stopping || (end_told && stay == Stay::UntilEnd) {
            break;
        }
    }
    ports.desk.settle(node);
    vitals.send(node, ports)?;
    news.losses(&node.status());
    news.left_out(ports.samples.left_out());
    let IdentifierPorts { estimates, status, .. } = ports;
    linger(estimates, status, shutdown)
}

/// The step sample → estimate.
fn take_in(
    node: &mut dyn Identifier,
    samples: &mut SampleSubscriber,
    estimates: &mut Publisher<Estimate>,
    vitals: &mut Vitals,
) -> Result<usize, BusError> {
    let mut failure = None;
    let mut begun = Instant::now();
    let taken = samples.drain(BATCH, |sample| {
        // Publishing, and in lockstep waiting for who reads, are no part of it.
        let mut computed = None;
        node.on_sample(sample, &mut |estimate| {
            computed = Some(begun.elapsed());
            if let Err(e) = estimates.send(estimate) {
                failure = Some(e);
            }
        });
        let now = Instant::now();
        match computed {
            Some(duration) => vitals.block.add(duration),
            None => vitals.step.add(now - begun),
        }
        begun = now;
    })?;
    if taken > 0 {
        vitals.heard(begun);
    }
    failure.map_or(Ok(taken), Err)
}

/// What the loop knows of itself.
#[derive(Debug)]
struct Vitals {
    step: Stopwatch,
    block: Stopwatch,
    started_ns: u64,
    first_sample_ns: u64,
    realtime: RealtimeStatus,
    heard: Option<Instant>,
    silent: bool,
    pauses: u64,
}

impl Vitals {
    fn new(started_ns: u64, realtime: RealtimeStatus) -> Self {
        Self {
            step: Stopwatch::new(),
            block: Stopwatch::new(),
            started_ns,
            first_sample_ns: 0,
            realtime,
            heard: None,
            silent: false,
            pauses: 0,
        }
    }

    /// Samples have come.
    fn heard(&mut self, at: Instant) {
        if self.first_sample_ns == 0 {
            self.first_sample_ns = monotonic_ns();
        }
        (self.heard, self.silent) = (Some(at), false);
    }

    /// Completes the node's status and sends it.
    fn send(&mut self, node: &dyn Identifier, ports: &mut IdentifierPorts) -> Result<(), BusError> {
        let mut status = node.status();
        (status.step, status.block) = (self.step.timing(), self.block.timing());
        status.realtime = self.realtime;
        status.process.started_ns = self.started_ns;
        status.process.first_sample_ns = self.first_sample_ns;
        ports.desk.complete(&mut status);
        let open = status.stream_id != 0 && status.state != State::Ended as u32;
        let silence = self
            .heard
            .filter(|_| open)
            .map_or(Duration::ZERO, |heard| heard.elapsed());
        status.process.silent_ns = silence.as_nanos() as u64;
        if silence >= SILENCE {
            if !self.silent {
                self.silent = true;
                self.pauses += 1;
                tracing::warn!(last_seq = status.last_seq, "no sample has come for a second or more");
            }
            status.flags |= status_flags::SILENT;
            status.error = LastError::new(ErrorCode::Silent, status.last_seq);
        }
        status.process.pauses = self.pauses;
        ports.status.send(&status)
    }
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
    window_s: Option<f64>,
    is_replay: bool,
}

impl News {
    /// Windows that are chosen from the signals are told whenever their length changes, once samples have come.
    fn window(&mut self, node: &dyn Identifier) {
        let window_s = node.window_s().filter(|_| node.status().estimates > 0);
        if window_s.is_some() && window_s != self.window_s {
            tracing::info!("rows of windows of {:.0} ms", 1e3 * window_s.unwrap_or(0.0));
            self.window_s = window_s;
        }
    }

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

    /// The first one was told when it came; this is how many there were.
    fn left_out(&self, samples: u64) {
        if samples > 0 {
            tracing::warn!(samples, "messages of another schema were left out");
        }
    }

    fn replay(&mut self, status: &Status) {
        let is_replay = status.flags & status_flags::REPLAY != 0;
        if is_replay != self.is_replay {
            self.is_replay = is_replay;
            tracing::info!(
                "{}",
                if is_replay {
                    "a replay: what it teaches is dropped when another stream begins"
                } else {
                    "the replay is over: the estimates go on from what was known before it"
                }
            );
        }
    }

    fn losses(&mut self, status: &Status) {
        if status.stream_id != self.stream {
            (self.stream, self.missing, self.rejected) = (status.stream_id, 0, 0);
        }
        if (status.missing, status.rejected) != (self.missing, self.rejected) {
            let missing = status.missing.saturating_sub(self.missing);
            let rejected = status.rejected.saturating_sub(self.rejected);
            tracing::warn!(
                missing,
                rejected,
                last_seq = status.last_seq,
                so_far = %status.faults,
                last = status.error.words(),
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
