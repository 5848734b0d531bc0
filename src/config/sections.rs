//! The sections of a configuration as core types.

use super::error::{Origin, Problem};
use super::schema::FileForm;
use crate::estimator::{EstimatorOptions, Structure};
use crate::model::{
    Delayed, ExtendedManipulator, ExtraTerms, KnownConstants, MAX_JOINTS, Manipulator, Parameter, Plant as _,
    PlantDefinition, ServoAxis,
};
use crate::rows::{InputSource, ProjectedOptions};
use crate::sim::SimOptions;
use std::path::PathBuf;

/// How samples are delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Lockstep for a simulation at full speed, else realtime.
    Auto,
    /// The plant never waits; a late consumer loses the oldest samples.
    Realtime,
    /// The plant waits for its consumers; nothing is lost.
    Lockstep,
}

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

/// Section `[model]`: which equations.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelConfig {
    /// The paper's two-joint arm.
    Manipulator {
        /// The equations.
        plant: Manipulator,
        /// Motor constants, where they are known: physical values are derived with them.
        known: Option<KnownConstants>,
    },
    /// The same with Coulomb friction or offsets.
    ExtendedManipulator {
        /// The equations.
        plant: ExtendedManipulator,
        /// As above.
        known: Option<KnownConstants>,
    },
    /// Either of them with the delay of its input as one more parameter.
    DelayedManipulator {
        /// The equations.
        plant: Delayed<ExtendedManipulator>,
        /// As above.
        known: Option<KnownConstants>,
    },
    /// One servo axis.
    ServoAxis {
        /// The equation.
        plant: ServoAxis,
    },
    /// The same with the delay of its input as one more parameter.
    DelayedServoAxis {
        /// The equation.
        plant: Delayed<ServoAxis>,
    },
    /// A plant of the caller's own, which is not in this library.
    Own(PlantDefinition),
}

/// The same expression for the plant of every model, and another one for what is known of a caller's own.
macro_rules! with_plant {
    ($model:expr, $plant:ident => $body:expr, $own:ident => $otherwise:expr) => {
        match $model {
            $crate::config::ModelConfig::Manipulator { plant: $plant, .. } => $body,
            $crate::config::ModelConfig::ExtendedManipulator { plant: $plant, .. } => $body,
            $crate::config::ModelConfig::DelayedManipulator { plant: $plant, .. } => $body,
            $crate::config::ModelConfig::ServoAxis { plant: $plant } => $body,
            $crate::config::ModelConfig::DelayedServoAxis { plant: $plant } => $body,
            $crate::config::ModelConfig::Own($own) => $otherwise,
        }
    };
}
#[cfg(feature = "service")]
pub(crate) use with_plant;

impl ModelConfig {
    /// The parameters to be identified.
    pub fn parameters(&self) -> &[Parameter] {
        with_plant!(self, plant => plant.parameters(), own => &own.parameters)
    }

    /// Everything about the plant but its terms.
    pub fn definition(&self) -> PlantDefinition {
        with_plant!(self, plant => PlantDefinition::of(plant), own => own.clone())
    }

    /// Which equation has which parameters.
    pub fn structure(&self) -> Structure {
        let definition = self.definition();
        Structure {
            params: definition.parameters.len(),
            equations: definition.equations.into_iter().map(|e| e.parameters).collect(),
        }
    }

    /// Name of the model.
    pub fn name(&self) -> &'static str {
        with_plant!(self, plant => plant.name(), own => own.name)
    }

    /// Terms of an arm beyond the paper's.
    pub fn extra_terms(&self) -> ExtraTerms {
        match self {
            Self::ExtendedManipulator { plant, .. } => plant.extra_terms(),
            Self::DelayedManipulator { plant, .. } => plant.plant().extra_terms(),
            _ => ExtraTerms::default(),
        }
    }

    /// Motor constants of an arm, where they are known.
    pub fn known(&self) -> Option<KnownConstants> {
        match self {
            Self::Manipulator { known, .. }
            | Self::ExtendedManipulator { known, .. }
            | Self::DelayedManipulator { known, .. } => *known,
            Self::ServoAxis { .. } | Self::DelayedServoAxis { .. } | Self::Own(_) => None,
        }
    }
}

/// How samples become rows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one per process")]
pub enum Rows {
    /// One row per sample and equation.
    Pointwise,
    /// One row per window and equation, from positions and inputs.
    Projected(ProjectedOptions),
}

/// Section `[identifier]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifierConfig {
    /// Form of the rows.
    pub rows: Rows,
    /// Whether the window of projected rows is chosen from the signals; the stride and the velocity filter of `rows` are upper limits then, and its
    /// window is the one to begin with.
    pub auto_window: bool,
    /// Source of u.
    pub input: InputSource,
    /// Magnitude from which on each joint's measured input is saturated; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// How long a signal may stand still that must move \[s\]; 0 for ever.
    pub frozen_after_s: f64,
}

/// Section `[estimator]`.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatorConfig {
    /// N, samples per block.
    pub block_len: usize,
    /// Everything else, checked against the model.
    pub options: EstimatorOptions,
}

/// Section `[monitor]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorConfig {
    /// Directory for the results, where one is stated.
    pub out_dir: Option<PathBuf>,
    /// A file of a recording that has this size is followed by another \[bytes\]; 0 for no limit.
    pub record_file_bytes: u64,
    /// Files of a recording that are kept; 0 for all.
    pub record_files: usize,
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
    /// Restarts are forgiven after so long without a failure \[s\].
    pub healthy_s: f64,
}

/// What a role asks of the system's scheduler and memory.
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

/// Section `[log]`: what the columns of a log file mean.
#[derive(Debug, Clone, PartialEq)]
pub struct LogColumns {
    /// Column of the time; rows follow each other at the sample period where there is none.
    pub time: Option<String>,
    /// One unit of the time column \[s\].
    pub time_unit_s: f64,
    /// Column of each joint's position.
    pub positions: Vec<String>,
    /// One unit of the positions \[rad or m\].
    pub position_unit: f64,
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
    pub model: ModelConfig,
    /// From samples to rows.
    pub identifier: IdentifierConfig,
    /// The recursion.
    pub estimator: EstimatorConfig,
    /// What is kept.
    pub monitor: MonitorConfig,
    /// What the identifier keeps for its next start.
    pub checkpoint: CheckpointConfig,
    /// What is done about processes that fail.
    pub supervision: SupervisionConfig,
    /// What each role asks of the system.
    pub realtime: RealtimeConfig,
    /// How a log file is read.
    pub log: LogColumns,
    pub(super) file: FileForm,
    pub(super) warnings: Vec<Problem>,
    /// Keys of a recording that decide on memory.
    pub(super) recorded: Vec<(&'static str, Origin)>,
}
