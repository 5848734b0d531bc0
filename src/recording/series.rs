//! The files of a recording: names and numbers.

use super::info::RunInfo;
use super::record_file::RecordFile;
use std::fs;
use std::path::{Path, PathBuf};

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

/// The oldest existing file of a recording; if their number is limited, older ones have been
/// removed.
pub fn oldest_file(first: &Path) -> Option<PathBuf> {
    existing_files(first).into_iter().next().map(|(_, path)| path)
}

/// The existing files of a recording, with their numbers.
pub(super) fn existing_files(first: &Path) -> Vec<(u32, PathBuf)> {
    let directory = match first.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut found: Vec<(u32, PathBuf)> = fs::read_dir(directory)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Some((number_within(first, &entry.path())?, entry.path())))
        .collect();
    found.sort();
    found
}

/// Number of a file in the recording whose first file is `first`; `None` for other files.
///
/// `run_20260801.mcap` could belong to the recording `run.mcap`, but may also be the first file of
/// another one: its metadata decide, and if they are missing or unreadable, its name.
fn number_within(first: &Path, path: &Path) -> Option<u32> {
    if path.file_name() == first.file_name() {
        return Some(0);
    }
    let (_, number) = split_number(path)?;
    if numbered(first, number).file_name() != path.file_name() {
        return None;
    }
    let info = RecordFile::open(path).and_then(|mut file| file.find_info());
    match info.ok().and_then(|info| info.file_number) {
        Some(own) if own != number => None,
        _ => Some(number),
    }
}

/// The first file of the recording to which the file at `path` belongs, and its number.
pub(super) fn first_file(path: &Path, info: &RunInfo) -> (PathBuf, u32) {
    let alone = (path.to_path_buf(), 0);
    match (info.file_number, split_number(path)) {
        (Some(0), _) | (_, None) => alone,
        // Recordings of earlier versions do not state a number, so the name decides.
        (None, Some(_)) if numbered(path, 1).exists() => alone,
        (None, Some(by_name)) => by_name,
        // A file with another name than the recorder's is read alone.
        (Some(number), Some(by_name)) if by_name.1 == number => by_name,
        (Some(_), Some(_)) => alone,
    }
}

/// `run_0003.mcap` is number 3 of `run.mcap` by its name.
fn split_number(path: &Path) -> Option<(PathBuf, u32)> {
    let stem = path.file_stem()?.to_string_lossy();
    let (stem, digits) = stem.rsplit_once('_')?;
    if digits.len() < 4 || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let mut name = stem.to_owned();
    if let Some(extension) = path.extension() {
        name.push('.');
        name.push_str(&extension.to_string_lossy());
    }
    Some((path.with_file_name(name), digits.parse().ok()?))
}
