//! Metadata of a recording: sufficient to read, identify again and report without any other file.

use crate::messages::{MAX_DERIVED, SCHEMA_VERSION};
use crate::model::{MAX_JOINTS, MAX_PARAMS};
use crate::node::monitor::Label;
use crate::words::cut;
use std::collections::BTreeMap;

/// The metadata of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RunInfo {
    /// Schema version of the messages; a recorder replaces it with its own.
    pub schema: u32,
    /// Identifies a recording; the same in all its files.
    pub recording_id: String,
    /// Number of this file in its recording, from 0; a recorder replaces it with its own. `None` in
    /// old recordings.
    pub file_number: Option<u32>,
    /// Robot name.
    pub robot: String,
    /// Model name.
    pub model: String,
    /// Hash of the model.
    pub model_hash: u64,
    /// Hash of the configuration that determines estimates.
    pub config_hash: u64,
    /// True if the configured plant was recorded, so its true values are known.
    pub simulated: bool,
    /// The whole configuration, TOML.
    pub config_toml: String,
    /// Number of joints.
    pub joints: usize,
    /// Unit of a position: `rad` or `m`.
    pub position_unit: String,
    /// Unit of the input: `V`.
    pub input_unit: String,
    /// Names of the equations.
    pub equations: Vec<String>,
    /// Parameters, in the order of θ.
    pub parameters: Vec<Label>,
    /// Derived values, in the order of the message.
    pub derived: Vec<Label>,
    /// Time of day at which CLOCK_MONOTONIC was 0, since 1970 \[ns\]; 0 in old recordings.
    pub clock_epoch_ns: u64,
    /// True if samples are also recorded as `sensor_msgs/msg/JointState`.
    pub joint_states: bool,
    /// The first form of a recording: sets of parameters are words instead of one bool per
    /// parameter, and log times are stream times.
    pub first_form: bool,
}

/// Schema versions that this program reads. In version 2 a set of parameters has one word;
/// everything else is the same.
const READABLE: [u32; 2] = [2, SCHEMA_VERSION];
/// Longest configuration in a recording \[bytes\]: the limit of a configuration with its setpoints.
const MAX_CONFIG_BYTES: usize = 4 << 20;
/// Longest other value \[bytes\]: 128 names with their units are far shorter.
const MAX_VALUE_BYTES: usize = 1 << 16;
/// Longest part of a value shown in an error \[characters\].
const SHOWN: usize = 60;
/// Longest name or unit \[bytes\].
const MAX_NAME_BYTES: usize = 128;

/// Why metadata cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InfoError {
    /// A key is missing.
    #[error("the metadata has no `{0}`")]
    Missing(&'static str),
    /// The messages have another schema.
    #[error(
        "`schema_version`: expected 2 or {SCHEMA_VERSION}, got {found}: thetabus {writer} wrote it; read it with that version"
    )]
    Schema {
        /// Schema version of the recording.
        found: String,
        /// Version of the program that wrote it.
        writer: String,
    },
    /// A value does not fit its key.
    #[error("metadata `{key}`: expected {expected}, got {got:?}")]
    Invalid {
        /// The key.
        key: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What was found.
        got: String,
    },
}

impl RunInfo {
    /// As the name-value pairs of a metadata record.
    pub(super) fn to_map(&self) -> BTreeMap<String, String> {
        let file_number = self.file_number.map(|number| ("file_number", number.to_string()));
        [
            ("thetabus_version", env!("CARGO_PKG_VERSION").to_string()),
            ("schema_version", SCHEMA_VERSION.to_string()),
            ("form", if self.first_form { "1" } else { "2" }.to_string()),
            ("clock_epoch_ns", self.clock_epoch_ns.to_string()),
            ("joint_states", self.joint_states.to_string()),
            ("recording_id", self.recording_id.clone()),
            ("robot", self.robot.clone()),
            ("model", self.model.clone()),
            ("model_hash", format!("{:016x}", self.model_hash)),
            ("config_hash", format!("{:016x}", self.config_hash)),
            ("config_toml", self.config_toml.clone()),
            ("simulated", self.simulated.to_string()),
            ("joints", self.joints.to_string()),
            ("position_unit", self.position_unit.clone()),
            ("input_unit", self.input_unit.clone()),
            ("equations", self.equations.join("\n")),
            ("parameters", labels_to_text(&self.parameters)),
            ("derived", labels_to_text(&self.derived)),
        ]
        .into_iter()
        .chain(file_number)
        .map(|(key, value)| (key.to_string(), value))
        .collect()
    }

