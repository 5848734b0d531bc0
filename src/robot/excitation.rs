//! Motions that are as informative as possible about a robot, within the limits of its joints.
//!
//! ```text
//! q_j(t) = c_j + α_j Σ_k [a_jk sin kωt + b_jk cos kωt],   ω = 2π/T,   k = 1 … H              (1)
//! Σ_k k a_jk = 0,   Σ_k k² b_jk = 0                       q̇ = q̈ = 0 at t = 0 and T           (2)
//! α_j: the largest with q_j, q̇_j and q̈_j within the limits of joint j                       (3)
//! max |s| ≤ max_i |s(t_i)| / cos(π H/M)            s of degree H at M instants t_i of a period (4)
//! maximise ½ ln det Λ                                     Λ of prediction                     (5)
//! ```
//!
//! A period begins and ends at rest in the same posture, so a controller can repeat it. (4) makes
//! the limits hold between the instants too. (5) is D-optimality: unlike the condition number, it
//! does not depend on the units of the parameters, and it includes prior knowledge. It has many
//! maxima of nearly the same height; the best of several random motions is improved by random steps
//! that grow after a success and shrink after failures.
//!
//! Sources: J. Swevers et al., IEEE Trans. Robotics and Automation 13 (1997), on (1) and (5); K.
//! Park, Robotica 24 (2006), on (2); H. Ehlich, K. Zeller, Math. Zeitschrift 86 (1964), on (4); I.
//! Rechenberg, *Evolutionsstrategie* (1973), on the length of the steps.

use super::dynamics::inverse_dynamics;
use super::error::MotionError;
use super::motion_table::MotionTable;
use super::prediction::Forecaster;
use super::state::{RobotSample, Setpoint};
use super::tree::Robot;
use crate::model::MAX_JOINTS;
use crate::random::Random;
use std::f64::consts::{PI, TAU};

/// Largest number of harmonics of an excitation.
pub const MAX_EXCITATION_HARMONICS: usize = 50;
/// Instants per period of the highest harmonic at which limits are checked: M/H of (4).
const LOOKS: usize = 40;
/// One in so many tries is drawn at random; the others improve the best one.
const DRAWN: usize = 8;
/// Length of a step relative to the shape: initial, smallest and largest.
const STEP: (f64, f64, f64) = (0.3, 0.02, 1.0);
/// Factors on the step length after a success and after a failure: in equilibrium one step in five
/// succeeds.
const SUCCESS: f64 = 1.5;
const FAILURE: f64 = 0.903_6;
/// Cost of a torque above its limit, per share of the limit \[nat\].
const OVERLOAD: f64 = 1e3;
/// Range of a joint without limits, on either side \[rad or m\], and its speed.
const UNLIMITED: (f64, f64) = (3.0, 2.0);

/// Limits of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointRange {
    /// Lowest position \[rad or m\].
    pub lower: f64,
    /// Highest position \[rad or m\], above the lowest.
    pub upper: f64,
    /// Largest speed \[rad/s or m/s\], > 0.
    pub velocity: f64,
    /// Largest acceleration \[rad/s² or m/s²\], > 0.
    pub acceleration: f64,
    /// Largest torque or force that the URDF's bodies may require \[N m or N\], > 0; infinite for
    /// no limit.
    pub effort: f64,
}

impl JointRange {
    /// The share `part` of the URDF's limits, at most `reach` \[rad or m\] on either side of the
    /// middle.
    pub fn of(robot: &Robot, part: f64, reach: f64, acceleration: f64) -> Vec<Self> {
        let range = |joint: &super::tree::RobotJoint| {
            let lower = joint.limits.lower.unwrap_or(-UNLIMITED.0);
            let upper = joint.limits.upper.unwrap_or(UNLIMITED.0);
            let middle = 0.5 * (lower + upper);
            let half = (0.5 * part * (upper - lower)).min(reach);
            Self {
                lower: middle - half,
                upper: middle + half,
                velocity: part * joint.limits.velocity.filter(|x| *x > 0.0).unwrap_or(UNLIMITED.1),
                acceleration,
                effort: joint
                    .limits
                    .effort
                    .filter(|x| *x > 0.0)
                    .map_or(f64::INFINITY, |x| part * x),
            }
        };
        robot.joints.iter().map(range).collect()
    }

