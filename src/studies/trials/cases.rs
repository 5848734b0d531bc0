//! The cases of the trials.

use super::axis::{AxisMotion, AxisSpec};
use super::disturbance::Disturbance;
use super::random_arm::{RandomArmSpec, Trouble};
use super::random_axis::{RandomAxisMotion, RandomAxisSpec};
use super::spec::{Arm, Motion, TrialSpec};

/// Headings of the tables.
const GRID: &str = "Motions, sensors, machines";
const PAYLOAD: &str = "Payload changes";
const SAMPLES: &str = "Samples lost, irregular, wrong";
const MODEL: &str = "Model wrong";
const SENSOR: &str = "Drive or sensor changes";
const OTHER: &str = "Scale, clock or friction changes";
const DRAWN: &str = "Errors as considered";
const ALONE: &str = "No error considered";
const MENDED: &str = "Model mended";
const AXIS: &str = "Servo axis with friction";
const AXIS_WRONG: &str = "Servo axis, model wrong";
const RANDOM_ARMS: &str = "Arms drawn at random";
const RANDOM_AXES: &str = "Servo axes drawn at random";
/// v_s of friction that falls with speed \[mm/s\]; the mean speed of the axis is 0.1 m/s.
const STRIBECK_SPEEDS: [u32; 3] = [5, 20, 50];

/// A trial of one of the machines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spec {
    /// The arm.
    Arm(TrialSpec),
    /// The servo axis.
    Axis(AxisSpec),
    /// An arm that the seed draws.
    RandomArm(RandomArmSpec),
    /// A servo axis that the seed draws.
    RandomAxis(RandomAxisSpec),
}

/// Trials that differ only in their seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Heading of the table that it belongs to.
    pub group: &'static str,
    /// The trial; the seed is that of the first one.
    pub spec: Spec,
}

impl Spec {
    /// The same with another seed, and with another number of blocks if there is one.
    #[must_use]
    pub fn with(self, seed: u64, blocks: Option<u64>) -> Self {
        match self {
            Self::Arm(spec) => Self::Arm(TrialSpec {
                seed,
                blocks: blocks.unwrap_or(spec.blocks),
                ..spec
            }),
            Self::Axis(spec) => Self::Axis(AxisSpec {
                seed,
                blocks: blocks.unwrap_or(spec.blocks),
                ..spec
            }),
            Self::RandomArm(spec) => Self::RandomArm(RandomArmSpec {
                seed,
                blocks: blocks.unwrap_or(spec.blocks),
                ..spec
            }),
            Self::RandomAxis(spec) => Self::RandomAxis(RandomAxisSpec {
                seed,
                blocks: blocks.unwrap_or(spec.blocks),
                ..spec
            }),
        }
    }

    /// The trial of an arm; `None` for other machines.
    pub fn arm(&self) -> Option<TrialSpec> {
        match self {
            Self::Arm(spec) => Some(*spec),
            Self::RandomArm(spec) => Some(spec.trial()),
            Self::Axis(_) | Self::RandomAxis(_) => None,
        }
    }

    /// Built-in configuration that the settings override.
    pub fn basis(&self) -> &'static str {
        match self {
            Self::Arm(_) | Self::RandomArm(_) => "encoder_only",
            Self::Axis(_) | Self::RandomAxis(_) => "servo_axis",
        }
    }

    /// Overrides of the basis, as `section.key=value`.
    pub fn settings(&self) -> Vec<String> {
        match self {
            Self::Arm(spec) => spec.settings(),
            Self::Axis(spec) => spec.settings(),
            Self::RandomArm(spec) => spec.trial().settings(),
            Self::RandomAxis(spec) => spec.settings(),
        }
    }

    /// Words that name the case, without its seed; filters look for them.
    pub fn words(&self) -> Vec<String> {
        match self {
            Self::Arm(spec) => spec.words(),
            Self::Axis(spec) => spec.words(),
            Self::RandomArm(spec) => spec.words(),
            Self::RandomAxis(spec) => spec.words(),
        }
    }

    /// The disturbance.
    pub fn disturbance(&self) -> Disturbance {
        match self {
            Self::Arm(spec) => spec.disturbance,
            Self::Axis(spec) => spec.disturbance,
            Self::RandomArm(spec) => spec.trial().disturbance,
            Self::RandomAxis(_) => Disturbance::None,
        }
    }
}

