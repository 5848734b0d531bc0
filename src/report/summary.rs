//! `summary.json` and the result table: the result of a run, with the truth if known.

use crate::messages::{Estimate, State};
use crate::node::monitor::{MonitorNode, lacking_words, relative_error, seconds};
use crate::node::state_words::{misfit_words, poorly_excited_words};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// Numbers of samples used, lost and refused in the last stream of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleCounts {
    /// Used.
    pub accepted: u64,
    /// Lost: gaps in `seq`.
    pub missing: u64,
    /// Refused: not finite, out of range, out of order.
    pub rejected: u64,
    /// Streams so far, this one included: one more for each restart of the publisher.
    #[serde(default)]
    pub streams: u64,
}

/// One parameter at the end of a run; unknown values are null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterSummary {
    /// Short name: `theta_1`.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// θ̂; null if there was no estimate.
    pub estimate: Option<f64>,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// The true value.
    pub truth: Option<f64>,
    /// (estimate − truth) / truth; null if the truth is 0.
    pub relative_error: Option<f64>,
    /// Whether the last block informed on it.
    pub excited: Option<bool>,
    /// Whether it was fixed.
    pub fixed: Option<bool>,
    /// Whether a controller may use it.
    #[serde(default)]
    pub usable: Option<bool>,
}

impl ParameterSummary {
    /// A note besides its numbers: `fixed`; `known from earlier blocks` for a value that the last
    /// block did not inform on; `not excited` for one that the motion leaves open.
    pub fn note(&self) -> &'static str {
        let known = self
            .estimate
            .zip(self.std)
            .is_some_and(|(value, std)| 3.0 * std < value.abs());
        match (self.fixed, self.excited, self.usable) {
            (Some(true), ..) => "fixed",
            (_, Some(false), Some(true)) => "",
            (_, Some(false), _) if known => "known from earlier blocks",
            (_, Some(false), _) => "not excited",
            _ => "",
        }
    }
}

/// One derived value at the end of a run; unknown values are null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DerivedSummary {
    /// Short name: `mass_2`.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// The value.
    pub estimate: Option<f64>,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// The true value.
    pub truth: Option<f64>,
}

/// One change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChangeSummary {
    /// Block that reported it.
    pub block: u64,
    /// Located time \[s\].
    pub t_s: f64,
    /// Time of the last sample of the reporting block \[s\].
    pub detected_t_s: f64,
    /// See [`crate::node::monitor::Change::blocks_to_1_percent`].
    pub blocks_to_1_percent: Option<u64>,
}

/// A run in one value: the contents of `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Message schema version.
    pub schema: u32,
    /// Robot name.
    pub robot: String,
    /// Model name.
    pub model: String,
    /// Hash of the configuration that determined the estimates, hexadecimal.
    pub config_hash: Option<String>,
    /// State of the last estimate, `collecting` if there was none.
    pub state: String,
    /// Estimates received.
    pub blocks: u64,
    /// Sample counts of the identifier.
    pub samples: SampleCounts,
    /// The parameters, in the order of θ.
    pub parameters: Vec<ParameterSummary>,
    /// Derived values.
    pub derived: Vec<DerivedSummary>,
    /// Changes found.
    pub changes: Vec<ChangeSummary>,
    /// Wall time of the run \[s\], if measured.
    pub wall_s: Option<f64>,
    /// Number of restarts by a launcher, by process; null without a launcher.
    #[serde(default)]
    pub restarts: Option<BTreeMap<String, u64>>,
    /// Why the state is `misfit`, in words; null in another state.
    #[serde(default)]
    pub misfit_reason: Option<String>,
    /// An error that the model lacks, in words, if the residuals show one.
    #[serde(default)]
    pub misfit: Option<String>,
    /// Why there is no estimate, in words, if the identifier reported a reason.
    #[serde(default)]
    pub no_estimate: Option<String>,
}

