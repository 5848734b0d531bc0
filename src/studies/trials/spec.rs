//! What is tried: an arm, a motion, sensors, a disturbance, a seed.

use super::disturbance::Disturbance;
use crate::sim::ArmParameters;

/// An arm with its payload and the gains of its controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arm {
    /// The paper's: links of 100 and 150 kg, from the change on 170 kg.
    Paper,
    /// Links of 0.6 m and 60 kg, 0.8 m and 80 kg, from the change on 95 kg; two different motors.
    Unequal,
    /// Links of 0.35 m and 0.5 m of 20 kg, from the change on 23 kg; small geared motors, whose windings take 4 ms instead of 100 ms.
    Small,
}

impl Arm {
    /// Every arm.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Unequal, Self::Small];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Unequal => "unequal",
            Self::Small => "small",
        }
    }

    /// Links and motors.
    pub fn parameters(self) -> ArmParameters {
        let paper = ArmParameters::cedro2022();
        match self {
            Self::Paper => paper,
            Self::Unequal => ArmParameters {
                length_1_m: 0.6,
                mass_1_kg: 60.0,
                length_2_m: 0.8,
                winding_resistance_ohm: [0.06, 0.08],
                winding_inductance_h: [0.003, 0.004],
                torque_constant_n_m_per_a: [16.0, 14.0],
                back_emf_constant_v_s_per_rad: [16.0, 14.0],
                ..paper
            },
            Self::Small => ArmParameters {
                length_1_m: 0.35,
                mass_1_kg: 20.0,
                length_2_m: 0.5,
                winding_resistance_ohm: [1.0, 1.2],
                winding_inductance_h: [0.004, 0.005],
                torque_constant_n_m_per_a: [6.0, 7.0],
                back_emf_constant_v_s_per_rad: [6.0, 7.0],
                ..paper
            },
        }
    }

    /// Mass of link 2 before and after the payload changes \[kg\].
    pub fn masses_kg(self) -> (f64, f64) {
        match self {
            Self::Paper => (150.0, 170.0),
            Self::Unequal => (80.0, 95.0),
            Self::Small => (20.0, 23.0),
        }
    }

    /// Gains K_p \[V/rad\] and K_d \[V s/rad\] at a sample period.
    ///
    /// The loop L J/k q⃛ + (R J/k − K_d Δ/2) q̈ + (k + K_d) q̇ + K_p q is stable if (R J/k − K_d Δ/2)(k + K_d) > K_p L J/k. The paper's gains are not
    /// at 2 ms for the lower joint with the arm raised, so that there they are smaller.
    pub fn gains(self, period_us: u32) -> ([f64; 2], [f64; 2]) {
        match self {
            Self::Paper if period_us <= 1000 => ([191.304; 2], [31.6957; 2]),
            Self::Paper => ([120.0; 2], [12.0; 2]),
            Self::Unequal => ([120.0, 150.0], [12.0, 12.0]),
            Self::Small => ([60.0, 80.0], [4.0, 5.0]),
        }
    }
}

/// What the arm follows, |q₁| ≤ 1 rad and |q₂| ≤ 0.8 rad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Random levels, each for 1 to 3 s.
    Steps,
    /// Moves of 0.6 to 1.6 s with the least jerk, rests up to 0.5 s.
    MinimumJerk,
    /// The same moves with a trapezoid of the speed.
    Trapezoidal,
    /// Six sines from 0.23 to 5.3 Hz with amplitudes that fall slowly, phases by the seed.
    Multisine,
    /// Moves with the least jerk and rests of 1 to 20 s.
    Rests,
    /// Moves of 10 to 30 s within 0.3 rad.
    Creeping,
    /// Six sines within 0.01 to 0.05 rad, by the seed.
    Tiny,
}

