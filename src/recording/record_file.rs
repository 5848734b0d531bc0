//! Reads a possibly damaged file as a sequence of MCAP records.
//!
//! The records are framed here and not by the `mcap` crate's readers, because these stop at the
//! first error. A damaged record is skipped, and reading continues at the next chunk found.

use super::info::RunInfo;
use super::loss::{Loss, ReadError};
use super::names::RUN_METADATA;
use mcap::records::{ChunkHeader, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Longest accepted record \[bytes\]; a recorder's chunks are about 1 MiB, its metadata below 5
/// MiB.
const RECORD_LIMIT: u64 = 64 << 20;
/// Opcode and length of a record.
const RECORD_HEAD: u64 = 9;
/// From the start of a chunk record to the length of the name of its compression.
const TO_COMPRESSION: u64 = RECORD_HEAD + 3 * 8 + 4;
/// That name as stored in the file.
const LZ4_NAME: &[u8] = b"\x03\x00\x00\x00lz4";

/// Decompresses the available data; true if they are complete and the checksum is right.
pub(super) fn decompress(header: &ChunkHeader, data: &[u8], out: &mut Vec<u8>) -> bool {
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
            // A header may state any size; lz4 expands a byte to at most 255.
            out.reserve(size.min(data.len().saturating_mul(255)));
            // A damaged stream must not grow beyond the size in the header.
            match lz4::Decoder::new(data) {
                Ok(decoder) => decoder.take(size as u64).read_to_end(out).is_ok(),
                Err(_) => false,
            }
        }
        "zstd" => {
            // As above; the window is part of the output.
            match ruzstd::decoding::StreamingDecoder::new_with_max_window_size(data, RECORD_LIMIT) {
                Ok(decoder) => decoder.take(size as u64).read_to_end(out).is_ok(),
                Err(_) => false,
            }
        }
        _ => false,
    };
    whole && out.len() == size && (header.uncompressed_crc == 0 || crc32fast::hash(out) == header.uncompressed_crc)
}

/// A length, and as many bytes.
fn sized<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (length, behind) = rest.split_first_chunk::<4>()?;
    let (taken, left) = behind.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *rest = left;
    Some(taken)
}

fn text(rest: &mut &[u8]) -> Option<String> {
    Some(std::str::from_utf8(sized(rest)?).ok()?.to_owned())
}

/// The next item in a file.
pub(super) enum Next {
    /// A record with this opcode; its body is in `body`.
    Record(u8),
    /// The file ends inside this chunk; the available part is in `body`.
    CutChunk,
    End,
}

/// A file as a sequence of records.
pub(super) struct RecordFile {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    /// Start of the record in `body`, and of the next one.
    start: u64,
    position: u64,
    pub(super) body: Vec<u8>,
    /// The closing magic was seen.
    pub(super) whole: bool,
}

impl RecordFile {
    pub(super) fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |source| ReadError::Io {
            path: path.to_path_buf(),
            source,
        };
        crate::pipe::refuse_named_pipe(path).map_err(failed)?;
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

    /// Bytes of the file.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Bytes up to the next record.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// The metadata of the run; leaves the file at its first record.
    pub(super) fn find_info(&mut self) -> Result<RunInfo, ReadError> {
        let begin = self.position;
        let mut reason = "it has no metadata of a run".to_string();
        let mut found = None;
        let mut ignored = Loss::default();
        while found.is_none() {
            match self.next_record(&mut ignored)? {
                Next::Record(op::METADATA) => match self.metadata() {
                    Some((name, map)) if name == RUN_METADATA => match RunInfo::from_map(&map) {
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

    pub(super) fn next_record(&mut self, loss: &mut Loss) -> Result<Next, ReadError> {
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

    /// Name and pairs of the metadata record in `body`; `None` if its lengths are inconsistent. The
    /// `mcap` crate's parser allocates the stated length, which may be gigabytes in a damaged
    /// record.
    pub(super) fn metadata(&self) -> Option<(String, BTreeMap<String, String>)> {
        let mut rest = self.body.as_slice();
        let name = text(&mut rest)?;
        let mut pairs = sized(&mut rest)?;
        let mut map = BTreeMap::new();
        while !pairs.is_empty() {
            let (key, value) = (text(&mut pairs)?, text(&mut pairs)?);
            map.insert(key, value);
        }
        Some((name, map))
    }

    /// Channel and number of messages of the message index in `body`.
    pub(super) fn message_index(&self) -> Option<(u16, u64)> {
        let (channel, mut rest) = self.body.split_first_chunk::<2>()?;
        let entries = sized(&mut rest)?;
        // time and offset of each message
        Some((u16::from_le_bytes(*channel), entries.len() as u64 / 16))
    }

    /// Header and data of the chunk in `body`; `None` if its lengths are inconsistent.
    pub(super) fn chunk(&self) -> Option<(ChunkHeader, &[u8])> {
        let (header, data) = self.chunk_head()?;
        (header.compressed_size == data.len() as u64).then_some((header, data))
    }

    /// The same for a chunk that may be truncated.
    pub(super) fn chunk_head(&self) -> Option<(ChunkHeader, &[u8])> {
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

    /// Continues at the next position that looks like a chunk, after the start of the failed
    /// record.
    pub(super) fn resynchronise(&mut self, loss: &mut Loss) -> Result<(), ReadError> {
        let failed_at = self.start;
        let mut from = failed_at + 1;
        let mut window = Vec::new();
        loop {
            self.seek(from)?;
            let left = self.length - from;
            let wanted = left.min(1 << 20);
            self.fill(wanted, &mut window)?;
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
            // The last window, or a file that has become shorter meanwhile.
            if (window.len() as u64) < wanted || wanted == left {
                loss.bytes += self.length - failed_at;
                return self.seek(self.length);
            }
            // A chunk's head may extend over two windows.
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
