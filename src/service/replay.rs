//! `thetabus replay`: a recording's samples on the bus again, as a plant that has done all this before.

use super::args::domain;
use super::plant::{boot_id, delivery, limit};
use super::{Exit, Failure, ReplayArgs, logging, report};
use crate::bus::{Bus, Delivery, Role, RoleLock, SamplePublisher};
use crate::config::{Source, Speed};
use crate::messages::{Sample, sample_flags};
use crate::recording::{Entry, ReadError, RecordingReader};
use crate::runner::{Pace, SampleSource, Shutdown, run_plant};

/// Publishes the samples of a recording, from the first to one flagged END.
///
/// # Errors
/// A recording that cannot be read, a plant that runs already, no consumer in lockstep, a bus that fails.
pub fn run(args: &ReplayArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let reader = report::open(&args.input, args.span.span()?)?;
    let recorded = Source::Embedded {
        name: "the recording's configuration".to_owned(),
        text: reader.info().config_toml.clone(),
    };
    // A replay loses nothing unless somebody asks for a live machine's manners.
    let mut own = vec![("plant.speed", Some(args.speed.clone()))];
    if !args.common.set.iter().any(|set| set.starts_with("bus.delivery=")) {
        own.push(("bus.delivery", Some("lockstep".to_owned())));
    }
    let config = args.common.load(vec![recorded], &own)?;
    let domain = domain(&config)?;
    let robot = &config.bus.robot;
    let _only_one = RoleLock::acquire(&domain, robot, Role::Plant)?;
    let mut source = Replay::new(reader, boot_id()).map_err(report::unreadable)?;

    let bus = Bus::join(&domain, robot, "replay")?;
    let delivery = delivery(&config);
    let mut publisher = SamplePublisher::new(&bus, delivery, shutdown.flag())?;
    tracing::info!(robot, domain = domain.name(), delivery = delivery.name(), "replay");
    if delivery == Delivery::Realtime {
        publisher.hold_for(args.common.launched.await_consumers, limit(&config));
    }
    let pace = Pace::new(match config.plant.speed {
        Speed::Max => None,
        Speed::Factor(factor) => Some(factor),
    });
    let sent = run_plant(&mut source, &mut publisher, pace, shutdown)?;
    if let Some(error) = source.failure {
        return Err(report::unreadable(error));
    }
    logging::result(&format!("{} samples replayed", sent.sent));
    let exit = report::tell_loss(&source.reader.loss());
    Ok(if sent.loss.is_none() { exit } else { Exit::DataLoss })
}

/// The samples of a recording as a new stream: seq, times and gaps as they were, the last one flagged END.
struct Replay {
    reader: RecordingReader,
    boot_id: u64,
    /// Read ahead, for the last one must be known as such.
    next: Option<Sample>,
    given: u64,
    failure: Option<ReadError>,
}

impl Replay {
    fn new(reader: RecordingReader, boot_id: u64) -> Result<Self, ReadError> {
        let mut replay = Self {
            reader,
            boot_id,
            next: None,
            given: 0,
            failure: None,
        };
        replay.next = replay.read()?;
        Ok(replay)
    }

    fn read(&mut self) -> Result<Option<Sample>, ReadError> {
        while let Some(entry) = self.reader.next_entry()? {
            if let Entry::Sample { sample, .. } = entry {
                let mut sample = *sample;
                sample.boot_id = self.boot_id;
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }
}

impl SampleSource for Replay {
    fn next_sample(&mut self) -> Option<Sample> {
        let mut sample = self.next.take()?;
        if sample.flags & sample_flags::END == 0 {
            self.next = match self.read() {
                Ok(next) => next,
                Err(error) => {
                    self.failure = Some(error);
                    None
                }
            };
        }
        if self.next.is_none() {
            sample.flags |= sample_flags::END;
        }
        self.given += 1;
        Some(sample)
    }

    fn end_early(&mut self) {
        if let Some(next) = &mut self.next {
            next.flags |= sample_flags::END;
        }
    }

    fn position(&self) -> u64 {
        self.given
    }

    fn len(&self) -> u64 {
        self.given + u64::from(self.next.is_some())
    }
}
