//! The equations of a plant.
//!
//! Every equation `e` of a plant is defined once, as terms differentiated in time:
//!
//! ```text
//! f_e(t; θ) = s_e u_e(t) − Σ_d (d/dt)^d g_{e,d}(q, q̇; θ)        f_n(θ) = 0 is the paper's (5)
//! φ_e(t; θ) = −∂f_e/∂θ                                          the regressor of (7)
//! ```
//!
//! with `q` the joint positions \[rad or m\], `u_e` the drive's input (voltage, current, torque or
//! force), `s_e` a constant scale and `θ` the parameters to be identified. This definition gives
//! both the pointwise form (one row per sample and equation, with the derivatives expanded by the
//! chain rule) and the projected form (integrals against a smooth window).

mod any_plant;
mod autodiff;
mod controller;
mod delayed;
mod derived;
mod error;
mod extended_manipulator;
mod load;
mod manipulator;
mod physical;
mod raw_manipulator;
mod servo_axis;

pub use any_plant::{AnyPlant, Number, SharedPlant};
pub use controller::PdController;
pub use delayed::{Delayed, usual_delay_limit_s};
pub use derived::PlantDerived;
pub use error::DefinitionError;
pub use extended_manipulator::{ExtendedManipulator, ExtraTerms};
pub use load::{ball_inertia, load_at_flange};
pub use manipulator::{MANIPULATOR_PARAMS, Manipulator, ManipulatorFeatures};
pub use physical::{ExtendedDerived, KnownConstants, ManipulatorDerived, PhysicalParameters, UnknownConstant};
pub use raw_manipulator::RawManipulator;
pub use servo_axis::{DriveInput, Motion, SERVO_PARAMS, ServoAxis};

use crate::words::fnv1a;
use std::borrow::Cow;
use std::ops::Range;

/// Largest number of joints of a sample, and so of a plant.
pub const MAX_JOINTS: usize = 8;
/// Largest number of parameters of an estimate, and so of a plant.
pub const MAX_PARAMS: usize = 128;
/// Unit of positions if some joints turn and others move along lines.
pub const MIXED_UNIT: &str = "rad or m";
/// Shortest and longest time between two samples \[s\].
pub const SAMPLE_PERIODS_S: (f64, f64) = (1e-5, 1.0);

/// The number types in which a plant's equations are evaluated: `f64`, dual numbers, truncated
/// series in time.
pub trait Scalar: num_dual::DualNum<Primitive = f64> + Copy {}
impl<T: num_dual::DualNum<Primitive = f64> + Copy> Scalar for T {}

/// All signals of the joints at one instant; SI units, only the first `joints` entries are used.
///
/// A signal that was not measured is zero here; the message that carries the sample states which
/// signals are valid.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointSample {
    /// Joint position q \[rad or m\].
    pub q: [f64; MAX_JOINTS],
    /// Joint velocity q̇ \[rad/s or m/s\].
    pub dq: [f64; MAX_JOINTS],
    /// Joint acceleration q̈ \[rad/s² or m/s²\].
    pub ddq: [f64; MAX_JOINTS],
    /// Joint jerk q⃛ \[rad/s³ or m/s³\].
    pub dddq: [f64; MAX_JOINTS],
    /// Commanded position φ_z of (13) \[rad or m\].
    pub setpoint: [f64; MAX_JOINTS],
    /// The drive's input u: voltage \[V\], current \[A\], torque \[N m\] or force \[N\].
    pub input: [f64; MAX_JOINTS],
}

/// One parameter of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Short name as in messages, files and tables: `theta_1`, `mass`.
    pub name: Cow<'static, str>,
    /// SI unit, `"1"` if it has none.
    pub unit: Cow<'static, str>,
    /// What it is, in a few words.
    pub meaning: Cow<'static, str>,
    /// Value to start from if the configuration gives none.
    pub start: f64,
    /// Physical lower bound, `-inf` if there is none.
    pub lower: f64,
    /// Physical upper bound, `+inf` if there is none.
    pub upper: f64,
}

