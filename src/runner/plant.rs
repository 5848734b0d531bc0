//! The plant's loop.

use super::{Pace, PaceReport, RunError, Shutdown, TICK};
use crate::bus::{Attached, BusError, Loss, SamplePublisher, Subscriber};
use crate::messages::{MachineCommand, Sample, sample_flags};
use crate::node::plant::PlantNode;
use crate::sim::Commanded;
use std::time::{Duration, Instant};

/// At full speed consumers are woken once per this many samples: waking costs more than sending.
const SAMPLES_PER_WAKE: u64 = 64;

/// How a plant's stream ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlantReport {
    /// Samples sent.
    pub sent: u64,
    /// What lockstep could not deliver.
    pub loss: Loss,
    /// How well the pace was kept.
    pub pace: PaceReport,
}

/// A source of a stream of samples.
pub trait SampleSource {
    /// The next sample; `None` after the one flagged `END`.
    fn next_sample(&mut self) -> Option<Sample>;
    /// Makes the next sample the last one.
    fn end_early(&mut self);
    /// Takes a controller's command; ignored by machines without a controller.
    fn command(&mut self, _command: &MachineCommand) {}
    /// Drops a command that is too old.
    fn forget_late_command(&mut self) {}
    /// Due time of the last sample \[ns of stream time\], if that differs from its time stamp.
    fn due_ns(&self) -> Option<u64> {
        None
    }
    /// Number of samples so far.
    fn position(&self) -> u64;
    /// Number of samples of the whole stream, as far as known.
    fn len(&self) -> u64;
    /// True if there is no sample at all.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<S: Commanded> SampleSource for PlantNode<S> {
    fn next_sample(&mut self) -> Option<Sample> {
        Self::next_sample(self)
    }
    fn end_early(&mut self) {
        Self::end_early(self);
    }
    fn command(&mut self, command: &MachineCommand) {
        Self::command(self, command);
    }
    fn forget_late_command(&mut self) {
        Self::forget_late_command(self);
    }
    fn due_ns(&self) -> Option<u64> {
        Some(Self::due_ns(self))
    }
    fn position(&self) -> u64 {
        Self::position(self)
    }
    fn len(&self) -> u64 {
        Self::len(self)
    }
}

/// Port on which a machine receives its controller's commands.
#[derive(Debug)]
pub struct CommandPort {
    commands: Subscriber<MachineCommand>,
    /// How long to wait for the answer to each sample; `None` for a machine that never waits.
    limit: Option<Duration>,
    /// True if the controller did not answer; it is not awaited until it answers again.
    silent: bool,
}

impl CommandPort {
    /// A port; with a `limit` the machine waits up to that long for the answer to each sample, as
    /// in lockstep.
    pub fn new(commands: Subscriber<MachineCommand>, limit: Option<Duration>) -> Self {
        Self {
            commands,
            limit,
            silent: false,
        }
    }

    fn is_awaited(&self) -> bool {
        self.limit.is_some() && !self.silent
    }

    /// Takes the commands that have arrived.
    fn take(&mut self, node: &mut impl SampleSource) -> Result<(), BusError> {
        let taken = self.commands.drain(|command| node.command(command))?;
        self.silent &= taken == 0;
        node.forget_late_command();
        Ok(())
    }

    /// Waits for the answer to a sample, so that a simulation faster than real time is controlled
    /// like a real machine.
    fn await_answer(
        &mut self,
        sample: &Sample,
        node: &mut impl SampleSource,
        shutdown: &Shutdown,
    ) -> Result<(), BusError> {
        let Some(limit) = self.limit else { return Ok(()) };
        let begun = Instant::now();
        loop {
            let mut answered = false;
            self.commands.drain(|command| {
                answered |= command.stream_id == sample.stream_id && command.seq >= sample.seq;
                node.command(command);
            })?;
            if answered || shutdown.requested() {
                return Ok(());
            }
            let left = limit.saturating_sub(begun.elapsed());
            if left.is_zero() {
                self.silent = true;
                tracing::warn!(
                    seq = sample.seq,
                    "the controller does not answer; the machine goes on with its own loop"
                );
                return Ok(());
            }
            self.commands.wait(left.min(TICK))?;
        }
    }
}

/// Publishes the stream of `node`, from its first sample to the one flagged `END`. A stop makes the
/// next sample the last one.
///
/// # Errors
/// If the bus fails, no consumer attaches in lockstep, or the source ends early.
pub fn run_plant(
    node: &mut impl SampleSource,
    publisher: &mut SamplePublisher,
    mut commands: Option<CommandPort>,
    mut pace: Pace,
    shutdown: &Shutdown,
) -> Result<PlantReport, RunError> {
    if publisher.wait_for_consumers()? == Attached::Yes {
        stream(node, publisher, commands.as_mut(), &mut pace, shutdown)?;
    }
    Ok(PlantReport {
        sent: node.position(),
        loss: publisher.loss(),
        pace: pace.report(),
    })
}

fn stream(
    node: &mut impl SampleSource,
    publisher: &mut SamplePublisher,
    mut commands: Option<&mut CommandPort>,
    pace: &mut Pace,
    shutdown: &Shutdown,
) -> Result<(), RunError> {
    loop {
        if shutdown.requested() {
            node.end_early();
        }
        if let Some(commands) = &mut commands {
            commands.take(node)?;
        }
        let Some(mut sample) = node.next_sample() else {
            // The last sample was flagged END unless the source ended early.
            return Err(RunError::SourceEnded {
                seq: node.position(),
                samples: node.len(),
            });
        };
        let due_ns = node.due_ns().unwrap_or(sample.t_ns);
        while let Some(pause) = pace.pause(due_ns, Instant::now()) {
            if shutdown.requested() {
                // It may be due much later, but as the last one it is sent now.
                sample.flags |= sample_flags::END;
                break;
            }
            std::thread::sleep(pause.min(TICK));
            if pause > TICK {
                publisher.serve_late_joiners()?;
            }
        }
        publisher.send(&sample)?;
        let awaited = commands.as_ref().is_some_and(|commands| commands.is_awaited());
        if awaited || !pace.is_max() || sample.seq % SAMPLES_PER_WAKE == 0 || sample.is_end() {
            publisher.wake();
        }
        if let Some(commands) = commands.as_mut().filter(|_| awaited && !sample.is_end()) {
            commands.await_answer(&sample, node, shutdown)?;
        }
        if sample.is_end() {
            break;
        }
    }
    Ok(publisher.linger()?)
}
