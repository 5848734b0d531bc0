//! Servo axes drawn at random: mass, friction, drive, encoder, controller and motion.

use crate::random::Random;
use crate::studies::draw::Draw;
use std::f64::consts::TAU;

/// Motion of a drawn axis, of an amplitude that is drawn as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RandomAxisMotion {
    /// Three sines.
    Sines,
    /// Steps to random places.
    Steps,
    /// A square wave.
    Square,
    /// Minimum-jerk moves with rests.
    MinimumJerk,
    /// The same with a trapezoid of the speed.
    Trapezoidal,
    /// A sine whose frequency rises through the run.
    Chirp,
}

impl RandomAxisMotion {
    /// Every motion.
    pub const ALL: [Self; 6] = [
        Self::Sines,
        Self::Steps,
        Self::Square,
        Self::MinimumJerk,
        Self::Trapezoidal,
        Self::Chirp,
    ];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sines => "sines",
            Self::Steps => "steps",
            Self::Square => "square",
            Self::MinimumJerk => "minimum_jerk",
            Self::Trapezoidal => "trapezoidal",
            Self::Chirp => "chirp",
        }
    }
}

/// A trial of an axis that its seed draws, with a right model throughout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomAxisSpec {
    /// Its motion.
    pub motion: RandomAxisMotion,
    /// Number of blocks.
    pub blocks: u64,
    /// Seed of the axis and of everything random in the run.
    pub seed: u64,
}

impl RandomAxisSpec {
    /// Words that name the case.
    pub fn words(&self) -> Vec<String> {
        vec![self.motion.name().to_owned(), "random_axis".to_owned()]
    }

    /// Overrides of the configuration `servo_axis`.
    pub fn settings(&self) -> Vec<String> {
        // another machine for each seed and each of the six motions
        let mut draw = Draw(Random(self.seed.wrapping_mul(8).wrapping_add(self.motion as u64)));
        let period_s = draw.of(&[0.0005, 0.001, 0.001, 0.002, 0.004]);
        let block_len = draw.of(&[500.0, 1000.0, 1900.0, 4000.0]);
        let duration_s = self.blocks as f64 * block_len * period_s;
        let (amplitude, mass, gain) = (draw.log(0.003, 2.0), draw.log(0.05, 500.0), draw.log(0.1, 100.0));
        // natural frequency [rad/s] and damping ratio of the closed loop, and pace of the motion
        let (stiff, damped) = (draw.log(8.0, 80.0).min(0.25 / period_s), draw.between(0.5, 1.2));
        let pace = match self.motion {
            RandomAxisMotion::Sines | RandomAxisMotion::Chirp => TAU * draw.log(0.3, 2.0),
            RandomAxisMotion::Steps | RandomAxisMotion::Square => stiff,
            RandomAxisMotion::MinimumJerk | RandomAxisMotion::Trapezoidal => draw.log(2.0, 6.0),
        };
        let force = mass * amplitude * pace * pace;
        let viscous = mass * draw.log(0.2, 20.0);
        let (coulomb, offset) = (force * draw.log(0.02, 0.5), force * draw.between(-0.5, 0.5));
        let resolution = amplitude / draw.log(200.0, 3e6);
        let noise = draw.log(0.002, 0.05) * (force + coulomb + offset.abs()) / gain;
        let (controller, timing) = draw.of(&[("sampled", "held"), ("analog", "continuous")]);
        let start = [mass, viscous, coulomb].map(|value| value * draw.log(0.3, 3.0));
        let mut settings = vec![
            format!("plant.seed={}", self.seed),
            format!("plant.sample_period_s={period_s:?}"),
            format!("plant.duration_s={duration_s:?}"),
            format!("plant.servo_axis.mass=[{mass:?}]"),
            format!("plant.servo_axis.viscous_friction={viscous:?}"),
            format!("plant.servo_axis.coulomb_friction={coulomb:?}"),
            format!("plant.servo_axis.offset={offset:?}"),
            format!("plant.servo_axis.gain={gain:?}"),
            format!("plant.servo_axis.proportional_gain={:?}", mass * stiff * stiff / gain),
            format!(
                "plant.servo_axis.derivative_gain={:?}",
                2.0 * damped * stiff * mass / gain
            ),
            "plant.servo_axis.input_limit=inf".to_owned(),
            format!("plant.servo_axis.position_resolution={resolution:?}"),
            format!("plant.sensors.input_noise_v={noise:?}"),
            format!("plant.controller.kind={controller:?}"),
            format!("model.servo_axis.gain={gain:?}"),
            format!("identifier.projected.timing={timing:?}"),
            "identifier.projected.window_s=\"auto\"".to_owned(),
            format!("identifier.projected.position_resolution=[{resolution:?}]"),
            format!("identifier.projected.input_noise=[{noise:?}]"),
            format!("estimator.block_len={block_len}"),
            format!(
                "estimator.theta_start=[{:?}, {:?}, {:?}, 0.0]",
                start[0], start[1], start[2]
            ),
            "estimator.noise_floor=[1.0]".to_owned(),
            "estimator.forgetting=\"directional\"".to_owned(),
            "estimator.forgetting_factor=0.98".to_owned(),
            "estimator.change_detection=true".to_owned(),
        ];
        settings.extend(self.setpoint(&mut draw, amplitude, pace, duration_s));
        settings
    }