impl Parameter {
    /// A parameter of either sign.
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str, start: f64) -> Self {
        Self::within(name, unit, meaning, start, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// A parameter within physical bounds.
    pub const fn within(
        name: &'static str,
        unit: &'static str,
        meaning: &'static str,
        start: f64,
        lower: f64,
        upper: f64,
    ) -> Self {
        Self {
            name: Cow::Borrowed(name),
            unit: Cow::Borrowed(unit),
            meaning: Cow::Borrowed(meaning),
            start,
            lower,
            upper,
        }
    }

    /// A parameter that cannot be negative: a mass, an inertia, a friction.
    pub const fn positive(name: &'static str, unit: &'static str, meaning: &'static str, start: f64) -> Self {
        Self::within(name, unit, meaning, start, 0.0, f64::INFINITY)
    }
}

/// One scalar equation of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Equation {
    /// Short name for tables: `joint_1`.
    pub name: Cow<'static, str>,
    /// Joint whose input drives this equation, counted from 0.
    pub input: usize,
    /// Scale s_e of the input; the residual has the input's unit times this scale.
    pub input_scale: f64,
    /// Highest time derivative d of a term g_{e,d}.
    pub order: usize,
    /// Indices of the parameters that this equation depends on. Equations may share parameters.
    pub parameters: Range<usize>,
    /// Bit j: this equation holds only while joint j moves, see
    /// [`needing_motion`](Self::needing_motion).
    pub motion: u32,
}

impl Equation {
    /// An equation whose residual is `input_scale` times the input of joint `input`, minus its
    /// terms up to the derivative `order`.
    pub const fn new(
        name: &'static str,
        input: usize,
        input_scale: f64,
        order: usize,
        parameters: Range<usize>,
    ) -> Self {
        Self {
            name: Cow::Borrowed(name),
            input,
            input_scale,
            order,
            parameters,
            motion: 0,
        }
    }

    /// For an equation with a term that jumps when joint `joint` reverses, such as Coulomb friction
    /// F sign q̇ or Stribeck friction.
    ///
    /// Such a term does not describe friction at rest: a sticking joint balances any force up to
    /// that of friction, while sign 0 = 0. So rows over a standstill of that joint are left out of
    /// this equation; a reversal, which passes through zero without resting, is kept. Terms that
    /// jump at q̇ = 0 are also found automatically; a term that is merely steep there, such as
    /// tanh(q̇/v), is not. `joint` is counted from 0; call this once for each joint that must move
    /// for the equation to hold.
    ///
    /// # Panics
    /// If `joint` is not below [`MAX_JOINTS`].
    #[must_use]
    pub const fn needing_motion(mut self, joint: usize) -> Self {
        assert!(joint < MAX_JOINTS, "a joint is below MAX_JOINTS");
        self.motion |= 1 << joint;
        self
    }
}

/// A plant without its terms: everything that names, checks and describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantDefinition {
    /// See [`Plant::name`].
    pub name: String,
    /// See [`Plant::joints`].
    pub joints: usize,
    /// See [`Plant::input_unit`].
    pub input_unit: String,
    /// Unit of the positions, see [`Plant::position_unit`]; [`MIXED_UNIT`] if joints differ.
    pub position_unit: String,
    /// See [`Plant::turns`], joint by joint.
    pub turns: Vec<bool>,
    /// See [`Plant::parameters`].
    pub parameters: Vec<Parameter>,
    /// See [`Plant::equations`].
    pub equations: Vec<Equation>,
    /// See [`Plant::relations`].
    pub relations: Vec<[usize; 4]>,
    /// See [`DerivedValues::quantities`]; empty if nothing follows from θ.
    pub derived: Vec<DerivedQuantity>,
}

impl PlantDefinition {
    /// Of a plant.
    pub fn of(plant: &impl Plant) -> Self {
        let turns: Vec<bool> = (0..plant.joints()).map(|joint| plant.turns(joint)).collect();
        let is_mixed = turns.contains(&true) && turns.contains(&false);
        let position_unit = if is_mixed { MIXED_UNIT } else { plant.position_unit() };
        Self {
            name: plant.name().to_owned(),
            joints: plant.joints(),
            input_unit: plant.input_unit().to_owned(),
            position_unit: position_unit.to_owned(),
            turns,
            parameters: plant.parameters().to_vec(),
            equations: plant.equations().to_vec(),
            relations: plant.relations().to_vec(),
            derived: plant.derived().to_vec(),
        }
    }

    /// Unit of a joint's position.
    pub fn joint_unit(&self, joint: usize) -> &str {
        match self.turns.get(joint) {
            Some(true) if self.is_mixed() => "rad",
            Some(false) if self.is_mixed() => "m",
            _ => &self.position_unit,
        }
    }

