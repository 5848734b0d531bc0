//! A simulated robot: forward dynamics of a URDF's tree in closed loop, with friction, sensors and
//! a changing payload.
//!
//! ```text
//! M(q) q̈ + … = τ − f,     f_i = f_v q̇ + (f_c + f_s e^−(q̇/v_s)²) z + f_0 + k q + f_d q̇ |q̇| + f_a |q̇|
//!                          dz/dt = (q̇ − |q̇| z)/δ                                              (1)
//! computed torque:  τ = ID(q, q̇, q̈_r + ω² e + 2 ω ė) + Ia (q̈_r + …)                            (2)
//! PD:               τ = g(q) + M_ii (ω² e + 2 ω ė)                                             (3)
//! servo:            τ = M_ii (ω² e + 2 ω ė), for feed-forward that supplies weight and inertia (4)
//! ```
//!
//! q̈ comes from the articulated-body algorithm, which is independent of the regressors. The
//! controller is sampled and knows only the URDF; the machine may differ from it. z (P. Dahl, 1968)
//! is advanced exactly over the distance of each step, so a reversing joint sticks. Between
//! controller periods the joints are integrated by the classical Runge–Kutta method. The torque of
//! a sample is its mean before and after the sample's instant.

use super::dynamics::{forward_dynamics, inverse_dynamics};
use super::error::RobotSimError;
use super::friction::{Engagement, FrictionTerm, JointFriction};
use super::model::RobotModel;
use super::reference::{MotionLimits, Motions, Reference};
use super::spatial::{BodyParameters, Placement};
use super::tree::Robot;
use crate::model::{JointSample, MAX_JOINTS, SAMPLE_PERIODS_S};
use crate::random::Random;

/// Controllers of the simulated robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RobotController {
    /// Inverse dynamics of the URDF's bodies.
    #[default]
    ComputedTorque,
    /// Independent joints, with gravity compensation for the URDF's bodies.
    Pd,
    /// Independent joints without gravity compensation, for commands that supply the weight.
    Servo,
}

/// Friction and rotor of a simulated joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SimulatedDrive {
    /// f_v \[N m s/rad or N s/m\], ≥ 0.
    pub viscous: f64,
    /// f_c \[N m or N\], ≥ 0.
    pub coulomb: f64,
    /// f_0 \[N m or N\].
    pub offset: f64,
    /// f_s, whose effect has fallen to 1/e at 0.1 rad/s or m/s \[N m or N\], ≥ 0.
    pub stribeck: f64,
    /// k of a spring with rest position 0 \[N m/rad or N/m\].
    pub spring: f64,
    /// f_d \[N m s²/rad² or N s²/m²\], ≥ 0.
    pub drag: f64,
    /// f_a \[N m s/rad or N s/m\].
    pub asymmetric: f64,
    /// Inertia of the rotor at the joint \[kg m² or kg\], ≥ 0.
    pub rotor_inertia: f64,
}

impl SimulatedDrive {
    /// Typical drives for the joints' sizes: Coulomb friction of 4 % and viscous friction of up to
    /// 4 % of the largest torque.
    pub fn sized(robot: &Robot) -> Vec<Self> {
        let sized = |(joint, effort): (&super::tree::RobotJoint, f64)| {
            let speed = joint.limits.velocity.filter(|x| *x > 0.0).unwrap_or(2.0);
            Self {
                viscous: 0.04 * effort / speed,
                coulomb: 0.04 * effort,
                offset: 0.0,
                stribeck: 0.0,
                spring: 0.0,
                drag: 0.0,
                asymmetric: 0.0,
                rotor_inertia: 0.002 * effort,
            }
        };
        robot.joints.iter().zip(robot.drive_sizes()).map(sized).collect()
    }
}

/// The payload from a time on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PayloadChange {
    /// When \[s\].
    pub t_s: f64,
    /// Mass \[kg\], ≥ 0; 0 for nothing.
    pub mass_kg: f64,
    /// Centre of mass in the flange's frame \[m\].
    pub center_m: [f64; 3],
    /// Inertia about the centre of mass, axes of the flange: xx, xy, yy, xz, yz, zz \[kg m²\].
    pub inertia_kg_m2: [f64; 6],
}

