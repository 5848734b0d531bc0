//! Names within a recording, and of the files that it consists of.

use std::fs;
use std::path::{Path, PathBuf};

/// Channel ids; fixed, so that a file whose definitions are damaged can still be read.
pub(super) mod channel {
    pub(in super::super) const SAMPLE: u16 = 1;
    pub(in super::super) const ESTIMATE: u16 = 2;
    pub(in super::super) const STATUS: u16 = 3;
    pub(in super::super) const RECORDER: u16 = 4;
    pub(in super::super) const JOINT_STATES: u16 = 5;
}

/// Name of the metadata record with [`RunInfo`].
pub(super) const RUN_METADATA: &str = "thetabus_run";
/// Name of the metadata records with what the identifier was told.
pub(super) const JOURNAL_METADATA: &str = "thetabus_journal";
/// Name of the metadata records with the clock of the streams behind them.
pub(super) const CLOCK_METADATA: &str = "thetabus_clock";
/// Name of the metadata record that a finished file ends with.
pub(super) const END_METADATA: &str = "thetabus_end";

/// `run.mcap`, `run_0001.mcap`, `run_0002.mcap` …
pub(super) fn numbered(first: &Path, number: u32) -> PathBuf {
    if number == 0 {
        return first.to_path_buf();
    }
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    let mut name = format!("{stem}_{number:04}");
    if let Some(extension) = first.extension() {
        name.push('.');
        name.push_str(&extension.to_string_lossy());
    }
    first.with_file_name(name)
}

/// The first file of a recording that is still there: the oldest ones are removed if their
/// number is limited.
pub fn oldest_file(first: &Path) -> Option<PathBuf> {
    existing_files(first).into_iter().next().map(|(_, path)| path)
}

/// The files of a recording that are there, with their numbers.
pub(super) fn existing_files(first: &Path) -> Vec<(u32, PathBuf)> {
    let directory = match first.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut found: Vec<(u32, PathBuf)> = fs::read_dir(directory)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let (of, number) = series(&entry.path());
            (of.file_name() == first.file_name()).then(|| (number, entry.path()))
        })
        .collect();
    found.sort();
    found
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