    /// Checks the limits of the joint of this name.
    fn validate(&self, joint: &str) -> Result<(), MotionError> {
        let joint = || joint.to_owned();
        if !(self.lower.is_finite() && self.upper.is_finite() && self.lower < self.upper) {
            return Err(MotionError::Empty {
                joint: joint(),
                lower: self.lower,
                upper: self.upper,
            });
        }
        let above_0 = [
            ("velocity", self.velocity, self.velocity.is_finite()),
            ("acceleration", self.acceleration, self.acceleration.is_finite()),
            ("effort", self.effort, true),
        ];
        match above_0
            .into_iter()
            .find(|(_, x, is_allowed)| !(*x > 0.0 && *is_allowed))
        {
            None => Ok(()),
            Some((name, got, _)) => Err(MotionError::Limit {
                joint: joint(),
                name,
                got,
            }),
        }
    }
}

/// Options of the design of a motion. The same options give the same motion, bit for bit.
#[derive(Debug, Clone, PartialEq)]
pub struct ExcitationOptions {
    /// T \[s\], 1 to 600.
    pub duration_s: f64,
    /// H, 2 to [`MAX_EXCITATION_HARMONICS`].
    pub harmonics: usize,
    /// Number of motions to try, 1 to 1 000 000.
    pub tries: usize,
    /// Seed of the random motions.
    pub seed: u64,
    /// Limits of each joint.
    pub ranges: Vec<JointRange>,
}

impl ExcitationOptions {
    /// 30 s of 12 harmonics, the best of 2000 tries.
    pub fn new(ranges: Vec<JointRange>) -> Self {
        Self {
            duration_s: 30.0,
            harmonics: 12,
            tries: 2000,
            seed: 0,
            ranges,
        }
    }

    /// Checks the numbers for a robot.
    ///
    /// # Errors
    /// The first number out of range.
    pub fn validate(&self, robot: &Robot) -> Result<(), MotionError> {
        let within = |name: &'static str, got: f64, low: f64, high: f64| match got >= low && got <= high {
            true => Ok(()),
            false => Err(MotionError::Range { name, low, high, got }),
        };
        within("duration", self.duration_s, 1.0, 600.0)?;
        within("harmonics", self.harmonics as f64, 2.0, MAX_EXCITATION_HARMONICS as f64)?;
        within("tries", self.tries as f64, 1.0, 1e6)?;
        if self.ranges.len() != robot.len() {
            return Err(MotionError::Limits {
                expected: robot.len(),
                got: self.ranges.len(),
            });
        }
        for (joint, range) in robot.joints.iter().zip(&self.ranges) {
            range.validate(&joint.name)?;
        }
        Ok(())
    }
}

/// A motion (1) with its figures.
#[derive(Debug, Clone)]
pub struct Excitation {
    /// T \[s\].
    pub duration_s: f64,
    /// ½ ln det Λ − ½ ln det Λ₀ \[nat\].
    pub gain: f64,
    /// The same for the median of the random motions.
    pub random_gain: f64,
    /// Largest torque or force that the URDF's bodies require, without friction \[N m or N\].
    pub effort: Vec<f64>,
    joints: Vec<Series>,
}

/// (1) of a joint.
#[derive(Debug, Clone, PartialEq)]
struct Series {
    /// Position of the curve's middle within the range that its limits leave, 0 to 1.
    place: f64,
    /// a_k and b_k of the shape, which (3) scales.
    tones: Vec<[f64; 2]>,
    /// c and α.
    center: f64,
    scale: f64,
}

impl Series {
    /// A random shape: amplitudes fall with the harmonic's number.
    fn draw(harmonics: usize, random: &mut Random) -> Self {
        let mut series = Self {
            place: random.uniform(),
            tones: (1..=harmonics)
                .map(|k| [random.normal() / k as f64, random.normal() / k as f64])
                .collect(),
            center: 0.0,
            scale: 1.0,
        };
        series.enforce_rest();
        series
    }

    /// The nearest shape with (2), of size 1.
    fn enforce_rest(&mut self) {
        let k = |i: usize| (i + 1) as f64;
        let sums = |power: i32, part: usize| -> f64 {
            let along: f64 = self
                .tones
                .iter()
                .enumerate()
                .map(|(i, x)| k(i).powi(power) * x[part])
                .sum();
            along / (0..self.tones.len()).map(|i| k(i).powi(2 * power)).sum::<f64>()
        };
        let (a, b) = (sums(1, 0), sums(2, 1));
        for (i, tone) in self.tones.iter_mut().enumerate() {
            tone[0] -= a * k(i); // (2)
            tone[1] -= b * k(i).powi(2);
        }
        let size = self
            .tones
            .iter()
            .flatten()
            .map(|x| x * x)
            .sum::<f64>()
            .sqrt()
            .max(1e-12);
        self.tones.iter_mut().flatten().for_each(|x| *x /= size);
    }

