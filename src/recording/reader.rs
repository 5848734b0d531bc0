//! Reads a recording front to back, as far as it goes: files cut by a kill, chunks that are damaged, with a count of what was lost.
//!
//! The records are framed here and not by the `mcap` crate's readers because these stop at the first error. A damaged record is left out, and
//! reading goes on at the next chunk that can be found; a chunk counts only if its checksum holds, except for the last one of a file
//! that was cut, of which every whole message is taken.

use super::cdr::CdrReader;
use super::info::{InfoError, RunInfo};
use super::journal::journal_from_map;
use super::layout::{Layout, NameCollision, RecorderStatus, no_estimate, no_sample};
use super::writer::{END_METADATA, JOURNAL_METADATA, RUN_METADATA, channel, numbered};
use crate::messages::{Estimate, Journal, Sample, Status};
use mcap::records::{ChunkHeader, MessageHeader, Record, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The longest record that is believed \[bytes\]; a recorder's chunks are near 1 MiB.
const RECORD_LIMIT: u64 = 256 << 20;
/// Opcode and length of a record.
const RECORD_HEAD: u64 = 9;
/// From the start of a chunk record to the length of the name of its compression.
const TO_COMPRESSION: u64 = RECORD_HEAD + 3 * 8 + 4;
/// How that name stands in the file.
const LZ4_NAME: &[u8] = b"\x03\x00\x00\x00lz4";

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
    /// What the recorder said of itself.
    Recorder(RecorderStatus),
}

/// What a recording has lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loss {
    /// Files that do not end as a recorder ends them: cut, or its process was killed.
    pub unfinished_files: u64,
    /// Chunks whose checksum or compression does not hold.
    pub damaged_chunks: u64,
    /// Messages that are known to be missing: counted by the index behind a damaged chunk, or not decodable.
    pub messages: u64,
    /// Bytes that could not be read as records.
    pub bytes: u64,
    /// Samples that never reached the recorder, as it says itself.
    pub samples_not_recorded: u64,
}

impl Loss {
    /// True where nothing was lost.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// In words, for a warning.
impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut parts = Vec::new();
        let mut part = |count: u64, what: &str| {
            if count > 0 {
                parts.push(format!("{count} {what}"));
            }
        };
        part(self.unfinished_files, "file(s) not finished by the recorder");
        part(self.damaged_chunks, "damaged chunk(s)");
        part(self.messages, "message(s) lost in them");
        part(self.bytes, "byte(s) unreadable");
        part(self.samples_not_recorded, "sample(s) never reached the recorder");
        match parts.is_empty() {
            true => f.write_str("nothing lost"),
            false => f.write_str(&parts.join(", ")),
        }
    }
}

