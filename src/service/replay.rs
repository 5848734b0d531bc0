//! `thetabus replay`: publishes a recording's samples on the bus again, in the role of the plant.

use super::args::domain;
use super::plant::{delivery, limit, stream_id};
use super::record::recording_at;
use super::script::recorded_commands;
use super::ticker::Ticker;
use super::{CommonArgs, Exit, Failure, ReplayArgs, foreign, logging, report};
use crate::bus::{Bus, BusError, ControlClient, Delivery, Role, RoleLock, SamplePublisher};
use crate::config::{Source, Speed};
use crate::messages::{Request, Sample, response_code, sample_flags, stream_tag};
use crate::recording::{Entry, ReadError, RecordingReader};
use crate::runner::{Pace, SampleSource, Shutdown, TICK, run_plant};
use std::path::Path;
use std::time::{Duration, Instant};

/// Default settings of a replay: nothing is lost, and it waits only for the identifier, because the
/// recorder of the original run need not be started again.
const REPLAY_SETTINGS: &str = "[bus]\ndelivery = \"lockstep\"\nlockstep_consumers = 1\n";

/// Publishes the samples of a recording, from the first to one flagged END.
///
/// # Errors
/// If the recording cannot be read, a plant is already running, no consumer attaches in lockstep,
/// or the bus fails.
pub fn run(args: &ReplayArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let recording = recording_at(&args.input);
    let reader = report::open(&recording, args.span.span()?)?;
    let settings = Source::Embedded {
        name: "a replay's own settings".to_owned(),
        text: REPLAY_SETTINGS.to_owned(),
    };
    let sources = vec![report::source_of(reader.info()), settings];
    let common = CommonArgs {
        catalog: super::robot::beside(&args.input, &args.common.catalog)?,
        ..args.common.clone()
    };
    let config = common.load(sources, &[("plant.speed", Some(args.speed.clone()))])?;
    let domain = domain(&config)?;
    let robot = &config.bus.robot;
    let _only_one = RoleLock::acquire(&domain, robot, Role::Plant)?;
    let mut source = Replay::new(reader, stream_id(), args.teach).map_err(report::unreadable)?;
    if source.next.is_none() {
        // Of a damaged recording, the damage is the reason.
        return match report::tell_loss(&source.reader.loss()) {
            Exit::DataLoss => logging::result("0 samples replayed").map(|()| Exit::DataLoss),
            _ => Err(args.span.nothing(&args.input)),
        };
    }

    let bus = Bus::join(&domain, robot, "replay")?;
    let delivery = delivery(&config);
    let mut publisher = SamplePublisher::new(&bus, delivery, shutdown.flag())?;
    tracing::info!(robot, domain = domain.name(), delivery = delivery.name(), "replay");
    if delivery == Delivery::Realtime {
        publisher.hold_for(args.common.launched.await_consumers, limit(&config));
    }
    repeat_commands(&recording, &bus, &source, limit(&config), shutdown)?;
    foreign::warn_of_replay(source.reader.info(), &bus);
    let pace = Pace::new(match config.plant.speed {
        Speed::Max => None,
        Speed::Factor(factor) => Some(factor),
    });
    source.ticker = Some(Ticker::start(&format!("replaying {}", args.input.display())));
    let sent = run_plant(&mut source, &mut publisher, None, pace, shutdown)?;
    drop(source.ticker);
    if let Some(error) = source.failure {
        return Err(report::unreadable(error));
    }
    let told = logging::result(&format!("{} samples replayed", sent.sent));
    let exit = report::tell_loss(&source.reader.loss());
    told?;
    Ok(if sent.loss.is_none() { exit } else { Exit::DataLoss })
}

/// Sends the identifier the recorded commands in advance, with the samples from which they apply,
/// for this stream only: nothing of them remains for the next stream, however this one ends.
fn repeat_commands(
    recording: &Path,
    bus: &Bus,
    source: &Replay,
    limit: Duration,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let stream = source.stream_id_recorded();
    let journal = recorded_commands(recording)?;
    // A replay ends with the first stream.
    let requests: Vec<_> = journal
        .iter()
        .filter(|entry| entry.stream_id == 0 || Some(entry.stream_id) == stream)
        .map(|entry| Request {
            stream: stream_tag(source.stream_id),
            ..entry.request
        })
        .collect();
    if requests.is_empty() {
        return Ok(());
    }
    let start = Instant::now();
    let client = loop {
        match ControlClient::new(bus) {
            Err(BusError::NoIdentifier { .. }) if start.elapsed() < limit && !shutdown.requested() => {
                std::thread::sleep(TICK);
            }
            Err(BusError::NoIdentifier { .. }) => {
                tracing::warn!("no identifier to repeat the recording's commands to; its estimates would differ");
                return Ok(());
            }
            client => break client?,
        }
    };
    for request in &requests {
        let response = client.ask(request, limit)?;
        if response.code != response_code::DONE {
            return Err(Failure::Failed(format!(
                "the identifier does not repeat a recorded command: {}; start it with the recording's configuration",
                response.text()
            )));
        }
    }
    tracing::info!(commands = requests.len(), "the recording's commands are repeated");
    Ok(())
}

/// The samples of a recording as a new stream: with the recorded seq, times and gaps, all flagged
/// as a replay, the last one flagged END.
struct Replay {
    reader: RecordingReader,
    stream_id: u64,
    /// Flag of its samples: what is learnt from them is dropped at the end of the stream, unless it
    /// should be kept.
    flag: u32,
    /// Id of the recorded stream.
    recorded: Option<u64>,
    /// Read ahead, because the last sample must be flagged.
    next: Option<Sample>,
    given: u64,
    failure: Option<ReadError>,
    ticker: Option<Ticker>,
}

impl Replay {
    fn new(reader: RecordingReader, stream_id: u64, teaches: bool) -> Result<Self, ReadError> {
        let mut replay = Self {
            reader,
            stream_id,
            flag: if teaches { 0 } else { sample_flags::REPLAY },
            recorded: None,
            next: None,
            given: 0,
            failure: None,
            ticker: None,
        };
        replay.next = replay.read()?;
        Ok(replay)
    }

    fn stream_id_recorded(&self) -> Option<u64> {
        self.recorded
    }

    fn read(&mut self) -> Result<Option<Sample>, ReadError> {
        while let Some(entry) = self.reader.next_entry()? {
            if let Entry::Sample { sample, .. } = entry {
                let mut sample = *sample;
                self.recorded.get_or_insert(sample.stream_id);
                sample.stream_id = self.stream_id;
                sample.flags = sample.flags & !sample_flags::REPLAY | self.flag;
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
        if let Some(ticker) = &self.ticker {
            ticker.at(self.reader.share_read());
        }
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
