//! What random robots are tried with.

/// A right model, something that the model lacks, or a fault of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RandomRobotCase {
    /// A right model with viscous and Coulomb friction and offsets.
    FewTerms,
    /// The default model, whose travel of reversals is another than the machine's.
    AllTerms,
    /// A payload is picked up.
    Payload,
    /// Drag.
    Drag,
    /// Viscous friction that differs by direction.
    Asymmetric,
    /// A spring at each joint.
    Spring,
    /// A torque that varies with the position.
    Cogging,
    /// Torques are late.
    Delay,
    /// Encoders with another zero.
    Zeros,
    /// The gain of a drive changes.
    Gain,
    /// An encoder slips.
    Slip,
    /// Samples are lost.
    Loss,
    /// Torques with spikes.
    Spikes,
    /// The zeros of the torque sensors drift.
    Drift,
    /// Torques in coarse steps.
    Counts,
    /// Time stamps that are early or late.
    Jitter,
    /// Velocities are measured.
    MeasuredVelocities,
}

impl RandomRobotCase {
    /// Every case with its name and what is tried, for tables.
    pub const ALL: [(Self, &'static str, &'static str); 17] = [
        (Self::FewTerms, "viscous, Coulomb, offset", "right model"),
        (
            Self::AllTerms,
            "default terms",
            "right model but for `presliding`, 0.02 to 2 mrad instead of 0.2",
        ),
        (Self::Payload, "payload", "2 to 40 % of the robot's mass is picked up"),
        (Self::Drag, "drag", "0 to 2 % of the largest torque at 2 rad/s"),
        (
            Self::Asymmetric,
            "asymmetric",
            "± 1 % of the largest torque at 2 rad/s to either side",
        ),
        (Self::Spring, "spring", "± 3 % of the largest torque per rad"),
        (
            Self::Cogging,
            "cogging",
            "0.2 to 2 % of the largest torque, 24 periods per turn",
        ),
        (Self::Delay, "delay", "0.25 to 1.5 ms of the torques"),
        (Self::Zeros, "zeros", "5 mrad (σ) of each encoder"),
        (Self::Gain, "gain", "changes by 2 to 30 % at one joint"),
        (Self::Slip, "slip", "3 to 100 mrad at one joint"),
        (Self::Loss, "loss", "0.1 to 5 % of the samples"),
        (
            Self::Spikes,
            "spikes",
            "up to twice the largest torque in 0.01 to 1 % of the samples",
        ),
        (
            Self::Drift,
            "drift",
            "zeros of the torques, 0.2 to 1 % of the largest per minute",
        ),
        (Self::Counts, "counts", "torques in steps of 0.2 to 3 % of the largest"),
        (Self::Jitter, "jitter", "time stamps off by 20 to 300 µs (σ)"),
        (
            Self::MeasuredVelocities,
            "velocities",
            "measured, instead of formed from positions",
        ),
    ];
}
