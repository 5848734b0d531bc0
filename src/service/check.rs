//! `thetabus config check`.

use super::{CommonArgs, Exit, Failure, logging};
use crate::config::{Config, Source};
use std::path::Path;

/// Loads a configuration file and says what is wrong or suspicious.
///
/// # Errors
/// Everything that is wrong with it.
pub fn config_check(file: &Path, set: &[String], common: &CommonArgs) -> Result<Exit, Failure> {
    let config = Config::load_for(&common.catalog, &[Source::File(file.to_owned())], set)?;
    for warning in config.warnings() {
        logging::result(&format!("warning: {warning}"))?;
    }
    logging::result(&format!("{}: ok", file.display()))?;
    Ok(Exit::Done)
}
