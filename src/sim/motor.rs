//! A DC motor, equations (12) and (14) to (18).
//!
//! ```text
//! u = R i + L di/dt + k_e q̇        (12) with (14), (15), (16)
//! M = k_m i                        (18)
//! ```
//!
//! u voltage \[V\], i current \[A\], q̇ joint velocity \[rad/s\], M torque on the joint \[N m\].

/// Constants of one motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// R_w \[Ω\].
    pub winding_resistance_ohm: f64,
    /// L \[H\], > 0.
    pub winding_inductance_h: f64,
    /// k_m \[N m/A\].
    pub torque_constant_n_m_per_a: f64,
    /// k_e \[V s/rad\].
    pub back_emf_constant_v_s_per_rad: f64,
}

impl Motor {
    /// di/dt \[A/s\] at a voltage \[V\], a current \[A\] and a joint velocity \[rad/s\]: (17)
    /// solved for di/dt.
    #[inline]
    pub fn current_rate(&self, voltage: f64, current: f64, dq: f64) -> f64 {
        (voltage - self.winding_resistance_ohm * current - self.back_emf_constant_v_s_per_rad * dq)
            / self.winding_inductance_h // (17), which is (12) with (14), (15), (16)
    }

    /// Torque \[N m\] of a current \[A\], (18); also the torque's rate for a current's rate.
    #[inline]
    pub fn torque(&self, current: f64) -> f64 {
        self.torque_constant_n_m_per_a * current // (18)
    }
}
