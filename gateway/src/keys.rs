//! The key space: `thetabus/<host>/<robot>/<topic>`.

use crate::error::GatewayError;
use thetabus::bus::{Topic, is_name};

/// First part of every key.
const ROOT: &str = "thetabus";
/// Last part of a robot's liveliness token.
pub const ALIVE: &str = "alive";
/// Last part of the key of a schema, behind the topic.
pub const SCHEMA: &str = "schema";

/// A host on the network: `[a-z0-9_-]{1,32}`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Host(String);

impl Host {
    /// A host of this name.
    ///
    /// # Errors
    /// The name has other characters, none, or more than 32.
    pub fn new(name: &str) -> Result<Self, GatewayError> {
        match is_name(name) {
            true => Ok(Self(name.to_owned())),
            false => Err(GatewayError::Host(name.to_owned())),
        }
    }

    /// This host, by the name that the system has: in lower case, `-` for each other character.
    ///
    /// # Errors
    /// The system has no name.
    pub fn own() -> Result<Self, GatewayError> {
        let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let legal = |c: char| {
            if c.is_ascii_alphanumeric() || c == '_' {
                c.to_ascii_lowercase()
            } else {
                '-'
            }
        };
        let name: String = name.trim().chars().map(legal).take(32).collect();
        Self::new(&name)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.0
    }
}

/// A robot as the command line has it.
///
/// # Errors
/// What was expected.
pub fn robot(text: &str) -> Result<String, String> {
    match is_name(text) {
        true => Ok(text.to_owned()),
        false => Err("expected 1 to 32 characters of [a-z0-9_-]".to_owned()),
    }
}

/// Key of a robot's topic, of its token, or of all that it has: `last` is the topic's name,
/// [`ALIVE`], or `*`. `host` and `robot` may be `*`.
pub fn key(host: &str, robot: &str, last: &str) -> String {
    format!("{ROOT}/{host}/{robot}/{last}")
}

/// Host, robot and the rest of a key; `None` if it is no key of ours.
pub fn parts(key: &str) -> Option<(&str, &str, &str)> {
    let (host, rest) = key.strip_prefix(ROOT)?.strip_prefix('/')?.split_once('/')?;
    let (robot, last) = rest.split_once('/')?;
    (is_name(host) && is_name(robot)).then_some((host, robot, last))
}

/// Topics that leave a domain, samples last.
pub const CARRIED: [Topic; 5] = [
    Topic::Description,
    Topic::Estimate,
    Topic::Status,
    Topic::Journal,
    Topic::Sample,
];

/// The topic of this name, if it is one that leaves a domain.
pub fn topic(name: &str) -> Option<Topic> {
    CARRIED.into_iter().find(|topic| topic.name() == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_key_gives_its_parts_and_foreign_keys_give_none() {
        assert_eq!(
            parts(&key("cell-1", "arm", "estimate")),
            Some(("cell-1", "arm", "estimate"))
        );
        assert_eq!(
            parts("thetabus/a/b/estimate/schema"),
            Some(("a", "b", "estimate/schema"))
        );
        for foreign in [
            "thetabus/a/b",
            "other/a/b/c",
            "thetabus/A/b/c",
            "thetabus/*/b/c",
            "thetabus//b/c",
            "",
        ] {
            assert_eq!(parts(foreign), None, "{foreign}");
        }
        assert_eq!(topic("journal"), Some(Topic::Journal));
        assert_eq!(topic("control"), None);
    }

    #[test]
    fn fault_names_that_a_key_cannot_hold_are_refused() {
        assert!(Host::own().is_ok());
        for name in ["", "a/b", "*", "Cell", "a b", &"x".repeat(33)] {
            let error = Host::new(name).expect_err("no such host").to_string();
            assert!(error.contains("[a-z0-9_-]") && error.contains("--host"), "{error}");
        }
    }
}