    /// True if some joints turn and others move along lines.
    pub fn is_mixed(&self) -> bool {
        self.position_unit == MIXED_UNIT
    }

    /// A hash of everything that determines the meaning of θ: names, units, equations. 64-bit
    /// FNV-1a of their text, the same on every machine; estimates and recordings carry it as
    /// `model_hash`.
    pub fn hash(&self) -> u64 {
        let parameters = self.parameters.iter().map(|p| format!("{} [{}]", p.name, p.unit));
        let equations = self.equations.iter().map(|e| {
            format!(
                "{} {} {} {} {:?}",
                e.name, e.input, e.input_scale, e.order, e.parameters
            )
        });
        let text = std::iter::once(self.name.clone()).chain(parameters).chain(equations);
        fnv1a(text.flat_map(|line| line.into_bytes().into_iter().chain([b'\n'])))
    }

    /// Checks the rules for every plant.
    ///
    /// # Errors
    /// The first rule that is violated.
    pub fn validate(&self) -> Result<(), DefinitionError> {
        let (joints, params) = (self.joints, self.parameters.len());
        if !(1..=MAX_JOINTS).contains(&joints) {
            return Err(DefinitionError::Joints(joints));
        }
        if !(1..=MAX_PARAMS).contains(&params) {
            return Err(DefinitionError::Parameters(params));
        }
        if !(1..=MAX_JOINTS).contains(&self.equations.len()) {
            return Err(DefinitionError::Equations(self.equations.len()));
        }
        for (i, parameter) in self.parameters.iter().enumerate() {
            let Parameter {
                name,
                start,
                lower,
                upper,
                ..
            } = parameter;
            if self.parameters[..i].iter().any(|other| other.name == *name) {
                return Err(DefinitionError::SameName(name.to_string()));
            }
            if !(start.is_finite() && start >= lower && start <= upper) {
                return Err(DefinitionError::Start {
                    parameter: name.to_string(),
                    lower: *lower,
                    upper: *upper,
                    got: *start,
                });
            }
        }
        for relation in &self.relations {
            if let Some(&index) = relation.iter().find(|index| **index >= params) {
                return Err(DefinitionError::Relation { index, params });
            }
        }
        for equation in &self.equations {
            let Equation {
                name,
                input,
                input_scale,
                order,
                parameters,
                motion,
            } = equation;
            let equation = || name.to_string();
            if *motion >> joints != 0 {
                return Err(DefinitionError::Motion {
                    equation: equation(),
                    joints,
                    mask: *motion,
                });
            }
            if *input >= joints {
                return Err(DefinitionError::Input {
                    equation: equation(),
                    joints,
                    got: *input,
                });
            }
            if !(input_scale.is_finite() && *input_scale != 0.0) {
                return Err(DefinitionError::InputScale {
                    equation: equation(),
                    got: *input_scale,
                });
            }
            if *order > 2 {
                return Err(DefinitionError::Order {
                    equation: equation(),
                    got: *order,
                });
            }
            if parameters.is_empty() || parameters.end > params {
                return Err(DefinitionError::ParametersOf {
                    equation: equation(),
                    params,
                    got: parameters.clone(),
                });
            }
        }
        Ok(())
    }
}

/// A plant, defined once: names, units, bounds, and the terms of its equations.
pub trait Plant {
    /// Name as in configuration files: `manipulator`.
    fn name(&self) -> &str;
    /// Number of joints, 1 to [`MAX_JOINTS`].
    fn joints(&self) -> usize;
    /// Unit of the input u, for tables and `describe`.
    fn input_unit(&self) -> &str;
    /// Unit of the positions q, for tables and `describe`: `"rad"`, the default, or `"m"`.
    fn position_unit(&self) -> &str {
        "rad"
    }
    /// True if joint `joint`, counted from 0, turns; false for a slide, whose position has no error
    /// of one period per turn and no zero of an angle. By default, as `position_unit` says for all
    /// joints: a machine with slides and hinges says it for each.
    fn turns(&self, joint: usize) -> bool {
        let _ = joint;
        self.position_unit() == "rad"
    }
    /// The parameters θ, at most [`MAX_PARAMS`].
    fn parameters(&self) -> &[Parameter];
    /// The equations.
    fn equations(&self) -> &[Equation];
    /// Relations that θ satisfies by definition: \[i, j, k, l\] for θ_i/θ_j = θ_k/θ_l, indices from
    /// 0. None by default.
    fn relations(&self) -> &[[usize; 4]] {
        &[]
    }
    /// Index of the parameter that is the delay \[s\] with which the recorded input acts; every
    /// equation must then have it among its parameters. `None`, the default, if the delay is not
    /// estimated.
    fn input_delay(&self) -> Option<usize> {
        None
    }
    /// Values derived from θ, such as a mass from two parameters. None by default.
    fn derived(&self) -> &[DerivedQuantity] {
        &[]
    }
    /// The derived value `index`, in the order of [`derived`](Self::derived); its gradient and
    /// standard deviation are computed from it. Never called if there are no derived values.
    fn derived_value<D: Scalar>(&self, index: usize, theta: &[D]) -> D {
        let _ = (index, theta);
        D::from(f64::NAN)
    }
    /// Writes the terms `g[d]`, d = 0..=order, of one equation; `theta` holds all parameters of the
    /// plant.
    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]);
}

