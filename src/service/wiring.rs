//! From a configuration to nodes: the one place that knows which core type a configured choice means.

use super::Failure;
use super::own_plant::OwnPlant;
use crate::checkpoint::Identity;
use crate::config::{Config, ModelConfig, Rows, with_plant};
use crate::estimator::BlockEstimator;
use crate::messages::signals;
use crate::model::{
    AutoDiff, DerivedValues, ExtendedDerived, ExtendedManipulator, ManipulatorDerived, Plant, PlantDefinition,
};
use crate::node::identifier::{Identifier, IdentifierNode, IdentifierOptions};
use crate::node::monitor::{Label, MonitorNode, Truth};
use crate::rows::{AutoWindowBlock, InputSource, PointwiseBlock, SampleBlock};
use crate::sim::{Machine, SimOptions};

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
    let truth = truth.filter(|sim| simulates(config, sim)).map(|sim| {
        Box::new(SimulatedTruth {
            sim: sim.clone(),
            names: config.model.parameters().iter().map(|p| p.name).collect(),
            derived,
        }) as Box<dyn Truth>
    });
    let model = config.model.definition().hash();
    Ok(MonitorNode::new(parameters, derived_labels, truth).of_model(model))
}

/// Whether the simulated machine is one that the model describes.
pub(super) fn simulates(config: &Config, sim: &SimOptions) -> bool {
    matches!(
        (&config.model, &sim.machine),
        (
            ModelConfig::Manipulator { .. }
                | ModelConfig::ExtendedManipulator { .. }
                | ModelConfig::DelayedManipulator { .. },
            Machine::Arm
        ) | (
            ModelConfig::ServoAxis { .. } | ModelConfig::DelayedServoAxis { .. },
            Machine::ServoAxis(_)
        )
    )
}

/// The identifier of the configured model, or of the program's own plant.
pub(super) fn identifier_node(config: &Config, own: Option<&OwnPlant>) -> Result<Box<dyn Identifier>, Failure> {
    if let Some(own) = own {
        return own.identifier(config);
    }
    // its own fast path
    if let (ModelConfig::Manipulator { plant, .. }, Rows::Pointwise) = (&config.model, &config.identifier.rows) {
        let rows = PointwiseBlock::new(*plant, config.identifier.input, config.estimator.block_len);
        return Ok(Box::new(node(
            config,
            plant,
            needed(config.identifier.input, plant),
            rows,
        )?));
    }
    with_plant!(&config.model, plant => identifier_of(config, plant), own => Err(Failure::Failed(format!(
        "the equations of {} are those of another program",
        own.name
    ))))
}

/// The identifier of a plant.
pub(super) fn identifier_of<P>(config: &Config, plant: &P) -> Result<Box<dyn Identifier>, Failure>
where
    P: Plant + Clone + Send + 'static,
{
    let input = config.identifier.input;
    let block_len = config.estimator.block_len;
    Ok(match &config.identifier.rows {
        Rows::Pointwise => {
            let rows = PointwiseBlock::new(AutoDiff(plant.clone()), input, block_len).leaving_out_standstill(plant);
            Box::new(node(config, plant, needed(input, plant), rows)?)
        }
        Rows::Projected(options) => {
            let start = &config.estimator.options.theta_start;
            let rows = match config.identifier.auto_window {
                true => AutoWindowBlock::chosen(plant, *options, block_len),
                false => AutoWindowBlock::fixed(plant.clone(), *options, block_len),
            };
            let rows = rows
                .and_then(|rows| rows.starting_at(start))
                .map_err(|e| Failure::Usage(format!("identifier.projected: {e}")))?;
            Box::new(node(config, plant, signals::Q | signals::INPUT, rows)?)
        }
    })
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

/// Signals that pointwise rows need: derivatives up to one more than the equations' terms are differentiated, for these hold q̇.
fn needed(input: InputSource, plant: &impl Plant) -> u32 {
    let source = match input {
        InputSource::Measured => signals::INPUT,
        InputSource::Controller(_) => signals::SETPOINT,
    };
    let derivatives = [signals::DQ, signals::DDQ, signals::DDDQ];
    let order = plant.equations().iter().map(|e| e.order).max().unwrap_or(0);
    derivatives
        .iter()
        .take(order + 1)
        .fold(signals::Q | source, |mask, signal| mask | signal)
}

fn node<B: SampleBlock + Send + 'static>(
    config: &Config,
    plant: &impl Plant,
    signals: u32,
    rows: B,
) -> Result<IdentifierNode<B>, Failure> {
    let period_s = config.plant.sim.sample_period_s;
    let options = IdentifierOptions {
        model_hash: PlantDefinition::of(plant).hash(),
        config_hash: config.config_hash(),
        sample_period_ns: (period_s * 1e9).round() as u64,
        input_limit: config.identifier.input_limit,
        frozen_after: (config.identifier.frozen_after_s / period_s).round() as u64,
        ..IdentifierOptions::new(config.estimator.block_len as u64, plant.joints(), signals)
    };
    let places = ExtendedManipulator::places(config.model.extra_terms());
    let derived = derived(config)?
        .map(|derived| Box::new(ExtendedDerived::new(derived, places)) as Box<dyn DerivedValues + Send>);
    let estimator = fresh_estimator(config)?;
    Ok(IdentifierNode::new(
        options,
        rows,
        estimator,
        derived,
        std::process::id(),
    ))
}

/// What a recording says of a plant.
pub(super) struct PlantDescription {
    pub(super) model_hash: u64,
    pub(super) joints: usize,
    pub(super) position_unit: String,
    pub(super) input_unit: String,
    pub(super) equations: Vec<String>,
}

/// The configured plant in words and numbers.
pub(super) fn plant_description(config: &Config) -> PlantDescription {
    let servo_axis = matches!(
        config.model,
        ModelConfig::ServoAxis { .. } | ModelConfig::DelayedServoAxis { .. }
    );
    let linear = servo_axis && config.file_form().servo_axis.motion == "linear";
    let plant = config.model.definition();
    PlantDescription {
        model_hash: plant.hash(),
        joints: plant.joints,
        position_unit: if linear { "m" } else { "rad" }.to_owned(),
        input_unit: plant.input_unit.to_owned(),
        equations: plant.equations.iter().map(|e| e.name.to_owned()).collect(),
    }
}

/// Name of the model.
pub(super) fn model_name(config: &Config) -> &'static str {
    config.model.name()
}

fn derived(config: &Config) -> Result<Option<ManipulatorDerived>, Failure> {
    config
        .model
        .known()
        .map(ManipulatorDerived::new)
        .transpose()
        .map_err(|e| Failure::Usage(format!("model.known: {e}")))
}

/// What the simulator knows and the identifier must find out.
struct SimulatedTruth {
    sim: SimOptions,
    /// The model's parameters.
    names: Vec<&'static str>,
    derived: Option<ManipulatorDerived>,
}

impl Truth for SimulatedTruth {
    fn theta(&self, t_s: f64) -> Vec<f64> {
        self.sim.true_values(&self.names, t_s)
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
