//! A file for many robots: `[[robot]]` entries, and settings shared by all of them.
//!
//! ```toml
//! [bus]
//! domain = "cell"
//!
//! [[robot]]
//! name = "welder"              # its topics are thetabus/welder/…
//! config = "robots/arm.toml"   # its own configuration, from this file's directory; settings of this file win
//!
//! [[robot]]
//! name = "axis"
//! count = 8                    # axis-1 to axis-8
//! ```

use super::Failure;
use crate::config::{CellRobot, Source};
use crate::pipe::{MAX_SETTINGS_BYTES, read_text};
use std::path::{Path, PathBuf};

/// Largest number of names listed in a message.
const LISTED: usize = 8;

/// The names of all robots in these files; `None` if no file has `[[robot]]` entries.
///
/// # Errors
/// If an entry is wrong.
pub(super) fn robots(files: &[PathBuf]) -> Result<Option<Vec<String>>, Failure> {
    for path in files {
        if let Some(robots) = read(path)? {
            return Ok(Some(robots.into_iter().map(|robot| robot.name).collect()));
        }
    }
    Ok(None)
}

/// The sources of one robot: these files; one with `[[robot]]` entries is replaced by the entry's
/// own file and, above it, the shared settings.
///
/// # Errors
/// If an entry is wrong, or the robot is not named or does not exist.
pub(super) fn sources(files: &[PathBuf], robot: Option<&str>) -> Result<Vec<Source>, Failure> {
    let mut sources = Vec::with_capacity(files.len());
    for path in files {
        match read(path)? {
            None => sources.push(Source::File(path.clone())),
            Some(robots) => {
                let own = pick(path, robots, robot)?;
                if let Some(config) = own.config {
                    readable(&config, &own.config_place)?;
                    sources.push(Source::File(config));
                }
                sources.push(Source::Shared(path.clone()));
            }
        }
    }
    Ok(sources)
}

/// Refuses a file of an entry that cannot be opened, at the place that names it.
fn readable(config: &Path, place: &str) -> Result<(), Failure> {
    let refused = |got: String| {
        Err(Failure::Usage(format!(
            "{place}: expected a configuration file, got {got}"
        )))
    };
    let unopened = |e: std::io::Error| refused(format!("{}, which cannot be opened: {e}", config.display()));
    match config.metadata() {
        Err(e) => unopened(e),
        Ok(found) if found.is_dir() => refused(format!("the directory {}", config.display())),
        Ok(found) if found.is_file() => std::fs::File::open(config).map(|_| ()).or_else(unopened),
        // Opening a pipe would wait for a writer; the loader refuses it.
        Ok(_) => Ok(()),
    }
}

fn pick(path: &Path, robots: Vec<CellRobot>, wanted: Option<&str>) -> Result<CellRobot, Failure> {
    let mut names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).take(LISTED).collect();
    if robots.len() > LISTED {
        names.push("…");
    }
    let names = names.join(", ");
    let index = match wanted {
        None if robots.len() == 1 => Some(0),
        None => {
            return Err(Failure::Usage(format!(
                "{}: it has {} robots ({names}): choose one by --robot; `identifier` and `load` take all of them",
                path.display(),
                robots.len()
            )));
        }
        Some(wanted) => robots.iter().position(|robot| robot.name == wanted),
    };
    let found = index.and_then(|index| robots.into_iter().nth(index));
    found.ok_or_else(|| {
        Failure::Usage(format!(
            "{}: no [[robot]] entry is called {:?}; it has {names}",
            path.display(),
            wanted.unwrap_or_default()
        ))
    })
}

/// The robots of a file; `None` for a file without entries, or one that cannot be read, which the
/// ordinary loader reports.
fn read(path: &Path) -> Result<Option<Vec<CellRobot>>, Failure> {
    // A pipe can be read only once, by the ordinary loader.
    if !path.is_file() {
        return Ok(None);
    }
    let text = read_text(path, MAX_SETTINGS_BYTES).unwrap_or_default();
    Ok(CellRobot::parse(&text, path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_missing_file_of_an_entry_is_told_with_file_line_and_key() {
        let dir = tempfile::tempdir().expect("a directory");
        let cell = dir.path().join("cell.toml");
        for (name, said) in [
            ("none.toml", "which cannot be opened: No such file"),
            (".", "got the directory"),
        ] {
            let text = format!("[[robot]]\nname = \"a\"\nconfig = \"{name}\"\n");
            std::fs::write(&cell, text).expect("written");
            let error = sources(std::slice::from_ref(&cell), None).expect_err(name).to_string();
            let place = format!("{}:3: robot[1].config: expected a configuration file, ", cell.display());
            assert!(error.contains(&place) && error.contains(said), "{error}");
        }
    }
}
