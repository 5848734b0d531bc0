//! The PD controllers, equation (13): u = K_p (φ_z − q) − K_d q̇.
//!
//! It is part of the model because (27) writes the input u in this form: an identifier that knows
//! setpoint and gains needs no measured voltage.

/// One controller.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PdController {
    /// K_p \[V/rad\].
    pub proportional_gain_v_per_rad: f64,
    /// K_d \[V s/rad\].
    pub derivative_gain_v_s_per_rad: f64,
}

impl PdController {
    /// Voltage \[V\] for a setpoint \[rad\], a position \[rad\] and a velocity \[rad/s\].
    #[inline]
    pub fn voltage(&self, setpoint: f64, q: f64, dq: f64) -> f64 {
        self.proportional_gain_v_per_rad * (setpoint - q) - self.derivative_gain_v_s_per_rad * dq // (13)
    }
}
