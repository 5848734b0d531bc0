//! A robot from its URDF as a [`Model`], for programs that identify it, simulate it and name its
//! values.

use super::identifier::{Identifier, IdentifierNode, IdentifierOptions};
use super::learner::Learner;
use super::model::{Model, ModelError, NodeSettings};
use super::robot::RobotLearner;
use crate::messages::signals;
use crate::model::{
    DefinitionError, DerivedQuantity, DerivedValues, Equation, JointSample, MAX_JOINTS, MAX_PARAMS, MIXED_UNIT,
    Parameter, PlantDefinition,
};
use crate::robot::LEAST_EXPLAINED;
#[cfg(feature = "sim")]
use crate::robot::Reference;
use crate::robot::{
    BODY_PARAMETERS, BodyParameters, Drives, Engagement, FilteredSample, IdentifyError, IdentifyOptions,
    PAYLOAD_VALUES, Payload, RobotIdentifier, RobotModel, RobotSimOptions, Velocities, controller_values,
};
use crate::words::fnv1a;
use std::sync::Arc;

/// Characters of a name taken from the robot; the rest distinguishes robots with the same name.
const LONGEST_NAME: usize = 20;

/// Settings of a robot's identifier and simulation.
#[derive(Debug, Clone)]
pub struct RobotSettings {
    /// The arm with its friction.
    pub model: RobotModel,
    /// Conversion of inputs to torques.
    pub drives: Drives,
    /// Options of the identification.
    pub options: IdentifyOptions,
    /// Time on either side over which velocities are computed from positions \[s\]; `None` if
    /// samples carry them.
    pub velocity_s: Option<f64>,
    /// The simulated robot; sample period and seed are those of the simulation.
    pub simulation: RobotSimOptions,
}

/// Settings from which no model follows.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotPlantError {
    /// The options of the identification.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The robot has more joints or parameters than an estimate holds.
    #[error(transparent)]
    Definition(#[from] DefinitionError),
}

/// A robot as a model.
#[derive(Debug)]
pub struct RobotPlant {
    settings: RobotSettings,
    definition: PlantDefinition,
    payload: Option<Arc<PayloadValues>>,
    /// The payload, whose parameters follow the arm's.
    group: Option<Payload>,
}

impl RobotPlant {
    /// A robot with these settings.
    ///
    /// # Errors
    /// If options do not fit, or there are more parameters than an estimate can hold.
    pub fn new(settings: RobotSettings) -> Result<Self, RobotPlantError> {
        let identifier = RobotIdentifier::new(settings.model.clone(), settings.options)?;
        let robot = settings.model.robot();
        let own = |text: &str| std::borrow::Cow::<'static, str>::Owned(text.to_owned());
        let parameters: Vec<Parameter> = identifier
            .parameters()
            .iter()
            .map(|p| Parameter {
                name: own(&p.name),
                unit: own(p.unit),
                meaning: own(&p.meaning),
                ..Parameter::new("", "", "", p.nominal)
            })
            .collect();
        let equations = robot.joints.iter().enumerate().map(|(i, joint)| Equation {
            name: own(&joint.name),
            ..Equation::new("", i, 1.0, 1, 0..parameters.len())
        });
        let derived: Vec<DerivedQuantity> = PAYLOAD_VALUES
            .iter()
            .filter(|_| identifier.estimates_payload())
            .map(|(name, unit, meaning)| DerivedQuantity::new(name, unit, meaning))
            .collect();
        let payload = settings.model.parameters().len();
        let (position_unit, input_unit) = robot_units(&settings.model, &settings.drives);
        let definition = PlantDefinition {
            name: name(&settings),
            joints: robot.len(),
            input_unit: input_unit.to_owned(),
            position_unit: position_unit.to_owned(),
            turns: robot.joints.iter().map(|joint| joint.turns).collect(),
            equations: equations.collect(),
            parameters,
            relations: Vec::new(),
            derived: derived.clone(),
        };
        definition.validate()?;
        Ok(Self {
            group: (!derived.is_empty()).then(|| Payload::new(&settings.model)),
            payload: (!derived.is_empty()).then(|| {
                Arc::new(PayloadValues {
                    quantities: derived,
                    first: payload,
                })
            }),
            settings,
            definition,
        })
    }

