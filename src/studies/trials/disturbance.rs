//! Disturbances of a run: of its payload, its samples, or the model.

/// Time before the end of a block \[s\] within which a change does not yet show with 13 bits.
const LATE_S: f64 = 0.05;

/// A disturbance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Disturbance {
    /// None; the payload changes once.
    None,
    /// The payload changes while both joints rest.
    AtRest,
    /// The mass of link 2 jumps by this percentage.
    Jump(i32),
    /// The same within the last 0.4 s of a block.
    JumpAtEnd(i32),
    /// Samples are lost in bursts.
    Loss {
        /// Share in thousandths.
        permille: u32,
        /// Samples lost together.
        burst: u32,
    },
    /// The samples' instants scatter by this many µs; time stamps show it.
    Jitter(u32),
    /// One sample in a hundred has a wrong position of either joint, by 0.01 to 1 rad, depending on
    /// the seed.
    PositionSpikes,
    /// One sample in a hundred has a wrong voltage at either motor, by 100 times the noise.
    InputSpikes,
    /// The voltage is measured with this many bits over ± 400 V.
    InputBits(u32),
    /// Coulomb friction at a joint, in per cent of the torque that holds link 2 level.
    Friction {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        percent: u32,
    },
    /// The same, with friction at both joints in the model.
    FrictionModelled {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        percent: u32,
    },
    /// The voltage acts this many µs later than configured in the identifier.
    Delay(u32),
    /// The same, with the delay estimated.
    DelayEstimated(u32),
    /// A resonance at 40 Hz between joints and encoders.
    Resonance,
    /// Encoders off their axes by this many arc seconds.
    Eccentricity(u32),
    /// The base is 1° off the vertical.
    Tilt,
    /// The recorded voltage of a motor has an offset.
    InputOffset {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        millivolts: u32,
    },
    /// The same, with an offset at both joints in the model.
    InputOffsetModelled {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        millivolts: u32,
    },
    /// An offset of the recorded voltage and Coulomb friction as above at the same joint, both in
    /// the model.
    FrictionAndOffsetModelled {
        /// Joint, 1 or 2.
        joint: usize,
        /// Friction.
        percent: u32,
        /// Offset.
        millivolts: u32,
    },
    /// Both windings' resistances grow by 10 % in 60 s.
    Heating,
    /// A rotor at joint 2, in per cent of the inertia of link 2.
    Rotor(u32),
    /// Viscous friction at both joints, in mN m s/rad.
    Viscous(u32),
    /// The gain of a motor's measured voltage is wrong from the middle of the run on.
    GainLater {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        percent: i32,
    },
    /// The measured voltage has an offset from then on.
    OffsetLater {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        millivolts: u32,
    },
    /// The position of a joint has an offset from then on.
    ZeroLater {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        milliradians: u32,
    },
    /// The scale of a joint's encoder is wrong from then on.
    ScaleLater {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        permille: i32,
    },
    /// The clock of the time stamps runs this many thousandths faster from then on.
    ClockLater(i32),
    /// Coulomb friction begins then, in per cent of the torque that holds link 2 level.
    FrictionLater {
        /// Joint, 1 or 2.
        joint: usize,
        /// Size.
        percent: u32,
    },
    /// An error of the machine, its kind chosen by the seed, drawn from the identifier's prior.
    Drawn,
    /// None, and the identifier considers no error.
    NoiseAlone,
    /// The axis has further friction, a fifth of its Coulomb friction, that falls with the speed v
    /// as exp(−(v/v_s)²), with v_s in mm/s.
    Stribeck(u32),
}