impl Motion {
    /// Every motion.
    pub const ALL: [Self; 7] = [
        Self::Steps,
        Self::MinimumJerk,
        Self::Trapezoidal,
        Self::Multisine,
        Self::Rests,
        Self::Creeping,
        Self::Tiny,
    ];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::MinimumJerk => "minimum_jerk",
            Self::Trapezoidal => "trapezoidal",
            Self::Multisine => "multisine",
            Self::Rests => "rests",
            Self::Creeping => "creeping",
            Self::Tiny => "tiny",
        }
    }

    /// Settings of `plant.setpoint`.
    fn settings(self, seed: u64) -> Vec<String> {
        let moves = |profile: &str, reach: f64, moves_s: (f64, f64), rests_s: (f64, f64)| {
            let both = |value: f64| format!("[{value:?}, {value:?}]");
            vec![
                "plant.setpoint.kind=\"moves\"".to_owned(),
                format!("plant.setpoint.moves.profile=\"{profile}\""),
                format!("plant.setpoint.moves.min_rad=[{:?}, {:?}]", -reach, -0.8 * reach),
                format!("plant.setpoint.moves.max_rad=[{:?}, {:?}]", reach, 0.8 * reach),
                format!("plant.setpoint.moves.min_move_s={}", both(moves_s.0)),
                format!("plant.setpoint.moves.max_move_s={}", both(moves_s.1)),
                format!("plant.setpoint.moves.min_rest_s={}", both(rests_s.0)),
                format!("plant.setpoint.moves.max_rest_s={}", both(rests_s.1)),
            ]
        };
        match self {
            // as config/encoder_only.toml has them
            Self::Steps => vec!["plant.setpoint.kind=\"random\"".to_owned()],
            Self::MinimumJerk => moves("minimum_jerk", 1.0, (0.6, 1.6), (0.0, 0.5)),
            Self::Trapezoidal => moves("trapezoidal", 1.0, (0.6, 1.6), (0.0, 0.5)),
            Self::Rests => moves("minimum_jerk", 1.0, (0.6, 1.6), (1.0, 20.0)),
            Self::Creeping => moves("trapezoidal", 0.3, (10.0, 30.0), (0.0, 1.0)),
            Self::Multisine => sines(seed),
            Self::Tiny => {
                let reach = 0.01 + 0.04 * spread(seed, 0);
                vec![
                    "plant.setpoint.kind=\"random_sines\"".to_owned(),
                    format!("plant.setpoint.random_sines.amplitude_rad=[{reach:?}, {reach:?}]"),
                ]
            }
        }
    }
}

/// Six sines of joint 1, six others of joint 2.
fn sines(seed: u64) -> Vec<String> {
    let base = [0.23, 0.43, 0.81, 1.51, 2.83, 5.3f64];
    let size = |frequency: f64| frequency.powf(-0.25);
    let total: f64 = base.iter().copied().map(size).sum();
    let lists = |value: &dyn Fn(usize, usize) -> f64| {
        let list = |joint: usize| (0..base.len()).map(|k| value(joint, k)).collect::<Vec<f64>>();
        format!("[{:?}, {:?}]", list(0), list(1))
    };
    let reach = [1.0, 0.8];
    vec![
        "plant.setpoint.kind=\"sines\"".to_owned(),
        // the joints share no frequency
        format!(
            "plant.setpoint.sines.frequency_hz={}",
            lists(&|joint, k| base[k] * (1.0 + 0.07 * joint as f64))
        ),
        format!(
            "plant.setpoint.sines.amplitude_rad={}",
            lists(&|joint, k| reach[joint] * size(base[k]) / total)
        ),
        format!(
            "plant.setpoint.sines.phase_rad={}",
            lists(&|joint, k| std::f64::consts::TAU * spread(seed, 1 + 7 * k as u64 + 5 * joint as u64))
        ),
    ]
}

/// A number in [0, 1) that seed and place choose: the fractions of multiples of the golden section cover the range evenly.
pub(super) fn spread(seed: u64, place: u64) -> f64 {
    ((13 * seed + place + 1) as f64 * 0.618_033_988_75).fract()
}

/// A trial of an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrialSpec {
    /// The machine.
    pub arm: Arm,
    /// What it follows.
    pub motion: Motion,
    /// Bits of the encoders.
    pub bits: u32,
    /// Sample period \[µs\].
    pub period_us: u32,
    /// Standard deviation of the noise on the measured voltage \[V\].
    pub noise_v: f64,
    /// What is wrong.
    pub disturbance: Disturbance,
    /// Number of blocks.
    pub blocks: u64,
    /// Seed of everything random.
    pub seed: u64,
}

impl TrialSpec {
    /// N of the trials, as in `config/encoder_only.toml`.
    pub const BLOCK_LEN: u64 = 1900;