/// Why a recording cannot be read at all.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file system refuses.
    #[error("cannot read the recording {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Not a recording.
    #[error("{path} is not a recording of thetabus: {reason}")]
    NotARecording {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
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

/// Reads the messages of a recording in the order of the file; a recording that was rotated goes on in the next file.
pub struct RecordingReader {
    info: RunInfo,
    layout: Layout,
    span: Span,
    file: RecordFile,
    next_number: u32,
    first: PathBuf,
    /// Messages of the chunk being read, and how far.
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
    /// Opens a recording; of a rotated one the first file that shall be read.
    ///
    /// # Errors
    /// Where the file cannot be read, or nothing in it tells what was recorded.
    pub fn open(path: &Path, span: Span) -> Result<Self, ReadError> {
        let mut file = RecordFile::open(path)?;
        let info = file.find_info()?;
        let not_ours = |reason: String| ReadError::NotARecording {
            path: path.to_path_buf(),
            reason,
        };
        let layout = Layout::new(&info).map_err(|e: NameCollision| not_ours(e.to_string()))?;
        let (first, number) = series(path);
        Ok(Self {
            info,
            layout,
            span,
            file,
            next_number: number + 1,
            first,
            chunk: Vec::new(),
            position: 0,
            counting_damaged: false,
            file_ended: false,
            at_end: false,
            loss: Loss::default(),
            sample: no_sample(),
            estimate: no_estimate(),
            status: Status::default(),
        })
    }

    /// What was recorded.
    pub fn info(&self) -> &RunInfo {
        &self.info
    }

    /// What was lost, as far as the recording has been read.
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// The next message; `None` at the end of all that can be read.
    ///
    /// # Errors
    /// Where the file system fails; damage is no error but counted in [`Self::loss`].
    pub fn next_entry(&mut self) -> Result<Option<Entry<'_>>, ReadError> {
        loop {
            while let Some(range) = self.next_message_of_chunk() {
                let (header, body) = message(&self.chunk[range.clone()]);
                if header.log_time < self.span.from_ns || header.log_time > self.span.to_ns {
                    continue;
                }
                let Ok(mut reader) = CdrReader::new(body) else {
                    self.loss.messages += 1;
                    continue;
                };
                let sent_ns = header.publish_time;
                let decoded = match header.channel_id {
                    channel::SAMPLE => self.layout.sample(&mut reader, &mut self.sample),
                    channel::ESTIMATE => self.layout.estimate(&mut reader, &mut self.estimate),
                    channel::STATUS => self.layout.status(&mut reader, &mut self.status),
                    channel::RECORDER => {
                        let mut recorder = RecorderStatus::default();
                        match Layout::recorder(&mut reader, &mut recorder) {
                            Ok(()) => {
                                self.loss.samples_not_recorded = recorder.samples_missing;
                                return Ok(Some(Entry::Recorder(recorder)));
                            }
                            Err(e) => Err(e),
                        }
                    }
                    // Channels of a later version: not ours, not lost.
                    _ => continue,
                };
                if decoded.is_err() {
                    self.loss.messages += 1;
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

    /// Bytes of the next message record in the chunk, behind its opcode and length.
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
                    let outside =
                        header.message_end_time < self.span.from_ns || header.message_start_time > self.span.to_ns;
                    // A chunk of definitions alone states 0 for both times.
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
                    if let Ok(Record::MessageIndex(index)) = mcap::parse_record(op::MESSAGE_INDEX, &self.file.body)
                        && (channel::SAMPLE..=channel::RECORDER).contains(&index.channel_id)
                    {
                        self.loss.messages += index.records.len() as u64;
                    }
                }
                Next::Record(op::METADATA) => {
                    if let Ok(Record::Metadata(metadata)) = mcap::parse_record(op::METADATA, &self.file.body) {
                        self.file_ended |= metadata.name == END_METADATA;
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
        let path = numbered(&self.first, self.next_number);
        if !path.exists() {
            return Ok(false);
        }
        let mut file = RecordFile::open(&path)?;
        // Another recording that happens to have such a name is not the continuation.
        if file.find_info()?.recording_id != self.info.recording_id {
            return Ok(false);
        }
        self.file = file;
        self.file_ended = false;
        self.next_number += 1;
        Ok(true)
    }
}

/// What the identifier was told while a recording was made, in the order in which it took effect; of a rotated one from this file on.
///
/// # Errors
/// Where a file cannot be read.
pub fn read_journal(path: &Path) -> Result<Vec<Journal>, ReadError> {
    let mut file = RecordFile::open(path)?;
    let id = file.find_info()?.recording_id;
    let (first, number) = series(path);
    let mut entries = Vec::new();
    // What is damaged is counted where the messages are read.
    let mut ignored = Loss::default();
    for next in number + 1.. {
        loop {
            match file.next_record(&mut ignored)? {
                Next::Record(op::METADATA) => {
                    if let Ok(Record::Metadata(metadata)) = mcap::parse_record(op::METADATA, &file.body)
                        && metadata.name == JOURNAL_METADATA
                    {
                        match journal_from_map(&metadata.metadata) {
                            Some(entry) => entries.push(entry),
                            None => ignored.messages += 1,
                        }
                    }
                }
                Next::Record(_) => {}
                Next::CutChunk | Next::End => break,
            }
        }
        let path = numbered(&first, next);
        if !path.exists() {
            break;
        }
        file = RecordFile::open(&path)?;
        if file.find_info()?.recording_id != id {
            break;
        }
    }
    Ok(entries)
}

/// `run_0003.mcap` is number 3 of `run.mcap`.
pub(super) fn series(path: &Path) -> (PathBuf, u32) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let numbered = stem
        .rsplit_once('_')
        .filter(|(_, digits)| digits.len() >= 4 && digits.bytes().all(|b| b.is_ascii_digit()))
        .and_then(|(stem, digits)| Some((stem.to_string(), digits.parse().ok()?)));
    match (numbered, path.extension()) {
        (Some((stem, number)), Some(extension)) => {
            let first = path.with_file_name(format!("{stem}.{}", extension.to_string_lossy()));
            (first, number)
        }
        _ => (path.to_path_buf(), 0),
    }
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

/// Decompresses what there is; true where it is all there and the checksum holds.
fn decompress(header: &ChunkHeader, data: &[u8], out: &mut Vec<u8>) -> bool {
    out.clear();
    let Ok(size) = usize::try_from(header.uncompressed_size) else {
        return false;
    };
    if size as u64 > RECORD_LIMIT {
        return false;
    }
    let whole = match header.compression.as_str() {
        "" => {
            out.extend_from_slice(data);
            true
        }
        "lz4" => {
            out.reserve(size);
            // A damaged stream must not grow beyond what the header promised.
            match lz4::Decoder::new(data) {
                Ok(decoder) => decoder.take(size as u64).read_to_end(out).is_ok(),
                Err(_) => false,
            }
        }
        _ => false,
    };
    whole && out.len() == size && (header.uncompressed_crc == 0 || crc32fast::hash(out) == header.uncompressed_crc)
}

enum Next {
    /// A record with this opcode; its body is in `body`.
    Record(u8),
    /// The file ends inside this chunk; what there is of it is in `body`.
    CutChunk,
    End,
}

/// A file as a sequence of records.
struct RecordFile {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    /// Start of the record in `body`, and of the next one.
    start: u64,
    position: u64,
    body: Vec<u8>,
    /// The closing magic was seen.
    whole: bool,
}

impl RecordFile {
    fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |source| ReadError::Io {
            path: path.to_path_buf(),
            source,
        };
        let mut file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut magic = Vec::new();
        (&mut file)
            .take(mcap::MAGIC.len() as u64)
            .read_to_end(&mut magic)
            .map_err(failed)?;
        if magic != mcap::MAGIC {
            return Err(ReadError::NotARecording {
                path: path.to_path_buf(),
                reason: format!("expected the first 8 bytes of an MCAP file, got {magic:02x?}"),
            });
        }
        Ok(Self {
            path: path.to_path_buf(),
            file: BufReader::with_capacity(1 << 16, file),
            length,
            start: 0,
            position: mcap::MAGIC.len() as u64,
            body: Vec::new(),
            whole: false,
        })
    }

    /// The metadata of the run; leaves the file at its first record.
    fn find_info(&mut self) -> Result<RunInfo, ReadError> {
        let begin = self.position;
        let mut reason = "it has no metadata of a run".to_string();
        let mut found = None;
        let mut ignored = Loss::default();
        while found.is_none() {
            match self.next_record(&mut ignored)? {
                Next::Record(op::METADATA) => match mcap::parse_record(op::METADATA, &self.body) {
                    Ok(Record::Metadata(m)) if m.name == RUN_METADATA => match info_of(&m.metadata) {
                        Ok(info) => found = Some(info),
                        Err(e) => reason = e.to_string(),
                    },
                    _ => {}
                },
                Next::Record(_) => {}
                Next::CutChunk | Next::End => break,
            }
        }
        self.seek(begin)?;
        self.whole = false;
        found.ok_or_else(|| ReadError::NotARecording {
            path: self.path.clone(),
            reason,
        })
    }

    fn next_record(&mut self, loss: &mut Loss) -> Result<Next, ReadError> {
        loop {
            self.start = self.position;
            self.body.clear();
            let left = self.length - self.position;
            let mut head = [0; RECORD_HEAD as usize];
            if left < RECORD_HEAD {
                let mut rest = Vec::new();
                self.fill(left, &mut rest)?;
                self.whole = rest == mcap::MAGIC;
                if !self.whole {
                    loss.bytes += left;
                }
                return Ok(Next::End);
            }
            self.file.read_exact(&mut head).map_err(|e| self.failed(e))?;
            self.position += RECORD_HEAD;
            let [opcode, length @ ..] = head;
            let length = u64::from_le_bytes(length);
            let left = left - RECORD_HEAD;
            if !(op::HEADER..=op::DATA_END).contains(&opcode) || length > RECORD_LIMIT || length > left {
                if opcode == op::CHUNK && length > left && length <= RECORD_LIMIT {
                    let mut body = std::mem::take(&mut self.body);
                    self.fill(left, &mut body)?;
                    self.body = body;
                    if self.chunk_head().is_some_and(|(header, _)| {
                        header
                            .compressed_size
                            .saturating_add(header.compression.len() as u64 + 40)
                            == length
                    }) {
                        return Ok(Next::CutChunk);
                    }
                }
                self.resynchronise(loss)?;
                continue;
            }
            let mut body = std::mem::take(&mut self.body);
            self.fill(length, &mut body)?;
            self.body = body;
            return Ok(Next::Record(opcode));
        }
    }

    /// Header and data of the chunk in `body`; `None` where its lengths contradict each other.
    fn chunk(&self) -> Option<(ChunkHeader, &[u8])> {
        let (header, data) = self.chunk_head()?;
        (header.compressed_size == data.len() as u64).then_some((header, data))
    }

    /// The same for a chunk that may be cut.
    fn chunk_head(&self) -> Option<(ChunkHeader, &[u8])> {
        let body = &self.body;
        let u64_at = |at: usize| Some(u64::from_le_bytes(*body.get(at..)?.first_chunk::<8>()?));
        let u32_at = |at: usize| Some(u32::from_le_bytes(*body.get(at..)?.first_chunk::<4>()?));
        let name_len = usize::try_from(u32_at(28)?).ok().filter(|&n| n <= 16)?;
        let name = body.get(32..32 + name_len)?;
        let header = ChunkHeader {
            message_start_time: u64_at(0)?,
            message_end_time: u64_at(8)?,
            uncompressed_size: u64_at(16)?,
            uncompressed_crc: u32_at(24)?,
            compression: std::str::from_utf8(name).ok()?.to_string(),
            compressed_size: u64_at(32 + name_len)?,
        };
        Some((header, &body[40 + name_len..]))
    }

    /// Goes on at the next place that looks like a chunk, behind the start of the record that failed.
    fn resynchronise(&mut self, loss: &mut Loss) -> Result<(), ReadError> {
        let failed_at = self.start;
        let mut from = failed_at + 1;
        let mut window = Vec::new();
        loop {
            self.seek(from)?;
            let left = self.length - from;
            self.fill(left.min(1 << 20), &mut window)?;
            let place = |at: usize| from + at as u64;
            let found = window
                .windows(LZ4_NAME.len())
                .enumerate()
                .filter(|(_, bytes)| *bytes == LZ4_NAME)
                .filter_map(|(at, _)| at.checked_sub(TO_COMPRESSION as usize))
                .find(|&at| window[at] == op::CHUNK);
            if let Some(at) = found {
                loss.bytes += place(at) - failed_at;
                return self.seek(place(at));
            }
            if window.len() as u64 == left {
                loss.bytes += self.length - failed_at;
                return self.seek(self.length);
            }
            // A chunk's head may straddle two windows.
            from += window.len() as u64 - (TO_COMPRESSION + LZ4_NAME.len() as u64);
        }
    }

    fn fill(&mut self, length: u64, into: &mut Vec<u8>) -> Result<(), ReadError> {
        into.clear();
        let read = (&mut self.file).take(length).read_to_end(into);
        let read = read.map_err(|e| self.failed(e))?;
        self.position += read as u64;
        Ok(())
    }

    fn seek(&mut self, to: u64) -> Result<(), ReadError> {
        self.position = to;
        let sought = self.file.seek(SeekFrom::Start(to));
        sought.map(|_| ()).map_err(|e| self.failed(e))
    }

    fn failed(&self, source: io::Error) -> ReadError {
        ReadError::Io {
            path: self.path.clone(),
            source,
        }
    }
}

fn info_of(map: &BTreeMap<String, String>) -> Result<RunInfo, InfoError> {
    RunInfo::from_map(map)
}
