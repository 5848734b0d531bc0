//! One servo axis: an inertia with viscous and Coulomb friction, driven by a force or torque.
//!
//! ```text
//! M q̈ + F_v q̇ + F_c sign q̇ + b = k u  as terms: g₀ = F_v q̇ + F_c sign q̇ + b, g₁ = M q̇, s = k
//! ```
//!
//! | symbol | meaning | linear axis | rotary axis |
//! |---|---|---|---|
//! | q | position | m | rad |
//! | u | the drive's input: voltage, current, force or torque | V, A, N | V, A, N m |
//! | k | force per unit of input | N/V, N/A, 1 | N m/V, N m/A, 1 |
//! | M | `mass`: mass or moment of inertia of all moving parts | kg | kg m² |
//! | F_v | `viscous_friction` | N s/m | N m s/rad |
//! | F_c | `coulomb_friction` | N | N m |
//! | b | `offset`: constant force or torque | N | N m |
//!
//! The model and its names are those of the EMPS benchmark: A. Janot, M. Gautier, M. Brunot, Data
//! Set and Reference Models of EMPS, Workshop on Nonlinear System Identification Benchmarks, 2019.
//! sign 0 = 0, so rows over a standstill are left out.

use super::{Equation, Parameter, Plant, Scalar};

/// Number of parameters of a servo axis.
pub const SERVO_PARAMS: usize = 4;

/// Motion of the axis, which determines its units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Motion {
    /// Along a line.
    #[default]
    Linear,
    /// About an axis.
    Rotary,
}

impl Motion {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Linear, "linear"), (Self::Rotary, "rotary")];
}

/// Kind of the drive's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveInput {
    /// Control voltage of a current-controlled drive \[V\].
    #[default]
    Voltage,
    /// Motor current \[A\].
    Current,
    /// Force \[N\] or torque \[N m\].
    Force,
}

impl DriveInput {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 3] = [
        (Self::Voltage, "voltage"),
        (Self::Current, "current"),
        (Self::Force, "force"),
    ];
}

static LINEAR: [Parameter; SERVO_PARAMS] = [
    Parameter::positive("mass", "kg", "everything that moves with the axis", 50.0),
    Parameter::positive("viscous_friction", "N s/m", "friction that grows with speed", 100.0),
    Parameter::positive("coulomb_friction", "N", "friction that is the same at any speed", 10.0),
    Parameter::new(
        "offset",
        "N",
        "constant force on the axis, and half the difference of Coulomb friction between the directions",
        0.0,
    ),
];

static ROTARY: [Parameter; SERVO_PARAMS] = [
    Parameter::positive("mass", "kg m^2", "moment of inertia of everything that moves", 1.0),
    Parameter::positive("viscous_friction", "N m s/rad", "friction that grows with speed", 1.0),
    Parameter::positive("coulomb_friction", "N m", "friction that is the same at any speed", 1.0),
    Parameter::new(
        "offset",
        "N m",
        "constant torque on the axis, and half the difference of Coulomb friction between the directions",
        0.0,
    ),
];

/// One servo axis; the gain of its input is known.
#[derive(Debug, Clone, PartialEq)]
pub struct ServoAxis {
    motion: Motion,
    input: DriveInput,
    equations: [Equation; 1],
}

impl ServoAxis {
    /// An axis whose drive produces `gain` \[N or N m per unit of input\]; must be finite and not
    /// 0, otherwise `None`.
    pub fn new(motion: Motion, input: DriveInput, gain: f64) -> Option<Self> {
        (gain.is_finite() && gain != 0.0).then_some(Self {
            motion,
            input,
            // static friction balances any force up to F_c
            equations: [Equation::new("axis", 0, gain, 1, 0..SERVO_PARAMS).needing_motion(0)],
        })
    }
}

impl Plant for ServoAxis {
    fn name(&self) -> &str {
        "servo_axis"
    }

    fn joints(&self) -> usize {
        1
    }

    fn input_unit(&self) -> &str {
        match (self.input, self.motion) {
            (DriveInput::Voltage, _) => "V",
            (DriveInput::Current, _) => "A",
            (DriveInput::Force, Motion::Linear) => "N",
            (DriveInput::Force, Motion::Rotary) => "N m",
        }
    }

    fn position_unit(&self) -> &str {
        match self.motion {
            Motion::Linear => "m",
            Motion::Rotary => "rad",
        }
    }

    fn parameters(&self) -> &[Parameter] {
        match self.motion {
            Motion::Linear => &LINEAR,
            Motion::Rotary => &ROTARY,
        }
    }

    fn equations(&self) -> &[Equation] {
        &self.equations
    }

    fn terms<D: Scalar>(&self, _equation: usize, _q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1] * dq[0] + theta[2] * dq[0].signum() + theta[3];
        g[1] = theta[0] * dq[0];
    }
}
