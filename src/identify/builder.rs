//! Collects what is known of a machine and its sensors, checks it, and builds its identifier.

use super::Identifier;
use crate::estimator::{ChangeDetection, EquationNoise, EstimatorOptions, ParameterPrior};
use crate::messages::{ParameterNames, signals};
use crate::model::{
    DefinitionError, Delayed, MAX_JOINTS, Plant, PlantDefinition, SAMPLE_PERIODS_S, usual_delay_limit_s,
};
use crate::node::identifier::IdentifierOptions;
use crate::node::model::{ModelError, NodeSettings, PlantModel, SharedModel};
use crate::rows::{Considered, InputSource, InputTiming, ProjectedOptions, RowForm, SensorNoise, auto_window_first};
use std::sync::Arc;

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

/// An error of a setting.
fn wrong(setting: &'static str, expected: &'static str, got: impl Into<String>) -> BuildError {
    BuildError::Setting {
        setting,
        expected,
        got: got.into(),
    }
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

/// The model of a plant with the parameter `input_delay`, from its start and limit \[s\].
#[derive(Clone)]
struct WithDelay(Arc<dyn Fn(f64, f64) -> SharedModel + Send + Sync>);

impl std::fmt::Debug for WithDelay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("WithDelay")
    }
}

/// Collects what is known of a machine, see [`Identifier::builder`].
#[derive(Debug, Clone)]
pub struct IdentifierBuilder {
    model: SharedModel,
    with_delay: WithDelay,
    /// By name; the last one of a name counts.
    priors: Vec<(String, ParameterPrior)>,
    sample_period_s: f64,
    block_len: usize,
    signals: Signals,
    /// The resolution is in counts per turn, which only angles have.
    counts_per_turn: bool,
    window_s: Option<f64>,
    stride_s: Option<f64>,
    velocity_half_width_s: Option<f64>,
    timing: InputTiming,
    input_delay_s: f64,
    /// Whether the delay is estimated, and its limit if that is stated.
    estimated_delay: Option<Option<f64>>,
    input_limit: Vec<f64>,
    frozen_after_s: f64,
    considered: Considered,
    forgetting_factor: f64,
    change_detection: Option<ChangeDetection>,
}

/// Default N of a block \[samples\].
const BLOCK_LEN: usize = 1900;

impl IdentifierBuilder {
    /// See [`Identifier::builder`].
    pub(super) fn new(plant: impl Plant + Clone + Send + Sync + 'static) -> Self {
        let own = plant.clone();
        let with_delay = move |start_s, limit_s| {
            let delayed = Delayed::new(own.clone(), start_s, limit_s);
            SharedModel::new(PlantModel::new(delayed))
        };
        Self {
            model: SharedModel::new(PlantModel::new(plant)),
            with_delay: WithDelay(Arc::new(with_delay)),
            priors: Vec::new(),
            sample_period_s: 1e-3,
            block_len: BLOCK_LEN,
            signals: Signals::Positions(None),
            counts_per_turn: false,
            window_s: None,
            stride_s: None,
            velocity_half_width_s: None,
            timing: InputTiming::Held,
            input_delay_s: 0.0,
            estimated_delay: None,
            input_limit: Vec::new(),
            frozen_after_s: 0.2,
            considered: Considered::default(),
            forgetting_factor: 0.98,
            change_detection: Some(ChangeDetection::default()),
        }
    }

    /// Time between two samples \[s\], 1e-5 to 1; 1e-3 by default.
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

    /// Time from a window to the next \[s\], one sample period to the window's length; a fifth of
    /// it by default, and at most 20 ms. If the window is chosen from the signals, this is an upper
    /// limit; below 100 Hz it is that of a window of 20 samples, and grows with the window.
    #[must_use]
    pub fn stride_s(mut self, stride_s: f64) -> Self {
        self.stride_s = Some(stride_s);
        self
    }

    /// Time on either side that the velocity filter uses \[s\], 3 to 100 sample periods; 8 by
    /// default, and at most a quarter of the window. More smooths away jumps of the jerk, less
    /// makes noise of the direction of a slow joint. If the window is chosen from the signals, this
    /// is an upper limit, as of [`stride_s`](Self::stride_s).
    #[must_use]
    pub fn velocity_half_width_s(mut self, half_width_s: f64) -> Self {
        self.velocity_half_width_s = Some(half_width_s);
        self
    }