/// A plant evaluated sample by sample from q, q̇, q̈, q⃛ and u.
///
/// [`AutoDiff`] implements this for any [`Plant`]; a plant may have a faster implementation, tested
/// equal.
pub trait PointwiseModel {
    /// The part of a sample that does not depend on θ, computed once per sample.
    type Features: Copy + Default;
    /// Extracts the features of a sample.
    fn features(&self, sample: &JointSample) -> Self::Features;
    /// Residual f_n(θ) of one equation; writes the regressor φ_n = −∂f_n/∂θ over the equation's own
    /// parameters.
    ///
    /// `theta` holds all parameters of the plant, `regressor` has the length of the equation's
    /// `parameters`.
    fn row(&self, equation: usize, features: &Self::Features, theta: &[f64], regressor: &mut [f64]) -> f64;
}

/// The pointwise form of any [`Plant`] by automatic differentiation.
#[derive(Debug, Clone)]
pub struct AutoDiff<P>(pub P);

/// A value derived from θ and, possibly, known constants.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DerivedQuantity {
    /// Short name as in messages, files and tables: `mass_2`.
    pub name: Cow<'static, str>,
    /// SI unit.
    pub unit: Cow<'static, str>,
    /// What it is, in a few words.
    pub meaning: Cow<'static, str>,
}

impl DerivedQuantity {
    /// A value with its name, SI unit and a short meaning.
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self {
            name: Cow::Borrowed(name),
            unit: Cow::Borrowed(unit),
            meaning: Cow::Borrowed(meaning),
        }
    }
}

/// Relative standard deviation of a parameter up to which the delta method is valid: a quotient is
/// then off by a twentieth of its own standard deviation.
const LINEAR: f64 = 0.05;

/// Values derived from θ̂, with their standard deviations.
pub trait DerivedValues {
    /// Names and units, at most [`MAX_DERIVED`](crate::messages::MAX_DERIVED).
    fn quantities(&self) -> &[DerivedQuantity];
    /// One value; writes its gradient over all parameters. `NaN` if the value is undefined at θ̂.
    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64;

    /// One value and its standard deviation by the delta method, √(∇ᵀ P ∇).
    ///
    /// `covariance(i, j)` is the covariance P of θ̂. The standard deviation is `NaN` (unknown) if P
    /// is not finite, or if a parameter of the value has a standard deviation above a twentieth of
    /// its size, because first order is not valid for a quotient with an uncertain denominator.
    fn value_and_std(&self, index: usize, theta: &[f64], covariance: &dyn Fn(usize, usize) -> f64) -> (f64, f64) {
        let mut gradient = [0.0; MAX_PARAMS];
        let gradient = &mut gradient[..theta.len()];
        let value = self.value_and_gradient(index, theta, gradient);
        let mut variance = 0.0;
        for (i, &d_i) in gradient.iter().enumerate().filter(|(_, d)| **d != 0.0) {
            if covariance(i, i) > LINEAR * LINEAR * theta[i] * theta[i] {
                return (value, f64::NAN);
            }
            for (j, &d_j) in gradient.iter().enumerate().filter(|(_, d)| **d != 0.0) {
                variance += d_i * covariance(i, j) * d_j;
            }
        }
        (value, if variance >= 0.0 { variance.sqrt() } else { f64::NAN })
    }
}