    /// A random step away.
    fn step(&mut self, length: f64, random: &mut Random) {
        let part = length / (2.0 * self.tones.len() as f64).sqrt();
        for tone in self.tones.iter_mut().flatten() {
            *tone += part * random.normal();
        }
        self.place = (self.place + length * random.normal()).clamp(0.0, 1.0);
        self.enforce_rest();
    }

    /// Σ_k [a_k sin kωt + b_k cos kωt] with its derivatives, at a part of the period.
    fn shape(&self, part: f64, duration_s: f64) -> Setpoint {
        let (sin, cos) = (TAU * part).sin_cos();
        let (mut s, mut c) = (0.0, 1.0);
        let mut sum = [0.0; 3];
        for (i, [a, b]) in self.tones.iter().enumerate() {
            (s, c) = (s * cos + c * sin, c * cos - s * sin);
            let w = TAU * (i + 1) as f64 / duration_s;
            let x = a * s + b * c;
            sum[0] += x; // (1)
            sum[1] += w * (a * c - b * s);
            sum[2] -= w * w * x;
        }
        sum
    }

    /// (3).
    fn fit(&mut self, range: &JointRange, duration_s: f64) {
        let looks = LOOKS * self.tones.len();
        let margin = (PI * self.tones.len() as f64 / looks as f64).cos(); // (4)
        let (mut low, mut high, mut speed, mut acceleration) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64, 0.0_f64);
        for look in 0..looks {
            let [x, dx, ddx] = self.shape(look as f64 / looks as f64, duration_s);
            (low, high) = (low.min(x), high.max(x));
            speed = speed.max(dx.abs());
            acceleration = acceleration.max(ddx.abs());
        }
        // The same theorem holds for the distance from the middle.
        let half = (0.5 * (high - low) / margin).max(1e-12);
        let (speed, acceleration) = ((speed / margin).max(1e-12), (acceleration / margin).max(1e-12));
        let room = 0.5 * (range.upper - range.lower);
        self.scale = (room / half)
            .min(range.velocity / speed)
            .min(range.acceleration / acceleration); // (3)
        let free = (room - self.scale * half).max(0.0);
        let middle = 0.5 * (range.upper + range.lower) + free * (2.0 * self.place - 1.0);
        self.center = middle - self.scale * 0.5 * (high + low);
    }

    fn at(&self, part: f64, duration_s: f64) -> Setpoint {
        let [x, dx, ddx] = self.shape(part, duration_s);
        [self.center + self.scale * x, self.scale * dx, self.scale * ddx] // (1)
    }
}