impl PayloadChange {
    /// Its ten parameters in the flange's frame.
    pub fn body(&self) -> BodyParameters {
        let [xx, xy, yy, xz, yz, zz] = self.inertia_kg_m2;
        let inertia = nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        BodyParameters::new(self.mass_kg, self.center_m.into(), inertia)
    }
}

/// Options of the simulation. The same options give the same samples, bit for bit.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotSimOptions {
    /// Time from one sample to the next \[s\], 1e-5 to 1.
    pub sample_period_s: f64,
    /// Periods of the controller per sample, 1 to 1000.
    pub control_steps: usize,
    /// Steps of the integration per period of the controller, 1 to 1000.
    pub substeps: usize,
    /// Seed of the motion and the noise.
    pub seed: u64,
    /// Seed of the differences from the URDF; it selects the machine.
    pub machine_seed: u64,
    /// The motion.
    pub motions: Motions,
    /// Its limits.
    pub limits: MotionLimits,
    /// The controller.
    pub controller: RobotController,
    /// ω of the controller \[1/s\], > 0.
    pub bandwidth_rad_per_s: f64,
    /// The drives, one per joint.
    pub drives: Vec<SimulatedDrive>,
    /// δ of the friction \[rad or m\], > 0.
    pub presliding: f64,
    /// Each body differs from the URDF by a factor of 1 ± this, 0 to 0.9.
    pub difference: f64,
    /// Steps of the encoders per turn or metre are 2 to this power; 0 for exact positions.
    pub encoder_bits: u32,
    /// False if only positions are measured.
    pub has_velocity: bool,
    /// Standard deviation of the measured torque relative to the joint's largest, ≥ 0.
    pub torque_noise: f64,
    /// The payloads, in order of time.
    pub payloads: Vec<PayloadChange>,
    /// Placement of the flange in the frame of the last body.
    pub flange: Placement,
}

impl RobotSimOptions {
    /// A robot that equals its URDF, with drives of its size, sampled at 1 kHz; encoders of 16
    /// bits, torque noise of 0.5 %.
    pub fn new(robot: &Robot) -> Self {
        Self {
            sample_period_s: 1e-3,
            control_steps: 1,
            substeps: 4,
            seed: 0,
            machine_seed: 0,
            motions: Motions::Fourier {
                harmonics: 5,
                period_s: 20.0,
            },
            limits: MotionLimits::default(),
            controller: RobotController::default(),
            bandwidth_rad_per_s: 30.0,
            drives: SimulatedDrive::sized(robot),
            presliding: 1e-4,
            difference: 0.0,
            encoder_bits: 16,
            has_velocity: false,
            torque_noise: 0.005,
            payloads: Vec::new(),
            flange: robot.flange,
        }
    }

    fn validate(&self, robot: &Robot) -> Result<(), RobotSimError> {
        let within = |name: &'static str, got: f64, low: f64, high: f64| match got >= low && got <= high {
            true => Ok(()),
            false => Err(RobotSimError::Range { name, low, high, got }),
        };
        within(
            "sample_period_s",
            self.sample_period_s,
            SAMPLE_PERIODS_S.0,
            SAMPLE_PERIODS_S.1,
        )?;
        within("control_steps", self.control_steps as f64, 1.0, 1000.0)?;
        within("substeps", self.substeps as f64, 1.0, 1000.0)?;
        within("bandwidth_rad_per_s", self.bandwidth_rad_per_s, 1e-3, 1e4)?;
        within("presliding", self.presliding, 1e-9, 1.0)?;
        within("difference", self.difference, 0.0, 0.9)?;
        within("encoder_bits", f64::from(self.encoder_bits), 0.0, 48.0)?;
        within("torque_noise", self.torque_noise, 0.0, 10.0)?;
        if self.drives.len() != robot.len() {
            return Err(RobotSimError::Drives {
                expected: robot.len(),
                got: self.drives.len(),
            });
        }
        for drive in &self.drives {
            within("viscous friction", drive.viscous, 0.0, 1e6)?;
            within("Coulomb friction", drive.coulomb, 0.0, 1e6)?;
            within("offset", drive.offset, -1e6, 1e6)?;
            within("Stribeck friction", drive.stribeck, 0.0, 1e6)?;
            within("spring", drive.spring, -1e6, 1e6)?;
            within("drag", drive.drag, 0.0, 1e6)?;
            within("asymmetric friction", drive.asymmetric, -1e6, 1e6)?;
            within("rotor_inertia", drive.rotor_inertia, 0.0, 1e6)?;
        }
        for (i, payload) in self.payloads.iter().enumerate() {
            within("payload mass", payload.mass_kg, 0.0, 1e6)?;
            let members = [
                ("t_s", &[payload.t_s][..]),
                ("center_m", &payload.center_m),
                ("inertia_kg_m2", &payload.inertia_kg_m2),
            ];
            let wrong = |(_, numbers): &(&'static str, &[f64])| numbers.iter().any(|x| !x.is_finite());
            if let Some((name, numbers)) = members.into_iter().find(wrong) {
                let got = numbers.to_vec();
                return Err(RobotSimError::Payload { name, got });
            }
            if i > 0 && payload.t_s <= self.payloads[i - 1].t_s {
                return Err(RobotSimError::PayloadTime(payload.t_s));
            }
        }
        Ok(())
    }
}

