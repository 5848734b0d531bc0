//! Converts the physical parameters of the arm to θ by equation (25), and back.
//!
//! The forward direction is (25) itself. Backward, nine numbers cannot give twelve: θ determines
//! k_e1 = θ₅, k_e2 = θ₈, l₂ = θ₉, the electrical time constants L₁/R₁ = θ₂/θ₄ and L₂/R₂ = θ₆/θ₇,
//! and products of masses with R/k_m. With the resistances, the torque constants and l₁ known, the
//! rest follows:
//!
//! ```text
//! m₂ = θ₇ k_m2 / (θ₉ R₂)     m₁ = θ₃ k_m1 / (l₁² R₁)     L₁ = R₁ θ₂/θ₄     L₂ = R₂ θ₆/θ₇
//! ```
//!
//! m₂ could also come from θ₄ = l₂² m₂ R₁/k_m1 and L₁ from θ₁/θ₃. Joint 2 gives the better m₂
//! (gravity acts on it even at rest), and link 2 gives the better L₁, because it is the heavier
//! one.

use super::{DerivedQuantity, DerivedValues, MANIPULATOR_PARAMS, Scalar};
use num_dual::Dual64;

/// Physical parameters of the paper's arm, the symbols of (24).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhysicalParameters {
    /// l₁ \[m\].
    pub length_1_m: f64,
    /// m₁ \[kg\].
    pub mass_1_kg: f64,
    /// l₂ \[m\].
    pub length_2_m: f64,
    /// m₂ \[kg\].
    pub mass_2_kg: f64,
    /// R_w of each motor \[Ω\].
    pub winding_resistance_ohm: [f64; 2],
    /// L of each motor \[H\].
    pub winding_inductance_h: [f64; 2],
    /// k_m of each motor \[N m/A\].
    pub torque_constant_n_m_per_a: [f64; 2],
    /// k_e of each motor \[V s/rad\].
    pub back_emf_constant_v_s_per_rad: [f64; 2],
}

/// Constants that must be known to compute physical parameters from θ; all must be > 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownConstants {
    /// l₁ \[m\].
    pub length_1_m: f64,
    /// R_w of each motor \[Ω\].
    pub winding_resistance_ohm: [f64; 2],
    /// k_m of each motor \[N m/A\].
    pub torque_constant_n_m_per_a: [f64; 2],
}

/// A known constant that is not a positive number.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{name} must be a positive number to recover physical parameters, got {value}")]
pub struct UnknownConstant {
    /// Name of the constant.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

impl PhysicalParameters {
    /// θ by (25).
    pub fn theta(&self) -> [f64; MANIPULATOR_PARAMS] {
        let Self {
            length_1_m: l1,
            mass_1_kg: m1,
            length_2_m: l2,
            mass_2_kg: m2,
            ..
        } = *self;
        let [r1, r2] = self.winding_resistance_ohm;
        let [inductance_1, inductance_2] = self.winding_inductance_h;
        let [km1, km2] = self.torque_constant_n_m_per_a;
        let [ke1, ke2] = self.back_emf_constant_v_s_per_rad;
        [
            l1 * l1 * inductance_1 * m1 / km1, // θ₁ of (25), the others follow in order
            inductance_1 * l2 * l2 * m2 / km1,
            l1 * l1 * m1 * r1 / km1,
            l2 * l2 * m2 * r1 / km1,
            ke1,
            l2 * inductance_2 * m2 / km2,
            l2 * m2 * r2 / km2,
            ke2,
            l2,
        ]
    }