impl Case {
    fn arm(group: &'static str, spec: TrialSpec) -> Self {
        Self {
            group,
            spec: Spec::Arm(spec),
        }
    }

    fn axis(group: &'static str, motion: AxisMotion, disturbance: Disturbance) -> Self {
        Self {
            group,
            spec: Spec::Axis(AxisSpec {
                motion,
                disturbance,
                blocks: 30,
                seed: 0,
            }),
        }
    }

    /// Cases of the axes.
    fn axes() -> impl Iterator<Item = Self> {
        let right = AxisMotion::ALL.map(|motion| Self::axis(AXIS, motion, Disturbance::None));
        let wrong = STRIBECK_SPEEDS.into_iter().flat_map(|speed| {
            AxisMotion::ALL.map(|motion| Self::axis(AXIS_WRONG, motion, Disturbance::Stribeck(speed)))
        });
        let random = RandomAxisMotion::ALL.map(|motion| Self {
            group: RANDOM_AXES,
            spec: Spec::RandomAxis(RandomAxisSpec {
                motion,
                blocks: 40,
                seed: 0,
            }),
        });
        right.into_iter().chain(wrong).chain(random)
    }

    /// Cases of the arms that seeds draw.
    fn random_arms() -> impl Iterator<Item = Self> {
        Trouble::ALL.into_iter().map(|trouble| Self {
            group: RANDOM_ARMS,
            spec: Spec::RandomArm(RandomArmSpec {
                trouble,
                blocks: 40,
                seed: 0,
            }),
        })
    }

    /// The name: words with slashes between them.
    pub fn name(&self) -> String {
        self.spec.words().join("/")
    }

    /// True if every word of the filter, separated by commas, begins one of the case's words.
    pub fn matches(&self, filter: &str) -> bool {
        let words = self.spec.words();
        let wanted = filter.split(',').map(str::trim).filter(|word| !word.is_empty());
        wanted
            .into_iter()
            .all(|word| words.iter().any(|own| own.starts_with(word)))
    }
}