    /// From the name-value pairs of a metadata record.
    ///
    /// # Errors
    /// If a key is missing, has another schema version or a value out of its range.
    pub(super) fn from_map(map: &BTreeMap<String, String>) -> Result<Self, InfoError> {
        let get = |key: &'static str| {
            let value = map.get(key).ok_or(InfoError::Missing(key))?;
            let limit = if key == "config_toml" {
                MAX_CONFIG_BYTES
            } else {
                MAX_VALUE_BYTES
            };
            match value.len() <= limit {
                true => Ok(value),
                false => Err(InfoError::invalid(key, "a shorter text", value)),
            }
        };
        let text = |key| get(key).cloned();
        let hash = |key: &'static str| {
            let got = get(key)?;
            u64::from_str_radix(got, 16).map_err(|_| InfoError::invalid(key, "16 hexadecimal digits", got))
        };
        let version = get("schema_version")?;
        let schema = version.parse().ok().filter(|found| READABLE.contains(found));
        let schema = schema.ok_or_else(|| {
            let writer = map.get("thetabus_version").map_or("unknown", String::as_str);
            InfoError::Schema {
                found: cut(version, SHOWN),
                writer: cut(writer, SHOWN),
            }
        })?;
        let joints = get("joints")?;
        let joints = joints
            .parse()
            .ok()
            .filter(|n| (1..=MAX_JOINTS).contains(n))
            .ok_or_else(|| InfoError::invalid("joints", "1 to 8", joints))?;
        let simulated = get("simulated")?;
        let simulated = simulated
            .parse()
            .map_err(|_| InfoError::invalid("simulated", "true or false", simulated))?;
        let first_form = match map.get("form").map(String::as_str) {
            None | Some("1") => true,
            Some("2") => false,
            Some(got) => return Err(InfoError::invalid("form", "1 or 2", got)),
        };
        let clock_epoch_ns = match map.get("clock_epoch_ns") {
            None => 0,
            Some(got) => got
                .parse()
                .map_err(|_| InfoError::invalid("clock_epoch_ns", "nanoseconds since 1970", got))?,
        };
        let file_number = match map.get("file_number") {
            None => None,
            Some(got) => {
                let number = got.parse().ok();
                Some(number.ok_or_else(|| InfoError::invalid("file_number", "0 to 4294967295", got))?)
            }
        };
        let info = Self {
            clock_epoch_ns,
            file_number,
            joint_states: map.get("joint_states").is_some_and(|value| value == "true"),
            first_form,
            schema,
            simulated,
            recording_id: text("recording_id")?,
            robot: text("robot")?,
            model: text("model")?,
            model_hash: hash("model_hash")?,
            config_hash: hash("config_hash")?,
            config_toml: text("config_toml")?,
            joints,
            position_unit: text("position_unit")?,
            input_unit: text("input_unit")?,
            equations: get("equations")?.lines().map(String::from).collect(),
            parameters: labels_from_text("parameters", get("parameters")?)?,
            derived: labels_from_text("derived", get("derived")?)?,
        };
        info.check()?;
        Ok(info)
    }

    /// Checks that the counts fit the messages.
    ///
    /// # Errors
    /// If they do not fit.
    pub fn check(&self) -> Result<(), InfoError> {
        let counts = [
            ("joints", self.joints, MAX_JOINTS, "1 to 8"),
            ("equations", self.equations.len(), MAX_JOINTS, "at most 8"),
            ("parameters", self.parameters.len(), MAX_PARAMS, "at most 128"),
            ("derived", self.derived.len(), MAX_DERIVED, "at most 32"),
        ];
        for (key, count, limit, expected) in counts {
            if count > limit || (key == "joints" && count == 0) {
                return Err(InfoError::invalid(key, expected, &count.to_string()));
            }
        }
        // They are shown on terminals and pages, and are column names of files.
        let labels = |labels: &'_ [Label]| -> Vec<String> {
            let words = labels.iter().flat_map(|label| [&label.name, &label.unit]);
            words.cloned().collect()
        };
        let words = [
            ("robot", vec![self.robot.clone()]),
            ("model", vec![self.model.clone()]),
            ("position_unit", vec![self.position_unit.clone()]),
            ("input_unit", vec![self.input_unit.clone()]),
            ("equations", self.equations.clone()),
            ("parameters", labels(&self.parameters)),
            ("derived", labels(&self.derived)),
        ];
        for (key, words) in words {
            let bad = |word: &&String| word.len() > MAX_NAME_BYTES || word.chars().any(char::is_control);
            if let Some(word) = words.iter().find(bad) {
                let expected = "at most 128 bytes without control characters";
                return Err(InfoError::invalid(key, expected, word));
            }
        }
        Ok(())
    }
}

