//! Pointwise rows, the paper's form: each sample gives one row per equation.
//!
//! A block keeps the part of each sample that does not depend on θ and evaluates rows at any θ from
//! it, so relinearising a block costs only arithmetic.

use super::SampleBlock;
use super::separation::Separation;
use super::standstill::SlowSamples;
use crate::estimator::{ParameterPrior, Residuals, Structure};
use crate::model::{AnyPlant, JointSample, MAX_JOINTS, PdController, PointwiseModel};

/// Which parameters each equation of a plant depends on, for the estimator.
pub fn structure(plant: &dyn AnyPlant) -> Structure {
    Structure {
        params: plant.parameters().len(),
        equations: plant
            .equations()
            .iter()
            .map(|equation| equation.parameters.clone())
            .collect(),
    }
}

/// Start values and bounds of a plant's parameters, for the estimator.
pub fn priors(plant: &dyn AnyPlant) -> impl Iterator<Item = ParameterPrior> {
    let parameters = plant.parameters().iter();
    parameters.map(|p| ParameterPrior::new(p.start).within(p.lower, p.upper))
}

/// Source of the drive's input u in the rows; `identifier.input`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum InputSource {
    /// The sample's own input.
    #[default]
    Measured,
    /// The PD law (13) from setpoint, position and velocity, as (27) does it; one controller per
    /// joint.
    ///
    /// Right only for an analog controller: a sampled one holds u, which (13) at later instants
    /// does not reproduce.
    Controller([PdController; MAX_JOINTS]),
}

impl InputSource {
    /// The sample as used by the rows.
    #[inline]
    pub fn apply(&self, sample: &JointSample) -> JointSample {
        let mut sample = *sample;
        if let Self::Controller(controllers) = self {
            for (joint, controller) in controllers.iter().enumerate() {
                // (13), or v of (27) without its factor 12
                sample.input[joint] = controller.voltage(sample.setpoint[joint], sample.q[joint], sample.dq[joint]);
            }
        }
        sample
    }
}

/// The samples of one block, whose rows can be evaluated at any θ.
#[derive(Debug, Clone)]
pub struct PointwiseBlock<M: PointwiseModel> {
    model: M,
    input: InputSource,
    features: Vec<M::Features>,
    times_ns: Vec<u64>,
    slow: Option<SlowSamples>,
    /// See [`Residuals::products`].
    products: Vec<(usize, usize)>,
    capacity: usize,
}

impl<M: PointwiseModel> PointwiseBlock<M> {
    /// An empty block for up to `capacity` samples. Only this call allocates.
    pub fn new(model: M, input: InputSource, capacity: usize) -> Self {
        Self {
            model,
            input,
            features: Vec::with_capacity(capacity),
            times_ns: Vec::with_capacity(capacity),
            slow: None,
            products: Vec::new(),
            capacity,
        }
    }

    /// Leaves out rows at which a joint is at rest, for equations that hold only in motion; see
    /// [`Equation::needing_motion`](crate::model::Equation::needing_motion). The velocity must be
    /// measured.
    #[must_use]
    pub fn leaving_out_standstill(mut self, plant: &dyn AnyPlant) -> Self {
        self.slow = SlowSamples::new(plant, self.capacity);
        self
    }

    /// Tells the estimator which parameters of the plant occur only in products; see
    /// [`Residuals::products`]. Otherwise the estimator takes the rows as the paper does.
    #[must_use]
    pub fn knowing_products(mut self, plant: &dyn AnyPlant) -> Self {
        self.products = Separation::new(plant).products;
        self
    }

    /// Largest number of samples in the block.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// The model of the rows.
    pub fn model(&self) -> &M {
        &self.model
    }
}

impl<M: PointwiseModel> SampleBlock for PointwiseBlock<M> {
    #[inline]
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        let fits = self.features.len() < self.capacity;
        if fits {
            let features = match self.input {
                InputSource::Measured => self.model.features(sample),
                InputSource::Controller(_) => self.model.features(&self.input.apply(sample)),
            };
            self.features.push(features);
            self.times_ns.push(t_ns);
            if let Some(slow) = &mut self.slow {
                slow.push(&sample.dq);
            }
        }
        fits
    }

    fn prepare(&mut self, _theta: &[f64]) {
        if let Some(slow) = &mut self.slow {
            slow.judge();
        }
    }

    fn clear(&mut self) {
        self.features.clear();
        self.times_ns.clear();
        if let Some(slow) = &mut self.slow {
            slow.clear();
        }
    }
}

impl<M: PointwiseModel> Residuals for PointwiseBlock<M> {
    fn len(&self) -> usize {
        self.features.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        if !self.is_used(equation, index) {
            regressor.fill(0.0);
            return 0.0;
        }
        self.model.row(equation, &self.features[index], theta, regressor)
    }

    #[inline]
    fn is_used(&self, equation: usize, index: usize) -> bool {
        !self.slow.as_ref().is_some_and(|slow| slow.is_spoilt(equation, index))
    }

    fn products(&self) -> &[(usize, usize)] {
        &self.products
    }

    fn span(&self, index: usize) -> (u64, u64) {
        let t_ns = self.times_ns[index];
        (t_ns, t_ns)
    }
}