impl Summary {
    /// The summary of a monitor's data.
    pub fn new(monitor: &MonitorNode, robot: &str, model: &str) -> Self {
        let last = monitor.last_estimate();
        let status = monitor
            .last_status()
            .filter(|s| last.is_none_or(|e| e.stream_id == s.stream_id));
        // The status after the last estimate also counts the samples of a partial last block.
        let samples = match (status, last) {
            (Some(s), _) => SampleCounts {
                accepted: s.accepted,
                missing: s.missing,
                rejected: s.rejected,
                streams: s.streams,
            },
            (None, Some(e)) => SampleCounts {
                accepted: e.accepted,
                missing: e.missing,
                rejected: e.rejected,
                streams: 1,
            },
            (None, None) => SampleCounts::default(),
        };
        Self {
            schema: crate::messages::SCHEMA_VERSION,
            robot: robot.to_string(),
            model: model.to_string(),
            config_hash: last.map(|e| format!("{:016x}", e.config_hash)),
            state: last
                .and_then(|e| State::from_wire(e.state))
                .unwrap_or_default()
                .name()
                .to_string(),
            blocks: monitor.blocks(),
            samples,
            parameters: parameters(monitor, last),
            derived: derived(monitor, last),
            changes: monitor
                .changes()
                .iter()
                .map(|c| ChangeSummary {
                    block: c.block,
                    t_s: c.t_s,
                    detected_t_s: c.detected_t_s,
                    blocks_to_1_percent: c.blocks_to_1_percent,
                })
                .collect(),
            wall_s: None,
            restarts: None,
            misfit_reason: last
                .filter(|e| e.state == State::Misfit as u32)
                .map(|e| misfit_words(e, None)),
            misfit: monitor.misfit().map(str::to_owned),
            no_estimate: status.and_then(|s| s.no_estimate()).map(str::to_owned),
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn parameters(monitor: &MonitorNode, last: Option<&Estimate>) -> Vec<ParameterSummary> {
    let truth = last
        .zip(monitor.truth())
        .map(|(e, truth)| truth.theta(seconds(e.t_last_ns)));
    monitor
        .parameters()
        .iter()
        .enumerate()
        .map(|(i, label)| {
            let estimate = last.and_then(|e| finite(e.theta[i]));
            let truth = truth.as_ref().and_then(|theta| theta.get(i).copied());
            ParameterSummary {
                name: label.name.clone(),
                unit: label.unit.clone(),
                estimate,
                std: last.and_then(|e| finite(e.theta_std[i])),
                truth,
                relative_error: estimate
                    .zip(truth)
                    .and_then(|(value, truth)| relative_error(value, truth))
                    .and_then(finite),
                excited: last.map(|e| e.excited.contains(i)),
                fixed: last.map(|e| e.fixed.contains(i)),
                usable: last.map(|e| e.is_usable(i)),
            }
        })
        .collect()
}

fn derived(monitor: &MonitorNode, last: Option<&Estimate>) -> Vec<DerivedSummary> {
    let truth = last
        .zip(monitor.truth())
        .map(|(e, truth)| truth.derived(seconds(e.t_last_ns)));
    monitor
        .derived()
        .iter()
        .enumerate()
        .map(|(i, label)| DerivedSummary {
            name: label.name.clone(),
            unit: label.unit.clone(),
            estimate: last.and_then(|e| finite(e.derived[i])),
            std: last.and_then(|e| finite(e.derived_std[i])),
            truth: truth.as_ref().and_then(|values| values.get(i).copied()),
        })
        .collect()
}

/// The result table as `thetabus run` prints it.
impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = "parameter";
        writeln!(
            f,
            "{name:<18} {:>14} {:>11} {:>14} {:>11}  unit",
            "estimate", "std", "truth", "error"
        )?;
        for p in &self.parameters {
            line(f, &p.name, [p.estimate, p.std, p.truth], &p.unit)?;
            match p.note() {
                "" => writeln!(f)?,
                words => writeln!(f, "  ({words})")?,
            }
        }
        for d in &self.derived {
            line(f, &d.name, [d.estimate, d.std, d.truth], &d.unit)?;
            writeln!(f)?;
        }
        for change in &self.changes {
            writeln!(f, "{change}")?;
        }
        self.end(f)
    }
}

impl Summary {
    /// Adds the reason for having no estimate, if it is the number of samples per block.
    #[must_use]
    pub fn of_blocks(mut self, block_len: usize) -> Self {
        let SampleCounts { accepted, rejected, .. } = self.samples;
        // blocks are cut by `seq`, so almost two blocks of samples may contain no complete one
        if self.blocks == 0 && accepted < 2 * block_len as u64 && rejected <= accepted {
            self.no_estimate.get_or_insert_with(|| {
                format!(
                    "expected a whole block of {block_len} samples (estimator.block_len; blocks begin at its multiples), got {accepted} samples"
                )
            });
        }
        self
    }

