//! Errors and suspicious settings of a configuration, collected while it is built.

use super::error::Problem;
use super::layers::Layers;
use crate::sim::ARM_JOINTS;

/// The findings while a configuration is built, with the origin of each key.
pub(super) struct Check<'a> {
    pub(super) layers: &'a Layers,
    pub(super) problems: Vec<Problem>,
    pub(super) warnings: Vec<Problem>,
}

impl Check<'_> {
    pub(super) fn wrong(&mut self, key: &str, message: impl Into<String>) {
        self.problems.push(Problem::new(self.layers.origin(key), key, message));
    }

    /// Of contradicting keys, the first one that was stated.
    pub(super) fn culprit<'k>(&self, keys: &[&'k str]) -> &'k str {
        let stated = keys.iter().copied().find(|key| self.stated(key));
        stated.or(keys.first().copied()).unwrap_or("")
    }

    pub(super) fn warn(&mut self, key: &str, message: impl Into<String>) {
        self.warnings.push(Problem::new(self.layers.origin(key), key, message));
    }

    pub(super) fn warn_without_effect(&mut self, key: &str, reason: &str) {
        let problem = Problem::without_effect(self.layers.origin(key), key, reason);
        self.warnings.push(problem);
    }

    pub(super) fn stated(&self, key: &str) -> bool {
        self.layers.entries().contains_key(key)
    }

    /// True if the present value was stated by a recording.
    pub(super) fn recorded(&self, key: &str) -> bool {
        self.layers.entries().get(key).is_some_and(|entry| entry.recorded)
    }
}

/// A list that the schema has checked to have one entry per joint.
pub(super) fn joints(list: &[f64]) -> [f64; ARM_JOINTS] {
    std::array::from_fn(|joint| list.get(joint).copied().unwrap_or(f64::NAN))
}
