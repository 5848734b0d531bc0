//! Options of a simulation: plain data with units in the names, validated before use.

use super::arm_parameters::{ARM_JOINTS, ArmParameters};
use super::controller::ControllerOptions;
use super::error::{SimError, in_range, positive};
use super::fault::{Fault, FaultKind, FaultSignal};
use super::schedule::MassSchedule;
use super::sensors::SensorOptions;
use super::servo_axis_options::ServoAxisOptions;
use super::setpoint::Setpoint;
use super::unmodelled::Unmodelled;
use crate::messages::signals;
use crate::model::{MANIPULATOR_PARAMS, Manipulator, Plant, SAMPLE_PERIODS_S};

/// Longest run \[sample periods\].
const MOST_PERIODS: f64 = 1e9;

/// Which machine is simulated.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Machine {
    /// The paper's two-joint arm.
    #[default]
    Arm,
    /// One servo axis; setpoint, initial position and sensors are those of joint 1, in the unit of
    /// its motion; its controller has its own gains.
    ServoAxis(ServoAxisOptions),
    /// The machine described by the model's equations, see
    /// [`PlantSimulator`](super::PlantSimulator); joint j follows the setpoint of joint j mod 2 and
    /// starts at its initial position.
    Plant(PlantMachine),
}

/// A machine of the model's own equations.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantMachine {
    /// Name of the model.
    pub model: String,
    /// Number of joints.
    pub joints: usize,
    /// r, the order of the equations' terms.
    pub order: usize,
    /// Names of the parameters.
    pub names: Vec<String>,
    /// True θ from a time on \[s\], one value per name; times increase from 0. At least one entry.
    pub truth: Vec<(f64, Vec<f64>)>,
    /// K_p of each joint, in the input's unit per rad or m; none: chosen from the joint's inertia.
    pub proportional_gain: Vec<f64>,
    /// K_d of each joint, in the input's unit per rad/s or m/s; none: chosen from the joint's
    /// inertia.
    pub derivative_gain: Vec<f64>,
}

impl PlantMachine {
    /// True θ at time `t_s` \[s\]; `t_s` ≥ 0.
    pub fn theta(&self, t_s: f64) -> &[f64] {
        let from = self.truth.partition_point(|(from_s, _)| *from_s <= t_s);
        &self.truth[from.saturating_sub(1)].1
    }

    fn validate(&self) -> Result<(), SimError> {
        let rising = self.truth.windows(2).all(|pair| pair[0].0 < pair[1].0);
        if self.truth.first().is_none_or(|first| first.0 != 0.0) || !rising {
            let got = self.truth.iter().map(|(t_s, _)| *t_s).collect::<Vec<_>>();
            return Err(SimError::new(
                "model.t_s",
                "rising times, the first one 0",
                format!("{got:?}"),
            ));
        }
        for (_, theta) in &self.truth {
            if theta.len() != self.names.len() || theta.iter().any(|x| !x.is_finite()) {
                let expected = format!("{} finite numbers, one per parameter", self.names.len());
                return Err(SimError::new("model.theta", expected, format!("{theta:?}")));
            }
        }
        Ok(())
    }
}

/// A whole simulation. The same options give the same samples, bit for bit; a longer duration only
/// adds samples.
#[derive(Debug, Clone, PartialEq)]
pub struct SimOptions {
    /// Δ \[s\], 1e-5 to 1.
    pub sample_period_s: f64,
    /// Length \[s\], > 0: samples 0, 1, … below duration/Δ.
    pub duration_s: f64,
    /// Runge-Kutta steps per sample, 1 to 1000.
    pub substeps: usize,
    /// The machine.
    pub machine: Machine,
    /// The arm and its motors.
    pub arm: ArmParameters,
    /// m₂ over time.
    pub mass_2: MassSchedule,
    /// The PD controllers.
    pub controller: ControllerOptions,
    /// Commanded position φ_z of each joint.
    pub setpoint: [Setpoint; ARM_JOINTS],
    /// Position at t = 0 \[rad\]; the arm starts at rest, with the motor current holding its
    /// weight.
    pub initial_q_rad: [f64; ARM_JOINTS],
    /// Seed of everything random: setpoints and sensor noise have separate streams.
    pub seed: u64,
    /// Errors between the exact signals and the samples.
    pub sensors: SensorOptions,
    /// Effects of the arm beyond its equations.
    pub unmodelled: Unmodelled,
    /// Scheduled faults; see [`Faults`](super::Faults).
    pub faults: Vec<Fault>,
}

