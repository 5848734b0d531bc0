//! The sections of a configuration as core types.

use super::catalog::Catalog;
use super::error::{Origin, Problem};
use super::schema::{Delivery, FeedForward, FileForm};
use crate::control::AdaptiveOptions;
use crate::estimator::EstimatorOptions;
use crate::model::{KnownConstants, MAX_JOINTS};
use crate::node::model::SharedModel;
use crate::rows::{InputSource, RowForm};
use crate::sim::SimOptions;
use std::path::PathBuf;

/// Section `[bus]`.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Robot of the topics' names.
    pub robot: String,
    /// Domain that isolates the run.
    pub domain: String,
    /// Delivery as configured; [`BusConfig::lockstep`] resolves `auto`.
    pub delivery: Delivery,
    /// Consumers that a lockstep run waits for.
    pub lockstep_consumers: usize,
    /// Longest wait for a consumer \[s\].
    pub lockstep_limit_s: f64,
    /// Samples by which a consumer may lag in real time.
    pub sample_buffer: usize,
    /// Subscribers of samples.
    pub max_sample_subscribers: usize,
    /// Subscribers of estimates, status, journal and description.
    pub max_estimate_subscribers: usize,
    /// Programs with a topic open.
    pub max_programs: usize,
}

impl BusConfig {
    /// Whether a run at this speed is in lockstep.
    pub fn lockstep(&self, speed: Speed) -> bool {
        match self.delivery {
            Delivery::Auto => speed == Speed::Max,
            Delivery::Realtime => false,
            Delivery::Lockstep => true,
        }
    }
}

/// How fast simulated time passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// As fast as it can be computed and consumed.
    Max,
    /// Simulated seconds per second, > 0.
    Factor(f64),
}

/// Section `[plant]`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantConfig {
    /// The simulation.
    pub sim: SimOptions,
    /// Its pace.
    pub speed: Speed,
}

/// Section `[identifier]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifierConfig {
    /// Form of the rows.
    pub rows: RowForm,
    /// True if the window of projected rows is chosen from the signals; then the stride and the
    /// velocity filter of `rows` are upper limits, and its window is the initial one.
    pub auto_window: bool,
    /// Source of u.
    pub input: InputSource,
    /// Magnitude at which each joint's measured input is saturated; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// How long a signal that should move may be constant \[s\]; 0 for no limit.
    pub frozen_after_s: f64,
}

/// Section `[estimator]`.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatorConfig {
    /// N, samples per block.
    pub block_len: usize,
    /// All other options, checked against the model.
    pub options: EstimatorOptions,
}

/// Section `[controller]`.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// Source of the feed-forward.
    pub feed_forward: FeedForward,
    /// Initial parameters, one per parameter of the model.
    pub theta: Vec<f64>,
    /// How estimates become feed-forward.
    pub options: AdaptiveOptions,
    /// Stream time for which a command is valid \[s\].
    pub deadline_s: f64,
}

/// Section `[monitor]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorConfig {
    /// Directory for the results, if one is stated.
    pub out_dir: Option<PathBuf>,
    /// Size at which a recording continues in a new file \[bytes\]; 0 for no limit.
    pub record_file_bytes: u64,
    /// Files of a recording that are kept; 0 for all.
    pub record_files: usize,
    /// True if samples are also recorded as joint states.
    pub record_joint_states: bool,
}

/// Section `[checkpoint]`.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckpointConfig {
    /// Directory of the checkpoints; none are written without it.
    pub dir: Option<PathBuf>,
    /// Time from one to the next \[s\].
    pub period_s: f64,
}

/// Section `[supervision]`: what a launcher does about a process that fails.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupervisionConfig {
    /// Restarts of each process before the launcher gives up; 0 for none.
    pub restarts: u64,
    /// Pause before the first restart \[s\], doubled with each.
    pub backoff_s: f64,
    /// Longest pause \[s\].
    pub backoff_limit_s: f64,
    /// Time without a failure after which the count of restarts is reset \[s\].
    pub healthy_s: f64,
}

/// Scheduler and memory settings of a role.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealtimeSettings {
    /// Priority of SCHED_FIFO, 1 to 99; `None` for the system's default policy.
    pub scheduler_priority: Option<u8>,
    /// CPUs to run on; none for all.
    pub cpu_affinity: Vec<usize>,
    /// Keep all memory from being swapped out.
    pub lock_memory: bool,
}

/// Sections `[realtime.*]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RealtimeConfig {
    /// Of the plant simulator.
    pub plant: RealtimeSettings,
    /// Of the identifier.
    pub identifier: RealtimeSettings,
    /// Of the monitor.
    pub monitor: RealtimeSettings,
}

/// Section `[log]`: the meaning of a log file's columns.
#[derive(Debug, Clone, PartialEq)]
pub struct LogColumns {
    /// Column of the time; without one, rows are one sample period apart.
    pub time: Option<String>,
    /// One unit of the time column \[s\].
    pub time_unit_s: f64,
    /// Column of each joint's position.
    pub positions: Vec<String>,
    /// One unit of each joint's position and setpoint \[rad or m\].
    pub position_units: Vec<f64>,
    /// Column of each joint's input.
    pub inputs: Vec<String>,
    /// One unit of the inputs, in the model's unit.
    pub input_unit: f64,
    /// Column of each joint's setpoint, or none.
    pub setpoints: Vec<String>,
}

/// A whole configuration, valid in itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Topics and delivery.
    pub bus: BusConfig,
    /// The simulated machine.
    pub plant: PlantConfig,
    /// The equations.
    pub model: SharedModel,
    /// From samples to rows.
    pub identifier: IdentifierConfig,
    /// The recursion.
    pub estimator: EstimatorConfig,
    /// The controller.
    pub controller: ControllerConfig,
    /// What is kept.
    pub monitor: MonitorConfig,
    /// The identifier's checkpoints.
    pub checkpoint: CheckpointConfig,
    /// Restarting of failed processes.
    pub supervision: SupervisionConfig,
    /// Real-time settings of each role.
    pub realtime: RealtimeConfig,
    /// How a log file is read.
    pub log: LogColumns,
    /// Known constants of the built-in arm, from which physical values are derived.
    pub known: Option<KnownConstants>,
    pub(super) file: FileForm,
    pub(super) catalog: Catalog,
    pub(super) warnings: Vec<Problem>,
    /// Keys of a recording that decide on memory.
    pub(super) recorded: Vec<(&'static str, Origin)>,
}
