//! Torques that are no torques: every joint's is its own position, velocity or acceleration times a
//! factor, as if the log had no torques or held a planned motion.
//!
//! ```text
//! min_c Σ (τ_k − c x_k)² < ε² Σ (τ_k − mean τ)²,  x: q, q̇ or q̈                                    (1)
//! ```

use super::state::RobotSample;
use std::fmt;

/// ε of (1): velocities that are formed from positions differ from measured ones by up to 1 %.
const NEARLY: f64 = 0.03;

/// The signal that the torques repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Echo {
    /// q.
    Position,
    /// q̇.
    Velocity,
    /// q̈.
    Acceleration,
}

impl fmt::Display for Echo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
        })
    }
}

impl Echo {
    /// The signal that the torques of all these joints repeat; steps longer than `max_gap_s` are
    /// gaps. A single joint may be a spring, or a mass without friction, but none is a mere
    /// damper.
    pub(super) fn of(log: &[RobotSample], moving: &[usize], max_gap_s: f64) -> Option<Self> {
        let least = |echo: Self| if echo == Self::Velocity { 1 } else { 2 };
        [Self::Position, Self::Velocity, Self::Acceleration]
            .into_iter()
            .filter(|echo| moving.len() >= least(*echo))
            .find(|echo| moving.iter().all(|joint| echo.is_of(log, *joint, max_gap_s)))
    }

    /// (1) for a joint.
    fn is_of(self, log: &[RobotSample], joint: usize, max_gap_s: f64) -> bool {
        let (mut n, mut sum, mut tt, mut xt, mut xx) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for three in log.windows(3) {
            let (before, at, after) = (&three[0], &three[1], &three[2]);
            let span_s = after.t_s - before.t_s;
            let x = match self {
                Self::Position => at.q[joint],
                Self::Velocity => at.dq[joint],
                Self::Acceleration if span_s > 2.0 * max_gap_s => continue,
                Self::Acceleration => (after.dq[joint] - before.dq[joint]) / span_s,
            };
            let tau = at.tau[joint];
            n += 1.0;
            sum += tau;
            (tt, xt, xx) = (tt + tau * tau, xt + x * tau, xx + x * x);
        }
        tt - xt * xt / xx < NEARLY * NEARLY * (tt - sum * sum / n) // (1)
    }
}
