//! Options of the simulated servo axis.

use super::error::{SimError, finite, not_negative, positive};
use super::schedule::MassSchedule;
use crate::model::SERVO_PARAMS;

/// Options of a simulated axis, in the units of its motion: m and N, or rad and N m.
#[derive(Debug, Clone, PartialEq)]
pub struct ServoAxisOptions {
    /// k: force per unit of input, finite and not 0.
    pub gain: f64,
    /// M over time, > 0.
    pub mass: MassSchedule,
    /// F_v, ≥ 0.
    pub viscous_friction: f64,
    /// F_c, ≥ 0.
    pub coulomb_friction: f64,
    /// F_s, which the model of the axis does not have, ≥ 0.
    pub stribeck_friction: f64,
    /// v_s \[m/s or rad/s\], > 0.
    pub stribeck_speed: f64,
    /// b.
    pub offset: f64,
    /// K_p \[input per m or rad\], ≥ 0.
    pub proportional_gain: f64,
    /// K_d \[input per m/s or rad/s\], ≥ 0.
    pub derivative_gain: f64,
    /// u_max: largest input of the drive, > 0; `inf` for no limit.
    pub input_limit: f64,
    /// One count of the position sensor \[m or rad\], ≥ 0; 0 for positions without rounding.
    pub position_resolution: f64,
}

impl ServoAxisOptions {
    /// The published parameters of the EMPS benchmark, with its resolution and drive, and a stiff
    /// PD controller.
    ///
    /// A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, Workshop on
    /// Nonlinear System Identification Benchmarks, 2019.
    pub fn emps() -> Self {
        Self {
            gain: 35.150_651_88,
            mass: MassSchedule::constant(95.1089),
            viscous_friction: 203.5034,
            coulomb_friction: 20.3935,
            stribeck_friction: 0.0,
            stribeck_speed: 0.01,
            offset: -3.1648,
            proportional_gain: 38_996.0,
            derivative_gain: 243.45,
            input_limit: 10.0,
            position_resolution: 5e-8,
        }
    }

    /// The true parameters at time `t_s` \[s\], in the order of
    /// [`ServoAxis`](crate::model::ServoAxis).
    pub fn true_theta(&self, t_s: f64) -> [f64; SERVO_PARAMS] {
        [
            self.mass.mass_kg(t_s),
            self.viscous_friction,
            self.coulomb_friction,
            self.offset,
        ]
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        finite("servo_axis.gain", self.gain)?;
        if self.gain == 0.0 {
            return Err(SimError::new("servo_axis.gain", "a number that is not 0", self.gain));
        }
        self.mass.validate().map_err(|error| SimError {
            field: "servo_axis.mass",
            ..error
        })?;
        not_negative("servo_axis.viscous_friction", self.viscous_friction)?;
        not_negative("servo_axis.coulomb_friction", self.coulomb_friction)?;
        not_negative("servo_axis.stribeck_friction", self.stribeck_friction)?;
        positive("servo_axis.stribeck_speed", self.stribeck_speed)?;
        finite("servo_axis.offset", self.offset)?;
        not_negative("servo_axis.proportional_gain", self.proportional_gain)?;
        not_negative("servo_axis.derivative_gain", self.derivative_gain)?;
        if self.input_limit != f64::INFINITY {
            positive("servo_axis.input_limit", self.input_limit)?;
        }
        not_negative("servo_axis.position_resolution", self.position_resolution)
    }
}
