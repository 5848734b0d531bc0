//! A two-joint arm drawn at random: links, motors, payload and controller.

use crate::random::Random;
use crate::sim::{ArmDynamics, ArmParameters};
use crate::studies::draw::Draw;

/// Largest natural frequency of the closed loop \[rad/s\].
const FASTEST: f64 = 30.0;
/// cos q₂ of the arm raised, or sagging, as far as the motions go.
const RAISED: f64 = 0.2;
/// Largest natural frequency 1/√(R J/k² · L/R) \[rad/s\].
const RESONANCE: f64 = 150.0;
/// Largest sag of link 2 when it is held level \[rad\].
const SAG: f64 = 0.3;

/// An arm with its payload and the gains of its controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnArm {
    /// Links and motors.
    pub parameters: ArmParameters,
    /// Mass of link 2 before and after the payload changes \[kg\].
    pub masses_kg: (f64, f64),
    /// Gains of the controller as shares of the largest stable ones.
    shares: [(f64, f64); 2],
}

impl DrawnArm {
    /// The arm of a seed.
    pub fn new(seed: u64) -> Self {
        let mut draw = Draw(Random(seed.wrapping_mul(32).wrapping_add(17)));
        // A short link 2 at the end of a long link 1 whirls: its centrifugal torque is too large.
        let (length_2_m, mass_2_kg) = (draw.log(0.2, 1.5), draw.log(1.0, 150.0));
        let (length_1_m, mass_1_kg) = (length_2_m * draw.log(0.2, 1.0), draw.log(2.0, 150.0));
        let sign = if draw.between(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
        let jump = 1.0 + sign * draw.log(0.02, 0.5);
        let mut arm = Self {
            parameters: ArmParameters {
                length_1_m,
                mass_1_kg,
                length_2_m,
                ..ArmParameters::cedro2022()
            },
            masses_kg: (mass_2_kg, jump * mass_2_kg),
            shares: [(0.0, 0.0); 2],
        };
        for joint in 0..2 {
            // Mechanical time constant R J/k² and electrical one L/R [s].
            let (constant, mechanical_s) = (draw.log(1.0, 30.0), draw.log(0.003, 0.1));
            // The loop must be stable with a natural frequency ω that bears link 2, ω² SAG =
            // 3 g/(2 l₂), and the samples must follow the resonance of inductance and inertia.
            let stiff = 1.5 * arm.parameters.gravity_m_s2 / (length_2_m * SAG);
            let electrical_s = draw.log(0.002, 0.1).min(0.2 / (mechanical_s * stiff));
            let electrical_s = electrical_s.max(RESONANCE.powi(-2) / mechanical_s);
            let resistance = mechanical_s * constant * constant / arm.inertia(joint, 1.0, mass_2_kg);
            let motors = &mut arm.parameters;
            motors.torque_constant_n_m_per_a[joint] = constant;
            motors.back_emf_constant_v_s_per_rad[joint] = constant;
            motors.winding_resistance_ohm[joint] = resistance;
            motors.winding_inductance_h[joint] = electrical_s * resistance;
            arm.shares[joint] = (draw.between(0.15, 0.4), draw.between(0.3, 1.5));
        }
        arm
    }

    /// Inertia of the arm about a joint \[kg m²\], with this cos q₂ and mass of link 2.
    fn inertia(&self, joint: usize, cos: f64, mass_2_kg: f64) -> f64 {
        let arm = &self.parameters;
        let (l1, l2) = (arm.length_1_m, arm.length_2_m);
        match joint {
            0 => arm.mass_1_kg * l1 * l1 / 3.0 + mass_2_kg * (l1 * l1 + l1 * l2 * cos + (l2 * cos).powi(2) / 3.0),
            _ => mass_2_kg * l2 * l2 / 3.0,
        }
    }

    /// Gains K_p \[V/rad\] and K_d \[V s/rad\] at a sample period Δ: shares of the largest ones
    /// with which the loop of [`Arm::gains`](super::Arm::gains) is stable.
    pub fn gains(&self, period_s: f64) -> ([f64; 2], [f64; 2]) {
        let lightest_kg = self.masses_kg.0.min(self.masses_kg.1);
        let mut gains = ([0.0; 2], [0.0; 2]);
        for (joint, (kp_share, kd_share)) in self.shares.into_iter().enumerate() {
            let k = self.parameters.torque_constant_n_m_per_a[joint];
            let resistance = self.parameters.winding_resistance_ohm[joint];
            let inductance = self.parameters.winding_inductance_h[joint];
            let inertia = self.inertia(joint, RAISED, lightest_kg);
            let kd = (kd_share * k).min(0.2 * resistance * inertia / (k * period_s));
            let damping = resistance * inertia / k - kd * period_s;
            let kp = kp_share * damping * (k + kd) * k / (inductance * inertia);
            gains.0[joint] = kp.min(resistance * inertia * FASTEST * FASTEST / k);
            gains.1[joint] = kd;
        }
        gains
    }

    /// Torque that holds link 2 level \[N m\].
    pub fn holding_torque(&self) -> f64 {
        let arm = &self.parameters;
        ArmDynamics::new(&arm.with_mass_2(self.masses_kg.0), arm.gravity_m_s2).holding_torque(0.0)
    }

    /// Voltage of a motor with the torque that holds link 2 level \[V\].
    pub fn holding_voltage(&self, joint: usize) -> f64 {
        let arm = &self.parameters;
        self.holding_torque() * arm.winding_resistance_ohm[joint] / arm.torque_constant_n_m_per_a[joint]
    }
}
