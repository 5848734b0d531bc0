//! The paper's arm with terms that (24) lacks: Coulomb friction and a constant torque at each
//! joint.
//!
//! ```text
//! k_m i = τ + F sign q̇ + τ₀        the motor overcomes friction F and an offset τ₀ besides the torque τ of (24)
//! u = R i + L di/dt + k_e q̇        its voltage, as in (12)
//!
//! 12 u_j = … + 12 (c_j sign q̇_j + o_j) + d/dt [12 κ_j sign q̇_j]        … as in manipulator.rs
//! c = R F/k_m     κ = L F/k_m     o = R τ₀/k_m
//! ```
//!
//! | symbol | parameter | meaning | unit |
//! |---|---|---|---|
//! | c_j | `coulomb_friction_j` | voltage of the current that overcomes friction | V |
//! | κ_j | `coulomb_inductance_j` | half the voltage-time area that reverses this current | V s |
//! | o_j | `offset_j` | voltage for a constant torque | V |
//!
//! Like θ₁ and θ₃ of one inertia, κ and c belong to one friction: κ₁/c₁ = θ₁/θ₃ and κ₂/c₂ = θ₆/θ₇
//! are both L/R of a winding. Both enter linearly. sign 0 = 0, so rows over a standstill of the
//! joint are left out. The parameters of joint 1 come first, then those of joint 2.

use super::{Equation, MANIPULATOR_PARAMS, Manipulator, Parameter, Plant, Scalar};

/// Parameters of joint 1 in the paper; the others are those of joint 2.
const JOINT_1: usize = 5;
/// Factor of (26).
const TWELVE: f64 = 12.0;

/// Terms of an arm in addition to the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ExtraTerms {
    /// Coulomb friction at each joint, two parameters each.
    pub coulomb_friction: bool,
    /// A constant torque at each joint, one parameter each.
    pub offset: bool,
}

impl ExtraTerms {
    /// Number of parameters that they add per joint.
    const fn per_joint(self) -> usize {
        2 * self.coulomb_friction as usize + self.offset as usize
    }

    /// True for the paper's arm.
    pub const fn is_none(self) -> bool {
        self.per_joint() == 0
    }
}

static COULOMB: [[Parameter; 2]; 2] = [
    [
        Parameter::positive(
            "coulomb_friction_1",
            "V",
            "F1 R1 / km1: resistance times Coulomb friction of joint 1",
            1.0,
        ),
        Parameter::positive(
            "coulomb_inductance_1",
            "V s",
            "F1 L1 / km1: inductance times Coulomb friction of joint 1",
            0.1,
        ),
    ],
    [
        Parameter::positive(
            "coulomb_friction_2",
            "V",
            "F2 R2 / km2: resistance times Coulomb friction of joint 2",
            1.0,
        ),
        Parameter::positive(
            "coulomb_inductance_2",
            "V s",
            "F2 L2 / km2: inductance times Coulomb friction of joint 2",
            0.1,
        ),
    ],
];

static OFFSETS: [Parameter; 2] = [
    Parameter::new(
        "offset_1",
        "V",
        "constant torque at joint 1, and half the difference of its Coulomb friction between the directions, times R1 / km1",
        0.0,
    ),
    Parameter::new(
        "offset_2",
        "V",
        "constant torque at joint 2, and half the difference of its Coulomb friction between the directions, times R2 / km2",
        0.0,
    ),
];

/// The two-joint arm with extra terms; without any it is [`Manipulator`].
#[derive(Debug, Clone, PartialEq)]
pub struct ExtendedManipulator {
    arm: Manipulator,
    terms: ExtraTerms,
    parameters: Vec<Parameter>,
    equations: [Equation; 2],
    relations: Vec<[usize; 4]>,
}

impl ExtendedManipulator {
    /// `arm` with these terms.
    pub fn new(arm: Manipulator, terms: ExtraTerms) -> Self {
        let extra = |joint: usize| {
            let coulomb = if terms.coulomb_friction {
                &COULOMB[joint][..]
            } else {
                &[]
            };
            let offset = if terms.offset { &OFFSETS[joint..=joint] } else { &[] };
            coulomb.iter().chain(offset).cloned()
        };
        let own = arm.parameters();
        let first = own[..JOINT_1].iter().cloned().chain(extra(0));
        let second = own[JOINT_1..].iter().cloned().chain(extra(1));
        let parameters: Vec<Parameter> = first.chain(second).collect();
        let border = JOINT_1 + terms.per_joint();
        let mut ranges = [0..border, border..parameters.len()].into_iter();
        let equations = [0, 1].map(|joint| {
            let paper = &arm.equations()[joint];
            let own = Equation {
                parameters: ranges.next().unwrap_or_default(),
                ..paper.clone()
            };
            match terms.coulomb_friction {
                true => own.needing_motion(joint),
                false => own,
            }
        });
        let place = |index: usize| Self::place(terms, index);
        let mut relations: Vec<[usize; 4]> = arm.relations().iter().map(|r| r.map(place)).collect();
        if terms.coulomb_friction {
            // κ/c = L/R of the winding: κ₁/c₁ = θ₁/θ₃, κ₂/c₂ = θ₆/θ₇
            let (c_1, c_2) = (JOINT_1, place(8) + 1);
            relations.push([c_1 + 1, c_1, place(0), place(2)]);
            relations.push([c_2 + 1, c_2, place(5), place(6)]);
        }
        Self {
            arm,
            terms,
            parameters,
            equations,
            relations,
        }
    }

    /// Indices of θ₁ to θ₉ among the parameters, counted from 0.
    pub fn places(terms: ExtraTerms) -> [usize; MANIPULATOR_PARAMS] {
        std::array::from_fn(|index| Self::place(terms, index))
    }

    fn place(terms: ExtraTerms, index: usize) -> usize {
        match index < JOINT_1 {
            true => index,
            false => index + terms.per_joint(),
        }
    }
}

impl Plant for ExtendedManipulator {
    fn name(&self) -> &str {
        self.arm.name()
    }

    fn joints(&self) -> usize {
        self.arm.joints()
    }

    fn input_unit(&self) -> &str {
        self.arm.input_unit()
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn equations(&self) -> &[Equation] {
        &self.equations
    }

    fn relations(&self) -> &[[usize; 4]] {
        &self.relations
    }

    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        let own: [D; MANIPULATOR_PARAMS] = Self::places(self.terms).map(|place| theta[place]);
        self.arm.terms(equation, q, dq, &own, g);
        let end = self.equations[equation].parameters.end;
        let mut extra = theta[end - self.terms.per_joint()..end].iter();
        if self.terms.coulomb_friction
            && let (Some(&friction), Some(&inductance)) = (extra.next(), extra.next())
        {
            let sign = dq[equation].signum() * TWELVE;
            g[0] += friction * sign;
            g[1] += inductance * sign;
        }
        if let Some(&offset) = extra.next() {
            g[0] += offset * TWELVE;
        }
    }
}
