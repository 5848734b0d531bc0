//! Writes a run as MCAP: `cdr` messages with `ros2msg` schemas, lz4 chunks, the run's metadata
//! first.
//!
//! The log time of a message is its stream time and the publish time the clock at sending, both as
//! time of day (`clock.rs`). Messages are in the file, and readable after a kill, from the next
//! [`Recorder::flush`] on.

use super::cdr::CdrWriter;
use super::clock::WallClock;
use super::info::{InfoError, RunInfo};
use super::joint_state_out::JointStates;
use super::journal::journal_to_map;
use super::layout::{Counts, NameCollision, RecorderStatus, channels, check_names};
use super::names::{CLOCK_METADATA, END_METADATA, JOURNAL_METADATA, RUN_METADATA, channel};
use super::series::{existing_files, numbered};
use super::unmeasured::marked;
use crate::files::{Temporary, vacant};
use crate::messages::{Estimate, Journal, Message, SCHEMA_VERSION, Sample, Status};
use crate::node::stream::{Place, StreamCursor};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Size of a chunk before compression \[bytes\].
const CHUNK_BYTES: u64 = 1 << 20;

/// How large a recording may become.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RecordingLimits {
    /// A file of this size is closed and the next one begun \[bytes\]; 0 for no limit.
    pub file_bytes: u64,
    /// Number of files kept, the oldest is removed for a new one; 0 for no limit.
    pub files: usize,
}

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file system refuses.
    #[error("cannot write the recording {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The names of the plant do not fit.
    #[error(transparent)]
    Names(#[from] NameCollision),
    /// The description of the run does not fit.
    #[error(transparent)]
    Info(#[from] InfoError),
}

/// Writes samples, estimates and status of one run.
pub struct Recorder {
    info: RunInfo,
    counts: Counts,
    limits: RecordingLimits,
    first: PathBuf,
    kept: std::collections::VecDeque<PathBuf>,
    file: OpenFile,
    /// Number of the file being written.
    number: u32,
    written: RecorderStatus,
    cursor: StreamCursor,
    clock: WallClock,
    joint_states: Option<JointStates>,
    last_t_ns: u64,
    last_sent_ns: u64,
    buffer: Vec<u8>,
}

struct OpenFile {
    path: PathBuf,
    writer: mcap::Writer<CountingFile>,
    bytes: Arc<AtomicU64>,
    sequence: [u32; 6],
}

impl Recorder {
    /// Begins a recording at `path`, which must not exist.
    ///
    /// # Errors
    /// If the file exists or cannot be created, or if the plant's names become equal in a
    /// recording.
    pub fn create(path: &Path, info: RunInfo, limits: RecordingLimits) -> Result<Self, RecordError> {
        Self::begin(path, 0, info, limits)
    }

    /// Begins with file `number` of the recording whose first file is `first`.
    fn begin(first: &Path, number: u32, info: RunInfo, limits: RecordingLimits) -> Result<Self, RecordError> {
        let path = numbered(first, number);
        let info = RunInfo {
            schema: SCHEMA_VERSION,
            first_form: false,
            file_number: Some(number),
            ..info
        };
        info.check()?;
        check_names(&info)?;
        let file = OpenFile::create(&path, &info)?;
        Ok(Self {
            counts: Counts::of(&info),
            clock: WallClock::new(info.clock_epoch_ns),
            joint_states: info.joint_states.then(|| JointStates::new(&info)),
            info,
            limits,
            first: first.to_path_buf(),
            kept: [path].into(),
            file,
            number,
            written: RecorderStatus::default(),
            cursor: StreamCursor::new(),
            last_t_ns: 0,
            last_sent_ns: 0,
            buffer: Vec::with_capacity(4096),
        })
    }

    /// Continues the recording at `path` in a separate file, after its recorder has died: readers
    /// join the two if `info` has the `recording_id` of the first. Like [`create`](Self::create) if
    /// there is none yet.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn resume(path: &Path, info: RunInfo, limits: RecordingLimits) -> Result<Self, RecordError> {
        let existing = existing_files(path);
        let Some(last) = existing.last().map(|(number, _)| *number) else {
            return Self::create(path, info, limits);
        };
        let mut recorder = Self::begin(path, following(path, last)?, info, limits)?;
        let next = recorder.kept.pop_back();
        recorder.kept = existing.into_iter().map(|(_, path)| path).chain(next).collect();
        recorder.make_room()?;
        Ok(recorder)
    }

    /// Writes a sample; `sent_ns` is the clock at sending.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn sample(&mut self, sample: &Sample, sent_ns: u64) -> Result<(), RecordError> {
        match self.cursor.advance(sample.stream_id, sample.seq) {
            Place::Gap { missing } => {
                self.written.samples_missing = self.written.samples_missing.saturating_add(missing);
            }
            Place::First | Place::Next | Place::Duplicate => {}
        }
        if self.clock.follow(sample, sent_ns) {
            // The data written so far have another clock, or none.
            let begun = self.file.writer.flush();
            self.file.check(begun)?;
            self.file.tell_clock(&self.clock)?;
        }
        self.last_t_ns = sample.t_ns;
        self.last_sent_ns = sent_ns;
        self.encode(marked(sample));
        self.put(channel::SAMPLE, sample.t_ns, sent_ns)?;
        if let Some(joint_states) = &self.joint_states {
            joint_states.write(sample, self.clock.of_stream(sample.t_ns), &mut self.buffer);
            self.put(channel::JOINT_STATES, sample.t_ns, sent_ns)?;
        }
        self.written.samples += 1;
        Ok(())
    }

    /// Writes an estimate; `sent_ns` is the clock at sending.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn estimate(&mut self, estimate: &Estimate, sent_ns: u64) -> Result<(), RecordError> {
        self.encode(*estimate);
        self.put(channel::ESTIMATE, estimate.t_last_ns, sent_ns)?;
        self.written.estimates += 1;
        Ok(())
    }

    /// Writes a status; `sent_ns` is the clock at sending.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn status(&mut self, status: &Status, sent_ns: u64) -> Result<(), RecordError> {
        self.encode(*status);
        self.put(channel::STATUS, status.last_t_ns, sent_ns)?;
        self.written.statuses += 1;
        Ok(())
    }

    /// Writes a command to the identifier, and the border at which it took effect.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn journal(&mut self, entry: &Journal) -> Result<(), RecordError> {
        // A separate record between the chunks, which is found without decompressing a recording.
        let put = self.file.writer.write_metadata(&Metadata {
            name: JOURNAL_METADATA.into(),
            metadata: journal_to_map(entry),
        });
        self.file.check(put)
    }

    /// Passes everything written so far to the operating system, with counts of written and lost
    /// messages; call it about once a second.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.written.file_bytes = self.file.bytes.load(Ordering::Relaxed);
        self.encode(self.written);
        self.put(channel::RECORDER, self.last_t_ns, self.last_sent_ns)?;
        let flushed = self.file.writer.flush();
        self.file.check(flushed)
    }

    /// Ends the recording: index, statistics, and the mark of a complete file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<RecorderStatus, RecordError> {
        self.flush()?;
        self.file.finish(&self.written)?;
        Ok(self.written)
    }

    /// Counts of the messages written so far.
    pub fn written(&self) -> &RecorderStatus {
        &self.written
    }

    /// The file being written.
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    fn encode(&mut self, mut message: impl Message) {
        let Ok(()) = message.visit(&mut CdrWriter::new(&mut self.buffer, &self.counts));
    }

    fn put(&mut self, channel: u16, t_ns: u64, sent_ns: u64) -> Result<(), RecordError> {
        let header = MessageHeader {
            channel_id: channel,
            sequence: self.file.sequence[channel as usize],
            // Before the first sample there is no stream time.
            log_time: match t_ns {
                0 => self.clock.of_sending(sent_ns).max(self.clock.of_stream(0)),
                _ => self.clock.of_stream(t_ns),
            },
            publish_time: self.clock.of_sending(sent_ns),
        };
        let put = self.file.writer.write_to_known_channel(&header, &self.buffer);
        self.file.check(put)?;
        self.file.sequence[channel as usize] = header.sequence.wrapping_add(1);
        let limit = self.limits.file_bytes;
        if limit > 0 && self.file.bytes.load(Ordering::Relaxed) >= limit {
            self.rotate()?;
        }
        Ok(())
    }

    fn rotate(&mut self) -> Result<(), RecordError> {
        self.number = following(&self.first, self.number)?;
        self.info.file_number = Some(self.number);
        let path = numbered(&self.first, self.number);
        let mut next = OpenFile::create(&path, &self.info)?;
        next.tell_clock(&self.clock)?;
        std::mem::replace(&mut self.file, next).finish(&self.written)?;
        self.kept.push_back(path);
        self.make_room()
    }

    /// Removes the oldest files beyond the limit.
    fn make_room(&mut self) -> Result<(), RecordError> {
        while self.limits.files > 0 && self.kept.len() > self.limits.files {
            if let Some(oldest) = self.kept.pop_front() {
                fs::remove_file(&oldest).map_err(|source| RecordError::Io { path: oldest, source })?;
            }
        }
        Ok(())
    }
}

