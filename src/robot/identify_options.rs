//! Options of the identification of a robot: windows, blocks, and allowances.

use super::error::IdentifyError;
use super::model::RobotModel;
use super::rows::WeakRows;
use super::windows::WindowOptions;

/// Shortest block \[s\]: the noise of each block of two seconds is kept.
const LEAST_BLOCK_S: f64 = 1e-4;
/// Most windows of a block: its rows are kept, in a hundred megabytes for a robot of six axes.
const MAX_BLOCK_WINDOWS: usize = 50_000;

/// Options of the identification of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifyOptions {
    /// Windows of the weak form.
    pub windows: WindowOptions,
    /// True if windows become longer when errors of the positions require it.
    pub lengthens: bool,
    /// Time on either side over which velocities were computed from positions \[s\]; `None` if they
    /// were measured. Standard deviations allow for the errors of either kind.
    pub formed_over_s: Option<f64>,
    /// Length of a block \[s\].
    pub block_s: f64,
    /// Blocks after which the weights of past blocks no longer change.
    pub settle_blocks: usize,
    /// Random walk of the friction parameters after settling, as a share of their size per √s; 0
    /// for constant friction.
    pub friction_walk: f64,
    /// Standard deviation by which [`widen_friction`](super::RobotIdentifier::widen_friction)
    /// widens the friction parameters, as a share of their size.
    pub friction_change: f64,
    /// Standard deviation of the change of the friction parameters when the payload changes, as a
    /// share of their size, because gears have more friction under load. 0 if friction does not
    /// depend on the load.
    pub payload_friction: f64,
    /// True if the flange may carry a changing payload, which is then detected and estimated
    /// separately from the arm.
    pub payload: bool,
    /// Standard deviation of the zero of each encoder and of the direction of gravity \[rad\], ≥ 0.
    /// Small ones leave no residual, because they only rotate the gravity moments. So they are not
    /// estimated, and standard deviations allow for them. If the residuals show one of more than
    /// three standard deviations, it is a misfit.
    pub zero_rad: f64,
    /// Standard deviation of the delay of the torques against positions and velocities \[s\], ≥ 0,
    /// for which standard deviations allow as well.
    pub delay_s: f64,
    /// Standard deviation of what drag, asymmetric friction or another Stribeck speed would add, as
    /// a share of the joint's viscous and Coulomb friction, ≥ 0. Standard deviations allow for it
    /// if the model has no such term. 0 if the terms describe the friction exactly.
    pub friction_shape: f64,
    /// The same of the torque of a spring. 0 if no joint has one.
    pub spring_share: f64,
    /// Relative standard deviation of masses due to that of the drives' gains, ≥ 0.
    pub gain_std: f64,
}

impl Default for IdentifyOptions {
    /// Blocks of 1 s; a random walk of friction of 5 % per √s after a minute, a change of half its
    /// size in a pause and of 5 % with the payload; zeros known to 5 mrad,
    /// delays to 0.5 ms; friction of another shape by 2 %, springs by 30 % of friction.
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
            delay_s: 5e-4,
            friction_shape: 0.02,
            spring_share: 0.3,
            gain_std: 0.0,
        }
    }
}

impl IdentifyOptions {
    /// Rows of a model with these windows, from velocities of this origin.
    pub(super) fn rows(&self, model: &RobotModel) -> Result<WeakRows, IdentifyError> {
        let rows = WeakRows::new(model, self.windows)?;
        Ok(match self.formed_over_s {
            Some(half_s) => rows.with_formed_velocities(half_s),
            None => rows,
        })
    }

    pub(super) fn validate(&self) -> Result<(), IdentifyError> {
        self.windows.validate()?;
        let most_s = MAX_BLOCK_WINDOWS as f64 * self.windows.stride_s;
        if !(LEAST_BLOCK_S..=most_s).contains(&self.block_s) {
            return Err(IdentifyError::Block {
                least_s: LEAST_BLOCK_S,
                most_s,
                most: MAX_BLOCK_WINDOWS,
                got_s: self.block_s,
            });
        }
        for (name, got) in [
            ("friction walk", self.friction_walk),
            ("friction change", self.friction_change),
            ("payload friction", self.payload_friction),
            ("zero_rad", self.zero_rad),
            ("delay_s", self.delay_s),
            ("friction_shape", self.friction_shape),
            ("spring_share", self.spring_share),
            ("gain_std", self.gain_std),
        ] {
            if !(got >= 0.0 && got.is_finite()) {
                return Err(IdentifyError::Negative { name, got });
            }
        }
        Ok(())
    }
}
