//! Arms drawn at random, with motions, sensors and one trouble each.

use super::disturbance::Disturbance;
use super::drawn_arm::DrawnArm;
use super::spec::{Arm, Motion, TrialSpec};
use crate::random::Random;
use crate::studies::draw::Draw;

/// What a drawn arm, its sensors or its model have; the seed draws joint and size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// None; the payload changes once.
    Right,
    /// The payload changes in the last 0.4 s of a block.
    LateChange,
    /// Coulomb friction.
    Friction,
    /// A delay of the voltages.
    Delay,
    /// A resonance at 40 Hz.
    Resonance,
    /// Encoders off their axes.
    Eccentricity,
    /// A base off the vertical.
    Tilt,
    /// An offset of a voltage.
    Offset,
    /// Windings that become warm.
    Heating,
    /// A rotor at joint 2.
    Rotor,
    /// Viscous friction.
    Viscous,
    /// Lost samples.
    Loss,
    /// Instants that scatter.
    Jitter,
    /// Wrong positions.
    PositionSpikes,
    /// Wrong voltages.
    InputSpikes,
    /// Voltages in few bits.
    InputBits,
    /// The gain of a voltage changes.
    GainLater,
    /// The offset of a voltage changes.
    OffsetLater,
    /// The zero of an encoder changes.
    ZeroLater,
    /// The scale of an encoder changes.
    ScaleLater,
    /// The clock changes.
    ClockLater,
    /// Friction begins.
    FrictionLater,
}

impl Trouble {
    /// Every trouble.
    pub const ALL: [Self; 22] = [
        Self::Right,
        Self::LateChange,
        Self::Friction,
        Self::Delay,
        Self::Resonance,
        Self::Eccentricity,
        Self::Tilt,
        Self::Offset,
        Self::Heating,
        Self::Rotor,
        Self::Viscous,
        Self::Loss,
        Self::Jitter,
        Self::PositionSpikes,
        Self::InputSpikes,
        Self::InputBits,
        Self::GainLater,
        Self::OffsetLater,
        Self::ZeroLater,
        Self::ScaleLater,
        Self::ClockLater,
        Self::FrictionLater,
    ];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::LateChange => "late_change",
            Self::Friction => "friction",
            Self::Delay => "delay",
            Self::Resonance => "resonance",
            Self::Eccentricity => "eccentricity",
            Self::Tilt => "tilt",
            Self::Offset => "offset",
            Self::Heating => "heating",
            Self::Rotor => "rotor",
            Self::Viscous => "viscous",
            Self::Loss => "loss",
            Self::Jitter => "jitter",
            Self::PositionSpikes => "position_spikes",
            Self::InputSpikes => "input_spikes",
            Self::InputBits => "input_bits",
            Self::GainLater => "gain_later",
            Self::OffsetLater => "offset_later",
            Self::ZeroLater => "zero_later",
            Self::ScaleLater => "scale_later",
            Self::ClockLater => "clock_later",
            Self::FrictionLater => "friction_later",
        }
    }

    /// The trouble with joint and size for an arm.
    fn disturbance(self, arm: &DrawnArm, draw: &mut Draw) -> Disturbance {
        let joint = draw.of(&[1, 2]);
        let sign = draw.of(&[-1, 1]);
        let mut whole = |low: f64, high: f64| draw.log(low, high).round() as u32;
        let change = |size: u32| sign * i32::try_from(size).unwrap_or(i32::MAX);
        let millivolts = 1e3 * arm.holding_voltage(joint - 1);
        match self {
            Self::Right => Disturbance::None,
            Self::LateChange => Disturbance::JumpAtEnd(change(whole(2.0, 50.0))),
            Self::Friction => Disturbance::Friction {
                joint,
                percent: whole(1.0, 15.0),
            },
            Self::Delay => Disturbance::Delay(whole(20.0, 300.0)),
            Self::Resonance => Disturbance::Resonance,
            Self::Eccentricity => Disturbance::Eccentricity(whole(10.0, 400.0)),
            Self::Tilt => Disturbance::Tilt,
            Self::Offset => Disturbance::InputOffset {
                joint,
                millivolts: whole(0.002 * millivolts, 0.1 * millivolts),
            },
            Self::Heating => Disturbance::Heating,
            Self::Rotor => Disturbance::Rotor(whole(1.0, 15.0)),
            Self::Viscous => {
                // at 1 rad/s, in mN m
                let torque = 1e3 * arm.holding_torque();
                Disturbance::Viscous(whole(0.005 * torque, 0.1 * torque))
            }
            Self::Loss => Disturbance::Loss {
                permille: whole(1.0, 50.0),
                burst: whole(1.0, 20.0),
            },
            Self::Jitter => Disturbance::Jitter(whole(20.0, 100.0)),
            Self::PositionSpikes => Disturbance::PositionSpikes,
            Self::InputSpikes => Disturbance::InputSpikes,
            Self::InputBits => Disturbance::InputBits(whole(12.0, 16.0)),
            Self::GainLater => Disturbance::GainLater {
                joint,
                percent: change(whole(2.0, 20.0)),
            },
            Self::OffsetLater => Disturbance::OffsetLater {
                joint,
                millivolts: whole(0.005 * millivolts, 0.1 * millivolts),
            },
            Self::ZeroLater => Disturbance::ZeroLater {
                joint,
                milliradians: whole(3.0, 50.0),
            },
            Self::ScaleLater => Disturbance::ScaleLater {
                joint,
                permille: change(whole(5.0, 50.0)),
            },
            Self::ClockLater => Disturbance::ClockLater(change(whole(3.0, 20.0))),
            Self::FrictionLater => Disturbance::FrictionLater {
                joint,
                percent: whole(2.0, 20.0),
            },
        }
    }
}

/// A trial of an arm that its seed draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomArmSpec {
    /// What it has.
    pub trouble: Trouble,
    /// Number of blocks.
    pub blocks: u64,
    /// Seed of the arm and of everything random in the run.
    pub seed: u64,
}

impl RandomArmSpec {
    /// Words that name the case.
    pub fn words(&self) -> Vec<String> {
        vec![self.trouble.name().to_owned(), "random_arm".to_owned()]
    }

    /// The trial of the seed.
    pub fn trial(&self) -> TrialSpec {
        // another arm for each seed and each trouble
        let seed = self.seed.wrapping_mul(32).wrapping_add(self.trouble as u64);
        let mut draw = Draw(Random(seed));
        let arm = DrawnArm::new(seed);
        TrialSpec {
            arm: Arm::Random(seed),
            motion: draw.of(&Motion::ALL),
            bits: draw.of(&[13, 14, 16, 16, 17, 20]),
            period_us: draw.of(&[500, 1000, 1000, 2000]),
            noise_v: draw.log(2e-4, 1e-2) * arm.holding_voltage(0).max(arm.holding_voltage(1)),
            disturbance: self.trouble.disturbance(&arm, &mut draw),
            blocks: self.blocks,
            seed: self.seed,
        }
    }
}