/// The number of the next file.
fn following(first: &Path, number: u32) -> Result<u32, RecordError> {
    number.checked_add(1).ok_or_else(|| RecordError::Io {
        path: numbered(first, number),
        source: io::Error::other(
            "expected a file number below 4294967295, which is the last one; record under another name",
        ),
    })
}

impl OpenFile {
    /// The file gets its name once its definitions are written, so that a recorder killed at any
    /// time leaves only readable files.
    fn create(path: &Path, info: &RunInfo) -> Result<Self, RecordError> {
        let bytes = Arc::new(AtomicU64::new(0));
        let failed = |source| RecordError::Io {
            path: path.to_path_buf(),
            source,
        };
        vacant(path).map_err(failed)?;
        let begun = Temporary::beside(path).map_err(failed)?;
        let file = begun.file().try_clone().map_err(failed)?;
        let sink = CountingFile {
            file: BufWriter::with_capacity(1 << 16, file),
            bytes: bytes.clone(),
        };
        let writer = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .compression_level(0)
            .chunk_size(Some(CHUNK_BYTES))
            .profile("ros2")
            .library(concat!("thetabus ", env!("CARGO_PKG_VERSION")))
            .create(sink)
            .map_err(|e| failed(io_error(e)))?;
        let mut open = Self {
            path: path.to_path_buf(),
            writer,
            bytes,
            sequence: [0; 6],
        };
        let defined = open.begin(info);
        open.check(defined)?;
        begun.appear().map_err(failed)?;
        Ok(open)
    }