    /// What the inputs do between two samples: held, the default, as a sampled controller gives
    /// them, or continuous, as a measured current, torque or voltage is. The wrong one has the
    /// effect of a delay of half a sample period.
    #[must_use]
    pub fn timing(mut self, timing: InputTiming) -> Self {
        self.timing = timing;
        self
    }

    /// The recorded input acts on the machine this much later \[s\], at most half of the window
    /// either way; negative if it was recorded late. 0 by default.
    #[must_use]
    pub fn input_delay_s(mut self, input_delay_s: f64) -> Self {
        self.input_delay_s = input_delay_s;
        self
    }

    /// Estimates the delay of the input, too, as the last parameter, `input_delay` \[s\], from
    /// [`input_delay_s`](Self::input_delay_s) on. Its magnitude stays below `limit_s` \[s\], best
    /// as small as is safe, because in slow motion a delay looks like an inertia. `None`: two
    /// sample periods, and at least 1 ms, beyond that start.
    #[must_use]
    pub fn estimate_input_delay(mut self, limit_s: Option<f64>) -> Self {
        self.estimated_delay = Some(limit_s);
        self
    }

    /// Magnitude at which the measurement of the inputs ends, in their unit and above 0: one
    /// number, or one per joint. Samples there are refused and counted as saturated. No limit by
    /// default.
    #[must_use]
    pub fn input_limit(mut self, limit: &[f64]) -> Self {
        self.input_limit = limit.to_vec();
        self
    }

    /// A position or input that stands still to the bit for so long \[s\], 0 to 3600 and at least
    /// 20 samples, although the other one says that it must move, is frozen: its samples are
    /// refused, its block is left out. 0.2 s by default; 0: never.
    #[must_use]
    pub fn frozen_after_s(mut self, frozen_after_s: f64) -> Self {
        self.frozen_after_s = frozen_after_s;
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
        self.priors.push((name.to_owned(), prior));
        self
    }

