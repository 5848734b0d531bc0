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
    refuse_directory(path)?;
    let problem = |e: io::Error| not_written(&whole(path).display(), &e);
    let mut file = File::create_new(path).map_err(problem)?;
    or_remove(path, file.write_all(text.as_bytes())).map_err(problem)
}

/// Removes a new file that could not be written whole: it would stand in the way of the next try.
pub(super) fn or_remove(path: &Path, written: io::Result<()>) -> io::Result<()> {
    written.inspect_err(|_| _ = std::fs::remove_file(path))
}

/// Refuses a file that exists, before anything is computed for it.
///
/// # Errors
/// If it exists.
pub(super) fn refuse_existing(path: &Path) -> Result<(), Failure> {
    refuse_directory(path)?;
    match path.exists() {
        true => Err(not_written(&path.display(), &ErrorKind::AlreadyExists.into())),
        false => Ok(()),
    }
}

/// Nobody should remove a directory for a file.
fn refuse_directory(path: &Path) -> Result<(), Failure> {
    match path.is_dir() {
        true => Err(Failure::Usage(format!(
            "{}: expected the name of a new file, got a directory",
            path.display()
        ))),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_nobody_is_told_to_remove_a_directory() {
        let dir = std::env::temp_dir();
        for refused in [write_new(&dir, "text"), refuse_existing(&dir)] {
            let said = refused.expect_err("a directory").to_string();
            assert!(
                said.ends_with("expected the name of a new file, got a directory"),
                "{said}"
            );
        }
    }
}
