//! Why a gateway ends, in words for the person who has to mend it.

use std::path::PathBuf;
use thetabus::bus::BusError;
use thiserror::Error;

/// Why a gateway cannot start or go on.
#[derive(Debug, Error)]
pub enum GatewayError {
    /// The bus of this host.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A host's name.
    #[error("host {0:?}: expected 1 to 32 characters of [a-z0-9_-]; name it by --host")]
    Host(String),
    /// The file with zenoh's configuration cannot be read.
    #[error("--config {}: {source}", path.display())]
    ConfigFile {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not what zenoh understands.
    #[error("--config {}: expected zenoh's configuration in JSON5, got: {problem}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// zenoh refuses.
    #[error("zenoh: {action}: {problem}")]
    Network {
        /// What was tried.
        action: &'static str,
        /// What zenoh says.
        problem: String,
    },
    /// Another gateway carries this robot.
    #[error(
        "robot {robot:?} in domain {domain:?} has a gateway already, process {pid}; a robot is either sent out of a domain or \
         brought into it, by one gateway: stop that one, or use another --domain; what comes from another host is passed on by \
         `thetabus-gateway route`"
    )]
    Way {
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
        /// The other gateway's process.
        pid: String,
    },
    /// No room for another robot.
    #[error("there are {0} robots already, as --max-robots says")]
    Full(usize),
    /// The system.
    #[error("{action}: {source}")]
    System {
        /// What was tried.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// Signals.
    #[error("signals cannot be handled: {0}")]
    Signals(String),
    /// A part of the load that did not do its work.
    #[error("load: {0}")]
    Load(String),
}

impl GatewayError {
    /// True if the command line or a file is to be mended.
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::Host(_) | Self::ConfigFile { .. } | Self::Config { .. } | Self::Bus(BusError::Name { .. })
        )
    }
}

/// Says what zenoh was doing.
pub fn network<E: std::fmt::Display>(action: &'static str) -> impl FnOnce(E) -> GatewayError {
    move |problem| GatewayError::Network {
        action,
        problem: words(problem),
    }
}

/// What zenoh says, without the lines of its source that it says it in: ` at /…/lib.rs:62.`
pub fn words(error: impl std::fmt::Display) -> String {
    let mut text = error.to_string();
    while let Some(end) = text.find(".rs:") {
        let Some(start) = text[..end].rfind(" at ") else { break };
        let rest = text[end + ".rs:".len()..].trim_start_matches(|c: char| c.is_ascii_digit());
        text = format!("{}{}", &text[..start], rest.strip_prefix('.').unwrap_or(rest));
    }
    text.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_words_of_zenoh_have_no_lines_of_its_source() {
        for (text, left) in [
            (
                "invalid port value at /srv/u/.cargo/registry/src/index-1/zenoh-1/src/lib.rs:62.",
                "invalid port value",
            ),
            (
                "Missing key. at /a b/utils.rs:532. at /a/unicast.rs:426. - Caused by no file at /c/d.rs:7.",
                "Missing key. - Caused by no file",
            ),
            (
                "bound to tcp/8.8.8.8:7447: [8.8.8.8:7447: no such address at /a/tcp.rs:61.] at /a/b.rs:338.",
                "bound to tcp/8.8.8.8:7447: [8.8.8.8:7447: no such address]",
            ),
            ("refused at once", "refused at once"),
            ("see x.rs:5", "see x.rs:5"),
        ] {
            assert_eq!(words(text), left);
        }
    }
}
