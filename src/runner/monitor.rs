//! The monitor's loop.

use super::{RunError, Shutdown, Stay, TICK};
use crate::bus::{BusError, SampleSubscriber, Subscriber};
use crate::messages::{Description, Estimate, Journal, Sample, Status};
use crate::node::monitor::MonitorNode;
use std::io;
use std::time::{Duration, Instant};

/// Samples received before the other topics are checked again.
const BATCH: usize = 4096;
/// How long samples may stay in their queue, of 4096 by default: often enough for a million samples
/// a second, and rarely enough to cost almost nothing at a thousand.
const SAMPLE_TICK: Duration = Duration::from_millis(4);

/// Ports of a monitor.
#[derive(Debug)]
pub struct MonitorPorts {
    /// Estimates in.
    pub estimates: Subscriber<Estimate>,
    /// Heartbeat in.
    pub status: Subscriber<Status>,
    /// Description of the model, in.
    pub description: Subscriber<Description>,
    /// Journal of commands, in.
    pub journal: Subscriber<Journal>,
    /// Samples in, if needed.
    pub samples: Option<SampleSubscriber>,
}

/// Receiver of the messages; `sent_ns` is CLOCK_MONOTONIC at sending.
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
    /// A command to the identifier.
    ///
    /// # Errors
    /// Ends the loop.
    fn journal(&mut self, entry: &Journal) -> io::Result<()>;
    /// Called once per round, at least several times a second.
    ///
    /// # Errors
    /// Ends the loop.
    fn round(&mut self) -> io::Result<()>;
}

/// Follows the identifier until asked to stop, or to the end of the first stream.
///
/// # Errors
/// If the bus or the sink fails, or the estimates are of another model than the node's labels.
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
        // A status is read before the estimates and passed on after them, so everything that it
        // counts has arrived.
        let mut failure = None;
        let mut last_status = None;
        let mut described = None;
        ports
            .description
            .drain(|description| described = Some(Box::new(*description)))?;
        // Wrong names are detected before a number is written under them; later the first estimate
        // shows it.
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
        // The identifier reports the end after the journal is complete.
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
        // The identifier reports the end after receiving the last sample, so that one has also
        // arrived here.
        let ending = stopping || (stay == Stay::UntilEnd && node.is_complete());
        if let Some(samples) = &mut ports.samples {
            // This loop does not wait for the event, but empties it so that it does not accumulate.
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

/// Takes a batch of samples, and at the end all of them; true if there may be more.
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
