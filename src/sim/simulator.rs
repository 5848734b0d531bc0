//! Motors, arm and controllers combined: consecutive samples of a closed loop.
//!
//! State x = (q₁, q₂, q̇₁, q̇₂, i₁, i₂). Derivatives in samples are not differences but follow from
//! the state: q̈ from (23), di/dt from (17), q⃛ from d/dt (23). So they satisfy (24) to rounding,
//! whatever the step of the integration.
//!
//! Setpoint steps and mass changes fall on sample instants: sample k has the values that apply from
//! its instant on.

use super::ArmParameters;
use super::arm::ArmDynamics;
use super::arm_parameters::ARM_JOINTS;
use super::controller::{Commanded, ControllerKind, PositionFeedback};
use super::error::SimError;
use super::instants::SampleInstants;
use super::integrator::rk4_step;
use super::motor::Motor;
use super::noise::Noise;
use super::options::{Machine, SimOptions};
use super::schedule::MassSchedule;
use super::sensors::Sensors;
use super::servo_axis::ServoAxisSimulator;
use super::setpoint::SetpointSource;
use super::unmodelled::Unmodelled;
use crate::model::{JointSample, MAX_JOINTS, PdController};
use std::array::from_fn;

/// The closed loop as an endless iterator: sample k = 0, 1, 2, … at t = k Δ.
///
/// Nothing is allocated per sample. It ends early only if the state is no longer finite (gains
/// that make the loop unstable).
#[derive(Debug, Clone)]
pub struct ArmSimulator {
    sample_period_s: f64,
    substeps: usize,
    arm: ArmParameters,
    mass_2: MassSchedule,
    kind: ControllerKind,
    feedback: PositionFeedback,
    controllers: [PdController; ARM_JOINTS],
    motors: [Motor; ARM_JOINTS],
    setpoints: [SetpointSource; ARM_JOINTS],
    /// Added to the controllers' voltages until the next command.
    feed_forward: [f64; ARM_JOINTS],
    voltage_limit: f64,
    sensors: Sensors,
    unmodelled: Unmodelled,
    instants: SampleInstants,
    /// Offsets of this sample and the next from their places on the grid \[s\].
    offset_s: [f64; 2],
    state: [f64; 6],
    mass_2_kg: f64,
    dynamics: ArmDynamics,
    k: u64,
}

impl ArmSimulator {
    /// A simulator at k = 0: the arm at rest, link 2's weight held by its motor current.
    ///
    /// # Errors
    /// If the options are invalid, see [`SimOptions::validate`].
    pub fn new(options: &SimOptions) -> Result<Self, SimError> {
        options.validate()?;
        let arm = options.arm;
        let mass_2_kg = options.mass_2.mass_kg(0.0);
        let dynamics = options
            .unmodelled
            .mechanics(&arm.with_mass_2(mass_2_kg), arm.gravity_m_s2);
        let [q1, q2] = options.initial_q_rad;
        let holding = dynamics.holding_torques(options.initial_q_rad);
        let [i1, i2] = from_fn(|joint| holding[joint] / arm.torque_constant_n_m_per_a[joint]);
        let mut instants = SampleInstants::new(options);
        let offset_s = [instants.next_offset_ns(), instants.next_offset_ns()].map(|ns| ns as f64 * 1e-9);
        Ok(Self {
            sample_period_s: options.sample_period_s,
            substeps: options.substeps,
            arm,
            mass_2: options.mass_2.clone(),
            kind: options.controller.kind,
            feedback: options.controller.feedback,
            controllers: from_fn(|joint| PdController {
                proportional_gain_v_per_rad: options.controller.proportional_gain_v_per_rad[joint],
                derivative_gain_v_s_per_rad: options.controller.derivative_gain_v_s_per_rad[joint],
            }),
            motors: from_fn(|joint| Motor {
                winding_resistance_ohm: arm.winding_resistance_ohm[joint],
                winding_inductance_h: arm.winding_inductance_h[joint],
                torque_constant_n_m_per_a: arm.torque_constant_n_m_per_a[joint],
                back_emf_constant_v_s_per_rad: arm.back_emf_constant_v_s_per_rad[joint],
            }),
            setpoints: from_fn(|joint| {
                let noise = Noise::new(options.seed, Noise::setpoint_stream(joint));
                SetpointSource::new(&options.setpoint[joint], options.sample_period_s, noise)
            }),
            feed_forward: [0.0; ARM_JOINTS],
            voltage_limit: options.controller.voltage_limit_v,
            sensors: Sensors::new(options.sensors, options.seed),
            unmodelled: options.unmodelled,
            instants,
            offset_s,
            state: [q1, q2, 0.0, 0.0, i1, i2],
            mass_2_kg,
            dynamics,
            k: 0,
        })
    }

