//! The content of all views at one instant: texts and numbers, ready to draw.

use serde::Serialize;

/// Overall condition, shown as a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Health {
    /// Estimates may be used.
    Good,
    /// Nothing is wrong, but there is no result yet.
    Wait,
    /// Something needs attention.
    Warn,
    /// No identifier is running, or its estimates must not be used.
    Bad,
}

/// Trend of an estimate, beyond its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Trend {
    /// Too few estimates.
    Unknown,
    /// It stays.
    Steady,
    /// It grows.
    Rising,
    /// It falls.
    Falling,
}

impl Trend {
    /// One character for a table.
    pub fn arrow(self) -> &'static str {
        match self {
            Self::Unknown => " ",
            Self::Steady => "→",
            Self::Rising => "↑",
            Self::Falling => "↓",
        }
    }
}

/// One quantity.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Short name.
    pub name: String,
    /// Unit as in a text; empty if there is none.
    pub unit: String,
    /// The estimate; `NaN` before the first.
    pub value: f64,
    /// Its standard deviation; `NaN` if there is none.
    pub std: f64,
    /// The value, rounded to its standard deviation.
    pub value_text: String,
    /// The standard deviation as text; empty if there is none.
    pub std_text: String,
    /// Its trend.
    pub trend: Trend,
    /// Whether controllers may use it.
    pub usable: bool,
    /// Whether the last block informed on it.
    pub excited: bool,
    /// Whether it is fixed by configuration or command.
    pub fixed: bool,
    /// Whether it is computed from the parameters.
    pub derived: bool,
}

impl Row {
    /// A short note: `usable`; `fixed`; `not excited` if the motion leaves it open; `uncertain` if
    /// it is known, but not well enough.
    pub fn note(&self) -> &'static str {
        let known = 3.0 * self.std < self.value.abs();
        match (self.fixed, self.usable, self.excited || known) {
            (true, ..) => "fixed",
            (_, true, _) => "usable",
            _ if !self.value.is_finite() => "",
            (_, _, false) => "not excited",
            _ => "uncertain",
        }
    }
}

/// Duration of a step of the identifier \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Times {
    /// Mean.
    pub mean_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// Longest.
    pub max_us: f64,
}

/// Everything at one instant. Unknown values are `NaN`, which JSON shows as null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct View {
    /// The result in a sentence.
    pub headline: String,
    /// The state in a sentence.
    pub words: String,
    /// The state's name as in files: `converged`.
    pub state: String,
    /// The state as a colour.
    pub health: Health,
    /// Whether an identifier is alive.
    pub alive: bool,
    /// Whether a command has stopped it.
    pub paused: bool,
    /// Seconds since its last heartbeat.
    pub heartbeat_s: f64,
    /// Process id of the identifier, 0 if it is not known.
    pub pid: u32,
    /// Block of the last estimate, 0 before the first.
    pub block: u64,
    /// Stream time of the last estimate \[s\].
    pub t_s: f64,
    /// Parameters, then derived values.
    pub rows: Vec<Row>,
    /// Parameters that may be used.
    pub usable: usize,
    /// Parameters.
    pub parameters: usize,
    /// Samples used since the start of the stream.
    pub accepted: u64,
    /// Samples lost since then.
    pub missing: u64,
    /// Samples refused since then.
    pub rejected: u64,
    /// Blocks without an estimate.
    pub lost_estimates: u64,
    /// Samples per second of the clock.
    pub samples_per_s: f64,
    /// Estimates per second of the clock.
    pub estimates_per_s: f64,
    /// χ² of the residuals over their number, per equation: 1 on average if the block fits.
    pub fit: Vec<f64>,
    /// Probability of residuals this large if the model is right.
    pub fit_probability: f64,
    /// Time to process a sample.
    pub step: Times,
    /// Time to estimate a block.
    pub block_step: Times,
    /// Memory of the identifier in use \[bytes\], 0 if it is not known.
    pub resident_bytes: u64,
    /// The identifier's text about an error that the model lacks; empty if the residuals show none.
    pub lacks: String,
    /// The last error, in words.
    pub error: String,
    /// Located times of the last changes \[s\].
    pub changes: Vec<f64>,
}
