//! The motion that a simulated machine is asked for, for who computes feed-forward along it.

use crate::model::JointSample;

/// A smooth motion in time, with its derivatives.
pub trait DesiredMotion: Send + std::fmt::Debug {
    /// `q`, `dq`, `ddq` and `setpoint` at a time \[s\], and `dddq` if it is known, else 0; times
    /// must not fall from call to call.
    fn at(&mut self, t_s: f64) -> JointSample;

    /// The same motion as it stands.
    fn copy(&self) -> Box<dyn DesiredMotion>;
}

impl Clone for Box<dyn DesiredMotion> {
    fn clone(&self) -> Self {
        self.copy()
    }
}