    fn setpoint(&self, draw: &mut Draw, amplitude: f64, pace: f64, duration_s: f64) -> Vec<String> {
        let of = |kind: &str, values: &[(&str, f64)]| {
            let values = values
                .iter()
                .map(|(key, value)| format!("plant.setpoint.{kind}.{key}={:?}", [value; 2]));
            std::iter::once(format!("plant.setpoint.kind=\"{kind}\""))
                .chain(values)
                .collect()
        };
        let mut moves = |profile: &str| {
            let (move_s, rest_s) = (3.0 / pace, draw.of(&[0.0, 0.5, 2.0, 10.0]));
            let mut settings: Vec<String> = of(
                "moves",
                &[
                    ("min_rad", -amplitude),
                    ("max_rad", amplitude),
                    ("min_move_s", move_s),
                    ("max_move_s", move_s * draw.between(1.2, 3.0)),
                    ("min_rest_s", 0.1 * rest_s),
                    ("max_rest_s", rest_s),
                ],
            );
            settings.push(format!("plant.setpoint.moves.profile=\"{profile}\""));
            settings
        };
        match self.motion {
            RandomAxisMotion::Sines => {
                let hz = pace / TAU;
                let sizes = [1.0, 0.2, 0.03].map(|share| share * amplitude);
                vec![
                    format!(
                        "plant.setpoint.sines.frequency_hz=[{:?}, [1.0]]",
                        [0.5 * hz, hz, 3.1 * hz]
                    ),
                    format!("plant.setpoint.sines.amplitude_rad=[{sizes:?}, [0.0]]"),
                ]
            }
            RandomAxisMotion::Steps => {
                let dwell_s = draw.log(0.2, 1.5);
                of(
                    "random",
                    &[
                        ("min_rad", -amplitude),
                        ("max_rad", amplitude),
                        ("min_dwell_s", dwell_s),
                        ("max_dwell_s", dwell_s * draw.between(1.5, 6.0)),
                    ],
                )
            }
            RandomAxisMotion::Square => of(
                "square",
                &[("amplitude_rad", amplitude), ("period_s", draw.log(0.3, 5.0))],
            ),
            RandomAxisMotion::MinimumJerk => moves("minimum_jerk"),
            RandomAxisMotion::Trapezoidal => moves("trapezoidal"),
            RandomAxisMotion::Chirp => of(
                "chirp",
                &[
                    ("amplitude_rad", amplitude),
                    ("end_frequency_hz", 3.0 * pace / TAU),
                    ("sweep_s", duration_s),
                ],
            ),
        }
    }
}
