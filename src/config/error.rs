//! Errors of a configuration, with messages that suffice to fix them without a manual.

use std::fmt;
use std::path::Path;

/// Where a value was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// In the defaults that are compiled in.
    Default,
    /// In a file, at this line (counted from 1).
    File {
        /// The file's name as given.
        name: String,
        /// Line of the key, 0 for the whole file.
        line: usize,
    },
    /// In a `--set` argument, quoted as given.
    Argument(String),
    /// In an option of the command line that stands for a key: `--speed fast`.
    Option(String),
}

impl Origin {
    /// A whole file.
    pub(super) fn whole(path: &Path) -> Self {
        Self::File {
            name: path.display().to_string(),
            line: 0,
        }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => write!(f, "built-in default"),
            Self::File { name, line: 0 } => write!(f, "{name}"),
            Self::File { name, line } => write!(f, "{name}:{line}"),
            Self::Argument(text) => write!(f, "--set {text}"),
            Self::Option(text) => f.write_str(text),
        }
    }
}

/// One error or suspicious setting.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where it was written.
    pub origin: Origin,
    /// Full key, `estimator.block_len`; empty if it concerns no key.
    pub key: String,
    /// What was expected and what was given, with a hint if there is one.
    pub message: String,
    /// The value is legal but has no effect, because it belongs to a choice that was not made.
    pub is_without_effect: bool,
}

impl Problem {
    /// The usual form: expected this, got that.
    pub(super) fn expected(origin: Origin, key: &str, expected: impl fmt::Display, got: impl fmt::Display) -> Self {
        Self {
            origin,
            key: key.to_owned(),
            message: format!("expected {expected}, got {got}"),
            is_without_effect: false,
        }
    }

    /// A problem with a free message.
    pub(super) fn new(origin: Origin, key: &str, message: impl Into<String>) -> Self {
        Self {
            origin,
            key: key.to_owned(),
            message: message.into(),
            is_without_effect: false,
        }
    }

    /// The same, of this file if it is about a default: what the file states does not go with it.
    #[cfg(feature = "robot")]
    pub(super) fn or_in(mut self, path: &Path) -> Self {
        if self.origin == Origin::Default {
            self.origin = Origin::whole(path);
        }
        self
    }

    /// A value that has no effect, with the reason.
    pub(super) fn without_effect(origin: Origin, key: &str, reason: &str) -> Self {
        Self {
            is_without_effect: true,
            ..Self::new(origin, key, format!("has no effect {reason}"))
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.key.is_empty() {
            write!(f, "{}: {}", self.origin, self.message)
        } else {
            write!(f, "{}: {}: {}", self.origin, self.key, self.message)
        }
    }
}

/// All errors of a configuration, one line each.
///
/// A program then ends with exit code 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", lines(.problems))]
pub struct ConfigError {
    /// At least one problem, in the order of the sources.
    pub problems: Vec<Problem>,
}

fn lines(problems: &[Problem]) -> String {
    problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}
