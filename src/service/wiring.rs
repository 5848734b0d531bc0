//! From a configuration to nodes: the one place that knows which core type a configured choice means.

use super::Failure;
use crate::config::{Config, ModelConfig};
use crate::estimator::BlockEstimator;
use crate::messages::signals;
use crate::model::{DerivedValues, Manipulator, ManipulatorDerived, Plant};
use crate::node::identifier::{IdentifierNode, IdentifierOptions};
use crate::node::monitor::{Label, MonitorNode, Truth};
use crate::rows::{InputSource, PointwiseBlock, structure};
use crate::sim::SimOptions;

/// A monitor that knows the names, and what the values really are where `truth` is the simulated machine.
pub(super) fn monitor_node(config: &Config, truth: Option<&SimOptions>) -> Result<MonitorNode, Failure> {
    let label = |name: &str, unit: &str| Label {
        name: name.to_owned(),
        unit: unit.to_owned(),
    };
    let parameters = config
        .model
        .parameters()
        .iter()
        .map(|p| label(p.name, p.unit))
        .collect();
    let derived = derived(config)?;
    let derived_labels = derived
        .iter()
        .flat_map(|derived| derived.quantities())
        .map(|quantity| label(quantity.name, quantity.unit))
        .collect();
    let truth = truth.map(|sim| {
        Box::new(SimulatedTruth {
            sim: sim.clone(),
            derived,
        }) as Box<dyn Truth>
    });
    Ok(MonitorNode::new(parameters, derived_labels, truth))
}

/// The identifier of the configured model.
pub(super) fn identifier_node(config: &Config) -> Result<IdentifierNode<PointwiseBlock<Manipulator>>, Failure> {
    let ModelConfig::Manipulator { plant, .. } = &config.model;
    let input = config.identifier.input;
    let needed = match input {
        InputSource::Measured => signals::ALL & !signals::SETPOINT,
        InputSource::Controller(_) => signals::ALL & !signals::INPUT,
    };
    let block_len = config.estimator.block_len;
    let options = IdentifierOptions {
        block_len: block_len as u64,
        joints: plant.joints(),
        signals: needed,
        model_hash: model_hash(plant),
        config_hash: config.config_hash(),
    };
    let estimator = BlockEstimator::new(structure(plant), config.estimator.options.clone())
        .map_err(|e| Failure::Usage(format!("estimator: {e}")))?;
    let rows = PointwiseBlock::new(*plant, input, block_len);
    let derived = derived(config)?.map(|derived| Box::new(derived) as Box<dyn DerivedValues>);
    Ok(IdentifierNode::new(
        options,
        rows,
        estimator,
        derived,
        std::process::id(),
    ))
}

/// Name of the model.
pub(super) fn model_name(config: &Config) -> &'static str {
    match &config.model {
        ModelConfig::Manipulator { plant, .. } => plant.name(),
    }
}

fn derived(config: &Config) -> Result<Option<ManipulatorDerived>, Failure> {
    match &config.model {
        ModelConfig::Manipulator { known, .. } => known
            .map(ManipulatorDerived::new)
            .transpose()
            .map_err(|e| Failure::Usage(format!("model.known: {e}"))),
    }
}

/// Changes with whatever gives θ̂ its meaning: names, units, equations. 64-bit FNV-1a, the same on every machine.
fn model_hash(plant: &impl Plant) -> u64 {
    let parameters = plant.parameters().iter().map(|p| format!("{} [{}]", p.name, p.unit));
    let equations = plant.equations().iter().map(|e| {
        format!(
            "{} {} {} {} {:?}",
            e.name, e.input, e.input_scale, e.order, e.parameters
        )
    });
    let text = std::iter::once(plant.name().to_owned())
        .chain(parameters)
        .chain(equations);
    text.flat_map(|line| line.into_bytes().into_iter().chain([b'\n']))
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
}

/// What the simulator knows and the identifier must find out.
struct SimulatedTruth {
    sim: SimOptions,
    derived: Option<ManipulatorDerived>,
}

impl Truth for SimulatedTruth {
    fn theta(&self, t_s: f64) -> Vec<f64> {
        self.sim.true_theta(t_s).to_vec()
    }

    fn derived(&self, t_s: f64) -> Vec<f64> {
        let theta = self.sim.true_theta(t_s);
        let mut gradient = theta;
        self.derived.iter().fold(Vec::new(), |mut values, derived| {
            let count = derived.quantities().len();
            values.extend((0..count).map(|i| derived.value_and_gradient(i, &theta, &mut gradient)));
            values
        })
    }
}
