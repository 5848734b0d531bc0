//! A model for the programs: one value behind one trait, independent of its equations.
//!
//! ```text
//! Plant (generic) ──PlantModel──▶ dyn Model ──identifier()──▶ dyn Identifier
//! ```
//!
//! Generics end here: a configuration holds a [`SharedModel`], whose identifier or simulator is one
//! boxed value per robot. Pointwise rows are compiled for their plant; projected rows call its
//! terms through [`AnyPlant`](crate::model::AnyPlant), a few times per sample.

use super::block_learner::BlockLearner;
use super::identifier::{Identifier, IdentifierNode, IdentifierOptions};
use super::learner::Learner;
use crate::estimator::{BlockEstimator, EstimatorOptions, LEAST_EXPLAINED, Structure};
use crate::messages::signals;
use crate::model::{
    AutoDiff, DerivedQuantity, DerivedValues, JointSample, MAX_JOINTS, MAX_PARAMS, Parameter, Plant, PlantDefinition,
    PlantDerived, PointwiseModel,
};
use crate::rows::{AutoWindowBlock, InputSource, PointwiseBlock, RowForm, SampleBlock, sticking_joints, structure};
use std::fmt;
use std::sync::Arc;

/// Settings of an identifier, besides its model.
#[derive(Debug, Clone)]
pub struct NodeSettings {
    /// Form of the rows.
    pub rows: RowForm,
    /// True if the window of projected rows is chosen from the signals.
    pub auto_window: bool,
    /// Source of u.
    pub input: InputSource,
    /// The estimator; its block length is that of `options`.
    pub estimator: EstimatorOptions,
    /// Options about streams and their faults. Joints, signals and model hash come from the model
    /// and need not be set.
    pub options: IdentifierOptions,
    /// Process id for the status.
    pub pid: u32,
}

/// Why a model gives no identifier or no simulator with these settings.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A setting does not fit.
    #[error("{section}: {problem}")]
    Setting {
        /// Section or key of the configuration.
        section: &'static str,
        /// The problem, in words.
        problem: String,
    },
    /// There is no simulator of this model.
    #[error("the model {0} brings no simulator")]
    NotSimulated(String),
}

impl ModelError {
    fn setting(section: &'static str, problem: impl fmt::Display) -> Self {
        let problem = problem.to_string();
        Self::Setting { section, problem }
    }
}

/// A model: the meaning of its numbers, and the construction of its identifier.
pub trait Model: fmt::Debug + Send + Sync {
    /// Names, units, bounds, equations.
    fn definition(&self) -> &PlantDefinition;

    /// Values derived from θ, if there are any.
    fn derived(&self) -> Option<Arc<dyn DerivedValues + Send + Sync>>;

    /// An identifier without data. Only this call allocates.
    ///
    /// # Errors
    /// The setting that does not fit this model.
    fn identifier(&self, settings: &NodeSettings) -> Result<Box<dyn Identifier>, ModelError>;

    /// The input at which the equations hold along a motion, per joint and in the input's unit,
    /// from q, q̇, q̈ and, if used, q⃛ of `motion`. 0 for a joint without an equation.
    fn input_for(&self, motion: &JointSample, theta: &[f64], input: &mut [f64; MAX_JOINTS]);

    /// Share of each joint's or equation's signal power that the model is expected to explain, 0 to
    /// 1: less is a misfit.
    fn least_explained(&self) -> f64 {
        LEAST_EXPLAINED
    }

    /// True if the parameters include a payload, which a command may declare.
    fn takes_payload(&self) -> bool {
        false
    }

    /// True if its identifier has no exchangeable estimator: it restarts by
    /// [`Change::Restart`](super::command::Change::Restart) and has no tunables.
    fn restarts_itself(&self) -> bool {
        false
    }

    /// Name as in configuration files.
    fn name(&self) -> &str {
        &self.definition().name
    }

    /// The parameters θ.
    fn parameters(&self) -> &[Parameter] {
        &self.definition().parameters
    }

