//! What an identifier publishes of itself, and what a monitor takes from it.

use crate::config::Config;
use crate::messages::{DerivedInfo, Description, JointInfo, ParameterInfo};
use crate::node::monitor::{Label, MonitorNode};

/// The configured model in the form of the topic.
pub(super) fn description(config: &Config) -> Description {
    let model = config.model.definition();
    let options = &config.estimator.options;
    let joints = (1..=model.joints)
        .map(|joint| JointInfo::new(&format!("joint_{joint}"), &model.position_unit, &model.input_unit));
    let parameters = model.parameters.iter().enumerate().map(|(i, p)| {
        let bounds = (options.lower[i], options.upper[i]);
        ParameterInfo::new(&p.name, &p.unit, &p.meaning, options.theta_start[i], bounds)
    });
    let derived = model.derived.iter();
    let derived = derived.map(|d| DerivedInfo::new(&d.name, &d.unit, &d.meaning));
    let mut description = Description::default()
        .of_model(&model.name, model.hash(), &model.input_unit)
        .with(joints, parameters, derived);
    description.config_hash = config.config_hash();
    description.block_len = config.estimator.block_len as u64;
    description.sample_period_ns = (config.plant.sim.sample_period_s * 1e9).round() as u64;
    description.equations = model.equations.len() as u32;
    description
}

/// A monitor that takes names and units from a description.
pub(super) fn monitor_of(description: &Description) -> MonitorNode {
    let label = |name: &str, unit: &str| Label {
        name: name.to_owned(),
        unit: unit.to_owned(),
    };
    let parameters = description.parameters().iter().map(|p| label(p.name(), p.unit()));
    let derived = description.derived().iter().map(|d| label(d.name(), d.unit()));
    MonitorNode::new(parameters.collect(), derived.collect(), None).of_model(description.model_hash)
}
