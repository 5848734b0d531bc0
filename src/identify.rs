//! Identification in a few lines, inside your own program: a plant, what its sensors are, samples
//! in, estimates out.
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
//! What is not said is chosen as `config/own_plant.toml` does: rows over windows of the positions,
//! noise and window learnt from the signals, the estimator that forgets only where new data come,
//! bounds by physics, changes detected. The service makes its identifier in the same way, from its
//! configuration: both end at [`Model::identifier`](crate::node::model::Model::identifier).

pub use crate::estimator::ParameterPrior;

use crate::estimator::{ChangeDetection, EquationNoise, EstimatorOptions};
use crate::messages::{Estimate, ParameterNames, Sample, nanoseconds, signals};
use crate::model::{JointSample, Plant};
use crate::node::identifier::{Identifier as Node, IdentifierOptions};
use crate::node::model::{ModelError, NodeSettings, PlantModel, SharedModel};
use crate::rows::{Considered, InputSource, ProjectedOptions, RowForm, SensorNoise, auto_window_first, priors};

/// Why there is no identifier.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The plant breaks a rule of its definition.
    #[error("the plant {plant}: {problem}")]
    Plant {
        /// Its name.
        plant: String,
        /// The rule, in words.
        problem: String,
    },
    /// The plant has no parameter of this name.
    #[error("expected a parameter out of {known}, got \"{name}\"")]
    UnknownParameter {
        /// The name that was given.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A setting is out of its range.
    #[error("{setting}: expected {expected}, got {got}")]
    Setting {
        /// Method of the builder.
        setting: &'static str,
        /// What would be right.
        expected: &'static str,
        /// What was given.
        got: String,
    },
    /// Settings that do not go together, or with this plant.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// What the rows are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one per builder")]
enum Signals {
    /// Positions and inputs, with noise that is learnt unless it is known.
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
    /// The resolution of the positions is one of angles.
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
    /// is learnt from the signals. For joints that turn; of one that moves along a line
    /// [`sensors`](Self::sensors) states the resolution.
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

    /// Samples carry exact velocities, accelerations and, if the equations ask for it, jerks, as
    /// those of a simulation do: one row per sample.
    #[must_use]
    pub fn exact_derivatives(mut self) -> Self {
        self.signals = Signals::Derivatives;
        self
    }

    /// Length of the windows that rows are made over \[s\], 8 to 2000 sample periods; chosen from
    /// the signals by default.
    #[must_use]
    pub fn window_s(mut self, window_s: f64) -> Self {
        self.window_s = Some(window_s);
        self
    }

    /// What the model does not say and standard deviations must allow for.
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

    /// Looks for sudden changes in this way, or not at all.
    #[must_use]
    pub fn change_detection(mut self, change_detection: Option<ChangeDetection>) -> Self {
        self.change_detection = change_detection;
        self
    }

    /// What is known of one parameter, by its name.
    #[must_use]
    pub fn prior(mut self, name: &str, prior: ParameterPrior) -> Self {
        match self.model.parameters().iter().position(|p| p.name == name) {
            Some(index) => self.priors[index] = prior,
            None => self.unknown = self.unknown.or_else(|| Some(name.to_owned())),
        }
        self
    }

    /// An identifier that has seen nothing. The only place that allocates.
    ///
    /// # Errors
    /// What is wrong, with the name of the setting or parameter.
    pub fn build(self) -> Result<Identifier, BuildError> {
        let definition = self.model.definition();
        definition.validate().map_err(|problem| BuildError::Plant {
            plant: definition.name.clone(),
            problem,
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
                        // positions along a line have no turn that an encoder could be off its
                        // centre in
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

/// Number that a stream without a publisher has.
const STREAM: u64 = 1;

impl Identifier {
    /// Begins with a plant: starts and bounds of its parameters as it defines them.
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

    /// Takes the next sample in, one period after the one before. Returns the estimate that it
    /// completes.
    pub fn push(&mut self, sample: &JointSample) -> Option<Estimate> {
        self.push_at(self.seq.saturating_mul(self.period_ns), sample)
    }

    /// Takes the next sample in, at a stream time \[ns\] of its own.
    ///
    /// A sample that cannot be used, because a signal is not finite or its time goes back, is
    /// counted in [`status`](Self::status) and left out.
    pub fn push_at(&mut self, t_ns: u64, sample: &JointSample) -> Option<Estimate> {
        let message = Sample::new(STREAM, self.seq, t_ns, self.joints, self.signals, sample);
        self.seq = self.seq.saturating_add(1);
        let mut completed = None;
        self.node
            .on_sample(&message, &mut |estimate| completed = Some(*estimate));
        completed
    }

    /// So many samples never came.
    pub fn skip(&mut self, samples: u64) {
        self.seq = self.seq.saturating_add(samples);
    }

    /// Names of the parameters, in the order of θ.
    pub fn names(&self) -> &ParameterNames {
        &self.names
    }

    /// Counters, state, and what was wrong last.
    pub fn status(&self) -> crate::messages::Status {
        self.node.status()
    }
}