    /// The lines below the table: counts, state, and messages of the identifier.
    fn end(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SampleCounts {
            accepted,
            missing,
            rejected,
            streams,
        } = self.samples;
        write!(
            f,
            "{} {}, {accepted} samples accepted, {missing} missing, {rejected} rejected",
            self.blocks,
            if self.blocks == 1 { "block" } else { "blocks" },
        )?;
        if streams > 1 {
            write!(f, " in the last of {streams} streams")?;
        }
        write!(f, "; state {}", self.state)?;
        if self.state == State::PoorlyExcited.name() {
            let usable = self.parameters.iter().filter(|p| p.usable == Some(true)).count();
            write!(f, " ({})", poorly_excited_words(usable, self.parameters.len()))?;
        }
        if let Some(words) = &self.misfit_reason {
            write!(f, " ({words})")?;
        }
        match self.wall_s {
            Some(wall) => writeln!(f, "; wall time {wall:.1} s")?,
            None => writeln!(f)?,
        }
        let restarted = self.restarts.iter().flatten().filter(|(_, count)| **count > 0);
        let restarted: Vec<String> = restarted.map(|(name, count)| format!("{name} {count}")).collect();
        if !restarted.is_empty() {
            writeln!(f, "started again: {}", restarted.join(", "))?;
        }
        if let Some(words) = &self.no_estimate {
            writeln!(f, "no estimate: {words}")?;
        }
        if let Some(words) = &self.misfit {
            writeln!(f, "{}", lacking_words(words, self.state == State::Misfit.name()))?;
        }
        Ok(())
    }
}

/// A quantity's name, estimate, standard deviation, truth, error and unit, without the line's end.
fn line(f: &mut fmt::Formatter<'_>, name: &str, values: [Option<f64>; 3], unit: &str) -> fmt::Result {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_string(), significant);
    let [estimate, std, truth] = values;
    write!(
        f,
        "{name:<18} {:>14} {:>11} {:>14} {:>11}  {unit}",
        number(estimate),
        std.map_or_else(|| "-".to_string(), |std| format!("{std:.1e}")),
        number(truth),
        error(estimate, std, truth).unwrap_or_else(|| "-".to_owned()),
    )
}

impl fmt::Display for ChangeSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "change at {:.3} s, announced by block {} at {:.3} s",
            self.t_s, self.block, self.detected_t_s
        )?;
        match self.blocks_to_1_percent {
            Some(0) => f.write_str(", all within 1 % of the truth in the same block"),
            Some(blocks) => write!(f, ", all within 1 % of the truth {blocks} block(s) later"),
            None => Ok(()),
        }
    }
}

/// The relative error in percent; `None` for an undetermined value, whose standard deviation
/// exceeds it, and for a truth of [0](relative_error).
pub(super) fn error(estimate: Option<f64>, std: Option<f64>, truth: Option<f64>) -> Option<String> {
    let determined = estimate.filter(|value| std.is_none_or(|std| std <= value.abs()));
    let error = determined
        .zip(truth)
        .and_then(|(value, truth)| relative_error(value, truth));
    error.map(percent)
}

/// A share in percent; if three decimals would round to zero or give too many digits, only the
/// magnitude.
fn percent(share: f64) -> String {
    let value = share * 100.0;
    if value != 0.0 && !(5e-4..1e5).contains(&value.abs()) {
        format!("{value:+.0e} %")
    } else {
        format!("{value:+.3} %")
    }
}