    /// The parameters of each equation.
    fn structure(&self) -> Structure {
        let definition = self.definition();
        Structure {
            params: definition.parameters.len(),
            equations: definition.equations.iter().map(|e| e.parameters.clone()).collect(),
        }
    }

    /// A simulation of the machine: samples k = 0, 1, 2, … without end.
    ///
    /// # Errors
    /// If the model cannot be simulated with these options.
    #[cfg(feature = "sim")]
    fn simulator(&self, _options: &crate::sim::SimOptions) -> Result<SampleSource, ModelError> {
        Err(ModelError::NotSimulated(self.name().to_owned()))
    }

    /// The desired motion of its simulator, if that differs from the setpoints of the options.
    ///
    /// # Errors
    /// If the model cannot be simulated with these options.
    #[cfg(feature = "sim")]
    fn desired_motion(
        &self,
        _options: &crate::sim::SimOptions,
    ) -> Result<Option<Box<dyn crate::sim::DesiredMotion>>, ModelError> {
        Ok(None)
    }
}

/// Samples of a simulated machine.
#[cfg(feature = "sim")]
pub type SampleSource = Box<dyn crate::sim::Commanded + Send>;

/// A model shared by a configuration and everything built from it; equal if the definitions are
/// equal.
#[derive(Debug, Clone)]
pub struct SharedModel(Arc<dyn Model>);

impl SharedModel {
    /// Shares a model.
    pub fn new(model: impl Model + 'static) -> Self {
        Self(Arc::new(model))
    }
}

impl std::ops::Deref for SharedModel {
    type Target = dyn Model;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl PartialEq for SharedModel {
    fn eq(&self, other: &Self) -> bool {
        self.definition() == other.definition()
    }
}

/// Any [`Plant`] as a [`Model`]; `M` is its pointwise form.
pub struct PlantModel<P, M = AutoDiff<P>> {
    plant: P,
    pointwise: M,
    definition: PlantDefinition,
    derived: Option<Arc<dyn DerivedValues + Send + Sync>>,
}

impl<P: Plant + Clone + Send + Sync + 'static> PlantModel<P> {
    /// A plant with the values that it [derives](Plant::derived) itself and the pointwise form by
    /// automatic differentiation.
    pub fn new(plant: P) -> Self {
        let derives = !plant.derived().is_empty();
        Self {
            pointwise: AutoDiff(plant.clone()),
            definition: PlantDefinition::of(&plant),
            derived: derives.then(|| Arc::new(PlantDerived(plant.clone())) as _),
            plant,
        }
    }
}

impl<P, M> PlantModel<P, M> {
    /// The same with a faster pointwise form, which must be tested equal.
    pub fn with_pointwise<N>(self, pointwise: N) -> PlantModel<P, N> {
        PlantModel {
            plant: self.plant,
            pointwise,
            definition: self.definition,
            derived: self.derived,
        }
    }

    /// The same with derived values that need more than θ, such as known constants.
    #[must_use]
    pub fn deriving(mut self, derived: impl DerivedValues + Send + Sync + 'static) -> Self {
        self.definition.derived = derived.quantities().to_vec();
        self.derived = Some(Arc::new(derived));
        self
    }
}

impl<P, M> fmt::Debug for PlantModel<P, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("PlantModel").field(&self.definition.name).finish()
    }
}

