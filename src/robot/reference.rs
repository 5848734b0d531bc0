//! Reference motions of a simulated robot: smooth, within the limits of its joints, drawn from a
//! seed.
//!
//! ```text
//! Fourier:  q_r = q₀ + ρ(t) Σ_k a_k sin(2π k t/T + φ_k),   ρ(t) = 10 x³ − 15 x⁴ + 6 x⁵, x = t/t_ρ up to 1          (1)
//! moves:    q_r = q_a + (q_b − q_a) ρ(t), all joints at the same time, then a rest              (2)
//! table:    a given motion, see `motion_table`; it has its own limits
//! ```
//!
//! Amplitudes are scaled so that position, speed and acceleration stay within the given part of the
//! limits. The polynomial begins and ends with zero speed and acceleration: T. Flash, N. Hogan, J.
//! of Neuroscience 5 (1985).

use super::error::MotionError;
use super::motion_table::MotionTable;
use super::state::Setpoint;
use super::tree::Robot;
use crate::model::MAX_JOINTS;
use crate::random::Random;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Largest number of harmonics of a Fourier motion.
pub const MAX_HARMONICS: usize = 16;
/// Time in which a Fourier motion grows to its full size \[s\].
const GROWTH_S: f64 = 3.0;
/// Instants per harmonic's period at which limits are checked.
const LOOKS: usize = 40;
/// A peak between two instants is larger by up to (π/40)²/2.
const BETWEEN_LOOKS: f64 = 0.99;
/// Range of a joint without limits, on either side \[rad or m\].
const UNLIMITED: f64 = 3.0;
/// Speed of a joint without a limit \[rad/s or m/s\].
const UNLIMITED_SPEED: f64 = 2.0;

/// Kinds of reference motions.
#[derive(Debug, Clone, PartialEq)]
pub enum Motions {
    /// Not at all.
    Rest,
    /// A sum of harmonics, different at each joint.
    Fourier {
        /// Number of harmonics, 1 to [`MAX_HARMONICS`].
        harmonics: usize,
        /// Period of the first \[s\], > 0.
        period_s: f64,
    },
    /// From one posture to the next, with a rest at each.
    Moves {
        /// Duration of the rest \[s\], ≥ 0.
        rest_s: f64,
    },
    /// From this table, regardless of the limits.
    Table(Arc<MotionTable>),
}

/// Limits of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Used share of the limits of position and speed, in (0, 1].
    pub part: f64,
    /// Largest distance from the middle of a joint's range \[rad or m\], > 0.
    pub reach: f64,
    /// Largest acceleration \[rad/s² or m/s²\], > 0.
    pub acceleration: f64,
}

impl Default for MotionLimits {
    /// 80 % of the limits, at most 1.2 rad from the middle, 4 rad/s².
    fn default() -> Self {
        Self {
            part: 0.8,
            reach: 1.2,
            acceleration: 4.0,
        }
    }
}

/// A running motion, to be evaluated at increasing times.
#[derive(Debug, Clone)]
pub struct Reference {
    kind: Motions,
    middle: [f64; MAX_JOINTS],
    /// Largest distance from the middle, speed and acceleration.
    most: [Setpoint; MAX_JOINTS],
    joints: usize,
    /// a_k and φ_k of each joint.
    tones: Vec<[(f64, f64); MAX_HARMONICS]>,
    random: Random,
    from: [f64; MAX_JOINTS],
    to: [f64; MAX_JOINTS],
    /// Begin and length of the present move \[s\].
    leg: (f64, f64),
}

