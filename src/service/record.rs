//! The monitor's sink: a line in the log and in estimates.csv per estimate, everything in the
//! recording.

use super::Failure;
use super::live::Live;
use super::run_info::run_info;
use crate::bus::{Bus, ControlClient};
use crate::config::Config;
use crate::messages::{Command, Description, ErrorCode, Estimate, Journal, LastError, Request, Sample, Status};
use crate::node::monitor::MonitorNode;
use crate::node::simulated_plant::SimulatedLosses;
use crate::recording::{
    EstimatesCsv, RecordError, Recorder, RecorderStatus, RecordingLimits, RecordingReader, Span, oldest_file,
};
use crate::runner::MonitorSink;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Name of the recording in a directory of results.
pub(super) const RECORDING: &str = "recording.mcap";

/// The recording at a path, or in a directory of results: its oldest existing file.
pub(super) fn recording_at(path: &Path) -> PathBuf {
    let first = match path.is_dir() {
        true => path.join(RECORDING),
        false => path.to_owned(),
    };
    match first.exists() {
        true => first,
        false => oldest_file(&first).unwrap_or(first),
    }
}

/// How long a recorder, which is already late, may wait for the identifier's answer.
const TELL_LIMIT: Duration = Duration::from_millis(100);
/// Largest time span that a killed recorder may lose.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Writes the messages of a monitor.
pub(super) struct Records {
    pub(super) csv: Option<EstimatesCsv<File>>,
    recorder: Option<Recorder>,
    flushed: Instant,
    /// Lost samples, as last reported to the identifier.
    told_missing: u64,
    /// Samples that a launched simulation loses on purpose; they do not count as lost.
    simulated: Option<SimulatedLosses>,
    /// True if the recording ended before its run.
    broken: bool,
    /// Bus on which losses are reported to the identifier.
    bus: Option<Bus>,
    /// The identifier's last error that was logged.
    told: LastError,
    /// Live output.
    live: Live,
}

impl Records {
    pub(super) fn new(
        csv: Option<EstimatesCsv<File>>,
        recorder: Option<Recorder>,
        bus: Option<Bus>,
        live: Live,
        simulated: Option<SimulatedLosses>,
    ) -> Self {
        Self {
            csv,
            recorder,
            flushed: Instant::now(),
            told_missing: 0,
            simulated,
            broken: false,
            bus,
            told: LastError::default(),
            live,
        }
    }

    /// Whether samples are recorded.
    pub(super) fn is_recording(&self) -> bool {
        self.recorder.is_some()
    }

    /// Adopts the identifier's names and units.
    pub(super) fn rename(&mut self, description: &Description) {
        self.live.rename(description);
    }

    /// Ends the recording and returns the number of samples that it lacks and no simulation has
    /// lost on purpose; `None` if there was none, an error if it is incomplete.
    pub(super) fn finish(mut self) -> Option<Result<u64, ()>> {
        self.live.finish();
        if self.broken {
            return Some(Err(()));
        }
        let finished = self.recorder.take()?.finish();
        Some(match finished {
            Ok(written) => Ok(self.lost_samples(&written)),
            Err(e) => {
                tracing::error!("{e}");
                Err(())
            }
        })
    }

    /// Samples missing in a recording that no simulation has lost on purpose.
    fn lost_samples(&mut self, written: &RecorderStatus) -> u64 {
        let (sent, missing) = (written.samples + written.samples_missing, written.samples_missing);
        missing.saturating_sub(self.simulated.as_mut().map_or(0, |losses| losses.among(sent)))
    }

    /// Reports the recorder's losses to the identifier for its status. If that fails, the file and
    /// the log still contain them.
    fn tell_identifier(&self, missing: u64) {
        let Some(bus) = &self.bus else { return };
        let request = Request::new(Command::Recorder).with_value(missing as f64);
        let told = ControlClient::new(bus).and_then(|client| client.ask(&request, TELL_LIMIT));
        if let Err(e) = told {
            tracing::debug!("the identifier was not told of the loss: {e}");
        }
    }

