//! One robot of an identifier: node, ports, and the loop's own figures.

use super::desk::LoopEnd;
use super::log_state::LogState;
use super::stopwatch::Stopwatch;
use super::{HEARTBEAT, Stay, TICK};
use crate::bus::{BusError, Publisher, SampleSubscriber, monotonic_ns};
use crate::messages::{ErrorCode, Estimate, LastError, RealtimeStatus, State, Status, status_flags};
use crate::node::identifier::Identifier;
use std::time::{Duration, Instant};

/// Samples received before the clock, the desk and the signals are checked again: each of them may
/// complete a block and take a millisecond.
const BATCH: usize = 64;
/// How long the publishers stay for subscribers that have not yet read the end.
const LINGER: Duration = Duration::from_secs(5);
/// A stream without samples for this long is silent.
const SILENCE: Duration = Duration::from_secs(1);

/// Ports of an identifier.
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
    /// Real-time settings granted by the system.
    pub realtime: RealtimeStatus,
}

/// Result of a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// There are more samples than one turn takes.
    More,
    /// The queue is empty.
    Empty,
}

/// A robot being identified. A session owns everything it needs, so a process can have any number
/// of sessions.
pub struct Session {
    /// Identifies the robot in log lines.
    span: tracing::Span,
    node: Box<dyn Identifier>,
    ports: IdentifierPorts,
    clock: Clock,
    end_told: bool,
    log: LogState,
    loop_status: LoopStatus,
    is_done: bool,
    /// True if its bus has failed: nothing more is sent.
    has_failed: bool,
    /// Readers of the estimates when it ended.
    readers: usize,
}

impl Session {
    /// A session without data.
    pub fn new(robot: &str, node: Box<dyn Identifier>, ports: IdentifierPorts) -> Self {
        Self {
            span: tracing::error_span!("robot", name = robot),
            clock: Clock::new(),
            end_told: false,
            log: LogState::default(),
            loop_status: LoopStatus::new(ports.started_ns, ports.realtime),
            is_done: false,
            has_failed: false,
            readers: 0,
            node,
            ports,
        }
    }

    /// Returns the node and drops the ports, so that nobody waits for an answer of the loop.
    pub fn into_node(self) -> Box<dyn Identifier> {
        self.node
    }

    pub(super) fn span(&self) -> tracing::Span {
        self.span.clone()
    }

    /// True once it has ended.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Ends a session that has failed; the caller logs why.
    pub(super) fn give_up(&mut self) {
        (self.is_done, self.has_failed) = (true, true);
    }

    /// Checks whether a plant has connected or disconnected; call it with an empty queue.
    pub(super) fn look(&mut self) -> Result<(), BusError> {
        self.ports.samples.refresh()?;
        self.log.plant(self.ports.samples.is_connected());
        Ok(())
    }

    /// Waits for samples, at most `limit`.
    pub(super) fn wait(&self, limit: Duration) -> Result<(), BusError> {
        self.ports.samples.wait(limit)
    }

    /// Processes at most one batch of samples, passes on commands and sends what is due.
    pub(super) fn turn(&mut self) -> Result<Turn, BusError> {
        let Self {
            node,
            ports,
            loop_status,
            ..
        } = self;
        let node = &mut **node;
        let taken = take_in(node, &mut ports.samples, &mut ports.estimates, loop_status)?;
        ports.desk.exchange(node);
        let ended = node.status().state == State::Ended as u32;
        if ended != self.end_told {
            self.end_told = ended;
            if ended {
                ports.desk.settle(node);
                loop_status.send(node, ports)?;
            }
        }
        if self.clock.heartbeat_due() {
            loop_status.send(node, ports)?;
            self.log.losses(&node.status());
            self.log.no_estimate(&node.status());
            self.log.window(node);
            self.log.replay(&node.status());
        }
        if self.clock.tick_due() {
            ports.estimates.serve_late_joiners()?;
            ports.status.serve_late_joiners()?;
        }
        Ok(if taken < BATCH { Turn::Empty } else { Turn::More })
    }

    /// True if the loop is over for this session, whether asked to stop or not.
    pub(super) fn is_over(&self, stopping: bool, stay: Stay) -> bool {
        stopping || (self.end_told && stay == Stay::UntilEnd)
    }

    /// Sends a last status, after everything that was received has been processed.
    pub(super) fn finish(&mut self) -> Result<(), BusError> {
        self.is_done = true;
        let Self { node, ports, .. } = self;
        ports.desk.settle(&mut **node);
        self.loop_status.send(&**node, ports)?;
        self.log.losses(&node.status());
        self.log.no_estimate(&node.status());
        self.log.left_out(ports.samples.left_out());
        self.readers = ports.estimates.subscribers();
        Ok(())
    }

    /// Sends the last messages to late joiners. True once it need not stay: after a failure, after
    /// `LINGER`, or after two ticks if there was no reader, a reader has left, or the process is
    /// asked to stop.
    pub(super) fn linger(&mut self, waited: Duration, stopping: bool) -> Result<bool, BusError> {
        if self.has_failed {
            return Ok(true);
        }
        self.ports.estimates.serve_late_joiners()?;
        self.ports.status.serve_late_joiners()?;
        let all_connected = waited >= 2 * TICK;
        let one_left = self.ports.estimates.subscribers() < self.readers;
        Ok((all_connected && (self.readers == 0 || one_left || stopping)) || waited >= LINGER)
    }
}

/// The step sample → estimate.
fn take_in(
    node: &mut dyn Identifier,
    samples: &mut SampleSubscriber,
    estimates: &mut Publisher<Estimate>,
    loop_status: &mut LoopStatus,
) -> Result<usize, BusError> {
    let mut failure = None;
    let mut begun = Instant::now();
    let taken = samples.drain(BATCH, |sample| {
        // Publishing, and waiting for readers in lockstep, are not included.
        let mut computed = None;
        node.on_sample(sample, &mut |estimate| {
            computed = Some(begun.elapsed());
            if let Err(e) = estimates.send(estimate) {
                failure = Some(e);
            }
        });
        let now = Instant::now();
        match computed {
            Some(duration) => loop_status.block.add(duration),
            None => loop_status.step.add(now - begun),
        }
        begun = now;
    })?;
    if taken > 0 {
        loop_status.heard(begun);
    }
    failure.map_or(Ok(taken), Err)
}

/// The loop's own figures.
#[derive(Debug)]
struct LoopStatus {
    step: Stopwatch,
    block: Stopwatch,
    started_ns: u64,
    first_sample_ns: u64,
    realtime: RealtimeStatus,
    heard: Option<Instant>,
    silent: bool,
    pauses: u64,
}

impl LoopStatus {
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

    /// Records that samples have arrived.
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