    fn begin(&mut self, info: &RunInfo) -> Result<(), McapError> {
        self.writer.write_metadata(&Metadata {
            name: RUN_METADATA.into(),
            metadata: info.to_map(),
        })?;
        let joint_states = info.joint_states.then(|| JointStates::channel(info));
        for channel in channels(info).into_iter().chain(joint_states) {
            let id = channel.id;
            self.writer
                .add_schema_with_id(id, &channel.schema_name, "ros2msg", channel.schema.as_bytes())?;
            self.writer
                .add_channel_with_id(id, id, &channel.topic, "cdr", &BTreeMap::new())?;
        }
        // The definitions in a separate chunk, which is small and so rarely damaged.
        self.writer.flush()
    }

    /// Writes the shift of times from here on.
    fn tell_clock(&mut self, clock: &WallClock) -> Result<(), RecordError> {
        let Some(metadata) = clock.to_map() else {
            return Ok(());
        };
        let told = self.writer.write_metadata(&Metadata {
            name: CLOCK_METADATA.into(),
            metadata,
        });
        self.check(told)
    }

    fn finish(mut self, written: &RecorderStatus) -> Result<(), RecordError> {
        let metadata = [
            ("samples", written.samples),
            ("estimates", written.estimates),
            ("statuses", written.statuses),
            ("samples_missing", written.samples_missing),
        ];
        let ended = self.writer.write_metadata(&Metadata {
            name: END_METADATA.into(),
            metadata: metadata.map(|(k, v)| (k.to_string(), v.to_string())).into(),
        });
        self.check(ended)?;
        let finished = self.writer.finish().map(|_| ());
        self.check(finished)?;
        let path = self.path.clone();
        self.writer
            .into_inner()
            .flush()
            .map_err(|source| RecordError::Io { path, source })
    }

    fn check(&self, result: Result<(), McapError>) -> Result<(), RecordError> {
        result.map_err(|e| RecordError::Io {
            path: self.path.clone(),
            source: io_error(e),
        })
    }
}

fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

/// A file that counts the bytes written to it.
struct CountingFile {
    file: BufWriter<File>,
    bytes: Arc<AtomicU64>,
}

impl Write for CountingFile {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let written = self.file.write(data)?;
        self.bytes.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for CountingFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}
