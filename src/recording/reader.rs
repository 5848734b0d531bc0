//! Reads a recording from front to back as far as possible, including truncated files and damaged
//! chunks, and counts the losses.
//!
//! A chunk is used only if its checksum is right, except for the last one of a truncated file, of
//! which every complete message is used. `record_file.rs` finds records in a damaged file.

use super::cdr::CdrReader;
use super::clock::stream_epoch;
use super::info::RunInfo;
use super::journal::journal_from_map;
use super::layout::{Counts, RecorderStatus, check_names};
use super::loss::{Loss, ReadError};
use super::names::{CLOCK_METADATA, END_METADATA, JOURNAL_METADATA, channel};
use super::record_file::{Next, RecordFile, decompress};
use super::series::{first_file, numbered};
use super::unmeasured::clear;
use crate::messages::{Estimate, Journal, Message as _, Sample, Status};
use mcap::records::{MessageHeader, op};
use std::path::{Path, PathBuf};

/// One message of a recording; `sent_ns` is the clock at sending.
#[derive(Debug)]
pub enum Entry<'a> {
    /// A sample.
    Sample {
        /// The message.
        sample: &'a Sample,
        /// CLOCK_MONOTONIC at sending \[ns\].
        sent_ns: u64,
    },
    /// An estimate.
    Estimate {
        /// The message.
        estimate: &'a Estimate,
        /// CLOCK_MONOTONIC at sending \[ns\].
        sent_ns: u64,
    },
    /// A status.
    Status {
        /// The message.
        status: &'a Status,
        /// CLOCK_MONOTONIC at sending \[ns\].
        sent_ns: u64,
    },
    /// Status of the recorder.
    Recorder(RecorderStatus),
}

/// A part of a recording, by stream time \[ns\], both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    /// From here.
    pub from_ns: u64,
    /// To here.
    pub to_ns: u64,
}

impl Default for Span {
    /// Everything.
    fn default() -> Self {
        Self {
            from_ns: 0,
            to_ns: u64::MAX,
        }
    }
}

/// Reads the messages of a recording in the order of the file; a rotated recording continues in the
/// next file.
pub struct RecordingReader {
    info: RunInfo,
    counts: Counts,
    span: Span,
    file: RecordFile,
    /// Time of day at which CLOCK_MONOTONIC was 0.
    clock_epoch_ns: u64,
    /// Time of day at which the stream's time was 0; `None` until the file has stated it.
    stream_epoch_ns: Option<u64>,
    /// Number of the file in `file`.
    number: u32,
    first: PathBuf,
    /// Bytes of all files, as they are now, and of those already read.
    bytes: u64,
    bytes_read: u64,
    /// Messages of the present chunk, and the position in it.
    chunk: Vec<u8>,
    position: usize,
    /// Damaged chunks are counted by the index that follows them.
    counting_damaged: bool,
    file_ended: bool,
    at_end: bool,
    loss: Loss,
    sample: Sample,
    estimate: Estimate,
    status: Status,
}

impl RecordingReader {
    /// Opens a recording; `path` is the first file to read of a rotated one.
    ///
    /// # Errors
    /// If the file cannot be read, or has no metadata.
    pub fn open(path: &Path, span: Span) -> Result<Self, ReadError> {
        let mut file = RecordFile::open(path)?;
        let info = file.find_info()?;
        let not_ours = |reason: String| ReadError::NotARecording {
            path: path.to_path_buf(),
            reason,
        };
        check_names(&info).map_err(|e| not_ours(e.to_string()))?;
        let (first, number) = first_file(path, &info);
        Ok(Self {
            counts: Counts::of(&info),
            clock_epoch_ns: info.clock_epoch_ns,
            stream_epoch_ns: info.first_form.then_some(0),
            info,
            span,
            bytes: file.length() + rest_of_series(&first, number),
            bytes_read: 0,
            file,
            number,
            first,
            chunk: Vec::new(),
            position: 0,
            counting_damaged: false,
            file_ended: false,
            at_end: false,
            loss: Loss::default(),
            sample: Sample::EMPTY,
            estimate: Estimate::EMPTY,
            status: Status::default(),
        })
    }

    /// The metadata of the recording.
    pub fn info(&self) -> &RunInfo {
        &self.info
    }

