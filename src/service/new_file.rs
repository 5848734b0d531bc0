//! Output files of commands: always new, never overwritten.

use super::Failure;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

/// Writes a file that does not exist yet.
///
/// # Errors
/// If it exists or cannot be written.
pub(super) fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    let written = File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|e| not_written(&whole(path).display(), &e))
}

/// Refuses a file that exists, before anything is computed for it.
///
/// # Errors
/// If it exists.
pub(super) fn refuse_existing(path: &Path) -> Result<(), Failure> {
    match path.exists() {
        true => Err(not_written(&path.display(), &ErrorKind::AlreadyExists.into())),
        false => Ok(()),
    }
}

/// The path from the root, for messages: a relative one says little without the working directory.
pub(super) fn whole(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Why a new file was not written.
pub(super) fn not_written(name: &dyn Display, e: &io::Error) -> Failure {
    match e.kind() {
        ErrorKind::AlreadyExists => Failure::Usage(format!(
            "{name} exists and is not written over; name another file or remove it"
        )),
        _ => Failure::Failed(format!("{name} cannot be written: {e}")),
    }
}
