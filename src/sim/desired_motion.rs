//! The desired motion of a simulated machine, for computing feed-forward along it.

use crate::model::JointSample;

/// A smooth motion in time, with its derivatives.
pub trait DesiredMotion: Send + std::fmt::Debug {
    /// `q`, `dq`, `ddq` and `setpoint` at a time \[s\], and `dddq` if it is known, otherwise 0;
    /// times must not decrease between calls.
    fn at(&mut self, t_s: f64) -> JointSample;

    /// A copy of the motion in its present state.
    fn copy(&self) -> Box<dyn DesiredMotion>;
}

impl Clone for Box<dyn DesiredMotion> {
    fn clone(&self) -> Self {
        self.copy()
    }
}
