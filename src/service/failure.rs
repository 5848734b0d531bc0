//! How a program ends, and why it failed.

use crate::bus::BusError;
use crate::config::ConfigError;
use crate::runner::RunError;
use thiserror::Error;

/// How a program ended without failing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Everything succeeded.
    Done,
    /// Finished, but data were lost.
    DataLoss,
    /// A signal asked it to end before the stream had ended. For a service that is normal and
    /// counts as done; a launcher that did not send the signal must know.
    Interrupted,
}

/// Why a program failed.
#[derive(Debug, Error)]
pub enum Failure {
    /// The command line or the configuration is wrong.
    #[error("{0}")]
    Usage(String),
    /// Something else.
    #[error("{0}")]
    Failed(String),
}

impl Failure {
    /// A wrong command line or configuration, in the words of an error.
    pub(super) fn usage(error: impl std::fmt::Display) -> Self {
        Self::Usage(error.to_string())
    }
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
