//! Sections and keys of the TOML file of a robot.

use serde::Deserialize;
use std::path::PathBuf;

/// The content of the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub model: ModelSection,
    #[serde(default)]
    pub drive: DriveSection,
    #[serde(default)]
    pub friction: FrictionSection,
    #[serde(default)]
    pub log: LogSection,
    #[serde(default)]
    pub identify: IdentifySection,
    #[serde(default)]
    pub simulate: SimulateSection,
    #[serde(default)]
    pub excite: ExciteSection,
    // Sections that every configuration may have; they are parsed elsewhere.
    pub bus: Option<toml::Table>,
    pub plant: Option<toml::Table>,
    pub estimator: Option<toml::Table>,
    pub monitor: Option<toml::Table>,
    pub checkpoint: Option<toml::Table>,
    pub supervision: Option<toml::Table>,
    pub controller: Option<toml::Table>,
    pub realtime: Option<toml::Table>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModelSection {
    #[serde(rename = "kind")]
    pub _kind: String,
    pub urdf: PathBuf,
    pub base: Option<String>,
    pub tip: Option<String>,
    pub joints: Option<Vec<String>>,
    pub gravity_m_per_s2: Option<Vec<f64>>,
    pub rotor_inertia: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct DriveSection {
    pub gain: Option<Vec<f64>>,
    pub coupling: Option<Vec<Vec<f64>>>,
    pub gain_std: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct FrictionSection {
    pub terms: Option<Vec<String>>,
    pub presliding: Option<f64>,
    pub rest_speed: Option<f64>,
    pub stribeck_speed: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct LogSection {
    pub time_column: Option<usize>,
    pub position_columns: Option<Vec<usize>>,
    pub velocity_columns: Option<Vec<usize>>,
    pub input_columns: Option<Vec<usize>>,
}

impl LogSection {
    /// True if it names columns of positions, velocities or inputs.
    pub fn names_columns(&self) -> bool {
        self.position_columns.is_some() || self.velocity_columns.is_some() || self.input_columns.is_some()
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct IdentifySection {
    pub window_s: Option<f64>,
    pub stride_s: Option<f64>,
    pub max_gap_s: Option<f64>,
    pub block_s: Option<f64>,
    pub settle_blocks: Option<usize>,
    pub friction_walk: Option<f64>,
    pub payload_friction: Option<f64>,
    pub zero_rad: Option<f64>,
    pub velocity: Option<Velocity>,
    pub velocity_s: Option<f64>,
    pub payload: Option<bool>,
}

/// Source of the velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Velocity {
    Measured,
    Differentiated,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct SimulateSection {
    pub motion: Option<Motion>,
    pub motion_csv: Option<PathBuf>,
    pub harmonics: Option<usize>,
    pub period_s: Option<f64>,
    pub rest_s: Option<f64>,
    pub part_of_limits: Option<f64>,
    pub reach: Option<f64>,
    pub acceleration: Option<f64>,
    pub controller: Option<Controller>,
    pub bandwidth_rad_per_s: Option<f64>,
    pub difference: Option<f64>,
    pub machine_seed: Option<u64>,
    pub encoder_bits: Option<u32>,
    pub torque_noise: Option<f64>,
    pub viscous: Option<Vec<f64>>,
    pub coulomb: Option<Vec<f64>>,
    pub offset: Option<Vec<f64>>,
    pub rotor_inertia: Option<Vec<f64>>,
    pub payload: Vec<PayloadSection>,
}

/// Limits of a designed motion; lists have one number per joint.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ExciteSection {
    pub duration_s: Option<f64>,
    pub harmonics: Option<usize>,
    pub tries: Option<usize>,
    pub seed: Option<u64>,
    pub part_of_limits: Option<f64>,
    pub reach: Option<f64>,
    pub lower: Option<Vec<f64>>,
    pub upper: Option<Vec<f64>>,
    pub velocity: Option<Vec<f64>>,
    pub acceleration: Option<Vec<f64>>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Motion {
    Rest,
    Fourier,
    Moves,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Controller {
    ComputedTorque,
    Pd,
    Servo,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PayloadSection {
    pub t_s: f64,
    pub mass_kg: f64,
    #[serde(default)]
    pub center_m: [f64; 3],
    #[serde(default)]
    pub inertia_kg_m2: [f64; 6],
}
