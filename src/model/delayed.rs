//! Any plant with one additional parameter: the delay of its input.
//!
//! ```text
//! f_e(t; θ, δ) = s_e u_e(t − δ) − Σ_d (d/dt)^d g_{e,d}(q, q̇; θ)
//! ```
//!
//! u is the recorded input, δ \[s\] its delay until it acts on the plant; negative if the record is
//! late. An unmodelled delay of half a sample biases an inertia by 10 % at 1 kHz, so an unknown
//! delay is estimated. Only for projected rows: a delay needs the input's derivatives, which
//! pointwise rows do not have.

use super::{DerivedQuantity, Equation, Parameter, Plant, Scalar};

/// The limit of a delay to be estimated \[s\], if none is stated: two sample periods, and at least
/// 1 ms, beyond its start. Records are often one sample off. A wider limit lets noise choose the
/// delay in the first blocks, if the motion hardly shows it; what is learnt there is far too
/// certain, because the rows are not linear in it.
pub fn usual_delay_limit_s(start_s: f64, sample_period_s: f64) -> f64 {
    start_s.abs() + (2.0 * sample_period_s).max(1e-3)
}

/// A plant whose input acts with an unknown delay, its last parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Delayed<P> {
    plant: P,
    parameters: Vec<Parameter>,
    equations: Vec<Equation>,
}

impl<P: Plant> Delayed<P> {
    /// `plant` with the parameter `input_delay`, from −`limit_s` to `limit_s` \[s\], starting at
    /// `start_s`.
    pub fn new(plant: P, start_s: f64, limit_s: f64) -> Self {
        let mut parameters = plant.parameters().to_vec();
        let mut equations = plant.equations().to_vec();
        parameters.push(Parameter::within(
            "input_delay",
            "s",
            "time from the recorded input to its effect",
            start_s,
            -limit_s,
            limit_s,
        ));
        for equation in &mut equations {
            equation.parameters.end = parameters.len();
        }
        Self {
            plant,
            parameters,
            equations,
        }
    }
}

impl<P: Plant> Plant for Delayed<P> {
    fn name(&self) -> &str {
        self.plant.name()
    }

    fn joints(&self) -> usize {
        self.plant.joints()
    }

    fn input_unit(&self) -> &str {
        self.plant.input_unit()
    }

    fn position_unit(&self) -> &str {
        self.plant.position_unit()
    }

    fn turns(&self, joint: usize) -> bool {
        self.plant.turns(joint)
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn equations(&self) -> &[Equation] {
        &self.equations
    }

    fn relations(&self) -> &[[usize; 4]] {
        self.plant.relations()
    }

    fn input_delay(&self) -> Option<usize> {
        Some(self.parameters.len() - 1)
    }

    fn derived(&self) -> &[DerivedQuantity] {
        self.plant.derived()
    }

    fn derived_value<D: Scalar>(&self, index: usize, theta: &[D]) -> D {
        self.plant.derived_value(index, &theta[..self.parameters.len() - 1])
    }

    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        self.plant
            .terms(equation, q, dq, &theta[..self.parameters.len() - 1], g);
    }
}