impl Reference {
    /// A motion of a robot from a seed.
    ///
    /// # Errors
    /// If a number is out of range.
    pub fn new(robot: &Robot, kind: Motions, limits: MotionLimits, seed: u64) -> Result<Self, MotionError> {
        let within = |name: &'static str, got: f64, low: f64, high: f64| match got > low && got <= high {
            true => Ok(()),
            false => Err(MotionError::Above { name, low, high, got }),
        };
        within("part of the limits", limits.part, 0.0, 1.0)?;
        within("reach", limits.reach, 0.0, 100.0)?;
        within("acceleration", limits.acceleration, 0.0, 1e4)?;
        match kind {
            Motions::Rest => {}
            Motions::Table(ref table) if table.joints() != robot.len() => {
                return Err(MotionError::Joints {
                    expected: robot.len(),
                    got: table.joints(),
                });
            }
            Motions::Table(_) => {}
            Motions::Fourier { harmonics, period_s } => {
                if !(1..=MAX_HARMONICS).contains(&harmonics) {
                    return Err(MotionError::Harmonics {
                        most: MAX_HARMONICS,
                        got: harmonics,
                    });
                }
                within("period", period_s, 0.0, 1e4)?;
            }
            Motions::Moves { rest_s } => within("rest", rest_s + 1e-9, 0.0, 1e4)?,
        }
        let mut reference = Self {
            kind,
            middle: [0.0; MAX_JOINTS],
            most: [[0.0; 3]; MAX_JOINTS],
            joints: robot.len(),
            tones: Vec::new(),
            random: Random(seed ^ 0x7265_6665_7265_6e63),
            from: [0.0; MAX_JOINTS],
            to: [0.0; MAX_JOINTS],
            leg: (0.0, 0.0),
        };
        for (i, joint) in robot.joints.iter().enumerate() {
            let lower = joint.limits.lower.unwrap_or(-UNLIMITED);
            let upper = joint.limits.upper.unwrap_or(UNLIMITED);
            reference.middle[i] = 0.5 * (lower + upper);
            reference.most[i] = [
                (0.5 * limits.part * (upper - lower)).min(limits.reach),
                // 0 means not stated, as in a designed motion
                limits.part
                    * joint
                        .limits
                        .velocity
                        .filter(|speed| *speed > 0.0)
                        .unwrap_or(UNLIMITED_SPEED),
                limits.acceleration,
            ];
        }
        if let Motions::Table(table) = &reference.kind {
            reference.middle = table.start();
        }
        (reference.from, reference.to) = (reference.middle, reference.middle);
        if let Motions::Fourier { harmonics, period_s } = reference.kind {
            for i in 0..robot.len() {
                let tones = reference.draw(i, harmonics, period_s);
                reference.tones.push(tones);
            }
        }
        Ok(reference)
    }

    /// The harmonics of a joint, as large as its limits allow.
    fn draw(&mut self, joint: usize, harmonics: usize, period_s: f64) -> [(f64, f64); MAX_HARMONICS] {
        let mut tones = [(0.0, 0.0); MAX_HARMONICS];
        for (k, tone) in tones.iter_mut().take(harmonics).enumerate() {
            let size = (0.5 + self.random.uniform()) / (k + 1) as f64;
            *tone = (size, TAU * self.random.uniform());
        }
        let mut largest = [0.0_f64; 3];
        let looks = LOOKS * harmonics;
        for look in 0..2 * looks {
            // Once while it grows, once through the whole period.
            let part = (look % looks) as f64 / looks as f64;
            let setpoint = match look < looks {
                true => grown(&tones, period_s, GROWTH_S * part),
                false => sum(&tones, period_s, period_s * part),
            };
            for (largest, x) in largest.iter_mut().zip(setpoint) {
                *largest = largest.max(x.abs());
            }
        }
        let scale = (0..3)
            .map(|d| self.most[joint][d] / largest[d].max(1e-12))
            .fold(f64::INFINITY, f64::min);
        tones.iter_mut().for_each(|tone| tone.0 *= BETWEEN_LOOKS * scale);
        tones
    }

    /// The posture that the motion begins at.
    pub fn start(&self) -> [f64; MAX_JOINTS] {
        self.middle
    }

    /// Setpoints of all joints at a time \[s\]; times must not decrease.
    pub fn at(&mut self, t_s: f64) -> [Setpoint; MAX_JOINTS] {
        let mut setpoints = [[0.0; 3]; MAX_JOINTS];
        match &self.kind {
            Motions::Table(table) => return table.at(t_s),
            Motions::Rest => (0..self.joints).for_each(|i| setpoints[i][0] = self.middle[i]),
            &Motions::Fourier { period_s, .. } => {
                for i in 0..self.joints {
                    let [q, dq, ddq] = grown(&self.tones[i], period_s, t_s);
                    setpoints[i] = [self.middle[i] + q, dq, ddq]; // (1)
                }
            }
            &Motions::Moves { rest_s } => {
                while t_s >= self.leg.0 + self.leg.1 + rest_s {
                    self.next_leg(rest_s);
                }
                let [r, dr, ddr] = smooth(t_s - self.leg.0, self.leg.1);
                for i in 0..self.joints {
                    let way = self.to[i] - self.from[i];
                    setpoints[i] = [self.from[i] + way * r, way * dr, way * ddr]; // (2)
                }
            }
        }
        setpoints
    }

    /// The next posture, and the time to reach it.
    fn next_leg(&mut self, rest_s: f64) {
        // Largest speed and acceleration of (2) for unit distance and time: 15/8, 10/√3.
        const SPEED: f64 = 1.875;
        const ACCELERATION: f64 = 5.7736;
        let mut length = 0.2_f64;
        self.from = self.to;
        for i in 0..self.joints {
            let [reach, speed, acceleration] = self.most[i];
            self.to[i] = self.middle[i] + self.random.within(reach);
            let way = (self.to[i] - self.from[i]).abs();
            length = length
                .max(SPEED * way / speed)
                .max((ACCELERATION * way / acceleration).sqrt());
        }
        self.leg = (self.leg.0 + self.leg.1 + rest_s, length);
    }
}

/// Σ a_k sin(2π k t/T + φ_k) with its derivatives.
fn sum(tones: &[(f64, f64)], period_s: f64, t_s: f64) -> Setpoint {
    let mut total = [0.0; 3];
    for (k, (a, phase)) in tones.iter().enumerate().filter(|(_, tone)| tone.0 != 0.0) {
        let w = TAU * (k + 1) as f64 / period_s;
        let (sin, cos) = (w * t_s + phase).sin_cos();
        total[0] += a * sin; // (1)
        total[1] += a * w * cos;
        total[2] -= a * w * w * sin;
    }
    total
}

/// The same times ρ.
fn grown(tones: &[(f64, f64)], period_s: f64, t_s: f64) -> Setpoint {
    let [r, dr, ddr] = smooth(t_s, GROWTH_S);
    let [s, ds, dds] = sum(tones, period_s, t_s);
    [r * s, dr * s + r * ds, ddr * s + 2.0 * dr * ds + r * dds] // (1)
}

/// ρ with its derivatives; 1 after `length`.
fn smooth(t_s: f64, length: f64) -> Setpoint {
    let x = if length > 0.0 { (t_s / length).max(0.0) } else { 1.0 };
    if x >= 1.0 {
        return [1.0, 0.0, 0.0];
    }
    [
        x * x * x * (10.0 + x * (6.0 * x - 15.0)), // (1)
        30.0 * (x * (1.0 - x)).powi(2) / length,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (length * length),
    ]
}
