//! Identification in a few lines inside your own program: describe the plant and its sensors, push
//! samples, get estimates.
//!
//! ```
//! use thetabus::identify::Identifier;
//! use thetabus::model::{JointSample, Manipulator};
//!
//! // position and voltage of each joint, encoders of 16 bits, 0.05 V of noise, 1 kHz
//! let mut identifier = Identifier::builder(Manipulator::default())
//!     .encoder(16, 0.05)
//!     .block_len(1900)
//!     .build()?;
//! let names = identifier.names().clone();
//! # let mut read_the_drive = || JointSample::default();
//! for _ in 0..3800 {
//!     let sample = read_the_drive();
//!     if let Some(estimate) = identifier.push(&sample) {
//!         if let Some(theta_7) = estimate.usable(&names, "theta_7") {
//!             println!("theta_7 = {} ± {}", theta_7.value, theta_7.std);
//!         }
//!     }
//! }
//! # Ok::<(), thetabus::identify::BuildError>(())
//! ```
//!
//! Settings that you leave out have the values of `config/own_plant.toml`: rows over windows of the
//! positions, noise and window learnt from the signals, an estimator that forgets only what new
//! data determine, bounds from physics, and change detection. The service builds its identifier in
//! the same way from its configuration: both call
//! [`Model::identifier`](crate::node::model::Model::identifier).

pub use crate::estimator::ParameterPrior;

use crate::estimator::{ChangeDetection, EquationNoise, EstimatorOptions};
use crate::messages::{Estimate, ParameterNames, Sample, nanoseconds, signals};
use crate::model::{DefinitionError, JointSample, Plant};
use crate::node::identifier::{Identifier as Node, IdentifierOptions};
use crate::node::model::{ModelError, NodeSettings, PlantModel, SharedModel};
use crate::rows::{Considered, InputSource, ProjectedOptions, RowForm, SensorNoise, auto_window_first, priors};

