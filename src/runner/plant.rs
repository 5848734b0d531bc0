//! The plant's loop.

use super::{Pace, PaceReport, RunError, Shutdown, TICK};
use crate::bus::{Attached, Loss, SamplePublisher};
use crate::messages::{Sample, sample_flags};
use crate::model::JointSample;
use crate::node::plant::PlantNode;
use std::time::Instant;

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

/// Where a stream of samples comes from.
pub trait SampleSource {
    /// The next sample; `None` after the one flagged `END`.
    fn next_sample(&mut self) -> Option<Sample>;
    /// Makes the next sample the last one.
    fn end_early(&mut self);
    /// When the last sample given is due \[ns of stream time\], where that is not its time stamp.
    fn due_ns(&self) -> Option<u64> {
        None
    }
    /// Samples given so far.
    fn position(&self) -> u64;
    /// Samples of the whole stream, as far as it is known.
    fn len(&self) -> u64;
    /// True where there is no sample at all.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<S: Iterator<Item = JointSample>> SampleSource for PlantNode<S> {
    fn next_sample(&mut self) -> Option<Sample> {
        Self::next_sample(self)
    }
    fn end_early(&mut self) {
        Self::end_early(self);
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

/// Publishes the stream of `node`, from its first sample to the one flagged `END`. A stop makes the next sample the last one.
///
/// # Errors
/// The bus fails, no consumer comes in lockstep, or the source ends before its time.
pub fn run_plant(
    node: &mut impl SampleSource,
    publisher: &mut SamplePublisher,
    mut pace: Pace,
    shutdown: &Shutdown,
) -> Result<PlantReport, RunError> {
    if publisher.wait_for_consumers()? == Attached::Yes {
        stream(node, publisher, &mut pace, shutdown)?;
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
    pace: &mut Pace,
    shutdown: &Shutdown,
) -> Result<(), RunError> {
    loop {
        if shutdown.requested() {
            node.end_early();
        }
        let Some(mut sample) = node.next_sample() else {
            // The last sample was flagged END unless the source ran dry.
            return Err(RunError::SourceEnded {
                seq: node.position(),
                samples: node.len(),
            });
        };
        let due_ns = node.due_ns().unwrap_or(sample.t_ns);
        while let Some(pause) = pace.pause(due_ns, Instant::now()) {
            if shutdown.requested() {
                // It may be due much later: it is the last one, and goes out now.
                sample.flags |= sample_flags::END;
                break;
            }
            std::thread::sleep(pause.min(TICK));
            if pause > TICK {
                publisher.serve_late_joiners()?;
            }
        }
        publisher.send(&sample)?;
        if !pace.is_max() || sample.seq % SAMPLES_PER_WAKE == 0 || sample.is_end() {
            publisher.wake();
        }
        if sample.is_end() {
            break;
        }
    }
    // A consumer that has only just attached maps the queue while its publisher still lives.
    let end = Instant::now();
    while end.elapsed() < 2 * TICK {
        publisher.serve_late_joiners()?;
        publisher.wake();
        std::thread::sleep(TICK / 4);
    }
    Ok(())
}
