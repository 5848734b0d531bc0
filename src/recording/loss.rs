//! Losses when reading a recording, and errors.

use std::io;
use std::path::PathBuf;

/// Losses of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loss {
    /// Files without a proper end: truncated, or the recorder was killed.
    pub unfinished_files: u64,
    /// Chunks with a wrong checksum or damaged compression.
    pub damaged_chunks: u64,
    /// Messages known to be missing: counted by the index after a damaged chunk, or not decodable.
    pub messages: u64,
    /// Bytes that could not be read as records.
    pub bytes: u64,
    /// Samples that did not reach the recorder, by its own count.
    pub samples_not_recorded: u64,
}

impl Loss {
    /// True if nothing was lost.
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
#[non_exhaustive]
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