/// Why an identifier could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The plant breaks a rule of its definition.
    #[error("the plant {plant}: {source}")]
    Plant {
        /// Its name.
        plant: String,
        /// The rule.
        source: DefinitionError,
    },
    /// The plant has no parameter of this name.
    #[error("expected a parameter out of {known}, got \"{name}\"")]
    UnknownParameter {
        /// The name that was given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// A setting is out of its range.
    #[error("{setting}: expected {expected}, got {got}")]
    Setting {
        /// Method of the builder.
        setting: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What was given.
        got: String,
    },
    /// Settings that contradict each other or do not fit this plant.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// What the rows are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one per builder")]
enum Signals {
    /// Positions and inputs. Their noise is learnt unless it is specified.
    Positions(Option<SensorNoise>),
    /// Positions with their exact derivatives, and inputs.
    Derivatives,
}

/// Collects what is known of a machine, see [`Identifier::builder`].
#[derive(Debug, Clone)]
pub struct IdentifierBuilder {
    model: SharedModel,
    priors: Vec<ParameterPrior>,
    unknown: Option<String>,
    sample_period_s: f64,
    block_len: usize,
    signals: Signals,
    /// The resolution is in counts per turn, which only angles have.
    counts_per_turn: bool,
    window_s: Option<f64>,
    considered: Considered,
    forgetting_factor: f64,
    change_detection: Option<ChangeDetection>,
}

/// Default N of a block \[samples\].
const BLOCK_LEN: usize = 1900;

impl IdentifierBuilder {
    /// Time between two samples \[s\], 1e-6 to 1; 1e-3 by default.
    #[must_use]
    pub fn sample_period_s(mut self, sample_period_s: f64) -> Self {
        self.sample_period_s = sample_period_s;
        self
    }

    /// N, samples per estimate, at least 1; 1900 by default.
    #[must_use]
    pub fn block_len(mut self, block_len: usize) -> Self {
        self.block_len = block_len;
        self
    }

    /// Encoders of 2^`bits` counts per turn, and white noise of this standard deviation on the
    /// input, in its unit; the same for all joints. If the sensors are not specified, their noise
    /// is learnt from the signals. Only for revolute joints; use [`sensors`](Self::sensors) for the
    /// resolution of a joint that moves along a line.
    #[must_use]
    pub fn encoder(self, bits: u32, input_noise: f64) -> Self {
        Self {
            counts_per_turn: true,
            ..self.sensors(SensorNoise::encoder(bits, input_noise))
        }
    }

    /// Sensors with this noise, joint by joint.
    #[must_use]
    pub fn sensors(mut self, noise: SensorNoise) -> Self {
        self.signals = Signals::Positions(Some(noise));
        self.counts_per_turn = false;
        self
    }

    /// States that samples carry exact velocities, accelerations and, if the equations use it,
    /// jerks, as those of a simulation do. There is then one row per sample.
    #[must_use]
    pub fn exact_derivatives(mut self) -> Self {
        self.signals = Signals::Derivatives;
        self
    }

    /// Length of the windows of the rows \[s\], 8 to 2000 sample periods; chosen from the signals
    /// by default.
    #[must_use]
    pub fn window_s(mut self, window_s: f64) -> Self {
        self.window_s = Some(window_s);
        self
    }

    /// Errors that the model lacks and that standard deviations must allow for.
    #[must_use]
    pub fn considered(mut self, considered: Considered) -> Self {
        self.considered = considered;
        self
    }

    /// λ per block, above 0 and at most 1; 0.98 by default.
    #[must_use]
    pub fn forgetting_factor(mut self, forgetting_factor: f64) -> Self {
        self.forgetting_factor = forgetting_factor;
        self
    }

    /// Options of the detection of sudden changes; `None` turns it off.
    #[must_use]
    pub fn change_detection(mut self, change_detection: Option<ChangeDetection>) -> Self {
        self.change_detection = change_detection;
        self
    }

    /// Sets the prior of the parameter `name`.
    #[must_use]
    pub fn prior(mut self, name: &str, prior: ParameterPrior) -> Self {
        match self.model.parameters().iter().position(|p| p.name == name) {
            Some(index) => self.priors[index] = prior,
            None => self.unknown = self.unknown.or_else(|| Some(name.to_owned())),
        }
        self
    }

    /// Builds an identifier that has seen no samples. Only this call allocates.
    ///
    /// # Errors
    /// An error that names the wrong setting or parameter.
    pub fn build(self) -> Result<Identifier, BuildError> {
        let definition = self.model.definition();
        definition.validate().map_err(|source| BuildError::Plant {
            plant: definition.name.clone(),
            source,
        })?;
        if let Some(name) = self.unknown {
            let known: Vec<&str> = definition.parameters.iter().map(|p| &*p.name).collect();
            let known = known.join(", ");
            return Err(BuildError::UnknownParameter { name, known });
        }
        let period_s = self.sample_period_s;
        if !(1e-6..=1.0).contains(&period_s) {
            return Err(BuildError::Setting {
                setting: "sample_period_s",
                expected: "1e-6 to 1 s",
                got: period_s.to_string(),
            });
        }
        if self.block_len == 0 {
            return Err(BuildError::Setting {
                setting: "block_len",
                expected: "at least 1 sample",
                got: "0".to_owned(),
            });
        }
        if self.counts_per_turn && definition.position_unit == "m" {
            return Err(BuildError::Setting {
                setting: "encoder",
                expected: "joints that turn; for others give sensors() with position_resolution [m]",
                got: "positions in m".to_owned(),
            });
        }
        let rows = match self.signals {
            Signals::Derivatives => RowForm::Pointwise,
            Signals::Positions(noise) => {
                let window_s = self.window_s.unwrap_or_else(|| auto_window_first(period_s));
                let recommended = ProjectedOptions::recommended();
                RowForm::Projected(
                    ProjectedOptions {
                        sample_period_s: period_s,
                        noise: noise.unwrap_or(SensorNoise::NONE),
                        learn_noise: noise.is_none(),
                        // an eccentric encoder has an error once per turn; a position along a line
                        // has no turn
                        considered: match &*definition.position_unit {
                            "m" => self.considered.without_turns(),
                            _ => self.considered,
                        },
                        ..recommended
                    }
                    .with_window(window_s),
                )
            }
        };
        let noise = match rows {
            RowForm::Projected(_) => EquationNoise::WHITENED,
            RowForm::Pointwise => EquationNoise::LEARNT,
        };
        let equations = definition.equations.len();
        let estimator = EstimatorOptions {
            equations: vec![noise; equations],
            forgetting_factor: self.forgetting_factor,
            change_detection: self.change_detection,
            drift_per_s: match &rows {
                RowForm::Projected(options) => options.considered.drift_per_s,
                RowForm::Pointwise => 0.0,
            },
            ..EstimatorOptions::recommended(self.priors, equations)
        };
        let settings = NodeSettings {
            rows,
            auto_window: self.window_s.is_none(),
            input: InputSource::Measured,
            estimator,
            options: IdentifierOptions {
                sample_period_ns: nanoseconds(period_s),
                ..IdentifierOptions::new(self.block_len as u64, 0, 0)
            },
            pid: std::process::id(),
        };
        let node = self.model.identifier(&settings)?;
        let names = definition.parameters.iter().map(|p| p.name.to_string());
        Ok(Identifier {
            node,
            names: ParameterNames::new(names),
            joints: definition.joints,
            signals: match settings.rows {
                RowForm::Projected(_) => signals::Q | signals::INPUT,
                RowForm::Pointwise => signals::ALL & !signals::SETPOINT,
            },
            period_ns: settings.options.sample_period_ns,
            seq: 0,
            model: self.model,
        })
    }
}

/// An identifier inside a program: samples in, estimates out, no bus.
///
/// After [`build`](IdentifierBuilder::build) it allocates nothing and locks nothing; the same
/// samples give the same bits.
pub struct Identifier {
    node: Box<dyn Node>,
    model: SharedModel,
    names: ParameterNames,
    joints: usize,
    signals: u32,
    period_ns: u64,
    seq: u64,
}

impl std::fmt::Debug for Identifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identifier")
            .field("model", &self.model)
            .field("samples", &self.seq)
            .finish_non_exhaustive()
    }
}

