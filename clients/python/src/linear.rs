//! A machine whose equations are linear in its parameters, as arrays: y = Φ θ, sample by sample.

use std::fmt;
use std::sync::Arc;
use thetabus::estimator::{BlockEstimator, Residuals};
use thetabus::model::{DerivedValues, Equation, JointSample, MAX_JOINTS, Parameter, PlantDefinition};
use thetabus::node::block_learner::BlockLearner;
use thetabus::node::identifier::{Identifier, IdentifierNode, IdentifierOptions};
use thetabus::node::model::{Model, ModelError, NodeSettings};
use thetabus::rows::SampleBlock;

/// Φ and y of a whole record, rows in the order sample, equation, parameter.
struct Arrays {
    phi: Vec<f64>,
    y: Vec<f64>,
    equations: usize,
    params: usize,
}

/// The machine as a model; its identifier reads the arrays at the numbers of the samples.
pub(crate) struct LinearModel {
    definition: PlantDefinition,
    arrays: Arc<Arrays>,
}

impl LinearModel {
    /// Of names and units of the parameters, their starts, the unit of y, and the arrays of
    /// `equations` rows per sample.
    pub(crate) fn new(
        parameters: Vec<(String, String, f64)>,
        y_unit: String,
        equations: usize,
        phi: Vec<f64>,
        y: Vec<f64>,
    ) -> Result<Self, String> {
        let params = parameters.len();
        if !(1..=MAX_JOINTS).contains(&equations) {
            return Err(format!("expected 1 to {MAX_JOINTS} equations, got {equations}"));
        }
        if phi.len() != y.len() * params || !y.len().is_multiple_of(equations) {
            return Err(format!(
                "expected {params} numbers of phi per number of y, got {} and {}",
                phi.len(),
                y.len()
            ));
        }
        let definition = PlantDefinition {
            name: "linear".to_owned(),
            joints: equations,
            input_unit: y_unit,
            position_unit: String::new(),
            turns: vec![false; equations],
            parameters: parameters
                .into_iter()
                .map(|(name, unit, start)| Parameter {
                    name: name.into(),
                    unit: unit.into(),
                    ..Parameter::new("", "", "", start)
                })
                .collect(),
            equations: (0..equations)
                .map(|e| Equation {
                    name: format!("row_{}", e + 1).into(),
                    ..Equation::new("", e, 1.0, 0, 0..params)
                })
                .collect(),
            relations: Vec::new(),
            derived: Vec::new(),
        };
        definition.validate().map_err(|e| e.to_string())?;
        let arrays = Arrays {
            phi,
            y,
            equations,
            params,
        };
        Ok(Self {
            definition,
            arrays: Arc::new(arrays),
        })
    }
}

impl fmt::Debug for LinearModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LinearModel")
            .field(&self.definition.parameters.len())
            .finish()
    }
}

impl Model for LinearModel {
    fn definition(&self) -> &PlantDefinition {
        &self.definition
    }

    fn derived(&self) -> Option<Arc<dyn DerivedValues + Send + Sync>> {
        None
    }

    fn input_for(&self, _: &JointSample, _: &[f64], input: &mut [f64; MAX_JOINTS]) {
        // The rows are known at the samples of the record alone.
        *input = [0.0; MAX_JOINTS];
    }

    fn identifier(&self, settings: &NodeSettings) -> Result<Box<dyn Identifier>, ModelError> {
        let wrong = |problem: String| ModelError::Setting {
            section: "estimator",
            problem,
        };
        let estimator =
            BlockEstimator::new(self.structure(), settings.estimator.clone()).map_err(|e| wrong(e.to_string()))?;
        let period_ns = settings.options.sample_period_ns;
        if period_ns == 0 {
            return Err(ModelError::Setting {
                section: "plant.sample_period_s",
                problem: "expected it to be known".to_owned(),
            });
        }
        let rows = Rows {
            arrays: self.arrays.clone(),
            period_ns,
            samples: Vec::with_capacity(settings.options.block_len as usize),
        };
        let options = IdentifierOptions {
            model_hash: self.definition.hash(),
            joints: self.definition.joints,
            signals: 0,
            // y may well stand still
            frozen_after: 0,
            ..settings.options
        };
        Ok(Box::new(IdentifierNode::new(
            options,
            BlockLearner::new(rows, estimator, None),
            settings.pid,
        )))
    }
}

/// A block of rows, by the numbers of its samples.
struct Rows {
    arrays: Arc<Arrays>,
    period_ns: u64,
    samples: Vec<usize>,
}

impl SampleBlock for Rows {
    fn push(&mut self, t_ns: u64, _: &JointSample) -> bool {
        let sample = ((t_ns + self.period_ns / 2) / self.period_ns) as usize;
        let fits =
            self.samples.len() < self.samples.capacity() && (sample + 1) * self.arrays.equations <= self.arrays.y.len();
        if fits {
            self.samples.push(sample);
        }
        fits
    }

    fn clear(&mut self) {
        self.samples.clear();
    }
}

impl Residuals for Rows {
    fn len(&self) -> usize {
        self.samples.len()
    }

    /// f = y − φᵀ θ.
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let Arrays {
            phi,
            y,
            equations,
            params,
        } = &*self.arrays;
        let at = self.samples[index] * equations + equation;
        regressor.copy_from_slice(&phi[at * params..(at + 1) * params]);
        y[at] - regressor.iter().zip(theta).map(|(phi, theta)| phi * theta).sum::<f64>()
    }

    fn span(&self, index: usize) -> (u64, u64) {
        let t_ns = self.samples[index] as u64 * self.period_ns;
        (t_ns, t_ns)
    }
}