/// Seven significant digits, plain if that is short.
pub(super) fn significant(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 {
        "0".to_string()
    } else if (1e-4..1e7).contains(&magnitude) {
        let decimals = (6 - magnitude.log10().floor() as i32).clamp(0, 12) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.6e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::monitor::tests::{estimate, monitor};

    #[test]
    fn prop_a_summary_survives_json_and_says_null_for_what_is_not_known() {
        let mut monitor = monitor();
        let empty = Summary::new(&monitor, "arm", "test");
        assert_eq!((empty.blocks, empty.state.as_str()), (0, "collecting"));
        assert_eq!(empty.parameters[0].estimate, None);

        monitor.on_estimate(&estimate(1, 10.5));
        let summary = Summary::new(&monitor, "arm", "test");
        let json = serde_json::to_string(&summary).unwrap();
        assert!(json.contains("\"std\":null"), "{json}");
        assert_eq!(serde_json::from_str::<Summary>(&json).unwrap(), summary);
        assert_eq!(summary.parameters[0].relative_error, Some(0.05));
        assert_eq!(
            summary.samples,
            SampleCounts {
                accepted: 1000,
                missing: 0,
                rejected: 0,
                streams: 1
            }
        );
    }

    #[test]
    fn regress_the_table_names_value_truth_error_and_unit() {
        let mut monitor = monitor();
        monitor.on_estimate(&estimate(1, 10.5));
        let table = Summary::new(&monitor, "arm", "test").to_string();
        for part in [
            "mass",
            "10.50000",
            "10.00000",
            "+5.000 %",
            "kg",
            "1 block,",
            "1000 samples accepted",
        ] {
            assert!(table.contains(part), "{part:?} is not in\n{table}");
        }
    }

    #[test]
    fn prop_a_value_that_is_known_or_usable_is_not_called_not_excited() {
        let parameter = |std: f64, excited: bool, usable: bool, fixed: bool| ParameterSummary {
            name: "m".to_owned(),
            unit: "kg".to_owned(),
            estimate: Some(-2.0),
            std: Some(std),
            truth: None,
            relative_error: None,
            excited: Some(excited),
            fixed: Some(fixed),
            usable: Some(usable),
        };
        for (std, [excited, usable, fixed], note) in [
            (0.01, [false, true, false], ""),
            (0.5, [false, false, false], "known from earlier blocks"),
            (0.7, [false, false, false], "not excited"),
            (f64::NAN, [false, false, false], "not excited"),
            (0.7, [true, false, false], ""),
            (0.7, [false, false, true], "fixed"),
        ] {
            assert_eq!(parameter(std, excited, usable, fixed).note(), note, "{std}");
        }
    }

    #[test]
    fn prop_a_small_error_is_not_shown_as_none() {
        for (share, text) in [
            (0.0, "+0.000 %"),
            (-0.05, "-5.000 %"),
            (4e-12, "+4e-10 %"),
            (-6e-6, "-0.001 %"),
            (120.0, "+12000.000 %"),
            (-4.2e6, "-4e8 %"),
        ] {
            assert_eq!(percent(share), text);
        }
    }

    #[test]
    fn regress_what_is_not_determined_has_no_error_in_percent() {
        for (value, std, truth, text) in [
            (10.5, Some(0.1), 10.0, Some("+5.000 %")),
            (10.5, None, 10.0, Some("+5.000 %")),
            (0.3, Some(0.5), 0.002, None),
            (0.002, Some(0.001), 0.0, None),
            (0.1, Some(0.001), 1e-17, None),
        ] {
            assert_eq!(error(Some(value), std, Some(truth)).as_deref(), text);
        }
        assert_eq!(error(None, None, Some(1.0)), None);
        assert_eq!(error(Some(1.0), None, None), None);
    }

    #[test]
    fn prop_seven_significant_digits_at_every_magnitude() {
        for (value, text) in [
            (0.0, "0"),
            (23.0, "23.00000"),
            (0.004_347_83, "0.004347830"),
            (-0.26, "-0.2600000"),
            (1.5e9, "1.500000e9"),
            (2e-7, "2.000000e-7"),
        ] {
            assert_eq!(significant(value), text);
        }
    }
}