impl<P, M> Model for PlantModel<P, M>
where
    P: Plant + Clone + Send + Sync + 'static,
    M: PointwiseModel + Clone + Send + Sync + 'static,
    M::Features: Send,
{
    fn definition(&self) -> &PlantDefinition {
        &self.definition
    }

    fn derived(&self) -> Option<Arc<dyn DerivedValues + Send + Sync>> {
        self.derived.clone()
    }

    fn identifier(&self, settings: &NodeSettings) -> Result<Box<dyn Identifier>, ModelError> {
        let block_len = settings.options.block_len as usize;
        let estimator = settings.estimator.validate(&self.structure());
        estimator.map_err(|e| ModelError::setting("estimator", e))?;
        match &settings.rows {
            RowForm::Pointwise => {
                let rows = PointwiseBlock::new(self.pointwise.clone(), settings.input, block_len)
                    .leaving_out_standstill(&self.plant)
                    .knowing_products(&self.plant);
                self.node(settings, pointwise_signals(settings.input, &self.definition), rows)
            }
            RowForm::Projected(options) => {
                let rows = match settings.auto_window {
                    true => AutoWindowBlock::chosen(self.plant.clone(), *options, block_len),
                    false => AutoWindowBlock::fixed(self.plant.clone(), *options, block_len),
                };
                let rows = rows
                    .and_then(|rows| rows.starting_at(&settings.estimator.theta_start()))
                    .map_err(|e| ModelError::setting("identifier.projected", e))?;
                self.node(settings, signals::Q | signals::INPUT, rows)
            }
        }
    }

    fn input_for(&self, motion: &JointSample, theta: &[f64], input: &mut [f64; MAX_JOINTS]) {
        *input = [0.0; MAX_JOINTS];
        let still = JointSample {
            input: [0.0; MAX_JOINTS],
            ..*motion
        };
        let features = self.pointwise.features(&still);
        let mut regressor = [0.0; MAX_PARAMS];
        for (e, equation) in self.definition.equations.iter().enumerate() {
            // f = s u − Σ …, so u = −f(u = 0)/s
            let own = &mut regressor[..equation.parameters.len()];
            input[equation.input] = -self.pointwise.row(e, &features, theta, own) / equation.input_scale;
        }
    }

    #[cfg(feature = "sim")]
    fn simulator(&self, options: &crate::sim::SimOptions) -> Result<SampleSource, ModelError> {
        let simulator = crate::sim::PlantSimulator::new(self.plant.clone(), options)
            .map_err(|e| ModelError::setting("plant", e))?;
        Ok(Box::new(simulator))
    }
}

impl<P: Plant, M> PlantModel<P, M> {
    fn node<B: SampleBlock + Send + 'static>(
        &self,
        settings: &NodeSettings,
        signals: u32,
        rows: B,
    ) -> Result<Box<dyn Identifier>, ModelError> {
        let estimator = BlockEstimator::new(structure(&self.plant), settings.estimator.clone())
            .map_err(|e| ModelError::setting("estimator", e))?;
        let options = IdentifierOptions {
            model_hash: self.definition.hash(),
            joints: self.definition.joints,
            signals,
            sticking: sticking_joints(&self.plant),
            ..settings.options
        };
        let derived = self
            .derived
            .clone()
            .map(|derived| Box::new(Shared(derived)) as Box<dyn DerivedValues + Send>);
        Ok(Box::new(IdentifierNode::<dyn Learner>::boxed(
            options,
            Box::new(BlockLearner::new(rows, estimator, derived)),
            settings.pid,
        )))
    }
}

/// Signals that pointwise rows need: derivatives up to one order more than the terms are
/// differentiated, because the terms contain q̇.
fn pointwise_signals(input: InputSource, definition: &PlantDefinition) -> u32 {
    let source = match input {
        InputSource::Measured => signals::INPUT,
        InputSource::Controller(_) => signals::SETPOINT,
    };
    let derivatives = [signals::DQ, signals::DDQ, signals::DDDQ];
    let order = definition.equations.iter().map(|e| e.order).max().unwrap_or(0);
    derivatives
        .iter()
        .take(order + 1)
        .fold(signals::Q | source, |mask, signal| mask | signal)
}

/// Derived values that several nodes read.
struct Shared(Arc<dyn DerivedValues + Send + Sync>);

impl DerivedValues for Shared {
    fn quantities(&self) -> &[DerivedQuantity] {
        self.0.quantities()
    }

    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64 {
        self.0.value_and_gradient(index, theta, gradient)
    }
}
