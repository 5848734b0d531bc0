//! Effects of a real arm that equations (12) to (23) lack: friction, a tilted base, windings that
//! heat up, rotors of geared motors.
//!
//! ```text
//! M_f = F tanh(q̇/v) + b q̇                   Coulomb and viscous friction of a joint, the jump at q̇ = 0 smoothed over the speed v
//! U   = W (cos α sin q₂ + sin α cos q₂ sin q₁)    potential energy with the base's axis α off the vertical
//! R(t) = R (1 + s min(t/T, 1))               both windings grow by the share s within T
//! E   ← E + ½ Σ J_r q̇²                       rotors turn with their joints, J_r counted at the joint
//! ```
//!
//! With tanh a held joint creeps with at most v instead of sticking; v is small compared with all
//! commanded speeds. The integration needs F h/(J v) < 2.7 for substeps of length h, see
//! [`Unmodelled::friction_speed_rad_per_s`].

use super::arm::ArmDynamics;
use super::arm_parameters::ARM_JOINTS;
use super::error::{SimError, in_range, not_negative, positive};
use crate::model::PhysicalParameters;

/// Effects beyond the paper's equations; all off by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unmodelled {
    /// F of each joint \[N m\], ≥ 0.
    pub coulomb_friction_n_m: [f64; ARM_JOINTS],
    /// v \[rad/s\], > 0: three quarters of the friction act at this speed. A smaller v needs more
    /// `substeps`.
    pub friction_speed_rad_per_s: f64,
    /// b of each joint \[N m s/rad\], ≥ 0.
    pub viscous_friction_n_m_s_per_rad: [f64; ARM_JOINTS],
    /// Time at which friction begins \[s\], ≥ 0.
    pub friction_from_s: f64,
    /// α \[rad\], −0.5 to 0.5.
    pub base_tilt_rad: f64,
    /// s, −0.9 to 10.
    pub heating_share: f64,
    /// T \[s\], > 0.
    pub heating_s: f64,
    /// J_r of each joint \[kg m²\], ≥ 0: the rotor's inertia times the square of the gear ratio.
    pub rotor_inertia_kg_m2: [f64; ARM_JOINTS],
}

impl Unmodelled {
    /// No effect beyond the equations.
    pub const fn none() -> Self {
        Self {
            coulomb_friction_n_m: [0.0; ARM_JOINTS],
            friction_speed_rad_per_s: 0.002,
            viscous_friction_n_m_s_per_rad: [0.0; ARM_JOINTS],
            friction_from_s: 0.0,
            base_tilt_rad: 0.0,
            heating_share: 0.0,
            heating_s: 60.0,
            rotor_inertia_kg_m2: [0.0; ARM_JOINTS],
        }
    }

    /// Mechanics of the arm with these parameters on this base, with these rotors.
    pub(super) fn mechanics(&self, physical: &PhysicalParameters, gravity_m_s2: f64) -> ArmDynamics {
        ArmDynamics::new(physical, gravity_m_s2)
            .tilted(self.base_tilt_rad)
            .with_rotors(self.rotor_inertia_kg_m2)
    }

    /// Friction torques \[N m\] at velocities \[rad/s\], against the motion, and their slopes \[N m
    /// s/rad\].
    #[inline]
    pub(super) fn friction(&self, dq: [f64; ARM_JOINTS]) -> [(f64, f64); ARM_JOINTS] {
        std::array::from_fn(|joint| {
            let (size, viscous) = (
                self.coulomb_friction_n_m[joint],
                self.viscous_friction_n_m_s_per_rad[joint],
            );
            if size == 0.0 {
                return (viscous * dq[joint], viscous);
            }
            let tanh = (dq[joint] / self.friction_speed_rad_per_s).tanh();
            let slope = size * (1.0 - tanh * tanh) / self.friction_speed_rad_per_s;
            (size * tanh + viscous * dq[joint], slope + viscous)
        })
    }

    /// The effects at time `t_s`, with or without friction.
    pub(super) fn at(&self, t_s: f64) -> Self {
        if t_s >= self.friction_from_s {
            return *self;
        }
        Self {
            coulomb_friction_n_m: [0.0; ARM_JOINTS],
            viscous_friction_n_m_s_per_rad: [0.0; ARM_JOINTS],
            ..*self
        }
    }

    /// R(t)/R at time `t_s` \[s\].
    pub(super) fn resistance_factor(&self, t_s: f64) -> f64 {
        1.0 + self.heating_share * (t_s / self.heating_s).clamp(0.0, 1.0)
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        for friction in self.coulomb_friction_n_m {
            not_negative("unmodelled.coulomb_friction_n_m", friction)?;
        }
        for friction in self.viscous_friction_n_m_s_per_rad {
            not_negative("unmodelled.viscous_friction_n_m_s_per_rad", friction)?;
        }
        for inertia in self.rotor_inertia_kg_m2 {
            not_negative("unmodelled.rotor_inertia_kg_m2", inertia)?;
        }
        positive("unmodelled.friction_speed_rad_per_s", self.friction_speed_rad_per_s)?;
        not_negative("unmodelled.friction_from_s", self.friction_from_s)?;
        in_range("unmodelled.base_tilt_rad", self.base_tilt_rad, -0.5, 0.5)?;
        in_range("unmodelled.heating_share", self.heating_share, -0.9, 10.0)?;
        positive("unmodelled.heating_s", self.heating_s)
    }
}
