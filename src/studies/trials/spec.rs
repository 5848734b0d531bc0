//! A trial of an arm: machine, motion, sensors, disturbance, seed.

use super::disturbance::Disturbance;
use super::drawn_arm::DrawnArm;
use super::spread::spread;
use crate::sim::ArmParameters;

/// An arm with its payload and the gains of its controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arm {
    /// The paper's: links of 100 and 150 kg, 170 kg after the change.
    Paper,
    /// Links of 0.6 m and 60 kg, 0.8 m and 80 kg, 95 kg after the change; two different motors.
    Unequal,
    /// Links of 0.35 m and 0.5 m of 20 kg, 23 kg after the change; small geared motors with
    /// electrical time constants of 4 ms instead of 100 ms.
    Small,
    /// One that this seed draws.
    Random(u64),
}

impl Arm {
    /// Every arm with a name of its own.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Unequal, Self::Small];

    /// Name in tables and filters.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Unequal => "unequal",
            Self::Small => "small",
            Self::Random(_) => "random_arm",
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
            Self::Random(seed) => DrawnArm::new(seed).parameters,
        }
    }

    /// Mass of link 2 before and after the payload changes \[kg\].
    pub fn masses_kg(self) -> (f64, f64) {
        match self {
            Self::Paper => (150.0, 170.0),
            Self::Unequal => (80.0, 95.0),
            Self::Small => (20.0, 23.0),
            Self::Random(seed) => DrawnArm::new(seed).masses_kg,
        }
    }

    /// Gains K_p \[V/rad\] and K_d \[V s/rad\] at a sample period.
    ///
    /// The loop L J/k q⃛ + (R J/k − K_d Δ/2) q̈ + (k + K_d) q̇ + K_p q is stable if (R J/k − K_d
    /// Δ/2)(k + K_d) > K_p L J/k. With the paper's gains the lower joint is unstable at 2 ms with
    /// the arm raised, so there they are smaller.
    pub fn gains(self, period_us: u32) -> ([f64; 2], [f64; 2]) {
        match self {
            Self::Paper if period_us <= 1000 => ([191.304; 2], [31.6957; 2]),
            Self::Paper => ([120.0; 2], [12.0; 2]),
            Self::Unequal => ([120.0, 150.0], [12.0, 12.0]),
            Self::Small => ([60.0, 80.0], [4.0, 5.0]),
            Self::Random(seed) => DrawnArm::new(seed).gains(1e-6 * f64::from(period_us)),
        }
    }
}

/// Motion of the arm, |q₁| ≤ 1 rad and |q₂| ≤ 0.8 rad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Random levels, each for 1 to 3 s.
    Steps,
    /// Minimum-jerk moves of 0.6 to 1.6 s, rests up to 0.5 s.
    MinimumJerk,
    /// The same moves with a trapezoid of the speed.
    Trapezoidal,
    /// Six sines from 0.23 to 5.3 Hz with slowly falling amplitudes and phases from the seed.
    Multisine,
    /// Minimum-jerk moves and rests of 1 to 20 s.
    Rests,
    /// Moves of 10 to 30 s within 0.3 rad.
    Creeping,
    /// Six sines within 0.01 to 0.05 rad, depending on the seed.
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
}

/// A trial of an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrialSpec {
    /// The machine.
    pub arm: Arm,
    /// The motion.
    pub motion: Motion,
    /// Bits of the encoders.
    pub bits: u32,
    /// Sample period \[µs\].
    pub period_us: u32,
    /// Standard deviation of the noise on the measured voltage \[V\].
    pub noise_v: f64,
    /// The disturbance.
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

    /// The same with another disturbance.
    #[must_use]
    pub fn disturbed(self, disturbance: Disturbance) -> Self {
        Self { disturbance, ..self }
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

    /// When the payload changes \[s\]: in the middle block, at a position chosen by the seed.
    pub fn change_s(&self) -> f64 {
        let block_len = Self::BLOCK_LEN as f64;
        let place = self
            .disturbance
            .place_of_change(spread(self.seed, 99), block_len * self.period_s());
        let samples = place * block_len;
        self.middle_s() + samples.round() * self.period_s()
    }

    /// Start values, alternately too large and too small by a factor of 2.5, as in
    /// `config/encoder_only.toml`.
    pub fn start(&self) -> Vec<f64> {
        let theta = self.arm.parameters().with_mass_2(self.arm.masses_kg().0).theta();
        let factors = [2.5, 0.4].into_iter().cycle();
        theta
            .iter()
            .zip(factors)
            .map(|(value, factor)| value * factor)
            .collect()
    }
}
