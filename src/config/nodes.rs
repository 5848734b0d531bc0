//! Creates an identifier and its description from a configuration.

use super::Config;
use crate::messages::{DerivedInfo, Description, JointInfo, ParameterInfo, nanoseconds};
use crate::node::identifier::{Identifier, IdentifierOptions};
use crate::node::model::{ModelError, NodeSettings};

impl Config {
    /// The identifier of the configured model, as a value: samples in, estimates out.
    ///
    /// # Errors
    /// If a setting does not fit the model.
    pub fn identifier(&self) -> Result<Box<dyn Identifier>, ModelError> {
        let period_s = self.plant.sim.sample_period_s;
        self.model.identifier(&NodeSettings {
            rows: self.identifier.rows,
            auto_window: self.identifier.auto_window,
            input: self.identifier.input,
            estimator: self.estimator.options.clone(),
            options: IdentifierOptions {
                config_hash: self.config_hash(),
                input_limit: self.identifier.input_limit,
                ..IdentifierOptions::new(self.estimator.block_len as u64, 0, 0)
                    .with_times(period_s, self.identifier.frozen_after_s)
            },
            pid: std::process::id(),
        })
    }

    /// Names, units, meanings, bounds and start values, for topic `description`.
    pub fn description(&self) -> Description {
        let model = self.model.definition();
        let priors = &self.estimator.options.parameters;
        let joints = (0..model.joints).map(|joint| {
            let name = format!("joint_{}", joint + 1);
            JointInfo::new(&name, model.joint_unit(joint), &model.input_unit)
        });
        let parameters = model.parameters.iter().zip(priors).map(|(p, prior)| {
            let bounds = (prior.lower, prior.upper);
            ParameterInfo::new(&p.name, &p.unit, &p.meaning, prior.start, bounds)
        });
        let derived = model.derived.iter();
        let derived = derived.map(|d| DerivedInfo::new(&d.name, &d.unit, &d.meaning));
        let mut description = Description::default()
            .of_model(&model.name, model.hash(), &model.input_unit)
            .with(joints, parameters, derived);
        description.config_hash = self.config_hash();
        description.block_len = self.estimator.block_len as u64;
        description.sample_period_ns = nanoseconds(self.plant.sim.sample_period_s);
        description.equations = model.equations.len() as u32;
        description
    }
}