impl SimOptions {
    /// The experiment of Section 5 of the paper; details that the paper leaves open are chosen
    /// here:
    ///
    /// - **Setpoints** (Fig. 3 cannot be read from the scan): steps within |q₁|, |q₂| ≤ 1 rad, held
    ///   for 1.1 s and 1.7 s. Both are shorter than a block of 1.9 s and have no small common
    ///   multiple with it, so every block, including the first, contains steps of both joints, at
    ///   different places. They begin small and grow: data taken while θ̂ is far off are linearised
    ///   in the wrong place and stay in the information, so there should be little of them. The
    ///   levels of joint 2 have both signs, because sin q₂ (gravity's time derivative)
    ///   distinguishes θ₆ from θ₇.
    /// - **Initial state**: at rest at q = 0, with the motor holding link 2's weight.
    /// - **Sub-steps**: 4 of 0.25 ms. The fastest mode of the arm is near 90 rad/s, so one
    ///   Runge-Kutta step covers 0.02 rad of it.
    pub fn cedro2022() -> Self {
        Self {
            sample_period_s: 0.001,
            duration_s: 170.0,
            substeps: 4,
            machine: Machine::Arm,
            arm: ArmParameters::cedro2022(),
            mass_2: MassSchedule::cedro2022(),
            controller: ControllerOptions::cedro2022(),
            setpoint: [
                Setpoint::Steps {
                    levels_rad: vec![
                        0.0, 0.1, -0.1, 0.2, -0.2, 0.4, -0.4, 0.7, -0.6, 1.0, -0.5, 0.9, 0.1, -0.8, 0.5, -0.3,
                    ],
                    dwell_s: 1.1,
                    shift_s: 0.5,
                },
                Setpoint::Steps {
                    levels_rad: vec![
                        0.0, 0.1, -0.1, 0.3, -0.2, -0.5, 0.4, -0.6, 0.5, 0.9, -0.7, 0.2, 1.0, -0.3,
                    ],
                    dwell_s: 1.7,
                    shift_s: 1.5,
                },
            ],
            initial_q_rad: [0.0; ARM_JOINTS],
            seed: 0,
            sensors: SensorOptions::exact(),
            unmodelled: Unmodelled::none(),
            faults: Vec::new(),
        }
    }

    /// Name of the model that describes this machine.
    pub fn model(&self) -> &str {
        match &self.machine {
            Machine::Arm => "manipulator",
            Machine::ServoAxis(_) => "servo_axis",
            Machine::Plant(plant) => &plant.model,
        }
    }

    /// Number of the machine's joints.
    pub fn joints(&self) -> usize {
        match &self.machine {
            Machine::Arm => ARM_JOINTS,
            Machine::ServoAxis(_) => 1,
            Machine::Plant(plant) => plant.joints,
        }
    }

    /// The machine's true parameters at time `t_s` \[s\], in the order of its model; `t_s` ≥ 0.
    pub fn true_parameters(&self, t_s: f64) -> Vec<f64> {
        match &self.machine {
            Machine::Arm => self.true_theta(t_s).to_vec(),
            Machine::ServoAxis(axis) => axis.true_theta(t_s).to_vec(),
            Machine::Plant(plant) => plant.theta(t_s).to_vec(),
        }
    }

    /// The true values of parameters by name at time `t_s` \[s\], for any model; `NaN` for a name
    /// without a value in this machine. `t_s` ≥ 0.
    pub fn true_values(&self, names: &[&str], t_s: f64) -> Vec<f64> {
        let arm = Manipulator::default();
        let own: Vec<(&str, f64)> = match &self.machine {
            Machine::Arm => arm
                .parameters()
                .iter()
                .map(|p| &*p.name)
                .zip(self.true_theta(t_s))
                .collect(),
            Machine::Plant(plant) => plant
                .names
                .iter()
                .map(String::as_str)
                .zip(plant.theta(t_s).iter().copied())
                .collect(),
            Machine::ServoAxis(axis) => ["mass", "viscous_friction", "coulomb_friction", "offset"]
                .into_iter()
                .zip(axis.true_theta(t_s))
                .collect(),
        };
        let heated = self.unmodelled.resistance_factor(t_s);
        let friction = |name: &str, of: &[f64; ARM_JOINTS], factor: f64| {
            let joint = name
                .strip_prefix("coulomb_")?
                .split_once('_')?
                .1
                .parse::<usize>()
                .ok()?;
            let joint = joint.checked_sub(1).filter(|joint| *joint < ARM_JOINTS)?;
            let current = self.unmodelled.coulomb_friction_n_m[joint] / self.arm.torque_constant_n_m_per_a[joint];
            Some(factor * of[joint] * current)
        };
        let value = |name: &str| match name {
            "input_delay" => Some(self.sensors.input_delay_s),
            "offset_1" => Some(self.input_offset_v(0, t_s)),
            "offset_2" => Some(self.input_offset_v(1, t_s)),
            name if name.starts_with("coulomb_friction_") => friction(name, &self.arm.winding_resistance_ohm, heated),
            name if name.starts_with("coulomb_inductance_") => friction(name, &self.arm.winding_inductance_h, 1.0),
            _ => None,
        };
        names
            .iter()
            .map(|name| {
                let known = own.iter().find(|(own, _)| own == name).map(|(_, value)| *value);
                known.or_else(|| value(name)).unwrap_or(f64::NAN)
            })
            .collect()
    }