    /// Number of the next sample.
    pub fn position(&self) -> u64 {
        self.k
    }

    /// The next sample with measured positions and exact derivatives and voltages; `None` once the
    /// state is no longer finite.
    fn exact_sample(&mut self) -> Option<JointSample> {
        if self.state.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let mass_2_kg = self.mass_2.mass_kg(self.k as f64 * self.sample_period_s);
        if mass_2_kg != self.mass_2_kg {
            self.mass_2_kg = mass_2_kg;
            let physical = self.arm.with_mass_2(mass_2_kg);
            self.dynamics = self.unmodelled.mechanics(&physical, self.arm.gravity_m_s2);
        }
        if self.unmodelled.heating_share != 0.0 {
            let heated = self.unmodelled.resistance_factor(self.k as f64 * self.sample_period_s);
            for (motor, cold) in self.motors.iter_mut().zip(self.arm.winding_resistance_ohm) {
                motor.winding_resistance_ohm = cold * heated;
            }
        }
        for setpoint in &mut self.setpoints {
            setpoint.begin_sample(self.k);
        }

        let [q1, q2, dq1, dq2, i1, i2] = self.state;
        let (q, dq) = ([q1, q2], [dq1, dq2]);
        let now = self.offset_s[0] / self.sample_period_s;
        let setpoint: [f64; ARM_JOINTS] = from_fn(|joint| self.setpoints[joint].value(now));
        let [motor_1, motor_2] = &self.motors;
        let unmodelled = self.unmodelled.at(self.k as f64 * self.sample_period_s);
        let [(friction_1, slope_1), (friction_2, slope_2)] = unmodelled.friction(dq);
        let torque = [motor_1.torque(i1) - friction_1, motor_2.torque(i2) - friction_2];
        let ddq = self.dynamics.accelerations(q, dq, torque);
        let measured_q = self.sensors.positions(q, dq, ddq);
        let seen_q = match self.feedback {
            PositionFeedback::True => q,
            PositionFeedback::Measured => measured_q,
        };
        // (13)
        let voltage: [f64; ARM_JOINTS] =
            from_fn(|joint| self.voltage(joint, setpoint[joint], seen_q[joint], dq[joint]));
        let torque_rate = [
            motor_1.torque(motor_1.current_rate(voltage[0], i1, dq1)) - slope_1 * ddq[0],
            motor_2.torque(motor_2.current_rate(voltage[1], i2, dq2)) - slope_2 * ddq[1],
        ];
        let dddq = self.dynamics.jerks(q, dq, ddq, torque_rate);

        let mut sample = JointSample::default();
        sample.q[..ARM_JOINTS].copy_from_slice(&measured_q);
        sample.dq[..ARM_JOINTS].copy_from_slice(&dq);
        sample.ddq[..ARM_JOINTS].copy_from_slice(&ddq);
        sample.dddq[..ARM_JOINTS].copy_from_slice(&dddq);
        sample.setpoint[..ARM_JOINTS].copy_from_slice(&setpoint);
        sample.input[..ARM_JOINTS].copy_from_slice(&voltage);
        let step_s = self.integrate(voltage);
        let [q1, q2, dq1, dq2, ..] = self.state;
        self.sensors
            .advance([[q[0], dq[0]], [q[1], dq[1]]], [[q1, dq1], [q2, dq2]], step_s);
        self.offset_s = [self.offset_s[1], self.instants.next_offset_ns() as f64 * 1e-9];
        self.k += 1;
        Some(sample)
    }

