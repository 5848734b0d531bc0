//! The arm (24) in its raw physical parameters, which Section 4 of the paper describes as not
//! identifiable.
//!
//! The equations are those of [`Manipulator`](super::Manipulator) with (25) inserted. Twelve
//! parameters act through eight combinations, so four directions of θ leave every residual
//! unchanged (for example, scaling m₁, R₁, L₁ or k_m1 against each other). An estimator must report
//! the rank, keep the start values of undetermined parameters, and stay finite.

use super::{Equation, Manipulator, Parameter, Plant, Scalar};

/// The arm in l, m, R, L, k_m, k_e; l₂ and m₂ are shared by both equations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RawManipulator {
    arm: Manipulator,
}

/// Joint 1's own parameters, the shared ones of link 2, joint 2's own.
static PARAMETERS: [Parameter; 12] = [
    Parameter::positive("length_1", "m", "length of link 1", 1.0),
    Parameter::positive("mass_1", "kg", "mass of link 1", 50.0),
    Parameter::positive("resistance_1", "ohm", "winding resistance of motor 1", 0.1),
    Parameter::positive("inductance_1", "H", "winding inductance of motor 1", 0.01),
    Parameter::positive("torque_constant_1", "N m/A", "torque constant of motor 1", 30.0),
    Parameter::positive("back_emf_constant_1", "V s/rad", "back-EMF constant of motor 1", 10.0),
    Parameter::positive("length_2", "m", "length of link 2", 0.5),
    Parameter::positive("mass_2", "kg", "mass of link 2 with its payload", 100.0),
    Parameter::positive("resistance_2", "ohm", "winding resistance of motor 2", 0.1),
    Parameter::positive("inductance_2", "H", "winding inductance of motor 2", 0.01),
    Parameter::positive("torque_constant_2", "N m/A", "torque constant of motor 2", 30.0),
    Parameter::positive("back_emf_constant_2", "V s/rad", "back-EMF constant of motor 2", 10.0),
];

static EQUATIONS: [Equation; 2] = [
    Equation::new("joint_1", 0, 12.0, 2, 0..8),
    Equation::new("joint_2", 1, 12.0, 2, 6..12),
];

impl RawManipulator {
    /// The raw parametrization of `arm`.
    pub fn new(arm: Manipulator) -> Self {
        Self { arm }
    }
}

impl Plant for RawManipulator {
    fn name(&self) -> &str {
        "raw_manipulator"
    }

    fn joints(&self) -> usize {
        2
    }

    fn input_unit(&self) -> &str {
        "V"
    }

    fn parameters(&self) -> &[Parameter] {
        &PARAMETERS
    }

    fn equations(&self) -> &[Equation] {
        &EQUATIONS
    }

    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        let [l1, m1, r1, inductance_1, km1, ke1] = [theta[0], theta[1], theta[2], theta[3], theta[4], theta[5]];
        let [l2, m2, r2, inductance_2, km2, ke2] = [theta[6], theta[7], theta[8], theta[9], theta[10], theta[11]];
        // (25)
        let identifiable = [
            l1 * l1 * inductance_1 * m1 / km1,
            inductance_1 * l2 * l2 * m2 / km1,
            l1 * l1 * m1 * r1 / km1,
            l2 * l2 * m2 * r1 / km1,
            ke1,
            l2 * inductance_2 * m2 / km2,
            l2 * m2 * r2 / km2,
            ke2,
            l2,
        ];
        self.arm.terms(equation, q, dq, &identifiable, g); // (24)
    }
}
