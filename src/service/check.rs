//! `thetabus config check`.

use super::{CommonArgs, Exit, Failure, logging};
use crate::config::{Config, Source};
use std::path::Path;

/// Loads a configuration file and says what is wrong or suspicious.
///
/// # Errors
/// Everything that is wrong with it.
pub fn config_check(file: &Path, set: &[String], common: &CommonArgs) -> Result<Exit, Failure> {
    let (catalog, source) = super::robot::source(file, &common.catalog)?
        .unwrap_or_else(|| (common.catalog.clone(), Source::File(file.to_owned())));
    let config = Config::load_for(&catalog, &[source], set)?;
    for warning in config.warnings() {
        logging::result(&format!("warning: {warning}"))?;
    }
    logging::result(&format!("{}: ok", file.display()))?;
    Ok(Exit::Done)
}