impl InfoError {
    fn invalid(key: &'static str, expected: &'static str, got: &str) -> Self {
        Self::Invalid {
            key,
            expected,
            got: cut(got, SHOWN),
        }
    }
}

fn labels_to_text(labels: &[Label]) -> String {
    let lines: Vec<String> = labels.iter().map(|l| format!("{}\t{}", l.name, l.unit)).collect();
    lines.join("\n")
}

fn labels_from_text(key: &'static str, text: &str) -> Result<Vec<Label>, InfoError> {
    text.lines()
        .map(|line| {
            let (name, unit) = line
                .split_once('\t')
                .ok_or_else(|| InfoError::invalid(key, "a name, a tab and a unit on each line", line))?;
            Ok(Label::new(name, unit))
        })
        .collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The arm: two joints, nine parameters, one derived value.
    pub(crate) fn arm() -> RunInfo {
        let label = |name: String, unit: &str| Label {
            name,
            unit: unit.to_string(),
        };
        RunInfo {
            schema: SCHEMA_VERSION,
            recording_id: "1-2".into(),
            file_number: Some(3),
            robot: "arm".into(),
            model: "manipulator".into(),
            model_hash: 0x1234,
            config_hash: u64::MAX,
            simulated: true,
            config_toml: "[plant]\nduration_s = 170.0 # \"Δ\"\n".into(),
            joints: 2,
            position_unit: "rad".into(),
            input_unit: "V".into(),
            equations: vec!["joint_1".into(), "joint_2".into()],
            parameters: (1..=9).map(|i| label(format!("theta_{i}"), "V s/rad")).collect(),
            derived: vec![label("mass_2".into(), "kg")],
            clock_epoch_ns: 1_700_000_000_123_456_789,
            joint_states: true,
            first_form: false,
        }
    }

    #[test]
    fn prop_metadata_comes_back_as_it_was() {
        let info = arm();
        assert_eq!(RunInfo::from_map(&info.to_map()), Ok(info));
    }

    #[test]
    fn fault_metadata_that_does_not_fit_is_refused_with_its_key() {
        let whole = arm().to_map();
        for key in ["robot", "joints", "parameters", "schema_version"] {
            let mut map = whole.clone();
            map.remove(key);
            assert_eq!(RunInfo::from_map(&map), Err(InfoError::Missing(key)));
        }
        for (key, value) in [
            ("joints", "9"),
            ("joints", "-1"),
            ("schema_version", "1"),
            ("schema_version", "4"),
            ("form", "3"),
            ("file_number", "-1"),
            ("clock_epoch_ns", "yesterday"),
            ("model_hash", "no"),
            ("parameters", "name without unit"),
        ] {
            let mut map = whole.clone();
            map.insert(key.into(), value.into());
            let error = RunInfo::from_map(&map).unwrap_err().to_string();
            assert!(error.contains(key) && error.contains(value), "{error}");
        }
    }
}