    /// (13) plus the commanded feed-forward, limited by the drive.
    fn voltage(&self, joint: usize, setpoint: f64, q: f64, dq: f64) -> f64 {
        let wanted = self.controllers[joint].voltage(setpoint, q, dq) + self.feed_forward[joint];
        wanted.clamp(-self.voltage_limit, self.voltage_limit)
    }

    /// Advances the state to the next sample instant and returns the time to it \[s\]; `held` is
    /// the voltage of this instant \[V\].
    fn integrate(&mut self, held: [f64; ARM_JOINTS]) -> f64 {
        let [from, to] = self.offset_s.map(|offset_s| offset_s / self.sample_period_s);
        let length = 1.0 + to - from;
        let length_s = self.sample_period_s * length;
        let step_s = length_s / self.substeps as f64;
        let unmodelled = self.unmodelled.at(self.k as f64 * self.sample_period_s);
        let Self {
            kind,
            controllers,
            motors: [motor_1, motor_2],
            setpoints,
            dynamics,
            feed_forward,
            voltage_limit,
            ..
        } = self;
        for substep in 0..self.substeps {
            self.state = rk4_step(&self.state, step_s, |fraction, &[q1, q2, dq1, dq2, i1, i2]| {
                let [u1, u2] = match kind {
                    ControllerKind::Sampled => held,
                    ControllerKind::Analog => {
                        let at = from + length * ((substep as f64 + fraction) / self.substeps as f64);
                        let wanted = [
                            controllers[0].voltage(setpoints[0].value(at), q1, dq1) + feed_forward[0],
                            controllers[1].voltage(setpoints[1].value(at), q2, dq2) + feed_forward[1],
                        ];
                        wanted.map(|voltage| voltage.clamp(-*voltage_limit, *voltage_limit))
                    }
                };
                let [(friction_1, _), (friction_2, _)] = unmodelled.friction([dq1, dq2]);
                let torque = [motor_1.torque(i1) - friction_1, motor_2.torque(i2) - friction_2];
                let [ddq1, ddq2] = dynamics.accelerations([q1, q2], [dq1, dq2], torque);
                [
                    dq1,
                    dq2,
                    ddq1,
                    ddq2,
                    motor_1.current_rate(u1, i1, dq1),
                    motor_2.current_rate(u2, i2, dq2),
                ]
            });
        }
        length_s
    }
}

impl Iterator for ArmSimulator {
    type Item = JointSample;

    fn next(&mut self) -> Option<JointSample> {
        let mut sample = self.exact_sample()?;
        self.sensors.measure(&mut sample);
        Some(sample)
    }
}

impl Commanded for ArmSimulator {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        self.feed_forward = from_fn(|joint| feed_forward[joint]);
    }
}

impl Commanded for MachineSimulator {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        match self {
            Self::Arm(arm) => arm.command(feed_forward),
            Self::ServoAxis(axis) => axis.command(feed_forward),
        }
    }
}

/// The machine named by [`SimOptions`], as an endless iterator.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "one per process")]
pub enum MachineSimulator {
    /// The arm.
    Arm(ArmSimulator),
    /// The servo axis.
    ServoAxis(ServoAxisSimulator),
}

impl MachineSimulator {
    /// A simulator at k = 0.
    ///
    /// # Errors
    /// If the options are invalid, see [`SimOptions::validate`].
    pub fn new(options: &SimOptions) -> Result<Self, SimError> {
        Ok(match &options.machine {
            Machine::Arm => Self::Arm(ArmSimulator::new(options)?),
            Machine::ServoAxis(axis) => Self::ServoAxis(ServoAxisSimulator::new(options, axis)?),
            Machine::Plant(plant) => {
                let expected = "a machine whose equations this library has; see PlantSimulator";
                return Err(SimError::new("machine", expected, &plant.model));
            }
        })
    }
}

impl Iterator for MachineSimulator {
    type Item = JointSample;

    fn next(&mut self) -> Option<JointSample> {
        match self {
            Self::Arm(arm) => arm.next(),
            Self::ServoAxis(axis) => axis.next(),
        }
    }
}