impl Disturbance {
    /// Disturbances of the payload.
    pub const PAYLOAD: [Self; 11] = [
        Self::AtRest,
        Self::Jump(-50),
        Self::Jump(-2),
        Self::Jump(2),
        Self::Jump(13),
        Self::Jump(50),
        Self::JumpAtEnd(-50),
        Self::JumpAtEnd(-2),
        Self::JumpAtEnd(2),
        Self::JumpAtEnd(13),
        Self::JumpAtEnd(50),
    ];
    /// Disturbances of the samples.
    pub const SAMPLES: [Self; 14] = [
        Self::loss(1, 1),
        Self::loss(10, 1),
        Self::loss(30, 1),
        Self::loss(50, 1),
        Self::loss(1, 20),
        Self::loss(10, 20),
        Self::loss(30, 20),
        Self::loss(50, 20),
        Self::Jitter(20),
        Self::Jitter(50),
        Self::Jitter(100),
        Self::PositionSpikes,
        Self::InputSpikes,
        Self::InputBits(12),
    ];
    /// Disturbances of the model.
    pub const MODEL: [Self; 16] = [
        Self::friction(1, 2),
        Self::friction(1, 10),
        Self::friction(2, 2),
        Self::friction(2, 10),
        Self::Delay(50),
        Self::Delay(150),
        Self::Resonance,
        Self::Eccentricity(20),
        Self::Eccentricity(200),
        Self::Tilt,
        Self::input_offset(2, 50),
        Self::input_offset(2, 500),
        Self::input_offset(1, 500),
        Self::Heating,
        Self::Rotor(5),
        Self::Viscous(20_000),
    ];
    /// Faults of a drive or a sensor in the middle of a run.
    pub const SENSOR: [Self; 7] = [
        Self::GainLater { joint: 1, percent: 2 },
        Self::GainLater { joint: 2, percent: 2 },
        Self::GainLater { joint: 1, percent: -5 },
        Self::GainLater { joint: 2, percent: -5 },
        Self::OffsetLater {
            joint: 2,
            millivolts: 100,
        },
        Self::ZeroLater {
            joint: 2,
            milliradians: 3,
        },
        Self::ZeroLater {
            joint: 2,
            milliradians: 20,
        },
    ];
    /// Disturbances for which the identifier has no column.
    pub const OTHER: [Self; 5] = [
        Self::ScaleLater { joint: 1, permille: 20 },
        Self::ScaleLater {
            joint: 2,
            permille: -20,
        },
        Self::ClockLater(10),
        Self::FrictionLater { joint: 1, percent: 10 },
        Self::FrictionLater { joint: 2, percent: 5 },
    ];
    /// Errors of the model for which the configuration compensates.
    pub const MODEL_MENDED: [Self; 10] = [
        Self::DelayEstimated(50),
        Self::DelayEstimated(150),
        Self::friction_modelled(1, 2),
        Self::friction_modelled(1, 10),
        Self::friction_modelled(2, 2),
        Self::friction_modelled(2, 10),
        Self::offset_modelled(1, 500),
        Self::offset_modelled(2, 50),
        Self::offset_modelled(2, 500),
        Self::FrictionAndOffsetModelled {
            joint: 2,
            percent: 10,
            millivolts: 500,
        },
    ];

    const fn loss(permille: u32, burst: u32) -> Self {
        Self::Loss { permille, burst }
    }

    const fn friction(joint: usize, percent: u32) -> Self {
        Self::Friction { joint, percent }
    }

    const fn friction_modelled(joint: usize, percent: u32) -> Self {
        Self::FrictionModelled { joint, percent }
    }

    const fn offset_modelled(joint: usize, millivolts: u32) -> Self {
        Self::InputOffsetModelled { joint, millivolts }
    }

    const fn input_offset(joint: usize, millivolts: u32) -> Self {
        Self::InputOffset { joint, millivolts }
    }

    /// Name in tables and filters.
    pub fn name(self) -> String {
        match self {
            Self::None => "none".to_owned(),
            Self::AtRest => "at_rest".to_owned(),
            Self::Jump(percent) => format!("jump{percent:+}%"),
            Self::JumpAtEnd(percent) => format!("late_jump{percent:+}%"),
            Self::Loss { permille, burst: 1 } => format!("loss_{}%", f64::from(permille) / 10.0),
            Self::Loss { permille, burst } => format!("loss_{}%_by_{burst}", f64::from(permille) / 10.0),
            Self::Jitter(us) => format!("jitter_{us}us"),
            Self::PositionSpikes => "position_spikes".to_owned(),
            Self::InputSpikes => "input_spikes".to_owned(),
            Self::InputBits(bits) => format!("input_{bits}bit"),
            Self::Friction { joint, percent } => format!("friction_{joint}_{percent}%"),
            Self::FrictionModelled { joint, percent } => format!("friction_{joint}_{percent}%_modelled"),
            Self::Delay(us) => format!("delay_{us}us"),
            Self::DelayEstimated(us) => format!("delay_{us}us_estimated"),
            Self::Resonance => "resonance_40Hz".to_owned(),
            Self::Eccentricity(arcsec) => format!("eccentricity_{arcsec}arcsec"),
            Self::Tilt => "tilt_1deg".to_owned(),
            Self::InputOffset { joint, millivolts } => format!("input_offset_{joint}_{millivolts}mV"),
            Self::InputOffsetModelled { joint, millivolts } => format!("input_offset_{joint}_{millivolts}mV_modelled"),
            Self::FrictionAndOffsetModelled {
                joint,
                percent,
                millivolts,
            } => format!("friction_{joint}_{percent}%_and_offset_{millivolts}mV_modelled"),
            Self::Heating => "heating_10%".to_owned(),
            Self::Rotor(percent) => format!("rotor_2_{percent}%"),
            Self::Viscous(b) => format!("viscous_{}Nms", f64::from(b) / 1000.0),
            Self::GainLater { joint, percent } => format!("gain_{joint}_later{percent:+}%"),
            Self::OffsetLater { joint, millivolts } => format!("input_offset_{joint}_later_{millivolts}mV"),
            Self::ZeroLater { joint, milliradians } => format!("zero_{joint}_later_{milliradians}mrad"),
            Self::ScaleLater { joint, permille } => {
                format!("scale_{joint}_later{:+}%", f64::from(permille) / 10.0)
            }
            Self::ClockLater(permille) => format!("clock_later{:+}%", f64::from(permille) / 10.0),
            Self::FrictionLater { joint, percent } => format!("friction_{joint}_later_{percent}%"),
            Self::Drawn => "drawn".to_owned(),
            Self::NoiseAlone => "noise_alone".to_owned(),
            Self::Stribeck(mm_per_s) => format!("stribeck_{mm_per_s}mm/s"),
        }
    }

