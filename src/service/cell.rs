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
use crate::config::Source;
use crate::pipe::{MAX_SETTINGS_BYTES, read_text};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Largest number of robots in one file.
const MAX_ROBOTS: u32 = 4096;
/// Largest number of names listed in a message.
const LISTED: usize = 8;

#[derive(Deserialize)]
struct File {
    robot: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    config: Option<PathBuf>,
    count: Option<u32>,
}

/// One robot of a file.
struct Robot {
    name: String,
    config: Option<PathBuf>,
}

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
                sources.extend(own.config.map(Source::File));
                sources.push(Source::Shared(path.clone()));
            }
        }
    }
    Ok(sources)
}

fn pick(path: &Path, robots: Vec<Robot>, wanted: Option<&str>) -> Result<Robot, Failure> {
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

/// The robots of a file; `None` for a file without entries, or one that is not TOML, which the
/// ordinary loader reports.
fn read(path: &Path) -> Result<Option<Vec<Robot>>, Failure> {
    // A pipe can be read only once, by the ordinary loader.
    if !path.is_file() {
        return Ok(None);
    }
    let text = read_text(path, MAX_SETTINGS_BYTES).unwrap_or_default();
    let is_cell = text
        .parse::<Table>()
        .is_ok_and(|table| matches!(table.get("robot"), Some(Value::Array(_))));
    if !is_cell {
        return Ok(None);
    }
    let problem = |problem: String| Failure::Usage(format!("{}: {problem}", path.display()));
    let file: File = toml::from_str(&text).map_err(|e| problem(e.to_string()))?;
    let base = path.parent().unwrap_or(Path::new(""));
    let (mut robots, mut seen) = (Vec::new(), BTreeSet::new());
    for entry in file.robot {
        let config = entry.config.map(|config| base.join(config));
        let names: Vec<String> = match entry.count {
            None => vec![entry.name],
            Some(count @ 1..=MAX_ROBOTS) => (1..=count).map(|i| format!("{}-{i}", entry.name)).collect(),
            Some(count) => {
                let name = entry.name;
                return Err(problem(format!(
                    "[[robot]] {name:?}: count is {count}, expected 1 to {MAX_ROBOTS}"
                )));
            }
        };
        for name in names {
            if !seen.insert(name.clone()) {
                return Err(problem(format!("[[robot]]: two entries give a robot called {name:?}")));
            }
            let config = config.clone();
            robots.push(Robot { name, config });
        }
    }
    if robots.is_empty() || robots.len() > MAX_ROBOTS as usize {
        let count = robots.len();
        return Err(problem(format!(
            "[[robot]]: {count} robots, expected 1 to {MAX_ROBOTS}"
        )));
    }
    Ok(Some(robots))
}
