//! How a program ends, and why it could not do its work.

use crate::bus::BusError;
use crate::config::ConfigError;
use crate::runner::RunError;
use thiserror::Error;

/// How a program ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All is well.
    Done,
    /// Finished, but data were lost.
    DataLoss,
    /// Asked to end by a signal before the stream had ended. That is what a service is for and
    /// counts as done; but a launcher that has not asked for it is told.
    Interrupted,
}

/// Why a program could not do its work.
#[derive(Debug, Error)]
pub enum Failure {
    /// The command line or the configuration is wrong.
    #[error("{0}")]
    Usage(String),
    /// Something else.
    #[error("{0}")]
    Failed(String),
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::Usage(error.to_string())
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Bus(error) => error.into(),
            error => Self::Failed(error.to_string()),
        }
    }
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Self {
        match error {
            BusError::Name { .. } | BusError::SocketPath { .. } | BusError::Machine { .. } => {
                Self::Usage(error.to_string())
            }
            error => Self::Failed(error.to_string()),
        }
    }
}