    /// Builds an identifier that has seen no samples. Only this call allocates.
    ///
    /// # Errors
    /// An error that names the wrong setting or parameter.
    pub fn build(self) -> Result<Identifier, BuildError> {
        self.check()?;
        let model = self.delayed_model()?;
        let definition = model.definition();
        definition.validate().map_err(|source| BuildError::Plant {
            plant: definition.name.clone(),
            source,
        })?;
        if self.counts_per_turn && !definition.turns.iter().all(|turns| *turns) {
            return Err(wrong(
                "encoder",
                "joints that turn; for others give sensors() with position_resolution [m]",
                "positions in m",
            ));
        }
        let rows = self.rows();
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
            ..EstimatorOptions::recommended(self.priors(definition)?, equations)
        };
        let settings = NodeSettings {
            rows,
            auto_window: self.window_s.is_none(),
            input: InputSource::Measured,
            estimator,
            options: IdentifierOptions {
                input_limit: self.input_limits(definition.joints)?,
                ..IdentifierOptions::new(self.block_len as u64, 0, 0)
                    .with_times(self.sample_period_s, self.frozen_after_s)
            },
            pid: std::process::id(),
        };
        let node = model.identifier(&settings)?;
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
            model,
        })
    }

    /// Checks the settings that need no plant.
    fn check(&self) -> Result<(), BuildError> {
        let (shortest, longest) = SAMPLE_PERIODS_S;
        if !(shortest..=longest).contains(&self.sample_period_s) {
            return Err(wrong(
                "sample_period_s",
                "1e-5 to 1 s, that is 1 Hz to 100 kHz",
                format!("{} s", self.sample_period_s),
            ));
        }
        if self.block_len == 0 {
            return Err(wrong("block_len", "at least 1 sample", "0"));
        }
        if !self.input_delay_s.is_finite() {
            return Err(wrong(
                "input_delay_s",
                "at most half of window_s either way",
                format!("{} s", self.input_delay_s),
            ));
        }
        if self.stride_s.is_some_and(|stride_s| !(stride_s > 0.0)) {
            return Err(wrong(
                "stride_s",
                "one sample period to window_s",
                format!("{:?} s", self.stride_s.unwrap_or_default()),
            ));
        }
        let periods = |half_width_s: f64| (half_width_s / self.sample_period_s).round();
        let half_width = self.velocity_half_width_s.map(periods);
        if let Some(periods) = half_width.filter(|periods| !(3.0..=100.0).contains(periods)) {
            return Err(wrong(
                "velocity_half_width_s",
                "3 to 100 sample periods",
                periods.to_string(),
            ));
        }
        if !(0.0..=3600.0).contains(&self.frozen_after_s) {
            return Err(wrong(
                "frozen_after_s",
                "0 to 3600 s",
                format!("{} s", self.frozen_after_s),
            ));
        }
        Ok(())
    }

    /// The model, with the parameter `input_delay` if that is estimated.
    fn delayed_model(&self) -> Result<SharedModel, BuildError> {
        const ESTIMATE: &str = "estimate_input_delay";
        let Some(limit_s) = self.estimated_delay else {
            return Ok(self.model.clone());
        };
        if self.signals == Signals::Derivatives {
            return Err(wrong(ESTIMATE, "rows from positions", "exact_derivatives()"));
        }
        let start_s = self.input_delay_s;
        let limit_s = limit_s.unwrap_or_else(|| usual_delay_limit_s(start_s, self.sample_period_s));
        // the negation catches NaN
        if !(limit_s > 0.0 && limit_s >= start_s.abs()) {
            let expected = "a limit above 0 and at least the magnitude of input_delay_s";
            return Err(wrong(ESTIMATE, expected, format!("{limit_s} s")));
        }
        Ok((self.with_delay.0)(start_s, limit_s))
    }

    /// The prior of each parameter.
    fn priors(&self, definition: &PlantDefinition) -> Result<Vec<ParameterPrior>, BuildError> {
        let parameters = &definition.parameters;
        let own = parameters
            .iter()
            .map(|p| ParameterPrior::new(p.start).within(p.lower, p.upper));
        let mut priors: Vec<ParameterPrior> = own.collect();
        for (name, prior) in &self.priors {
            let Some(index) = parameters.iter().position(|p| p.name == *name) else {
                let known: Vec<&str> = parameters.iter().map(|p| &*p.name).collect();
                return Err(BuildError::UnknownParameter {
                    name: name.clone(),
                    known: known.join(", "),
                });
            };
            priors[index] = *prior;
        }
        Ok(priors)
    }

    /// The limit of each joint's input.
    fn input_limits(&self, joints: usize) -> Result<[f64; MAX_JOINTS], BuildError> {
        let limits = self.input_limit.as_slice();
        if limits.len() > 1 && limits.len() != joints || !limits.iter().all(|limit| *limit > 0.0) {
            return Err(wrong(
                "input_limit",
                "one number above 0, or one per joint",
                format!("{limits:?}"),
            ));
        }
        Ok(std::array::from_fn(|joint| match limits {
            [one] => *one,
            limits => limits.get(joint).copied().unwrap_or(f64::INFINITY),
        }))
    }

    /// What the rows are made of, and how.
    fn rows(&self) -> RowForm {
        let Signals::Positions(noise) = self.signals else {
            return RowForm::Pointwise;
        };
        let period_s = self.sample_period_s;
        let window_s = self.window_s.unwrap_or_else(|| auto_window_first(period_s));
        let recommended = ProjectedOptions::recommended();
        let half_width = self
            .velocity_half_width_s
            .map(|half_width_s| (half_width_s / period_s).round());
        let asked = ProjectedOptions {
            sample_period_s: period_s,
            window_s,
            stride_s: self.stride_s.unwrap_or(recommended.stride_s),
            velocity_half_width: half_width.map_or(recommended.velocity_half_width, |periods| periods as usize),
            timing: self.timing,
            input_delay_s: self.input_delay_s,
            noise: noise.unwrap_or(SensorNoise::NONE),
            learn_noise: noise.is_none(),
            considered: self.considered,
        };
        let mut options = asked.with_window(window_s);
        // what is stated holds for a stated window; for an automatic one it is an upper limit
        if self.window_s.is_some() {
            options.stride_s = self.stride_s.unwrap_or(options.stride_s);
            options.velocity_half_width = half_width.map_or(options.velocity_half_width, |periods| periods as usize);
        }
        RowForm::Projected(options)
    }
}
