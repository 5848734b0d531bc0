//! Physical constants of the simulated arm.

use super::error::{SimError, not_negative, positive};
use crate::model::PhysicalParameters;

/// Joints of the simulated arm.
pub const ARM_JOINTS: usize = 2;

/// Physical constants of the arm and its motors, except the payload-dependent mass of link 2.
///
/// The links are uniform beams: centre of gravity at half the length, moment of inertia m l²/12,
/// below (22) in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmParameters {
    /// l₁ \[m\], > 0.
    pub length_1_m: f64,
    /// m₁ \[kg\], > 0.
    pub mass_1_kg: f64,
    /// l₂ \[m\], > 0.
    pub length_2_m: f64,
    /// g \[m/s²\], ≥ 0.
    pub gravity_m_s2: f64,
    /// R_w of each motor \[Ω\], > 0.
    pub winding_resistance_ohm: [f64; ARM_JOINTS],
    /// L of each motor \[H\], > 0.
    pub winding_inductance_h: [f64; ARM_JOINTS],
    /// k_m of each motor \[N m/A\], > 0.
    pub torque_constant_n_m_per_a: [f64; ARM_JOINTS],
    /// k_e of each motor \[V s/rad\], ≥ 0.
    pub back_emf_constant_v_s_per_rad: [f64; ARM_JOINTS],
}

impl ArmParameters {
    /// Section 5 of the paper.
    pub const fn cedro2022() -> Self {
        Self {
            length_1_m: 0.5,
            mass_1_kg: 100.0,
            length_2_m: 1.0,
            gravity_m_s2: 9.81,
            winding_resistance_ohm: [0.04; ARM_JOINTS],
            winding_inductance_h: [0.004; ARM_JOINTS],
            torque_constant_n_m_per_a: [23.0; ARM_JOINTS],
            back_emf_constant_v_s_per_rad: [23.0; ARM_JOINTS],
        }
    }

    /// These constants together with a mass of link 2 \[kg\].
    pub const fn with_mass_2(&self, mass_2_kg: f64) -> PhysicalParameters {
        PhysicalParameters {
            length_1_m: self.length_1_m,
            mass_1_kg: self.mass_1_kg,
            length_2_m: self.length_2_m,
            mass_2_kg,
            winding_resistance_ohm: self.winding_resistance_ohm,
            winding_inductance_h: self.winding_inductance_h,
            torque_constant_n_m_per_a: self.torque_constant_n_m_per_a,
            back_emf_constant_v_s_per_rad: self.back_emf_constant_v_s_per_rad,
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        positive("arm.length_1_m", self.length_1_m)?;
        positive("arm.mass_1_kg", self.mass_1_kg)?;
        positive("arm.length_2_m", self.length_2_m)?;
        not_negative("arm.gravity_m_s2", self.gravity_m_s2)?;
        for joint in 0..ARM_JOINTS {
            positive("arm.winding_resistance_ohm", self.winding_resistance_ohm[joint])?;
            positive("arm.winding_inductance_h", self.winding_inductance_h[joint])?;
            positive("arm.torque_constant_n_m_per_a", self.torque_constant_n_m_per_a[joint])?;
            not_negative(
                "arm.back_emf_constant_v_s_per_rad",
                self.back_emf_constant_v_s_per_rad[joint],
            )?;
        }
        Ok(())
    }
}