/// The closed loop as an endless iterator of samples k = 0, 1, … at t = k Δ; it ends if the
/// state is no longer finite. Nothing is allocated per sample.
#[derive(Debug, Clone)]
pub struct RobotSimulator {
    /// The robot by its URDF, as the controller knows it.
    known: Robot,
    /// The machine's bodies without payload.
    bodies: Vec<BodyParameters>,
    /// With the present payload.
    loaded: Vec<BodyParameters>,
    options: RobotSimOptions,
    reference: Reference,
    friction: JointFriction,
    rotors: Vec<f64>,
    gains: [f64; MAX_JOINTS],
    effort: [f64; MAX_JOINTS],
    /// Sizes of the drives, also of those without a limit.
    sizes: Vec<f64>,
    noise: Random,
    q: [f64; MAX_JOINTS],
    dq: [f64; MAX_JOINTS],
    engagement: [Engagement; MAX_JOINTS],
    tau: [f64; MAX_JOINTS],
    feed_forward: [f64; MAX_JOINTS],
    next_payload: usize,
    k: u64,
}

impl RobotSimulator {
    /// A robot at rest at the start of its motion.
    ///
    /// # Errors
    /// If a number is out of range.
    pub fn new(robot: &Robot, options: RobotSimOptions) -> Result<Self, RobotSimError> {
        options.validate(robot)?;
        let reference = Reference::new(robot, options.motions.clone(), options.limits, options.seed)?;
        let mut differences = Random(options.machine_seed ^ 0x6469_6666_6572);
        let bodies: Vec<BodyParameters> = robot
            .bodies
            .iter()
            .map(|body| {
                let factor = 1.0 + differences.within(options.difference);
                BodyParameters(body.0.map(|x| factor * x))
            })
            .collect();
        let rotors: Vec<f64> = options.drives.iter().map(|drive| drive.rotor_inertia).collect();
        let mut simulator = Self {
            known: robot.clone(),
            loaded: bodies.clone(),
            bodies,
            friction: JointFriction {
                presliding: options.presliding,
                ..JointFriction::default()
            },
            gains: [0.0; MAX_JOINTS],
            effort: [f64::INFINITY; MAX_JOINTS],
            sizes: robot.drive_sizes(),
            noise: Random(options.seed ^ 0x006e_6f69_7365),
            q: reference.start(),
            dq: [0.0; MAX_JOINTS],
            engagement: [Engagement::default(); MAX_JOINTS],
            tau: [0.0; MAX_JOINTS],
            feed_forward: [0.0; MAX_JOINTS],
            next_payload: 0,
            k: 0,
            rotors,
            reference,
            options,
        };
        let n = robot.len();
        for i in 0..n {
            let limit = robot.joints[i].limits.effort.filter(|x| *x > 0.0);
            simulator.effort[i] = limit.unwrap_or(f64::INFINITY);
            let (mut unit, mut with, mut without) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
            let still = [0.0; MAX_JOINTS];
            unit[i] = 1.0;
            simulator.inverse(&still[..n], &unit[..n], &mut with[..n]);
            simulator.inverse(&still[..n], &still[..n], &mut without[..n]);
            simulator.gains[i] = with[i] - without[i] + simulator.rotors[i]; // M_ii
        }
        simulator.load(0.0);
        let mut hold = [[0.0; 3]; MAX_JOINTS];
        (0..n).for_each(|i| hold[i][0] = simulator.q[i]);
        simulator.control(&hold);
        Ok(simulator)
    }