/// A few cases, for quick checks while changing the estimator.
pub fn quick_cases() -> Vec<Case> {
    let case_of = |group, disturbance, motion, arm, bits, period_us| {
        Case::arm(
            group,
            TrialSpec {
                arm,
                bits,
                period_us,
                disturbance,
                blocks: 40,
                ..TrialSpec::new(motion, 0)
            },
        )
    };
    let case = |motion, arm, bits, period_us| case_of(GRID, Disturbance::None, motion, arm, bits, period_us);
    let mut cases: Vec<Case> = Motion::ALL
        .iter()
        .map(|&motion| case(motion, Arm::Paper, 16, 1000))
        .collect();
    cases.extend([
        case(Motion::MinimumJerk, Arm::Paper, 13, 1000),
        case(Motion::MinimumJerk, Arm::Paper, 20, 1000),
        case(Motion::MinimumJerk, Arm::Paper, 16, 500),
        case(Motion::MinimumJerk, Arm::Paper, 16, 2000),
        case(Motion::Steps, Arm::Unequal, 16, 1000),
        case(Motion::MinimumJerk, Arm::Unequal, 16, 1000),
        case(Motion::Steps, Arm::Small, 16, 1000),
        case(Motion::MinimumJerk, Arm::Small, 16, 1000),
    ]);
    let disturbed = |group, motion, disturbance| case_of(group, disturbance, motion, Arm::Paper, 16, 1000);
    for motion in [
        Motion::Steps,
        Motion::MinimumJerk,
        Motion::Trapezoidal,
        Motion::Multisine,
    ] {
        cases.push(disturbed(DRAWN, motion, Disturbance::Drawn));
        cases.push(disturbed(ALONE, motion, Disturbance::NoiseAlone));
    }
    cases.extend([
        disturbed(PAYLOAD, Motion::Rests, Disturbance::AtRest),
        disturbed(PAYLOAD, Motion::Steps, Disturbance::JumpAtEnd(13)),
        disturbed(PAYLOAD, Motion::MinimumJerk, Disturbance::Jump(-50)),
        disturbed(SAMPLES, Motion::Steps, Disturbance::SAMPLES[1]),
        disturbed(SAMPLES, Motion::Steps, Disturbance::SAMPLES[2]),
        disturbed(SAMPLES, Motion::Steps, Disturbance::Jitter(100)),
        disturbed(SAMPLES, Motion::Steps, Disturbance::PositionSpikes),
        disturbed(SAMPLES, Motion::Steps, Disturbance::InputSpikes),
        disturbed(SAMPLES, Motion::Steps, Disturbance::InputBits(12)),
    ]);
    for motion in [Motion::MinimumJerk, Motion::Steps, Motion::Multisine] {
        cases.extend(Disturbance::MODEL.map(|disturbance| disturbed(MODEL, motion, disturbance)));
    }
    for motion in [Motion::Steps, Motion::MinimumJerk] {
        cases.extend(Disturbance::MODEL_MENDED.map(|disturbance| disturbed(MENDED, motion, disturbance)));
    }
    for motion in [Motion::Steps, Motion::MinimumJerk] {
        cases.extend(Disturbance::SENSOR.map(|disturbance| disturbed(SENSOR, motion, disturbance)));
        cases.extend(Disturbance::OTHER.map(|disturbance| disturbed(OTHER, motion, disturbance)));
    }
    cases.extend(Case::axes());
    cases.extend(Case::random_arms());
    cases
}

/// All cases.
pub fn full_cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for motion in Motion::ALL {
        for arm in Arm::ALL {
            for bits in [13, 16, 20] {
                for period_us in [500, 1000, 2000] {
                    // Moves of half a minute need longer runs.
                    let slow = matches!(motion, Motion::Rests | Motion::Creeping) && period_us < 1000;
                    let spec = TrialSpec {
                        arm,
                        bits,
                        period_us,
                        blocks: if slow { 120 } else { 60 },
                        ..TrialSpec::new(motion, 0)
                    };
                    cases.push(Case::arm(GRID, spec));
                }
            }
        }
    }
    let mut disturbed = |group, disturbance, motions: &[Motion], arms: &[Arm]| {
        for &motion in motions {
            for &arm in arms {
                let spec = TrialSpec {
                    arm,
                    disturbance,
                    ..TrialSpec::new(motion, 0)
                };
                cases.push(Case::arm(group, spec));
            }
        }
    };
    let both = [Motion::Steps, Motion::MinimumJerk];
    for disturbance in Disturbance::PAYLOAD {
        match disturbance {
            Disturbance::AtRest => disturbed(PAYLOAD, disturbance, &[Motion::Rests], &Arm::ALL),
            _ => disturbed(PAYLOAD, disturbance, &both, &Arm::ALL),
        }
    }
    for disturbance in Disturbance::SAMPLES {
        disturbed(SAMPLES, disturbance, &both, &[Arm::Paper]);
    }
    for disturbance in Disturbance::MODEL {
        disturbed(MODEL, disturbance, &both, &Arm::ALL);
    }
    for disturbance in Disturbance::SENSOR {
        disturbed(SENSOR, disturbance, &both, &Arm::ALL);
    }
    for disturbance in Disturbance::OTHER {
        disturbed(OTHER, disturbance, &both, &Arm::ALL);
    }
    disturbed(DRAWN, Disturbance::Drawn, &both, &Arm::ALL);
    disturbed(ALONE, Disturbance::NoiseAlone, &both, &Arm::ALL);
    for disturbance in Disturbance::MODEL_MENDED {
        disturbed(MENDED, disturbance, &both, &Arm::ALL);
    }
    cases.extend(Case::axes());
    cases.extend(Case::random_arms());
    cases
}