    /// The default run: the paper's arm, steps, 16 bits, 1 ms, 0.05 V; 60 blocks.
    pub fn new(motion: Motion, seed: u64) -> Self {
        Self {
            arm: Arm::Paper,
            motion,
            bits: 16,
            period_us: 1000,
            noise_v: 0.05,
            disturbance: Disturbance::None,
            blocks: 60,
            seed,
        }
    }

    /// Words that name the case, without its seed; filters look for them.
    pub fn words(&self) -> Vec<String> {
        vec![
            self.motion.name().to_owned(),
            self.arm.name().to_owned(),
            format!("{}bit", self.bits),
            format!("{}ms", f64::from(self.period_us) / 1000.0),
            self.disturbance.name(),
        ]
    }

    /// Sample period \[s\].
    pub fn period_s(&self) -> f64 {
        f64::from(self.period_us) * 1e-6
    }

    /// Beginning of the block in the middle of the run \[s\].
    pub fn middle_s(&self) -> f64 {
        (self.blocks / 2 * Self::BLOCK_LEN) as f64 * self.period_s()
    }

    /// When the payload changes \[s\]: in the block in the middle, at a place that the seed chooses.
    pub fn change_s(&self) -> f64 {
        let samples = self.disturbance.place_of_change(spread(self.seed, 99), self.period_s()) * Self::BLOCK_LEN as f64;
        self.middle_s() + samples.round() * self.period_s()
    }

    /// Start values, a factor of 2.5 off, up and down in turn, as in `config/encoder_only.toml`.
    pub fn start(&self) -> Vec<f64> {
        let theta = self.arm.parameters().with_mass_2(self.arm.masses_kg().0).theta();
        let factors = [2.5, 0.4].into_iter().cycle();
        theta
            .iter()
            .zip(factors)
            .map(|(value, factor)| value * factor)
            .collect()
    }

    /// What the configuration `encoder_only` has to be overridden with, as `section.key=value`.
    pub fn settings(&self) -> Vec<String> {
        let arm = self.arm.parameters();
        let (first_kg, then_kg) = self.arm.masses_kg();
        let then_kg = self.disturbance.mass_after(first_kg, then_kg);
        let (kp, kd) = self.arm.gains(self.period_us);
        let period_s = self.period_s();
        let resolution = std::f64::consts::TAU / f64::from(self.bits).exp2();
        let known = [
            ("winding_resistance_ohm", arm.winding_resistance_ohm),
            ("torque_constant_n_m_per_a", arm.torque_constant_n_m_per_a),
        ];
        let motors = [
            ("winding_inductance_h", arm.winding_inductance_h),
            ("back_emf_constant_v_s_per_rad", arm.back_emf_constant_v_s_per_rad),
        ];
        let mut settings = vec![
            format!("plant.seed={}", self.seed),
            format!("plant.sample_period_s={period_s:?}"),
            format!(
                "plant.duration_s={:?}",
                (self.blocks * Self::BLOCK_LEN) as f64 * period_s
            ),
            format!("plant.mass_2.t_s=[0.0, {:?}]", self.change_s()),
            format!("plant.mass_2.mass_kg=[{first_kg:?}, {then_kg:?}]"),
            format!("plant.sensors.encoder_bits={}", self.bits),
            format!("plant.sensors.input_noise_v={:?}", self.noise_v),
            format!("identifier.projected.position_resolution=[{resolution:?}]"),
            format!("identifier.projected.input_noise=[{:?}]", self.noise_v),
            format!("estimator.block_len={}", Self::BLOCK_LEN),
            format!("estimator.theta_start={:?}", self.start()),
            format!("plant.controller.proportional_gain_v_per_rad={kp:?}"),
            format!("plant.controller.derivative_gain_v_s_per_rad={kd:?}"),
            format!("plant.arm.length_1_m={:?}", arm.length_1_m),
            format!("plant.arm.mass_1_kg={:?}", arm.mass_1_kg),
            format!("plant.arm.length_2_m={:?}", arm.length_2_m),
            format!("model.known.length_1_m={:?}", arm.length_1_m),
        ];
        settings.extend(
            known
                .iter()
                .map(|(key, values)| format!("model.known.{key}={values:?}")),
        );
        let motors = known.iter().chain(&motors);
        settings.extend(motors.map(|(key, values)| format!("plant.arm.{key}={values:?}")));
        settings.extend(self.motion.settings(self.seed));
        settings.extend(self.disturbance.settings(self));
        settings
    }
}