    /// A disk failure ends the recording but not the monitor, whose output is then even more
    /// important.
    fn record(&mut self, write: impl FnOnce(&mut Recorder) -> Result<(), RecordError>) {
        if let Some(recorder) = &mut self.recorder
            && let Err(e) = write(recorder)
        {
            tracing::error!("{e}; the recording ends here");
            self.recorder = None;
            self.broken = true;
        }
    }
}

impl MonitorSink for Records {
    fn sample(&mut self, sample: &Sample, sent_ns: u64) -> io::Result<()> {
        self.live.sample(sample);
        self.record(|recorder| recorder.sample(sample, sent_ns));
        Ok(())
    }

    fn estimate(&mut self, node: &MonitorNode, estimate: &Estimate, sent_ns: u64) -> io::Result<()> {
        self.live.estimate(node, estimate, sent_ns);
        self.record(|recorder| recorder.estimate(estimate, sent_ns));
        self.csv.as_mut().map_or(Ok(()), |csv| csv.write(estimate))
    }

    fn status(&mut self, status: &Status, sent_ns: u64) -> io::Result<()> {
        // at most twice a second, and once for each kind of refused sample
        let reason = ErrorCode::from_wire(status.error.code);
        let samples = matches!(
            reason,
            Some(ErrorCode::WrongJoints | ErrorCode::WrongSignals | ErrorCode::NotFinite)
        );
        if samples && status.error.code != self.told.code {
            tracing::warn!(
                seq = status.error.seq,
                rejected = status.rejected,
                "the identifier refuses samples: {}",
                status.error.words()
            );
        }
        self.told = status.error;
        self.live.status(status, sent_ns);
        self.record(|recorder| recorder.status(status, sent_ns));
        Ok(())
    }

    fn journal(&mut self, entry: &Journal) -> io::Result<()> {
        // A state arrives in parts; log only one line.
        if entry.request.part == 0 {
            let command = Command::from_wire(entry.request.command).map_or("unknown", Command::name);
            let (name, value) = (entry.request.name(), entry.request.value());
            tracing::info!(
                block = entry.block,
                from_seq = entry.request.from_seq,
                name,
                value,
                "command: {command}"
            );
        }
        self.record(|recorder| recorder.journal(entry));
        Ok(())
    }

    fn round(&mut self) -> io::Result<()> {
        self.live.round();
        if self.flushed.elapsed() < FLUSH_PERIOD {
            return Ok(());
        }
        self.flushed = Instant::now();
        self.record(Recorder::flush);
        let written = self.recorder.as_ref().map(|recorder| *recorder.written());
        let missing = written.map_or(0, |written| self.lost_samples(&written));
        if missing > self.told_missing {
            tracing::warn!(
                missing,
                "the recorder cannot keep up; samples are missing in the recording"
            );
            self.told_missing = missing;
            self.tell_identifier(missing);
        }
        Ok(())
    }
}

/// Begins a recording of the configured plant.
///
/// `resume` continues the recording of a monitor that died, in a separate file that readers join to
/// the first.
pub(super) fn recorder(
    path: &Path,
    config: &Config,
    node: &MonitorNode,
    simulated: bool,
    resume: bool,
) -> Result<Recorder, Failure> {
    let limits = RecordingLimits {
        file_bytes: config.monitor.record_file_bytes,
        files: config.monitor.record_files,
    };
    let mut info = run_info(config, node, simulated);
    let begun = if resume {
        let oldest = oldest_file(path);
        if let Some(Ok(reader)) = oldest.map(|path| RecordingReader::open(&path, Span::default())) {
            info.recording_id.clone_from(&reader.info().recording_id);
        }
        Recorder::resume(path, info, limits)
    } else {
        Recorder::create(path, info, limits)
    };
    begun.map_err(|e| match e {
        RecordError::Io { ref source, .. } if source.kind() == io::ErrorKind::AlreadyExists => Failure::Usage(format!(
            "{} exists, and recordings are never written over; name another file or remove it",
            path.display()
        )),
        e => Failure::Failed(e.to_string()),
    })
}