    /// Offset of the recorded input of a joint at time `t_s` \[s\], by faults of the kind `wrong`.
    fn input_offset_v(&self, joint: usize, t_s: f64) -> f64 {
        let faults = self.faults.iter();
        let active = faults.filter(|fault| {
            let concerns = fault.joint.is_none_or(|own| own == joint);
            fault.signal == FaultSignal::Input && concerns && (fault.from_s..fault.to_s).contains(&t_s)
        });
        active
            .filter_map(|fault| match fault.kind {
                FaultKind::Wrong { offset, .. } => Some(offset),
                _ => None,
            })
            .sum()
    }

    /// Which of a sample's [`signals`] hold data.
    pub fn signals(&self) -> u32 {
        match &self.machine {
            Machine::Arm => self.sensors.signals(),
            Machine::ServoAxis(axis) if axis.position_resolution > 0.0 => {
                signals::Q | signals::SETPOINT | signals::INPUT
            }
            Machine::ServoAxis(_) => self.sensors.signals() & !signals::DDDQ,
            Machine::Plant(plant) if plant.order < 2 => self.sensors.signals() & !signals::DDDQ,
            Machine::Plant(_) => self.sensors.signals(),
        }
    }

    /// True θ of (25) of the arm at time `t_s` \[s\]; `t_s` ≥ 0.
    pub fn true_theta(&self, t_s: f64) -> [f64; MANIPULATOR_PARAMS] {
        let mut physical = self.arm.with_mass_2(self.mass_2.mass_kg(t_s));
        let heated = self.unmodelled.resistance_factor(t_s);
        physical.winding_resistance_ohm.iter_mut().for_each(|r| *r *= heated);
        let mut theta = physical.theta();
        // the rotor of joint 1 adds to J₁ = m₁ l₁²/12, that of joint 2 to no parameter
        let rotor = 12.0 * self.unmodelled.rotor_inertia_kg_m2[0] / physical.torque_constant_n_m_per_a[0];
        theta[0] += rotor * physical.winding_inductance_h[0];
        theta[2] += rotor * physical.winding_resistance_ohm[0];
        theta
    }

    /// Number of samples: 170 s at 1 ms are samples 0 to 169 999.
    pub fn sample_count(&self) -> u64 {
        // A duration that is a whole number of periods up to rounding counts as that number.
        let periods = self.duration_s / self.sample_period_s;
        let rounded = periods.round();
        if (periods - rounded).abs() < 1e-6 {
            rounded as u64
        } else {
            periods.ceil() as u64
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        in_range(
            "sample_period_s",
            self.sample_period_s,
            SAMPLE_PERIODS_S.0,
            SAMPLE_PERIODS_S.1,
        )?;
        positive("duration_s", self.duration_s)?;
        let (shortest, longest) = (self.sample_period_s, MOST_PERIODS * self.sample_period_s);
        if !(self.duration_s >= shortest && self.duration_s <= longest) {
            let expected = format!("1 to {MOST_PERIODS:e} sample periods, {shortest} to {longest:.0} s");
            return Err(SimError::new("duration_s", expected, self.duration_s));
        }
        if !(1..=1000).contains(&self.substeps) {
            return Err(SimError::new("substeps", "1 to 1000", self.substeps));
        }
        match &self.machine {
            Machine::Arm => {}
            Machine::ServoAxis(axis) => axis.validate()?,
            Machine::Plant(plant) => plant.validate()?,
        }
        self.arm.validate()?;
        self.mass_2.validate()?;
        self.controller.validate()?;
        for (joint, setpoint) in self.setpoint.iter().enumerate() {
            setpoint
                .validate(self.sample_period_s)
                .map_err(|error| error.of_joint(joint))?;
        }
        for joint in 0..ARM_JOINTS {
            in_range("initial_q_rad", self.initial_q_rad[joint], -100.0, 100.0)?;
        }
        self.sensors.validate()?;
        self.unmodelled.validate()?;
        self.faults.iter().try_for_each(|fault| fault.validate(self.joints()))
    }
}