    /// Its settings.
    pub fn settings(&self) -> &RobotSettings {
        &self.settings
    }
}

/// Units of the positions and of the drives' inputs.
pub fn robot_units(model: &RobotModel, drives: &Drives) -> (&'static str, &'static str) {
    let joints = &model.robot().joints;
    let is_torque = drives.gain.iter().all(|gain| *gain == 1.0);
    let (position, effort) = match (joints.iter().any(|j| j.turns), joints.iter().all(|j| j.turns)) {
        (true, true) => ("rad", "N m"),
        (true, false) => (MIXED_UNIT, "N m or N"),
        (false, _) => ("m", "N"),
    };
    (position, if is_torque { effort } else { "A" })
}

/// The robot's name, with a digest of everything that determines the meaning of its parameters:
/// combinations from the URDF, friction terms, windows.
fn name(settings: &RobotSettings) -> String {
    let model = &settings.model;
    let mut own: String = model
        .robot()
        .name
        .to_lowercase()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .take(LONGEST_NAME)
        .collect();
    if own.is_empty() {
        own.push_str("robot");
    }
    let meanings = model.parameters().iter().map(|p| format!("{} {}", p.name, p.meaning));
    let rest = format!("{:?} {:?} {:?}", model.friction(), settings.options, settings.drives);
    let digest = fnv1a(meanings.chain([rest]).flat_map(String::into_bytes));
    format!("{own}_{:08x}", digest as u32)
}

impl Model for RobotPlant {
    fn definition(&self) -> &PlantDefinition {
        &self.definition
    }

    fn derived(&self) -> Option<Arc<dyn DerivedValues + Send + Sync>> {
        self.payload.clone().map(|payload| payload as _)
    }

    fn input_for(&self, motion: &JointSample, theta: &[f64], input: &mut [f64; MAX_JOINTS]) {
        let model = &self.settings.model;
        let (n, arm) = (model.robot().len(), model.parameters().len());
        let mut effective = [0.0; MAX_PARAMS];
        match &self.group {
            Some(payload) => payload.effective(theta, &mut effective[..arm]),
            None => effective[..arm].copy_from_slice(&theta[..arm]),
        }
        // The engagement of a resting joint does not follow from the motion alone.
        let state = FilteredSample {
            q: motion.q,
            dq: motion.dq,
            ddq: motion.ddq,
            engagement: motion.dq.map(Engagement::steady),
            ..FilteredSample::default()
        };
        let mut tau = [0.0; MAX_JOINTS];
        model.torques(&effective[..arm], &state, &mut tau[..n]);
        *input = self.settings.drives.inputs(&tau);
    }

    fn least_explained(&self) -> f64 {
        LEAST_EXPLAINED
    }

    fn takes_payload(&self) -> bool {
        self.payload.is_some()
    }

    fn restarts_itself(&self) -> bool {
        true
    }

    fn identifier(&self, settings: &NodeSettings) -> Result<Box<dyn Identifier>, ModelError> {
        let setting = |problem: &dyn std::fmt::Display| ModelError::Setting {
            section: "identify",
            problem: problem.to_string(),
        };
        let own = &self.settings;
        let robot = RobotIdentifier::new(own.model.clone(), own.options).map_err(|e| setting(&e))?;
        let period_s = settings.options.sample_period_ns as f64 * 1e-9;
        if let Some(too_far_apart) = own.options.windows.too_far_apart(period_s) {
            return Err(setting(&too_far_apart));
        }
        let velocities = own.velocity_s.map(|half_s| {
            let half = if period_s > 0.0 {
                (half_s / period_s).round()
            } else {
                0.0
            };
            Velocities::new(half as usize, own.options.windows.max_gap_s)
        });
        let speed = if velocities.is_some() { 0 } else { signals::DQ };
        let options = IdentifierOptions {
            model_hash: self.definition.hash(),
            joints: self.definition.joints,
            signals: signals::Q | signals::INPUT | speed,
            // A joint that sticks under torque must not count as a frozen sensor.
            frozen_after: 0,
            ..settings.options
        };
        Ok(Box::new(IdentifierNode::<dyn Learner>::boxed(
            options,
            Box::new(RobotLearner::new(own.drives.clone(), robot, velocities)),
            settings.pid,
        )))
    }

