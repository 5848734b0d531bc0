//! `thetabus config check`, `show` and `new`.

use super::new_file::write_new;
use super::{CommonArgs, Exit, Failure, logging};
use crate::config::{Config, Source};
use std::collections::BTreeSet;
use std::path::Path;

/// Loads a configuration file and says what is wrong or suspicious.
///
/// # Errors
/// Everything that is wrong with it.
pub fn config_check(file: &Path, set: &[String], common: &CommonArgs) -> Result<Exit, Failure> {
    let common = CommonArgs {
        config: vec![file.to_owned()],
        set: set.to_vec(),
        ..common.clone()
    };
    let mut told = BTreeSet::new();
    for config in common.load_robots_quietly(&[])? {
        for warning in config.warnings() {
            let warning = format!("warning: {warning}");
            // Robots that share a file share what is wrong with it.
            if told.insert(warning.clone()) {
                logging::result(&warning)?;
            }
        }
    }
    logging::result(&format!("{}: ok", file.display()))?;
    Ok(Exit::Done)
}

/// Prints a configuration that is built in, or the names of all.
///
/// # Errors
/// There is none of this name, or standard output cannot be written.
pub fn config_show(name: Option<&str>) -> Result<Exit, Failure> {
    match name {
        Some(name) => logging::result(built_in(name)?.trim_end())?,
        None => logging::result(&Config::embedded_names().collect::<Vec<_>>().join("\n"))?,
    }
    Ok(Exit::Done)
}

/// Writes a configuration that is built in to a file that does not exist yet.
///
/// # Errors
/// There is none of this name, or the file exists or cannot be written.
pub fn config_new(file: Option<&Path>, from: &str) -> Result<Exit, Failure> {
    let text = built_in(from)?;
    let file = file.map_or_else(|| Path::new(from).with_extension("toml"), Path::to_path_buf);
    write_new(&file, &text)?;
    logging::result(&format!(
        "{}: written; a configuration states only what differs from the defaults",
        file.display()
    ))?;
    Ok(Exit::Done)
}

fn built_in(name: &str) -> Result<String, Failure> {
    match Config::embedded(name) {
        Some(Source::Embedded { text, .. }) => Ok(text),
        _ => {
            let names: Vec<&str> = Config::embedded_names().collect();
            let message = format!("expected a configuration out of {}, got \"{name}\"", names.join(", "));
            Err(Failure::Usage(message))
        }
    }
}
