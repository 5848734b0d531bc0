//! A simulated servo axis under a PD controller.
//!
//! ```text
//! M dv/dt = k u − F_v v − F(v) sign v − b      moving, v ≠ 0;  F(v) = F_c + F_s exp(−(v/v_s)²)
//! v = 0 while |k u − b| ≤ F(0)                 stuck: friction balances up to F(0)
//! u = K_p (setpoint − q) − K_d v, limited to ± u_max
//! ```
//!
//! q, v position and velocity \[m, m/s or rad, rad/s\]; M, F_v, F_c, b, k as in
//! [`ServoAxis`](crate::model::ServoAxis); F_s, the Stribeck effect, is not part of that model.
//! Coulomb friction is a jump: a Runge-Kutta step that would take v through zero is cut at the
//! zero, where the axis sticks or starts in the other direction. While it sticks, friction may have
//! any value up to F(0), so such samples do not obey the model's F_c sign v, as on a real machine.

use super::controller::{Commanded, ControllerKind, PositionFeedback};
use super::error::SimError;
use super::instants::SampleInstants;
use super::integrator::rk4_step;
use super::noise::Noise;
use super::options::SimOptions;
use super::sensors::Sensors;
use super::servo_axis_options::ServoAxisOptions;
use super::setpoint::SetpointSource;
use crate::model::{JointSample, MAX_JOINTS};

impl ServoAxisOptions {
    fn input(&self, setpoint: f64, q: f64, v: f64, feed_forward: f64) -> f64 {
        let u = self.proportional_gain * (setpoint - q) - self.derivative_gain * v + feed_forward;
        u.clamp(-self.input_limit, self.input_limit)
    }

    /// Acceleration under an input.
    fn acceleration(&self, mass: f64, motion: Motion, u: f64, v: f64) -> f64 {
        match motion {
            Motion::Stuck => 0.0,
            Motion::Moving(sign) => {
                (self.gain * u - self.viscous_friction * v - self.dry_friction(v) * sign - self.offset) / mass
            }
        }
    }

    /// F(v).
    fn dry_friction(&self, v: f64) -> f64 {
        match self.stribeck_friction {
            0.0 => self.coulomb_friction,
            more => self.coulomb_friction + more * (-(v / self.stribeck_speed).powi(2)).exp(),
        }
    }

    /// The state of motion from rest under an input.
    fn set_off(&self, u: f64) -> Motion {
        let force = self.gain * u - self.offset;
        if force.abs() <= self.dry_friction(0.0) {
            Motion::Stuck
        } else {
            Motion::Moving(force.signum())
        }
    }
}

/// State of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Motion {
    Stuck,
    /// With this sign of the velocity.
    Moving(f64),
}

/// The closed loop as an endless iterator: sample k = 0, 1, 2, … at t = k Δ.
///
/// Nothing is allocated per sample. It ends early only if the state is no longer finite (gains
/// that make the loop unstable).
#[derive(Debug, Clone)]
pub struct ServoAxisSimulator {
    axis: ServoAxisOptions,
    sample_period_s: f64,
    substeps: usize,
    kind: ControllerKind,
    feedback: PositionFeedback,
    setpoint: SetpointSource,
    sensors: Sensors,
    instants: SampleInstants,
    /// Offsets of this sample and the next from their places on the grid \[s\].
    offset_s: [f64; 2],
    /// q, v.
    state: [f64; 2],
    motion: Motion,
    mass: f64,
    feed_forward: f64,
    k: u64,
}

impl ServoAxisSimulator {
    /// A simulator at k = 0: the axis at rest at the first initial position, following the first
    /// setpoint.
    ///
    /// # Errors
    /// If the options are invalid, see [`SimOptions::validate`].
    pub fn new(options: &SimOptions, axis: &ServoAxisOptions) -> Result<Self, SimError> {
        options.validate()?;
        axis.validate()?;
        let noise = Noise::new(options.seed, Noise::setpoint_stream(0));
        let mut instants = SampleInstants::new(options);
        let offset_s = [instants.next_offset_ns(), instants.next_offset_ns()].map(|ns| ns as f64 * 1e-9);
        Ok(Self {
            axis: axis.clone(),
            sample_period_s: options.sample_period_s,
            substeps: options.substeps,
            kind: options.controller.kind,
            feedback: options.controller.feedback,
            setpoint: SetpointSource::new(&options.setpoint[0], options.sample_period_s, noise),
            sensors: Sensors::new(options.sensors, options.seed).with_resolution(axis.position_resolution),
            instants,
            offset_s,
            state: [options.initial_q_rad[0], 0.0],
            motion: Motion::Stuck,
            mass: axis.mass.mass_kg(0.0),
            feed_forward: 0.0,
            k: 0,
        })
    }