/// Stream id of a stream without a publisher.
const STREAM: u64 = 1;

impl Identifier {
    /// A builder for this plant, with the start values and bounds that the plant defines.
    pub fn builder(plant: impl Plant + Clone + Send + Sync + 'static) -> IdentifierBuilder {
        IdentifierBuilder {
            priors: priors(&plant).collect(),
            model: SharedModel::new(PlantModel::new(plant)),
            unknown: None,
            sample_period_s: 1e-3,
            block_len: BLOCK_LEN,
            signals: Signals::Positions(None),
            counts_per_turn: false,
            window_s: None,
            considered: Considered::default(),
            forgetting_factor: 0.98,
            change_detection: Some(ChangeDetection::default()),
        }
    }

    /// Takes the next sample, one period after the previous one. Returns an estimate if the sample
    /// completes a block.
    pub fn push(&mut self, sample: &JointSample) -> Option<Estimate> {
        self.push_at(self.seq.saturating_mul(self.period_ns), sample)
    }

    /// Takes the next sample, with its own stream time \[ns\].
    ///
    /// A sample that cannot be used, because a signal is not finite or its time goes back, is left
    /// out and counted in [`status`](Self::status).
    pub fn push_at(&mut self, t_ns: u64, sample: &JointSample) -> Option<Estimate> {
        let message = Sample::new(STREAM, self.seq, t_ns, self.joints, self.signals, sample);
        self.seq = self.seq.saturating_add(1);
        let mut completed = None;
        self.node
            .on_sample(&message, &mut |estimate| completed = Some(*estimate));
        completed
    }

    /// States that `samples` samples were lost.
    pub fn skip(&mut self, samples: u64) {
        self.seq = self.seq.saturating_add(samples);
    }

    /// Names of the parameters, in the order of θ.
    pub fn names(&self) -> &ParameterNames {
        &self.names
    }

    /// Counters, state, and the last error.
    pub fn status(&self) -> crate::messages::Status {
        self.node.status()
    }
}
