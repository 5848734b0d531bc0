//! The state of a robot at one instant; SI units, only the first entries up to the number of joints
//! are used.

use super::friction::Engagement;
use crate::model::MAX_JOINTS;

/// A sample as recorded.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RobotSample {
    /// Time \[s\].
    pub t_s: f64,
    /// Positions \[rad or m\].
    pub q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s or m/s\].
    pub dq: [f64; MAX_JOINTS],
    /// Torques or forces of the drives at the joints \[N m or N\].
    pub tau: [f64; MAX_JOINTS],
}

/// A sample with the signals needed to predict torques.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FilteredSample {
    /// Time \[s\].
    pub t_s: f64,
    /// Positions \[rad or m\].
    pub q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s or m/s\].
    pub dq: [f64; MAX_JOINTS],
    /// Accelerations \[rad/s² or m/s²\].
    pub ddq: [f64; MAX_JOINTS],
    /// Engagement of friction.
    pub engagement: [Engagement; MAX_JOINTS],
    /// Torques or forces of the drives as recorded \[N m or N\].
    pub tau: [f64; MAX_JOINTS],
}

/// Position, speed and acceleration of a joint.
pub type Setpoint = [f64; 3];