impl Excitation {
    /// Designs a motion for the model, with the misfit of a forecaster. `go_on` is called with the
    /// number of motions tried; the search ends if it returns false.
    ///
    /// # Errors
    /// If options are out of range, or no motion satisfies the torque limits.
    pub fn design(
        forecaster: &mut Forecaster,
        options: &ExcitationOptions,
        go_on: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Self, MotionError> {
        options.validate(forecaster.model().robot())?;
        let mut random = Random(options.seed ^ 0x0065_7863_6974_6521);
        let drawn = (options.tries / DRAWN).max(1);
        let mut best: Option<(f64, Self)> = None;
        let mut gains = Vec::with_capacity(drawn);
        let mut length = STEP.0;
        for tries in 0..options.tries {
            if !go_on(tries) && best.is_some() {
                break;
            }
            let joints = match &best {
                Some((_, best)) if tries >= drawn => best.varied(length, &mut random),
                _ => (0..options.ranges.len())
                    .map(|_| Series::draw(options.harmonics, &mut random))
                    .collect(),
            };
            let Some((value, motion)) = Self::evaluate(forecaster, options, joints) else {
                continue;
            };
            if tries < drawn {
                gains.push(motion.gain);
            }
            let is_better = best.as_ref().is_none_or(|(before, _)| value > *before);
            if tries >= drawn {
                let factor = if is_better { SUCCESS } else { FAILURE };
                length = (length * factor).clamp(STEP.1, STEP.2);
            }
            if is_better {
                best = Some((value, motion));
            }
        }
        let Some((_, mut motion)) = best else {
            return Err(MotionError::NoRows);
        };
        gains.sort_by(f64::total_cmp);
        motion.random_gain = gains.get(gains.len() / 2).copied().unwrap_or(motion.gain);
        let joints = &forecaster.model().robot().joints;
        for ((joint, range), effort) in joints.iter().zip(&options.ranges).zip(&motion.effort) {
            if *effort > range.effort {
                return Err(MotionError::Effort {
                    joint: joint.name.clone(),
                    limit: range.effort,
                    got: *effort,
                });
            }
        }
        Ok(motion)
    }

    /// The shapes with a change of one joint, and sometimes of others: small changes succeed more
    /// often.
    fn varied(&self, length: f64, random: &mut Random) -> Vec<Series> {
        let mut joints = self.joints.clone();
        let sure = (random.uniform() * joints.len() as f64) as usize;
        for (i, series) in joints.iter_mut().enumerate() {
            if i == sure || random.uniform() < 0.3 {
                series.step(length, random);
            }
        }
        joints
    }

    /// The motion of these shapes with (5), and its score.
    fn evaluate(
        forecaster: &mut Forecaster,
        options: &ExcitationOptions,
        mut joints: Vec<Series>,
    ) -> Option<(f64, Self)> {
        let duration_s = options.duration_s;
        for (series, range) in joints.iter_mut().zip(&options.ranges) {
            series.fit(range, duration_s);
        }
        let mut motion = Self {
            duration_s,
            gain: 0.0,
            random_gain: 0.0,
            effort: Vec::new(),
            joints,
        };
        let count = (duration_s / forecaster.step_s()).ceil();
        let step = duration_s / count;
        let n = motion.joints.len();
        let mut effort = [0.0_f64; MAX_JOINTS];
        let robot = forecaster.model().robot().clone();
        forecaster.sample_motion((0..=count as usize).map(|k| {
            let mut sample = RobotSample {
                t_s: step * k as f64,
                ..RobotSample::default()
            };
            let (mut ddq, mut tau) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
            for (i, series) in motion.joints.iter().enumerate() {
                [sample.q[i], sample.dq[i], ddq[i]] = series.at(k as f64 / count, duration_s);
            }
            let (q, dq) = (&sample.q[..n], &sample.dq[..n]);
            inverse_dynamics(&robot, &robot.bodies, q, dq, &ddq[..n], &mut tau[..n]);
            for (most, tau) in effort.iter_mut().zip(tau) {
                *most = most.max(tau.abs());
            }
            sample
        }));
        motion.effort = effort[..n].to_vec();
        motion.gain = forecaster.gain()?;
        let overload: f64 = motion
            .effort
            .iter()
            .zip(&options.ranges)
            .map(|(effort, range)| (effort / range.effort - 1.0).max(0.0))
            .sum();
        Some((motion.gain - OVERLOAD * overload, motion))
    }

    /// Setpoints of all joints at a time \[s\]; the motion repeats.
    pub fn at(&self, t_s: f64) -> [Setpoint; MAX_JOINTS] {
        let mut setpoints = [[0.0; 3]; MAX_JOINTS];
        let part = (t_s / self.duration_s).fract();
        for (setpoint, series) in setpoints.iter_mut().zip(&self.joints) {
            *setpoint = series.at(part, self.duration_s); // (1)
        }
        setpoints
    }

    /// One period as a table with a point every `step_s` or slightly less \[s\].
    ///
    /// # Errors
    /// If the step is not above 0 or is longer than a tenth of the period.
    pub fn table(&self, step_s: f64) -> Result<MotionTable, MotionError> {
        if !(step_s >= 1e-5 && step_s <= 0.1 * self.duration_s) {
            return Err(MotionError::Step {
                most_s: 0.1 * self.duration_s,
                got_s: step_s,
            });
        }
        let count = (self.duration_s / step_s).ceil() as usize;
        let times: Vec<f64> = (0..=count).map(|k| self.duration_s * k as f64 / count as f64).collect();
        let positions: Vec<[f64; MAX_JOINTS]> = times
            .iter()
            .map(|t_s| self.at(*t_s).map(|setpoint| setpoint[0]))
            .collect();
        MotionTable::new(self.joints.len(), &times, &positions)
    }
}