    /// The next sample; `None` once the state is no longer finite.
    fn exact_sample(&mut self) -> Option<JointSample> {
        if self.state.iter().any(|x| !x.is_finite()) {
            return None;
        }
        self.mass = self.axis.mass.mass_kg(self.k as f64 * self.sample_period_s);
        self.setpoint.begin_sample(self.k);
        let [q, v] = self.state;
        let setpoint = self.setpoint.value(self.offset_s[0] / self.sample_period_s);
        // The shift of the reading instant needs the acceleration, which needs the input, which may
        // need the reading: the true position is used instead, with an error below a count.
        let ddq = self.axis.acceleration(
            self.mass,
            self.motion,
            self.axis.input(setpoint, q, v, self.feed_forward),
            v,
        );
        let [measured_q, _] = self.sensors.positions([q, 0.0], [v, 0.0], [ddq, 0.0]);
        let seen_q = match self.feedback {
            PositionFeedback::True => q,
            PositionFeedback::Measured => measured_q,
        };
        let u = self.axis.input(setpoint, seen_q, v, self.feed_forward);
        if v == 0.0 {
            self.motion = self.axis.set_off(u);
        }
        let mut sample = JointSample::default();
        sample.q[0] = measured_q;
        sample.dq[0] = v;
        sample.ddq[0] = self.axis.acceleration(self.mass, self.motion, u, v);
        sample.setpoint[0] = setpoint;
        sample.input[0] = u;
        self.integrate(u);
        let length_s = self.sample_period_s + self.offset_s[1] - self.offset_s[0];
        self.sensors
            .advance([[q, v], [0.0; 2]], [self.state, [0.0; 2]], length_s);
        self.offset_s = [self.offset_s[1], self.instants.next_offset_ns() as f64 * 1e-9];
        self.k += 1;
        Some(sample)
    }

    /// Advances the state to the next sample instant; `held` is the input of this instant.
    fn integrate(&mut self, held: f64) {
        let [start, _] = self.grid();
        let length = self.grid()[1] - start;
        for substep in 0..self.substeps {
            let (mut from, mut cuts) = (0.0, 0);
            // Each pass is an interval without a change of direction. A drive cannot reverse the
            // axis more often than this within a substep.
            while from < 1.0 && cuts < 4 {
                let at =
                    |fraction: f64, substeps: usize| start + length * ((substep as f64 + fraction) / substeps as f64);
                if self.state[1] == 0.0 {
                    let setpoint = self.setpoint.value(at(from, self.substeps));
                    let u = match self.kind {
                        ControllerKind::Sampled => held,
                        ControllerKind::Analog => self.axis.input(setpoint, self.state[0], 0.0, self.feed_forward),
                    };
                    self.motion = self.axis.set_off(u);
                }
                let Motion::Moving(sign) = self.motion else { break };
                let end = self.step(held, substep, from, 1.0 - from);
                if end[1] * sign > 0.0 {
                    self.state = end;
                    break;
                }
                // The velocity passes zero: find the zero by bisection.
                let (mut before, mut after) = (0.0, 1.0 - from);
                for _ in 0..40 {
                    let middle = 0.5 * (before + after);
                    if self.step(held, substep, from, middle)[1] * sign > 0.0 {
                        before = middle;
                    } else {
                        after = middle;
                    }
                }
                let [q, _] = self.step(held, substep, from, after);
                self.state = [q, 0.0];
                from += after;
                cuts += 1;
            }
        }
    }

    /// This sample and the next as places on the grid, 0 and 1 unless samples are irregular.
    fn grid(&self) -> [f64; 2] {
        let [from, to] = self.offset_s.map(|offset_s| offset_s / self.sample_period_s);
        [from, 1.0 + to]
    }

    /// The state after a part of a substep, all as fractions of it.
    fn step(&mut self, held: f64, substep: usize, from: f64, length: f64) -> [f64; 2] {
        let substeps = self.substeps as f64;
        let [start, end] = self.grid();
        let whole = end - start;
        let step_s = length * (whole * self.sample_period_s) / substeps;
        let Self {
            axis,
            kind,
            setpoint,
            state,
            motion,
            mass,
            feed_forward,
            ..
        } = self;
        rk4_step(state, step_s, |fraction, &[q, v]| {
            let u = match kind {
                ControllerKind::Sampled => held,
                ControllerKind::Analog => {
                    let at = start + whole * ((substep as f64 + from + fraction * length) / substeps);
                    axis.input(setpoint.value(at.min(end)), q, v, *feed_forward)
                }
            };
            [v, axis.acceleration(*mass, *motion, u, v)]
        })
    }
}

impl Commanded for ServoAxisSimulator {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        self.feed_forward = feed_forward[0];
    }
}

impl Iterator for ServoAxisSimulator {
    type Item = JointSample;

    fn next(&mut self) -> Option<JointSample> {
        let mut sample = self.exact_sample()?;
        self.sensors.measure(&mut sample);
        Some(sample)
    }
}