    /// The constants of this arm that [`ManipulatorDerived`] needs.
    pub fn known(&self) -> KnownConstants {
        KnownConstants {
            length_1_m: self.length_1_m,
            winding_resistance_ohm: self.winding_resistance_ohm,
            torque_constant_n_m_per_a: self.torque_constant_n_m_per_a,
        }
    }
}

impl KnownConstants {
    /// Checks that every constant is a positive finite number.
    ///
    /// # Errors
    /// The first constant that is not positive and finite.
    pub fn validate(&self) -> Result<(), UnknownConstant> {
        let [r1, r2] = self.winding_resistance_ohm;
        let [km1, km2] = self.torque_constant_n_m_per_a;
        [
            ("length_1_m", self.length_1_m),
            ("winding_resistance_ohm", r1),
            ("winding_resistance_ohm", r2),
            ("torque_constant_n_m_per_a", km1),
            ("torque_constant_n_m_per_a", km2),
        ]
        .into_iter()
        .find(|&(_, value)| !(value.is_finite() && value > 0.0))
        .map_or(Ok(()), |(name, value)| Err(UnknownConstant { name, value }))
    }
}

/// Physical values of the arm from θ̂ and known motor constants, with standard deviations by the
/// delta method.
///
/// The inverse of (25), see the head of this file. Values are `NaN` if they are undefined at θ̂
/// (for example, θ₉ = 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManipulatorDerived {
    known: KnownConstants,
}

static QUANTITIES: [DerivedQuantity; 4] = [
    DerivedQuantity::new("mass_2", "kg", "mass of link 2 with its payload"),
    DerivedQuantity::new("mass_1", "kg", "mass of link 1"),
    DerivedQuantity::new("inductance_1", "H", "winding inductance of motor 1"),
    DerivedQuantity::new("inductance_2", "H", "winding inductance of motor 2"),
];

impl ManipulatorDerived {
    /// Derived values for known motor constants.
    ///
    /// # Errors
    /// If a constant is not a positive finite number.
    pub fn new(known: KnownConstants) -> Result<Self, UnknownConstant> {
        known.validate().map(|()| Self { known })
    }

    fn value<D: Scalar>(&self, index: usize, theta: &[D]) -> D {
        let [r1, r2] = self.known.winding_resistance_ohm;
        let [km1, km2] = self.known.torque_constant_n_m_per_a;
        let l1 = self.known.length_1_m;
        match index {
            0 => theta[6] / theta[8] * (km2 / r2),
            1 => theta[2] * (km1 / (l1 * l1 * r1)),
            2 => theta[1] / theta[3] * r1,
            _ => theta[5] / theta[6] * r2,
        }
    }
}

impl DerivedValues for ManipulatorDerived {
    fn quantities(&self) -> &[DerivedQuantity] {
        &QUANTITIES
    }

    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64 {
        let mut dual = [Dual64::from(0.0); MANIPULATOR_PARAMS];
        for (dual, &value) in dual.iter_mut().zip(theta) {
            dual.re = value;
        }
        for parameter in 0..MANIPULATOR_PARAMS {
            dual[parameter].eps = 1.0;
            gradient[parameter] = self.value(index, &dual).eps;
            dual[parameter].eps = 0.0;
        }
        let value = self.value(index, theta);
        if value.is_finite() { value } else { f64::NAN }
    }
}

/// The same values of an arm with [extra terms](super::ExtendedManipulator), which do not change
/// them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedDerived {
    arm: ManipulatorDerived,
    /// Indices of θ₁ to θ₉.
    places: [usize; MANIPULATOR_PARAMS],
}

impl ExtendedDerived {
    /// Derived values of an arm with θ₁ to θ₉ at the indices `places`, see
    /// [`ExtendedManipulator::places`](super::ExtendedManipulator::places).
    pub fn new(arm: ManipulatorDerived, places: [usize; MANIPULATOR_PARAMS]) -> Self {
        Self { arm, places }
    }
}

impl DerivedValues for ExtendedDerived {
    fn quantities(&self) -> &[DerivedQuantity] {
        self.arm.quantities()
    }

    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64 {
        let own = self.places.map(|place| theta[place]);
        let mut own_gradient = [0.0; MANIPULATOR_PARAMS];
        let value = self.arm.value_and_gradient(index, &own, &mut own_gradient);
        gradient.fill(0.0);
        for (place, slope) in self.places.into_iter().zip(own_gradient) {
            gradient[place] = slope;
        }
        value
    }
}
