//! How a robot is identified: windows, blocks, and what is allowed for.

use super::windows::WindowOptions;

/// How a robot is identified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifyOptions {
    /// Windows of the weak form.
    pub windows: WindowOptions,
    /// True if windows become longer when errors of the positions ask for it.
    pub lengthens: bool,
    /// Time to either side over which velocities were formed from positions \[s\]; `None` if they
    /// were measured.
    pub formed_over_s: Option<f64>,
    /// Length of a block \[s\].
    pub block_s: f64,
    /// Blocks after which the weights of what is past are kept.
    pub settle_blocks: usize,
    /// Random walk of the friction parameters after settling, as a part of their size per √s; 0 for
    /// friction that stays.
    pub friction_walk: f64,
    /// Standard deviation by which
    /// [`widen_friction`](super::RobotIdentifier::widen_friction) widens the friction parameters,
    /// as a part of their size.
    pub friction_change: f64,
    /// Standard deviation of the change of the friction parameters when the payload changes, as a
    /// part of their size: gears have more friction under load. 0 if friction does not depend on
    /// the load.
    pub payload_friction: f64,
    /// True if the flange may carry a payload that comes and goes: it is found and estimated apart
    /// from the arm.
    pub payload: bool,
    /// Standard deviation of the zero of each encoder and of the direction of gravity \[rad\], ≥ 0.
    /// Small ones leave no residual: the moments of what the links weigh turn with them. So they
    /// are not estimated, and standard deviations allow for them. Those of more than three standard
    /// deviations that the residuals show are a misfit.
    pub zero_rad: f64,
    /// Relative standard deviation of masses by the gains of the drives, ≥ 0: how well the gains
    /// are known.
    pub gain_std: f64,
}

impl Default for IdentifyOptions {
    /// Blocks of 1 s; friction that walks by 5 % per √s after a minute, may change by half its size
    /// in a pause and by 5 % with the payload; zeros known to 5 mrad.
    fn default() -> Self {
        Self {
            windows: WindowOptions::default(),
            lengthens: false,
            formed_over_s: None,
            block_s: 1.0,
            settle_blocks: 60,
            friction_walk: 0.05,
            friction_change: 0.5,
            payload_friction: 0.05,
            payload: false,
            zero_rad: 0.005,
            gain_std: 0.0,
        }
    }
}

impl IdentifyOptions {
    pub(super) fn validate(&self) -> Result<(), String> {
        self.windows.validate()?;
        if !(self.block_s > 0.0 && self.block_s.is_finite()) {
            return Err(format!(
                "block length: expected a time above 0 [s], got {}",
                self.block_s
            ));
        }
        for (name, value) in [
            ("friction walk", self.friction_walk),
            ("friction change", self.friction_change),
            ("payload friction", self.payload_friction),
            ("zero_rad", self.zero_rad),
            ("gain_std", self.gain_std),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name}: expected a number of at least 0, got {value}"));
            }
        }
        Ok(())
    }
}