    /// Words of the right cause, of which one must appear, and the joint's number if there is one.
    pub fn cause(self) -> Option<(&'static [&'static str], Option<usize>)> {
        match self {
            Self::Friction { joint, .. } => Some((&["friction"], Some(joint))),
            Self::Delay(_) => Some((&["delay"], None)),
            Self::Resonance => Some((&["resonance", "flexible"], None)),
            Self::Eccentricity(_) => Some((&["eccentric", "off its centre"], None)),
            Self::Tilt => Some((&["tilt", "gravity"], None)),
            Self::InputOffset { joint, .. } => Some((&["offset"], Some(joint))),
            Self::Heating => Some((&["heat", "resistance", "drift"], None)),
            Self::Rotor(_) => Some((&["rotor"], Some(2))),
            Self::Viscous(_) => Some((&["viscous"], None)),
            Self::GainLater { joint, .. } => Some((&["gain"], Some(joint))),
            Self::OffsetLater { joint, .. } => Some((&["offset"], Some(joint))),
            Self::ZeroLater { joint, .. } => Some((&["zero"], Some(joint))),
            // a scale of a joint about the vertical is exactly a gain
            Self::ScaleLater { joint, .. } => Some((&["scale", "gain"], Some(joint))),
            Self::ClockLater(_) => Some((&["clock"], None)),
            Self::FrictionLater { joint, .. } => Some((&["friction"], Some(joint))),
            Self::Stribeck(_) => Some((&["friction"], None)),
            _ => None,
        }
    }

    /// True if the model, a drive or a sensor is wrong.
    fn is_of_the_machine(self) -> bool {
        match self {
            Self::None
            | Self::AtRest
            | Self::Jump(_)
            | Self::JumpAtEnd(_)
            | Self::Loss { .. }
            | Self::Jitter(_)
            | Self::PositionSpikes
            | Self::InputSpikes
            | Self::InputBits(_)
            | Self::Drawn
            | Self::NoiseAlone
            | Self::Stribeck(_) => false,
            Self::Friction { .. }
            | Self::FrictionModelled { .. }
            | Self::Delay(_)
            | Self::DelayEstimated(_)
            | Self::Resonance
            | Self::Eccentricity(_)
            | Self::Tilt
            | Self::InputOffset { .. }
            | Self::InputOffsetModelled { .. }
            | Self::FrictionAndOffsetModelled { .. }
            | Self::Heating
            | Self::Rotor(_)
            | Self::Viscous(_)
            | Self::GainLater { .. }
            | Self::OffsetLater { .. }
            | Self::ZeroLater { .. }
            | Self::ScaleLater { .. }
            | Self::ClockLater(_)
            | Self::FrictionLater { .. } => true,
        }
    }

    /// Mass of link 2 after the change \[kg\].
    pub(super) fn mass_after(self, first_kg: f64, then_kg: f64) -> f64 {
        match self {
            Self::Jump(percent) | Self::JumpAtEnd(percent) => first_kg * (1.0 + f64::from(percent) / 100.0),
            // One disturbance at a time.
            _ if self.is_of_the_machine() => first_kg,
            _ => then_kg,
        }
    }

    /// Position of the payload's change within its block, 0 to 1, from a number of the seed.
    pub(super) fn place_of_change(self, spread: f64, block_s: f64) -> f64 {
        match self {
            Self::JumpAtEnd(_) => 1.0 - 0.4 / block_s * spread,
            // JumpAtEnd is for changes that come too late to show
            _ => (1.0 - LATE_S / block_s) * spread,
        }
    }

    /// Settings for an identifier that has these keys.
    pub fn optional_settings(self) -> Vec<(&'static str, String)> {
        match self {
            Self::InputBits(bits) => vec![(
                "identifier.projected.input_resolution",
                format!("[{:?}]", 800.0 / f64::from(bits).exp2()),
            )],
            _ => Vec::new(),
        }
    }
}