    /// Share of its bytes read so far, 0 to 1.
    pub fn share_read(&self) -> f64 {
        (self.bytes_read + self.file.position()) as f64 / self.bytes.max(1) as f64
    }

    /// Losses so far.
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// The next message; `None` at the end of the readable data.
    ///
    /// # Errors
    /// If the file system fails; damage is no error but counted in [`Self::loss`].
    pub fn next_entry(&mut self) -> Result<Option<Entry<'_>>, ReadError> {
        loop {
            while let Some(range) = self.next_message_of_chunk() {
                let (header, body) = message(&self.chunk[range.clone()]);
                let Ok(mut reader) = CdrReader::new(body, &self.counts) else {
                    self.loss.messages += 1;
                    continue;
                };
                let sent_ns = header.publish_time.saturating_sub(self.clock_epoch_ns);
                let decoded = match header.channel_id {
                    channel::SAMPLE => {
                        let decoded = self.sample.visit(&mut reader);
                        clear(&mut self.sample);
                        decoded
                    }
                    channel::ESTIMATE => self.estimate.visit(&mut reader),
                    channel::STATUS => self.status.visit(&mut reader),
                    channel::RECORDER => {
                        let mut recorder = RecorderStatus::default();
                        match recorder.visit(&mut reader) {
                            Ok(()) => {
                                self.loss.samples_not_recorded = recorder.samples_missing;
                                return Ok(Some(Entry::Recorder(recorder)));
                            }
                            Err(e) => Err(e),
                        }
                    }
                    // Channels of a later version are ignored and not lost.
                    _ => continue,
                };
                if decoded.is_err() {
                    self.loss.messages += 1;
                    continue;
                }
                let t_ns = match header.channel_id {
                    channel::SAMPLE => self.sample.t_ns,
                    channel::ESTIMATE => self.estimate.t_last_ns,
                    _ => self.status.last_t_ns,
                };
                if t_ns < self.span.from_ns || t_ns > self.span.to_ns {
                    continue;
                }
                return Ok(Some(match header.channel_id {
                    channel::SAMPLE => Entry::Sample {
                        sample: &self.sample,
                        sent_ns,
                    },
                    channel::ESTIMATE => Entry::Estimate {
                        estimate: &self.estimate,
                        sent_ns,
                    },
                    _ => Entry::Status {
                        status: &self.status,
                        sent_ns,
                    },
                }));
            }
            if self.at_end || !self.next_chunk()? {
                self.at_end = true;
                return Ok(None);
            }
        }
    }

    /// Bytes of the next message record in the chunk, after its opcode and length.
    fn next_message_of_chunk(&mut self) -> Option<std::ops::Range<usize>> {
        loop {
            let rest = &self.chunk[self.position..];
            let head = rest.first_chunk::<9>()?;
            let [opcode, length @ ..] = *head;
            let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
            let start = self.position + 9;
            let end = start.checked_add(length).filter(|&end| end <= self.chunk.len())?;
            self.position = end;
            if opcode == op::MESSAGE && length >= MESSAGE_HEAD {
                return Some(start..end);
            }
        }
    }

    /// Reads on to the next chunk with messages of the span; false at the end of the last file.
    fn next_chunk(&mut self) -> Result<bool, ReadError> {
        self.chunk.clear();
        self.position = 0;
        loop {
            match self.file.next_record(&mut self.loss)? {
                Next::Record(op::CHUNK) => {
                    self.counting_damaged = false;
                    let Some((header, data)) = self.file.chunk() else {
                        self.file.resynchronise(&mut self.loss)?;
                        continue;
                    };
                    // Without the clock record, if it is damaged, every chunk is examined.
                    let outside = self.stream_epoch_ns.is_some_and(|epoch| {
                        header.message_end_time < self.span.from_ns.saturating_add(epoch)
                            || header.message_start_time > self.span.to_ns.saturating_add(epoch)
                    });
                    // A chunk with only definitions states 0 for both times.
                    if outside && header.message_end_time != 0 {
                        continue;
                    }
                    if decompress(&header, data, &mut self.chunk) {
                        return Ok(true);
                    }
                    self.chunk.clear();
                    self.loss.damaged_chunks += 1;
                    self.counting_damaged = true;
                }
                Next::Record(op::MESSAGE_INDEX) if self.counting_damaged => {
                    if let Some((channel, messages)) = self.file.message_index()
                        && (channel::SAMPLE..=channel::RECORDER).contains(&channel)
                    {
                        self.loss.messages += messages;
                    }
                }
                Next::Record(op::METADATA) => {
                    if let Some((name, map)) = self.file.metadata() {
                        self.file_ended |= name == END_METADATA;
                        if name == CLOCK_METADATA {
                            self.stream_epoch_ns = stream_epoch(&map);
                        }
                    }
                }
                Next::Record(_) => {}
                Next::CutChunk => {
                    if let Some((header, data)) = self.file.chunk_head() {
                        decompress(&header, data, &mut self.chunk);
                    }
                    self.loss.bytes += self.file.body.len() as u64;
                    return Ok(true);
                }
                Next::End => {
                    if !self.file_ended || !self.file.whole {
                        self.loss.unfinished_files += 1;
                    }
                    if !self.next_file()? {
                        return Ok(false);
                    }
                }
            }
        }
    }

    /// Goes on to the next file of a rotated recording.
    fn next_file(&mut self) -> Result<bool, ReadError> {
        let Some(number) = self.number.checked_add(1) else {
            return Ok(false);
        };
        let path = numbered(&self.first, number);
        if !path.exists() {
            return Ok(false);
        }
        let mut file = RecordFile::open(&path)?;
        // Another recording with such a name is not the continuation.
        let info = file.find_info()?;
        if info.recording_id != self.info.recording_id {
            return Ok(false);
        }
        // Another program may have continued the recording, after a restart of the machine.
        self.counts = Counts::of(&info);
        self.clock_epoch_ns = info.clock_epoch_ns;
        self.stream_epoch_ns = info.first_form.then_some(0);
        self.bytes_read += self.file.length();
        self.file = file;
        self.file_ended = false;
        self.number = number;
        Ok(true)
    }
}

