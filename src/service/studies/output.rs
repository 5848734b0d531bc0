//! Output of a study's tables, and the command that generates them.

use crate::service::{Failure, logging};
use std::path::Path;

/// Writes a text to a file and reports it; to standard output without a file.
///
/// # Errors
/// If the file or standard output cannot be written.
pub(super) fn write(out: Option<&Path>, text: &str) -> Result<(), Failure> {
    let Some(file) = out else {
        return logging::result(text.trim_end());
    };
    std::fs::write(file, text).map_err(|error| Failure::Failed(format!("{}: {error}", file.display())))?;
    logging::result(&format!("{}: written", file.display()))
}

/// The beginning of the command line of the study with this name.
pub(super) fn command(name: &str) -> String {
    format!("cargo run --release --features studies --bin studies -- {name}")
}
