//! Two uniform beams, one rotating about the vertical, the other rising from its top: equations
//! (19) to (23).
//!
//! With J₁ = m₁l₁²/12, C = m₂l₂²/4, J₂ = m₂l₂²/3 = C + m₂l₂²/12, W = m₂ g l₂/2 the energies (21),
//! (22) are
//!
//! ```text
//! E = ½ (J₁ + C cos²q₂) q̇₁² + ½ J₂ q̇₂²            U = W sin q₂ + const
//! ```
//!
//! and Lagrange's equations (23)
//!
//! ```text
//! (J₁ + C cos²q₂) q̈₁ − C sin 2q₂ q̇₁ q̇₂ = M₁
//! J₂ q̈₂ + ½ C sin 2q₂ q̇₁² + W cos q₂ = M₂
//! ```
//!
//! A base whose axis is α off the vertical has U = W (cos α sin q₂ + sin α cos q₂ sin q₁), whose
//! derivatives then stand for W cos q₂.
//!
//! q \[rad\], q₂ = 0 horizontal; M \[N m\]. Their time derivatives give the jerk from the torques'
//! rates.

use crate::model::PhysicalParameters;

/// The mechanics of the arm for one mass of link 2; angles, velocities and torques are `[joint 1,
/// joint 2]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmDynamics {
    /// J₁ \[kg m²\].
    inertia_1: f64,
    /// C \[kg m²\].
    coupling: f64,
    /// J₂ \[kg m²\].
    inertia_2: f64,
    /// W \[N m\].
    weight: f64,
    /// sin α, cos α.
    tilt: [f64; 2],
}

impl ArmDynamics {
    /// The arm with these parameters, without motors.
    pub fn new(physical: &PhysicalParameters, gravity_m_s2: f64) -> Self {
        let PhysicalParameters {
            length_1_m: l1,
            mass_1_kg: m1,
            length_2_m: l2,
            mass_2_kg: m2,
            ..
        } = *physical;
        Self {
            inertia_1: m1 * l1 * l1 / 12.0,
            coupling: m2 * l2 * l2 / 4.0,
            inertia_2: m2 * l2 * l2 / 3.0,
            weight: m2 * gravity_m_s2 * l2 / 2.0,
            tilt: [0.0, 1.0],
        }
    }

    /// The same on a base whose axis is `base_tilt_rad` off the vertical.
    #[must_use]
    pub fn tilted(mut self, base_tilt_rad: f64) -> Self {
        self.tilt = base_tilt_rad.sin_cos().into();
        self
    }

    /// The same with rotors that turn with the joints, of these inertias \[kg m²\]: E of (21), (22)
    /// has ½ J q̇² more for each.
    #[must_use]
    pub fn with_rotors(mut self, [rotor_1, rotor_2]: [f64; 2]) -> Self {
        self.inertia_1 += rotor_1;
        self.inertia_2 += rotor_2;
        self
    }

    /// Torques of gravity ∂U/∂q \[N m\], from sine and cosine of q₂.
    #[inline]
    fn gravity(&self, q1: f64, sin: f64, cos: f64) -> [f64; 2] {
        let [tilt_sin, tilt_cos] = self.tilt;
        if tilt_sin == 0.0 {
            return [0.0, self.weight * cos];
        }
        let (sin_1, cos_1) = q1.sin_cos();
        [
            self.weight * tilt_sin * cos * cos_1,
            self.weight * (tilt_cos * cos - tilt_sin * sin * sin_1),
        ]
    }

    /// d/dt of these \[N m/s\].
    fn gravity_rate(&self, q1: f64, sin: f64, cos: f64, dq: [f64; 2]) -> [f64; 2] {
        let [tilt_sin, tilt_cos] = self.tilt;
        let (sin_1, cos_1) = q1.sin_cos();
        [
            -self.weight * tilt_sin * (sin * cos_1 * dq[1] + cos * sin_1 * dq[0]),
            -self.weight * (tilt_cos * sin * dq[1] + tilt_sin * (cos * sin_1 * dq[1] + sin * cos_1 * dq[0])),
        ]
    }

    /// Energy E + U \[J\], (21) and (22), U counted from q₂ = 0.
    pub fn energy(&self, q: [f64; 2], dq: [f64; 2]) -> f64 {
        let (sin, cos) = q[1].sin_cos();
        // (21) with V₂ from (19) and (20), then (22)
        0.5 * (self.inertia_1 + self.coupling * cos * cos) * dq[0] * dq[0]
            + 0.5 * self.inertia_2 * dq[1] * dq[1]
            + self.weight * (self.tilt[1] * sin + self.tilt[0] * cos * q[0].sin())
    }

    /// Torque of joint 2 that holds link 2 at rest at elevation `q2` \[N m\].
    pub fn holding_torque(&self, q2: f64) -> f64 {
        self.weight * q2.cos()
    }

    /// Torques that hold both joints at rest \[N m\].
    pub fn holding_torques(&self, q: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = q[1].sin_cos();
        self.gravity(q[0], sin, cos)
    }

    /// Accelerations \[rad/s²\] under torques \[N m\]: (23) solved for q̈.
    #[inline]
    pub fn accelerations(&self, q: [f64; 2], dq: [f64; 2], torque: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = q[1].sin_cos();
        let sin_2q2 = 2.0 * sin * cos;
        let gravity = self.gravity(q[0], sin, cos);
        // (23)
        [
            (torque[0] + self.coupling * sin_2q2 * dq[0] * dq[1] - gravity[0])
                / (self.inertia_1 + self.coupling * cos * cos),
            (torque[1] - 0.5 * self.coupling * sin_2q2 * dq[0] * dq[0] - gravity[1]) / self.inertia_2,
        ]
    }

    /// Jerks \[rad/s³\]: d/dt of (23), with the torques' rates \[N m/s\] and the accelerations
    /// \[rad/s²\].
    pub fn jerks(&self, q: [f64; 2], dq: [f64; 2], ddq: [f64; 2], torque_rate: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = q[1].sin_cos();
        let (sin_2q2, cos_2q2) = (2.0 * sin * cos, cos * cos - sin * sin);
        // d/dt (J₁ + C cos²q₂) = −C sin 2q₂ q̇₂
        let coriolis_rate = 2.0 * cos_2q2 * dq[1] * dq[0] * dq[1] + sin_2q2 * (ddq[0] * dq[1] + dq[0] * ddq[1]);
        let gravity_rate = self.gravity_rate(q[0], sin, cos, dq);
        let centrifugal_rate = cos_2q2 * dq[1] * dq[0] * dq[0] + sin_2q2 * dq[0] * ddq[0];
        [
            (torque_rate[0] + self.coupling * (sin_2q2 * dq[1] * ddq[0] + coriolis_rate) - gravity_rate[0])
                / (self.inertia_1 + self.coupling * cos * cos),
            (torque_rate[1] - self.coupling * centrifugal_rate - gravity_rate[1]) / self.inertia_2,
        ]
    }
}