/// Bytes of the files of a rotated recording after this one.
fn rest_of_series(first: &Path, number: u32) -> u64 {
    let later = (number..u32::MAX).map(|number| number + 1);
    let files = later.map(|number| std::fs::metadata(numbered(first, number)).ok());
    files.map_while(|file| file.map(|file| file.len())).sum()
}

/// The commands to the identifier during a recording, in the order in which they took effect; for a
/// rotated one from this file on. Also returns the number of damaged entries, which are missing.
///
/// # Errors
/// If a file cannot be read.
pub fn read_journal(path: &Path) -> Result<(Vec<Journal>, u64), ReadError> {
    let mut file = RecordFile::open(path)?;
    let info = file.find_info()?;
    let (first, mut number) = first_file(path, &info);
    let (mut entries, mut damaged) = (Vec::new(), 0);
    // Other damage is counted when the messages are read.
    let mut ignored = Loss::default();
    loop {
        loop {
            match file.next_record(&mut ignored)? {
                Next::Record(op::METADATA) => {
                    let entry = match file.metadata() {
                        Some((name, map)) if name == JOURNAL_METADATA => journal_from_map(&map),
                        Some(_) => continue,
                        // damaged, and may have been a journal
                        None => None,
                    };
                    match entry {
                        Some(entry) => entries.push(entry),
                        None => damaged += 1,
                    }
                }
                Next::Record(_) => {}
                Next::CutChunk | Next::End => break,
            }
        }
        let Some(next) = number.checked_add(1) else { break };
        let path = numbered(&first, next);
        if !path.exists() {
            break;
        }
        file = RecordFile::open(&path)?;
        if file.find_info()?.recording_id != info.recording_id {
            break;
        }
        number = next;
    }
    Ok((entries, damaged))
}

/// Channel, sequence, log time, publish time.
const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;

fn message(record: &[u8]) -> (MessageHeader, &[u8]) {
    let (head, body) = record.split_at(MESSAGE_HEAD);
    let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let header = MessageHeader {
        channel_id: u16::from_le_bytes([head[0], head[1]]),
        sequence: 0,
        log_time: u64_at(6),
        publish_time: u64_at(14),
    };
    (header, body)
}