    fn inverse(&self, dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        let n = self.known.len();
        inverse_dynamics(&self.known, &self.known.bodies, &self.q[..n], dq, ddq, tau);
    }

    /// Adds torques or forces to those of the controller, from the next sample until the next call
    /// \[N m or N\].
    pub fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        self.feed_forward = *feed_forward;
    }

    /// Number of the next sample.
    pub fn position(&self) -> u64 {
        self.k
    }

    /// The machine's bodies without payload.
    pub fn bodies(&self) -> &[BodyParameters] {
        &self.bodies
    }

    /// The options.
    pub fn options(&self) -> &RobotSimOptions {
        &self.options
    }

    /// The true parameters of a model of this robot at a time \[s\], with those of the payload
    /// after the arm's.
    pub fn truth(&self, model: &RobotModel, t_s: f64) -> Vec<f64> {
        let mut machine = self.known.clone();
        machine.bodies.clone_from(&self.bodies);
        let mut theta = model.base().nominal(&machine, &self.rotors);
        for (drive, friction) in self.options.drives.iter().zip(model.friction()) {
            theta.extend(friction.terms.iter().map(|term| match term {
                FrictionTerm::Viscous => drive.viscous,
                FrictionTerm::Coulomb => drive.coulomb,
                FrictionTerm::Offset => drive.offset,
                FrictionTerm::Load => 0.0,
                FrictionTerm::Stribeck => drive.stribeck,
                FrictionTerm::Spring => drive.spring,
                FrictionTerm::Drag => drive.drag,
                FrictionTerm::Asymmetric => drive.asymmetric,
                FrictionTerm::Reversal => drive.coulomb * (self.options.presliding / friction.presliding - 1.0),
            }));
        }
        theta.extend(self.payload(t_s).0);
        theta
    }

    /// The true positions and velocities \[rad or m, per s\].
    pub fn state(&self) -> ([f64; MAX_JOINTS], [f64; MAX_JOINTS]) {
        (self.q, self.dq)
    }

    /// The payload in the flange's frame at a time \[s\].
    pub fn payload(&self, t_s: f64) -> BodyParameters {
        let all = &self.options.payloads;
        let now = all.iter().rev().find(|change| change.t_s <= t_s + 1e-9);
        now.map_or(BodyParameters::default(), PayloadChange::body)
    }

    /// Applies the payload at this time.
    fn load(&mut self, t_s: f64) {
        let due = |at: usize| self.options.payloads.get(at).is_some_and(|p| p.t_s <= t_s + 1e-9);
        if !due(self.next_payload) {
            return;
        }
        while due(self.next_payload) {
            self.next_payload += 1;
        }
        let payload = self.payload(t_s).moved(&self.options.flange);
        if let (Some(last), Some(bare)) = (self.loaded.last_mut(), self.bodies.last()) {
            *last = bare.plus(&payload);
        }
    }

    /// The controller's torques for these setpoints.
    fn control(&mut self, setpoints: &[[f64; 3]; MAX_JOINTS]) {
        let n = self.known.len();
        let w = self.options.bandwidth_rad_per_s;
        let (mut wanted, mut tau) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        for i in 0..n {
            let [q, dq, ddq] = setpoints[i];
            let back = w * w * (q - self.q[i]) + 2.0 * w * (dq - self.dq[i]);
            wanted[i] = match self.options.controller {
                RobotController::ComputedTorque => ddq + back,        // (2)
                RobotController::Pd | RobotController::Servo => back, // (3), (4)
            };
        }
        match self.options.controller {
            RobotController::ComputedTorque => {
                self.inverse(&self.dq[..n], &wanted[..n], &mut tau[..n]); // (2)
                (0..n).for_each(|i| tau[i] += self.rotors[i] * wanted[i]); // (2)
            }
            RobotController::Pd => {
                let still = [0.0; MAX_JOINTS];
                self.inverse(&still[..n], &still[..n], &mut tau[..n]); // (3)
                (0..n).for_each(|i| tau[i] += self.gains[i] * wanted[i]); // (3)
            }
            RobotController::Servo => (0..n).for_each(|i| tau[i] = self.gains[i] * wanted[i]), // (4)
        }
        for i in 0..n {
            self.tau[i] = (tau[i] + self.feed_forward[i]).clamp(-self.effort[i], self.effort[i]);
        }
    }

    /// (1): accelerations at a state.
    fn accelerations(&self, q: &[f64; MAX_JOINTS], dq: &[f64; MAX_JOINTS], ddq: &mut [f64; MAX_JOINTS]) {
        let n = self.known.len();
        let mut net = [0.0; MAX_JOINTS];
        for i in 0..n {
            let drive = &self.options.drives[i];
            net[i] = self.tau[i] - drive.viscous * dq[i] - drive.coulomb * self.engagement[i].z - drive.offset; // (1)
            net[i] -= drive.spring * q[i]; // (1)
            net[i] -= (drive.drag * dq[i] + drive.asymmetric) * dq[i].abs(); // (1)
            if drive.stribeck > 0.0 {
                let slow = (-(dq[i] / self.friction.stribeck_speed).powi(2)).exp();
                net[i] -= drive.stribeck * self.engagement[i].z * slow; // (1)
            }
        }
        let (robot, bodies) = (&self.known, &self.loaded);
        forward_dynamics(robot, bodies, &self.rotors, &q[..n], &dq[..n], &net[..n], &mut ddq[..n]);
    }

    /// One Runge–Kutta step of the joints, then the friction's.
    fn integrate(&mut self, h: f64) {
        let (q, v1) = (self.q, self.dq);
        let moved = |x: &[f64; MAX_JOINTS], rate: &[f64; MAX_JOINTS], h: f64| -> [f64; MAX_JOINTS] {
            std::array::from_fn(|i| x[i] + h * rate[i])
        };
        let mut a = [[0.0; MAX_JOINTS]; 4];
        self.accelerations(&q, &v1, &mut a[0]);
        let v2 = moved(&v1, &a[0], 0.5 * h);
        self.accelerations(&moved(&q, &v1, 0.5 * h), &v2, &mut a[1]);
        let v3 = moved(&v1, &a[1], 0.5 * h);
        self.accelerations(&moved(&q, &v2, 0.5 * h), &v3, &mut a[2]);
        let v4 = moved(&v1, &a[2], h);
        self.accelerations(&moved(&q, &v3, h), &v4, &mut a[3]);
        for i in 0..self.known.len() {
            let step = h / 6.0 * (v1[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
            self.q[i] += step;
            self.dq[i] += h / 6.0 * (a[0][i] + 2.0 * a[1][i] + 2.0 * a[2][i] + a[3][i]);
            self.engagement[i] = self.friction.engagement(step, self.engagement[i]); // (1)
        }
    }
}

impl Iterator for RobotSimulator {
    type Item = JointSample;

    fn next(&mut self) -> Option<JointSample> {
        let n = self.known.len();
        if self.q[..n].iter().chain(&self.dq[..n]).any(|x| !x.is_finite()) {
            return None;
        }
        let period = self.options.sample_period_s;
        let t = self.k as f64 * period;
        self.load(t);
        let before = self.tau;
        let setpoints = self.reference.at(t);
        self.control(&setpoints);
        let mut sample = JointSample::default();
        let steps = f64::from(self.options.encoder_bits).exp2();
        for i in 0..n {
            let turn = if self.known.joints[i].turns {
                std::f64::consts::TAU
            } else {
                1.0
            };
            let step = turn / steps;
            sample.q[i] = match self.options.encoder_bits {
                0 => self.q[i],
                _ => (self.q[i] / step).round() * step,
            };
            sample.setpoint[i] = setpoints[i][0];
            let noise = self.options.torque_noise * self.sizes[i];
            sample.input[i] = 0.5 * (before[i] + self.tau[i]);
            if noise > 0.0 {
                sample.input[i] += noise * self.noise.normal();
            }
        }
        if self.options.has_velocity {
            sample.dq = self.dq;
            self.accelerations(&self.q, &self.dq, &mut sample.ddq);
        }
        let h = period / (self.options.control_steps * self.options.substeps) as f64;
        for step in 0..self.options.control_steps {
            if step > 0 {
                let at = t + period * step as f64 / self.options.control_steps as f64;
                let setpoints = self.reference.at(at);
                self.control(&setpoints);
            }
            for _ in 0..self.options.substeps {
                self.integrate(h);
            }
        }
        self.k += 1;
        Some(sample)
    }
}
