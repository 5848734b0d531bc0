//! The `[[robot]]` entries of a file for many robots, read like any other configuration.

use super::error::{ConfigError, Origin, Problem};
use super::layers::{Layers, MAX_PROBLEMS};
use super::schema::{CELL, MAX_ROBOTS, ROBOTS};
use crate::words::is_name;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// One robot of a file with `[[robot]]` entries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellRobot {
    /// Its name, the only one in the file.
    pub name: String,
    /// Its own configuration.
    pub config: Option<PathBuf>,
    /// File, line and key that name it.
    pub config_place: String,
}

impl CellRobot {
    /// The robots of `text`, the content of the file `path`; `None` for a file without entries, or
    /// one that is not TOML, which [`Config::load`](super::Config::load) reports.
    ///
    /// # Errors
    /// All errors of the entries, and of single keys that the robots share.
    pub fn parse(text: &str, path: &Path) -> Result<Option<Vec<Self>>, ConfigError> {
        let entries = |table: &DeTable<'_>| Some(table.get(ROBOTS)?.get_ref().as_array()?.len());
        let Some(entries) = DeTable::parse(text).ok().and_then(|table| entries(table.get_ref())) else {
            return Ok(None);
        };
        let mut layers = Layers::of(&CELL);
        layers.text(&path.display().to_string(), text, None);
        let mut problems = std::mem::take(&mut layers.problems);
        let (robots, mut more) = robots(entries, path, &layers);
        if let Some(untold) = more.len().checked_sub(MAX_PROBLEMS).filter(|untold| *untold > 0) {
            more.truncate(MAX_PROBLEMS);
            let message = format!("and {untold} more problems");
            more.push(Problem::new(Origin::whole(path), "", message));
        }
        problems.append(&mut more);
        match problems.is_empty() {
            true => Ok(Some(robots)),
            false => Err(ConfigError { problems }),
        }
    }
}

/// The robots of the entries whose keys are right, and what is wrong with their names and number.
fn robots(entries: usize, path: &Path, layers: &Layers) -> (Vec<CellRobot>, Vec<Problem>) {
    let base = path.parent().unwrap_or(Path::new(""));
    let (mut robots, mut problems, mut seen) = (Vec::new(), Vec::new(), BTreeMap::new());
    if entries == 0 {
        let expected = format!("1 to {MAX_ROBOTS} robots");
        problems.push(Problem::expected(layers.origin(ROBOTS), ROBOTS, expected, "none"));
    }
    for entry in 1..=entries {
        let value = |key: &str| layers.inner(&format!("{ROBOTS}[{entry}].{key}"));
        let Some((name, origin)) = value("name").and_then(|(name, origin)| Some((name.as_str()?, origin))) else {
            continue;
        };
        let config = value("config").and_then(|(config, _)| Some(base.join(config.as_str()?)));
        let config_place = match value("config") {
            Some((_, origin)) => format!("{origin}: {ROBOTS}[{entry}].config"),
            None => String::new(),
        };
        let names: Vec<String> = match value("count").and_then(|(count, _)| count.as_integer()) {
            None => vec![name.to_owned()],
            Some(count) => (1..=count).map(|i| format!("{name}-{i}")).collect(),
        };
        let mut wrong = |expected: String, got: String| {
            let key = format!("{ROBOTS}[{entry}].name");
            problems.push(Problem::expected(origin.clone(), &key, expected, got));
        };
        if let Some(long) = names.last().filter(|name| !is_name(name)) {
            let expected = "a name of at most 32 characters with its number".to_owned();
            wrong(expected, format!("{long:?}"));
        }
        if let Some((name, other)) = names.iter().find_map(|name| Some((name, seen.get(name)?))) {
            wrong(format!("another name than in {ROBOTS}[{other}]"), format!("{name:?}"));
        }
        for name in names {
            seen.insert(name.clone(), entry);
            robots.push(CellRobot {
                name,
                config: config.clone(),
                config_place: config_place.clone(),
            });
        }
        if robots.len() as u64 > MAX_ROBOTS {
            wrong(format!("1 to {MAX_ROBOTS} robots in a file"), "more".to_owned());
            break;
        }
    }
    (robots, problems)
}
