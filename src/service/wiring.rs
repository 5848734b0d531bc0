//! From a configuration to nodes: the one place that knows what each of its sections is for.

use super::Failure;
use crate::checkpoint::Identity;
use crate::config::Config;
use crate::estimator::BlockEstimator;
use crate::model::DerivedValues;
use crate::node::identifier::Identifier;
use crate::node::model::ModelError;
use crate::node::monitor::{Label, MonitorNode, Truth};
use crate::node::predicted_input::PredictedInput;
use crate::sim::SimOptions;
use std::sync::Arc;

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        Self::Usage(error.to_string())
    }
}

/// A monitor that knows the names, and what the values really are if `truth` is the simulated
/// machine.
pub(super) fn monitor_node(config: &Config, truth: Option<&SimOptions>) -> MonitorNode {
    let definition = config.model.definition();
    let parameters = definition
        .parameters
        .iter()
        .map(|p| Label::new(&*p.name, &*p.unit))
        .collect();
    let derived = definition
        .derived
        .iter()
        .map(|d| Label::new(&*d.name, &*d.unit))
        .collect();
    let truth = truth.filter(|sim| simulates(config, sim)).map(|sim| {
        Box::new(SimulatedTruth {
            sim: sim.clone(),
            names: definition.parameters.iter().map(|p| p.name.to_string()).collect(),
            derived: config.model.derived(),
        }) as Box<dyn Truth>
    });
    MonitorNode::new(parameters, derived, truth)
        .of_model(definition.hash())
        .explaining(config.model.least_explained())
}

/// Whether the simulated machine is one that the model describes.
pub(super) fn simulates(config: &Config, sim: &SimOptions) -> bool {
    config.model.name() == sim.model()
}

/// The identifier of the configured model.
pub(super) fn identifier_node(config: &Config) -> Result<Box<dyn Identifier>, Failure> {
    Ok(config.identifier()?)
}

/// What predicts the joints' inputs along the measured motion.
pub(super) fn input_prediction(config: &Config) -> PredictedInput {
    PredictedInput::new(config.model.clone(), config.plant.sim.sample_period_s)
}

/// An estimator at its start values.
pub(super) fn fresh_estimator(config: &Config) -> Result<BlockEstimator, Failure> {
    BlockEstimator::new(config.model.structure(), config.estimator.options.clone())
        .map_err(|e| Failure::Usage(format!("estimator: {e}")))
}

/// Whose checkpoints an identifier of this configuration reads and writes.
pub(super) fn identity(config: &Config) -> Identity {
    Identity {
        robot: config.bus.robot.clone(),
        model_hash: config.model.definition().hash(),
        config_hash: config.config_hash(),
    }
}

/// What the simulator knows and the identifier must find out.
struct SimulatedTruth {
    sim: SimOptions,
    /// The model's parameters.
    names: Vec<String>,
    derived: Option<Arc<dyn DerivedValues + Send + Sync>>,
}

impl Truth for SimulatedTruth {
    fn theta(&self, t_s: f64) -> Vec<f64> {
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        self.sim.true_values(&names, t_s)
    }

    fn derived(&self, t_s: f64) -> Vec<f64> {
        let theta = self.theta(t_s);
        let mut gradient = vec![0.0; theta.len()];
        let count = self.derived.as_ref().map_or(0, |derived| derived.quantities().len());
        let values = self.derived.iter().cycle().zip(0..count);
        values
            .map(|(derived, i)| derived.value_and_gradient(i, &theta, &mut gradient))
            .collect()
    }
}
