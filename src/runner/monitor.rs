//! The monitor's loop.

use super::{RunError, Shutdown, Stay, TICK};
use crate::bus::{BusError, SampleSubscriber, Subscriber};
use crate::messages::{Description, Estimate, Journal, Sample, Status};
use crate::node::monitor::MonitorNode;
use std::io;
use std::time::{Duration, Instant};

/// Samples taken in before the other topics are looked at again.
const BATCH: usize = 4096;
/// How long samples may lie in their queue, of 4096 by default: a recorder is awake often enough
/// for a million samples a second, and seldom enough to cost nothing at a thousand.
const SAMPLE_TICK: Duration = Duration::from_millis(4);

/// What a monitor is connected to.
#[derive(Debug)]
pub struct MonitorPorts {
    /// Estimates in.
    pub estimates: Subscriber<Estimate>,
    /// Heartbeat in.
    pub status: Subscriber<Status>,
    /// What the identifier says of its model, in.
    pub description: Subscriber<Description>,
    /// What the identifier was told, in.
    pub journal: Subscriber<Journal>,
    /// Samples in, if they are wanted.
    pub samples: Option<SampleSubscriber>,
}

/// Where the messages go; `sent_ns` is CLOCK_MONOTONIC at sending.
pub trait MonitorSink {
    /// A sample.
    ///
    /// # Errors
    /// Ends the loop.
    fn sample(&mut self, sample: &Sample, sent_ns: u64) -> io::Result<()>;
    /// An estimate that the node had not seen before.
    ///
    /// # Errors
    /// Ends the loop.
    fn estimate(&mut self, node: &MonitorNode, estimate: &Estimate, sent_ns: u64) -> io::Result<()>;
    /// A status.
    ///
    /// # Errors
    /// Ends the loop.
    fn status(&mut self, status: &Status, sent_ns: u64) -> io::Result<()>;
    /// Something that the identifier was told.
    ///
    /// # Errors
    /// Ends the loop.
    fn journal(&mut self, entry: &Journal) -> io::Result<()>;
    /// Called once per round, some times a second at least.
    ///
    /// # Errors
    /// Ends the loop.
    fn round(&mut self) -> io::Result<()>;
}

/// Follows the identifier until asked to stop, or to the end of the first stream.
///
/// # Errors
/// The bus or the sink fails, or the estimates are of another model than the node's labels.
pub fn run_monitor(
    node: &mut MonitorNode,
    ports: &mut MonitorPorts,
    stay: Stay,
    shutdown: &Shutdown,
    sink: &mut impl MonitorSink,
) -> Result<(), RunError> {
    let mut busy = false;
    let mut refreshed = Instant::now();
    loop {
        let pause = match (&ports.samples, busy) {
            (None, _) => TICK,
            (Some(_), false) => SAMPLE_TICK,
            (Some(_), true) => Duration::ZERO,
        };
        ports.estimates.wait(pause)?;
        let stopping = shutdown.requested();
        // A status is read before the estimates and told after them: what it speaks of has arrived
        // then.
        let mut failure = None;
        let mut last_status = None;
        let mut described = None;
        ports
            .description
            .drain(|description| described = Some(Box::new(*description)))?;
        // Names that do not fit are found before a number stands under them; later the first
        // estimate tells.
        if let Some(description) = described
            && node.blocks() == 0
            && !node.is_described_by(&description)
        {
            return Err(RunError::ForeignModel(Some(description)));
        }
        ports.status.drain_timed(|status, sent_ns| {
            keep_first(&mut failure, || sink.status(status, sent_ns));
            last_status = Some(*status);
        })?;
        // The identifier tells the end after the journal has what took effect.
        ports
            .journal
            .drain(|entry| keep_first(&mut failure, || sink.journal(entry)))?;
        ports.estimates.drain_timed(|estimate, sent_ns| {
            if node.on_estimate(estimate) {
                keep_first(&mut failure, || sink.estimate(node, estimate, sent_ns));
            }
        })?;
        if let Some(status) = last_status {
            node.on_status(&status);
        }
        // The identifier tells the end after it has taken in the last sample, so that one has
        // arrived here, too.
        let ending = stopping || (stay == Stay::UntilEnd && node.is_complete());
        if let Some(samples) = &mut ports.samples {
            // The event is not what this waits for; it is emptied, so that it does not pile up.
            samples.wait(Duration::ZERO)?;
            if refreshed.elapsed() >= TICK {
                refreshed = Instant::now();
                samples.refresh()?;
            }
            busy = drain(samples, ending, |sample, sent_ns| {
                keep_first(&mut failure, || sink.sample(sample, sent_ns));
            })?;
        }
        keep_first(&mut failure, || sink.round());
        if let Some(e) = failure {
            return Err(e.into());
        }
        if node.foreign_model().is_some() {
            return Err(RunError::ForeignModel(None));
        }
        if ending {
            return Ok(());
        }
    }
}

/// Takes a batch of samples, and all that are there at the end; true if more may be there.
fn drain(samples: &mut SampleSubscriber, ending: bool, mut take: impl FnMut(&Sample, u64)) -> Result<bool, BusError> {
    loop {
        let busy = samples.drain_timed(BATCH, &mut take)? == BATCH;
        if !(ending && busy) {
            return Ok(busy);
        }
    }
}

fn keep_first(failure: &mut Option<io::Error>, act: impl FnOnce() -> io::Result<()>) {
    if failure.is_none() {
        *failure = act().err();
    }
}
