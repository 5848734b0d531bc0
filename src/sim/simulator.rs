//! Motors, arm and controllers put together: samples of a closed loop, one after the other.
//!
//! State x = (q₁, q₂, q̇₁, q̇₂, i₁, i₂). Derivatives of samples are not differenced but follow from the state: q̈ from (23), di/dt from
//! (17), q⃛ from d/dt (23). So they satisfy (24) to rounding, whatever the step of the integration.
//!
//! Setpoint steps and mass changes fall on sample instants: sample k is taken with the values that hold from its instant on.

use super::ArmParameters;
use super::arm::ArmDynamics;
use super::integrator::rk4_step;
use super::motor::Motor;
use super::noise::Noise;
use super::options::{ARM_JOINTS, ControllerKind, Machine, PositionFeedback, SimError, SimOptions};
use super::schedule::MassSchedule;
use super::sensors::Sensors;
use super::servo_axis::ServoAxisSimulator;
use super::setpoint::SetpointSource;
use crate::model::{JointSample, PdController};
use std::array::from_fn;

/// The closed loop as an endless iterator: sample k = 0, 1, 2, … at t = k Δ.
///
/// Nothing is allocated per sample. It ends early only where the state is no longer finite (gains that make the loop unstable).
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
    sensors: Sensors,
    state: [f64; 6],
    mass_2_kg: f64,
    dynamics: ArmDynamics,
    k: u64,
}

impl ArmSimulator {
    /// A simulator at k = 0: the arm at rest, link 2's weight held by its motor current.
    ///
    /// # Errors
    /// The options are not valid, see [`SimOptions::validate`].
    pub fn new(options: &SimOptions) -> Result<Self, SimError> {
        options.validate()?;
        let arm = options.arm;
        let mass_2_kg = options.mass_2.mass_kg(0.0);
        let dynamics = ArmDynamics::new(&arm.with_mass_2(mass_2_kg), arm.gravity_m_s2);
        let [q1, q2] = options.initial_q_rad;
        let holding_current = dynamics.holding_torque(q2) / arm.torque_constant_n_m_per_a[1];
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
            sensors: Sensors::new(options.sensors, options.seed),
            state: [q1, q2, 0.0, 0.0, 0.0, holding_current],
            mass_2_kg,
            dynamics,
            k: 0,
        })
    }

    /// Number of the next sample.
    pub fn position(&self) -> u64 {
        self.k
    }

    /// The next sample with measured positions and exact derivatives and voltages; `None` once the state is no longer finite.
    fn exact_sample(&mut self) -> Option<JointSample> {
        if self.state.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let mass_2_kg = self.mass_2.mass_kg(self.k as f64 * self.sample_period_s);
        if mass_2_kg != self.mass_2_kg {
            self.mass_2_kg = mass_2_kg;
            self.dynamics = ArmDynamics::new(&self.arm.with_mass_2(mass_2_kg), self.arm.gravity_m_s2);
        }
        for setpoint in &mut self.setpoints {
            setpoint.begin_sample(self.k);
        }

        let [q1, q2, dq1, dq2, i1, i2] = self.state;
        let (q, dq) = ([q1, q2], [dq1, dq2]);
        let setpoint: [f64; ARM_JOINTS] = from_fn(|joint| self.setpoints[joint].value(0.0));
        let [motor_1, motor_2] = &self.motors;
        let ddq = self
            .dynamics
            .accelerations(q, dq, [motor_1.torque(i1), motor_2.torque(i2)]);
        let measured_q = self.sensors.positions(q, dq, ddq);
        let seen_q = match self.feedback {
            PositionFeedback::True => q,
            PositionFeedback::Measured => measured_q,
        };
        // (13)
        let voltage: [f64; ARM_JOINTS] =
            from_fn(|joint| self.controllers[joint].voltage(setpoint[joint], seen_q[joint], dq[joint]));
        let torque_rate = [
            motor_1.torque(motor_1.current_rate(voltage[0], i1, dq1)),
            motor_2.torque(motor_2.current_rate(voltage[1], i2, dq2)),
        ];
        let dddq = self.dynamics.jerks(q, dq, ddq, torque_rate);

        let mut sample = JointSample::default();
        sample.q[..ARM_JOINTS].copy_from_slice(&measured_q);
        sample.dq[..ARM_JOINTS].copy_from_slice(&dq);
        sample.ddq[..ARM_JOINTS].copy_from_slice(&ddq);
        sample.dddq[..ARM_JOINTS].copy_from_slice(&dddq);
        sample.setpoint[..ARM_JOINTS].copy_from_slice(&setpoint);
        sample.input[..ARM_JOINTS].copy_from_slice(&voltage);
        self.integrate(voltage);
        self.k += 1;
        Some(sample)
    }

    /// Carries the state on to the next sample instant; `held` is the voltage of this instant \[V\].
    fn integrate(&mut self, held: [f64; ARM_JOINTS]) {
        let step_s = self.sample_period_s / self.substeps as f64;
        let Self {
            kind,
            controllers,
            motors: [motor_1, motor_2],
            setpoints,
            dynamics,
            ..
        } = self;
        for substep in 0..self.substeps {
            self.state = rk4_step(&self.state, step_s, |fraction, &[q1, q2, dq1, dq2, i1, i2]| {
                let [u1, u2] = match kind {
                    ControllerKind::Sampled => held,
                    ControllerKind::Analog => {
                        let at = (substep as f64 + fraction) / self.substeps as f64;
                        [
                            controllers[0].voltage(setpoints[0].value(at), q1, dq1),
                            controllers[1].voltage(setpoints[1].value(at), q2, dq2),
                        ]
                    }
                };
                let [ddq1, ddq2] =
                    dynamics.accelerations([q1, q2], [dq1, dq2], [motor_1.torque(i1), motor_2.torque(i2)]);
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

/// Whichever machine [`SimOptions`] name, as an endless iterator.
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
    /// The options are not valid, see [`SimOptions::validate`].
    pub fn new(options: &SimOptions) -> Result<Self, SimError> {
        Ok(match &options.machine {
            Machine::Arm => Self::Arm(ArmSimulator::new(options)?),
            Machine::ServoAxis(axis) => Self::ServoAxis(ServoAxisSimulator::new(options, axis)?),
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
