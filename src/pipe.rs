//! Named pipes in the place of files.

use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

/// Refuses a named pipe: to open one waits for a writer, and no signal ends that wait. What a shell
/// passes as `<(…)` is a pipe below /dev or /proc that has its writer already, and is let through.
///
/// # Errors
/// A named pipe elsewhere. What cannot be looked at is left to the caller, who opens it next.
pub(crate) fn refuse_named_pipe(path: &Path) -> io::Result<()> {
    let is_pipe = std::fs::metadata(path).is_ok_and(|found| found.file_type().is_fifo());
    match is_pipe && !path.starts_with("/dev") && !path.starts_with("/proc") {
        true => Err(io::Error::other("expected a file, got a named pipe")),
        false => Ok(()),
    }
}
