//! What happens to the samples of a random robot.

use super::random_case::RandomRobotCase;
use super::random_machine::{LENGTH_S, RandomRobot};
use crate::model::{JointSample, MAX_JOINTS};
use crate::random::Random;
use crate::robot::PayloadChange;
use crate::studies::draw::Draw;

/// Periods of a cogging torque per turn or metre, times 2 π.
const COGGING: f64 = 24.0;
/// Time from the first to the last instant of a change \[s\].
const CHANGES_S: (f64, f64) = (20.0, 55.0);
/// Speed at which drag is stated \[rad/s or m/s\].
const SPEED: f64 = 2.0;

/// Faults of the sensors, and when something changes.
pub(super) struct RandomFaults {
    /// Largest torque of each joint.
    efforts: Vec<f64>,
    joint: usize,
    change_s: f64,
    has_change: bool,
    noise: Random,
    last: [f64; MAX_JOINTS],
    before_last: [f64; MAX_JOINTS],
    delay: f64,
    gain: f64,
    slip: f64,
    zeros: [f64; MAX_JOINTS],
    loss: f64,
    spikes: f64,
    drift_per_s: f64,
    counts: f64,
    jitter_s: f64,
    cogging: f64,
}

impl RandomFaults {
    /// Draws those of a case; terms that the model lacks are added to the machine.
    pub fn new(case: RandomRobotCase, machine: &mut RandomRobot, draw: &mut Draw) -> Self {
        let efforts = machine.robot.drive_sizes();
        let n = efforts.len();
        let (change_s, joint) = (
            draw.between(CHANGES_S.0, CHANGES_S.1),
            draw.between(0.0, n as f64) as usize,
        );
        let sign = draw.of(&[-1.0, 1.0]);
        let mut faults = Self {
            efforts,
            joint,
            change_s,
            has_change: false,
            noise: Random(machine.options.seed ^ 0xabcdef),
            last: [f64::NAN; MAX_JOINTS],
            before_last: [f64::NAN; MAX_JOINTS],
            delay: 0.0,
            gain: 1.0,
            slip: 0.0,
            zeros: [0.0; MAX_JOINTS],
            loss: 0.0,
            spikes: 0.0,
            drift_per_s: 0.0,
            counts: 0.0,
            jitter_s: 0.0,
            cogging: 0.0,
        };
        let drives = machine.options.drives.iter_mut().zip(&faults.efforts);
        match case {
            RandomRobotCase::FewTerms | RandomRobotCase::AllTerms | RandomRobotCase::MeasuredVelocities => {}
            RandomRobotCase::Payload => {
                faults.has_change = true;
                machine.options.payloads = vec![payload(machine, change_s, draw)];
            }
            RandomRobotCase::Drag => {
                drives.for_each(|(drive, effort)| drive.drag = effort * draw.between(0.0, 0.02) / (SPEED * SPEED));
            }
            RandomRobotCase::Asymmetric => {
                drives.for_each(|(drive, effort)| drive.asymmetric = effort * draw.between(-0.01, 0.01) / SPEED);
            }
            RandomRobotCase::Spring => {
                drives.for_each(|(drive, effort)| drive.spring = effort * draw.between(-0.03, 0.03));
            }
            RandomRobotCase::Cogging => faults.cogging = draw.log(0.002, 0.02),
            RandomRobotCase::Delay => {
                faults.delay = (draw.between(0.25e-3, 1.5e-3) / machine.options.sample_period_s).min(2.0);
            }
            RandomRobotCase::Zeros => faults.zeros = std::array::from_fn(|_| 0.005 * draw.0.normal()),
            RandomRobotCase::Gain => faults.gain = 1.0 + sign * draw.log(0.02, 0.3),
            RandomRobotCase::Slip => faults.slip = sign * draw.log(0.003, 0.1),
            RandomRobotCase::Loss => faults.loss = draw.log(0.001, 0.05),
            RandomRobotCase::Spikes => faults.spikes = draw.log(1e-4, 1e-2),
            RandomRobotCase::Drift => faults.drift_per_s = sign * draw.log(0.002, 0.01) / 60.0,
            RandomRobotCase::Counts => faults.counts = draw.log(0.002, 0.03),
            RandomRobotCase::Jitter => faults.jitter_s = draw.log(2e-5, 3e-4),
        }
        faults
    }

    /// True if a payload was picked up after `from_s` and not after `to_s`.
    pub fn changes_within(&self, from_s: f64, to_s: f64) -> bool {
        self.has_change && self.change_s > from_s && self.change_s <= to_s.min(LENGTH_S)
    }

    /// What has been added to the torque of a joint by this time \[N m or N\].
    pub fn offset(&self, joint: usize, t_s: f64) -> f64 {
        let sign = if joint.is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * self.efforts[joint] * self.drift_per_s * t_s
    }

    /// Changes a sample, and says when it is stamped \[ns\]; `None` if it is lost.
    pub fn disturb(&mut self, seq: u64, period_ns: u64, sample: &mut JointSample) -> Option<u64> {
        let t_s = 1e-9 * (seq * period_ns) as f64;
        let torques = sample.input;
        for joint in 0..self.efforts.len() {
            let effort = self.efforts[joint];
            sample.input[joint] = self.late(joint, torques[joint]);
            sample.input[joint] += self.cogging * effort * (COGGING * sample.q[joint]).sin();
            sample.input[joint] += self.offset(joint, t_s);
            sample.q[joint] += self.zeros[joint];
            if self.noise.uniform() < self.spikes {
                sample.input[joint] += effort * self.noise.within(2.0);
            }
            if self.counts > 0.0 {
                let step = self.counts * effort;
                sample.input[joint] = (sample.input[joint] / step).round() * step;
            }
        }
        (self.before_last, self.last) = (self.last, torques);
        if t_s >= self.change_s {
            sample.input[self.joint] *= self.gain;
            sample.q[self.joint] += self.slip;
        }
        let is_lost = self.noise.uniform() < self.loss;
        let late_ns = 1e9 * self.jitter_s * self.noise.normal().clamp(-3.0, 3.0);
        (!is_lost).then(|| (seq * period_ns).saturating_add_signed(late_ns as i64))
    }

    /// The torque of up to two samples ago, linear between samples.
    fn late(&self, joint: usize, now: f64) -> f64 {
        let or_now = |value: f64| if value.is_finite() { value } else { now };
        let (last, before_last) = (or_now(self.last[joint]), or_now(self.before_last[joint]));
        match self.delay <= 1.0 {
            true => now + self.delay * (last - now),
            false => last + (self.delay - 1.0) * (before_last - last),
        }
    }
}

/// A payload of 2 to 40 % of the robot's mass.
fn payload(machine: &RandomRobot, t_s: f64, draw: &mut Draw) -> PayloadChange {
    let robot: f64 = machine.robot.bodies.iter().map(|body| body.mass()).sum();
    let mass_kg = robot * draw.log(0.02, 0.4);
    let inertia = 1e-3 * mass_kg;
    PayloadChange {
        t_s,
        mass_kg,
        center_m: [0.02, 0.0, 0.08],
        inertia_kg_m2: [inertia, 0.0, inertia, 0.0, 0.0, inertia],
    }
}
