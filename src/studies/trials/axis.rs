//! Trials of the servo axis, which sticks at rest.

use super::disturbance::Disturbance;
use super::spread::spread;

/// Motion of the axis, within 5 cm on either side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisMotion {
    /// The sines of `config/servo_axis.toml`.
    Sines,
    /// A square wave, with amplitude and period from the seed.
    Square,
    /// Minimum-jerk moves and rests up to 1 s.
    MinimumJerk,
    /// The same with a trapezoid of the speed.
    Trapezoidal,
}

impl AxisMotion {
    /// Every motion.
    pub const ALL: [Self; 4] = [Self::Sines, Self::Square, Self::MinimumJerk, Self::Trapezoidal];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sines => "sines",
            Self::Square => "square",
            Self::MinimumJerk => "minimum_jerk",
            Self::Trapezoidal => "trapezoidal",
        }
    }
}

/// A trial of the servo axis of `config/servo_axis.toml`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSpec {
    /// Its motion.
    pub motion: AxisMotion,
    /// Its disturbance.
    pub disturbance: Disturbance,
    /// Number of blocks.
    pub blocks: u64,
    /// Seed of everything random.
    pub seed: u64,
}

impl AxisSpec {
    /// Words that name the case.
    pub fn words(&self) -> Vec<String> {
        let mut words = vec![self.motion.name().to_owned(), "axis".to_owned()];
        if self.disturbance != Disturbance::None {
            words.push(self.disturbance.name());
        }
        words
    }

    /// Overrides of the configuration `servo_axis`.
    pub fn settings(&self) -> Vec<String> {
        let mut settings = vec![
            format!("plant.seed={}", self.seed),
            format!("plant.duration_s={:?}", self.blocks as f64 * 1.9),
        ];
        if let Disturbance::Stribeck(mm_per_s) = self.disturbance {
            settings.extend([
                "plant.servo_axis.stribeck_friction=4.0".to_owned(),
                format!("plant.servo_axis.stribeck_speed={:?}", f64::from(mm_per_s) * 1e-3),
                "plant.substeps=10".to_owned(),
            ]);
        }
        let moves = |profile: &str| {
            vec![
                "plant.setpoint.kind=\"moves\"".to_owned(),
                format!("plant.setpoint.moves.profile=\"{profile}\""),
                "plant.setpoint.moves.min_rad=[-0.05, 0.0]".to_owned(),
                "plant.setpoint.moves.max_rad=[0.05, 0.0]".to_owned(),
                "plant.setpoint.moves.min_move_s=[0.3, 1.0]".to_owned(),
                "plant.setpoint.moves.max_move_s=[1.0, 1.0]".to_owned(),
                "plant.setpoint.moves.max_rest_s=[1.0, 1.0]".to_owned(),
            ]
        };
        settings.extend(match self.motion {
            AxisMotion::Sines => Vec::new(),
            AxisMotion::Square => vec![
                "plant.setpoint.kind=\"square\"".to_owned(),
                format!(
                    "plant.setpoint.square.amplitude_rad=[{:?}, 0.0]",
                    0.01 + 0.04 * spread(self.seed, 1)
                ),
                format!(
                    "plant.setpoint.square.period_s=[{:?}, 1.0]",
                    1.2 + 1.8 * spread(self.seed, 2)
                ),
                format!("plant.setpoint.square.shift_s=[{:?}, 0.0]", 1.2 * spread(self.seed, 3)),
            ],
            AxisMotion::MinimumJerk => moves("minimum_jerk"),
            AxisMotion::Trapezoidal => moves("trapezoidal"),
        });
        settings
    }
}