    #[cfg(feature = "sim")]
    fn simulator(&self, options: &crate::sim::SimOptions) -> Result<super::model::SampleSource, ModelError> {
        let own = &self.settings;
        let simulation = RobotSimOptions {
            sample_period_s: options.sample_period_s,
            seed: options.seed,
            ..own.simulation.clone()
        };
        let simulator = crate::robot::RobotSimulator::new(own.model.robot(), simulation).map_err(not_simulated)?;
        Ok(Box::new(Driven {
            simulator,
            drives: own.drives.clone(),
        }))
    }

    #[cfg(feature = "sim")]
    fn desired_motion(
        &self,
        options: &crate::sim::SimOptions,
    ) -> Result<Option<Box<dyn crate::sim::DesiredMotion>>, ModelError> {
        let (robot, simulation) = (self.settings.model.robot(), &self.settings.simulation);
        let reference = Reference::new(robot, simulation.motions.clone(), simulation.limits, options.seed);
        Ok(Some(Box::new(Wanted(reference.map_err(not_simulated)?))))
    }
}

#[cfg(feature = "sim")]
fn not_simulated(error: impl std::fmt::Display) -> ModelError {
    ModelError::Setting {
        section: "simulate",
        problem: error.to_string(),
    }
}

/// The desired motion of a simulated robot; its third derivative is not used.
#[cfg(feature = "sim")]
#[derive(Debug, Clone)]
struct Wanted(Reference);

#[cfg(feature = "sim")]
impl crate::sim::DesiredMotion for Wanted {
    fn at(&mut self, t_s: f64) -> JointSample {
        let setpoints = self.0.at(t_s);
        let part = |order: usize| std::array::from_fn(|joint| setpoints[joint][order]);
        JointSample {
            q: part(0),
            dq: part(1),
            ddq: part(2),
            setpoint: part(0),
            ..JointSample::default()
        }
    }

    fn copy(&self) -> Box<dyn crate::sim::DesiredMotion> {
        Box::new(self.clone())
    }
}

/// A simulated robot whose inputs are those of its drives.
#[cfg(feature = "sim")]
struct Driven {
    simulator: crate::robot::RobotSimulator,
    drives: Drives,
}

#[cfg(feature = "sim")]
impl Iterator for Driven {
    type Item = crate::model::JointSample;

    fn next(&mut self) -> Option<Self::Item> {
        let mut sample = self.simulator.next()?;
        sample.input = self.drives.inputs(&sample.input);
        Some(sample)
    }
}

#[cfg(feature = "sim")]
impl crate::sim::Commanded for Driven {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        self.simulator.command(&self.drives.torques(feed_forward));
    }
}

/// The payload of θ in the form that robot controllers use.
#[derive(Debug)]
struct PayloadValues {
    quantities: Vec<DerivedQuantity>,
    first: usize,
}

impl DerivedValues for PayloadValues {
    fn quantities(&self) -> &[DerivedQuantity] {
        &self.quantities
    }

    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let mut body = BodyParameters::default();
        body.0.copy_from_slice(&theta[self.first..self.first + BODY_PARAMETERS]);
        if body.mass() == 0.0 {
            return 0.0;
        }
        for p in 0..BODY_PARAMETERS {
            let h = 1e-6 * body.mass().abs();
            let at = |step: f64| {
                let mut moved = body;
                moved.0[p] += step;
                controller_values(&moved)[index]
            };
            gradient[self.first + p] = (at(h) - at(-h)) / (2.0 * h);
        }
        controller_values(&body)[index]
    }
}
