//! A simulated machine of any plant: its own equations, solved for the highest derivative.
//!
//! ```text
//! f_e(q, q̇, …, q^(r+1), u; θ) = 0        r the order of the terms, f affine in x = q^(r+1)
//! x = −A⁻¹ f(x = 0)                       A = ∂f/∂x, one column per joint
//! u = K_p (setpoint − q) − K_d q̇          computed once per sample and held
//! ```
//!
//! With r = 1 the state is (q, q̇); with r = 2, as for motors with an inductance, it is (q, q̇,
//! q̈). It is integrated by Runge-Kutta steps. The equations are those that the identifier fits, so
//! this machine shows how well they can be identified, not whether they are right.
//!
//! Gains that are not given are those of a loop at [`LOOP_RAD_PER_S`] with damping 1 around the
//! joint's own inertia ∂f/∂q̈ at the start.

use super::arm_parameters::ARM_JOINTS;
use super::controller::Commanded;
use super::error::SimError;
use super::noise::Noise;
use super::options::{Machine, PlantMachine, SimOptions};
use super::sensors::Sensors;
use super::setpoint::SetpointSource;
use crate::model::{AutoDiff, JointSample, MAX_JOINTS, MAX_PARAMS, Plant, PointwiseModel};
use nalgebra::{DMatrix, DVector};

/// Natural frequency of the position loop if no gains are given \[rad/s\].
const LOOP_RAD_PER_S: f64 = 12.0;

/// The closed loop as an endless iterator: sample k = 0, 1, 2, … at t = k Δ. It ends early only if
/// the state is no longer finite.
pub struct PlantSimulator<P> {
    form: AutoDiff<P>,
    machine: PlantMachine,
    /// r, the order of the equations' terms.
    order: usize,
    joints: usize,
    sample_period_s: f64,
    substeps: usize,
    gains: [[f64; 2]; MAX_JOINTS],
    feed_forward: [f64; MAX_JOINTS],
    setpoints: Vec<SetpointSource>,
    sensors: Sensors<MAX_JOINTS>,
    theta: Vec<f64>,
    /// q, q̇, q̈, q⃛ of each joint; derivatives beyond the state follow from the equations.
    state: JointSample,
    columns: DMatrix<f64>,
    right: DVector<f64>,
    k: u64,
}

impl<P: Plant> PlantSimulator<P> {
    /// A simulator at k = 0, at rest at the first initial positions.
    ///
    /// # Errors
    /// If the options are invalid, or the equations do not determine the acceleration.
    pub fn new(plant: P, options: &SimOptions) -> Result<Self, SimError> {
        options.validate()?;
        let Machine::Plant(machine) = &options.machine else {
            return Err(SimError::new("machine", "\"model\"", "another one"));
        };
        let joints = plant.joints();
        let order = plant.equations().iter().map(|e| e.order).max().unwrap_or(0);
        if plant.equations().len() != joints || order == 0 {
            let expected = "\"model\" only if the model has one equation with inertia per joint";
            let got = format!(
                "{} equations of order up to {order} for {joints} joints",
                plant.equations().len()
            );
            return Err(SimError::new("machine", expected, got));
        }
        let mut state = JointSample::default();
        for joint in 0..joints {
            state.q[joint] = options.initial_q_rad[joint % ARM_JOINTS];
        }
        let setpoints = (0..joints).map(|joint| {
            let noise = Noise::new(options.seed, Noise::setpoint_stream(joint));
            SetpointSource::new(&options.setpoint[joint % ARM_JOINTS], options.sample_period_s, noise)
        });
        let mut simulator = Self {
            theta: machine.theta(0.0).to_vec(),
            machine: machine.clone(),
            order,
            joints,
            sample_period_s: options.sample_period_s,
            substeps: options.substeps,
            gains: [[0.0; 2]; MAX_JOINTS],
            feed_forward: [0.0; MAX_JOINTS],
            setpoints: setpoints.collect(),
            sensors: Sensors::new(options.sensors, options.seed),
            state,
            columns: DMatrix::zeros(joints, joints),
            right: DVector::zeros(joints),
            form: AutoDiff(plant),
            k: 0,
        };
        simulator.choose_gains()?;
        Ok(simulator)
    }

    /// f_e at a state, for all equations in order.
    fn residuals(&self, state: &JointSample, out: &mut [f64]) {
        let mut regressor = [0.0; MAX_PARAMS];
        for (e, equation) in self.form.0.equations().iter().enumerate() {
            out[e] = self
                .form
                .row(e, state, &self.theta, &mut regressor[..equation.parameters.len()]);
        }
    }

    /// The array of the derivative q^(d).
    fn derivative(state: &mut JointSample, d: usize) -> &mut [f64; MAX_JOINTS] {
        match d {
            0 => &mut state.q,
            1 => &mut state.dq,
            2 => &mut state.ddq,
            _ => &mut state.dddq,
        }
    }

    /// Fills in the highest derivative; false if the equations do not determine it.
    fn solve(&mut self, state: &mut JointSample) -> bool {
        let (n, highest) = (self.joints, self.order + 1);
        let mut at_zero = [0.0; MAX_JOINTS];
        let mut with_one = [0.0; MAX_JOINTS];
        *Self::derivative(state, highest) = [0.0; MAX_JOINTS];
        self.residuals(state, &mut at_zero);
        for joint in 0..n {
            Self::derivative(state, highest)[joint] = 1.0;
            self.residuals(state, &mut with_one);
            Self::derivative(state, highest)[joint] = 0.0;
            for e in 0..n {
                self.columns[(e, joint)] = with_one[e] - at_zero[e];
            }
        }
        for e in 0..n {
            self.right[e] = -at_zero[e];
        }
        let solved = self.columns.clone().lu().solve(&self.right);
        let Some(x) = solved.filter(|x| x.iter().all(|x| x.is_finite())) else {
            return false;
        };
        Self::derivative(state, highest)[..n].copy_from_slice(x.as_slice());
        true
    }

    /// K_p = m ω², K_d = 2 m ω with m = −∂f/∂q̈ over the input's scale, unless the options have
    /// gains.
    fn choose_gains(&mut self) -> Result<(), SimError> {
        let rest = self.state;
        let mut at_zero = [0.0; MAX_JOINTS];
        let mut with_one = [0.0; MAX_JOINTS];
        self.residuals(&rest, &mut at_zero);
        for joint in 0..self.joints {
            let mut moved = rest;
            moved.ddq[joint] = 1.0;
            self.residuals(&moved, &mut with_one);
            let equation = self.form.0.equations().iter().position(|e| e.input == joint);
            let own = equation.map(|e| (at_zero[e] - with_one[e]) / self.form.0.equations()[e].input_scale);
            let given = |list: &[f64]| list.get(joint).copied();
            let inertia = own.filter(|m| m.is_finite() && *m != 0.0);
            let gains = [
                given(&self.machine.proportional_gain).or(inertia.map(|m| m * LOOP_RAD_PER_S.powi(2))),
                given(&self.machine.derivative_gain).or(inertia.map(|m| 2.0 * m * LOOP_RAD_PER_S)),
            ];
            let [Some(proportional), Some(derivative)] = gains else {
                let expected = "gains, because the equations show no inertia of this joint";
                return Err(SimError::new("model.proportional_gain", expected, "none").of_joint(joint));
            };
            self.gains[joint] = [proportional, derivative];
        }
        let mut state = self.state;
        match self.solve(&mut state) {
            true => Ok(()),
            false => Err(SimError::new(
                "model.theta",
                "true values at which every joint has inertia",
                format!("{:?}", self.theta),
            )),
        }
    }

    fn next_sample(&mut self) -> Option<JointSample> {
        let t_s = self.k as f64 * self.sample_period_s;
        let truth = self.machine.theta(t_s);
        self.theta.copy_from_slice(truth);
        let mut state = self.state;
        for joint in 0..self.joints {
            let source = &mut self.setpoints[joint];
            source.begin_sample(self.k);
            state.setpoint[joint] = source.value(0.0);
            let [proportional, derivative] = self.gains[joint];
            state.input[joint] = proportional * (state.setpoint[joint] - state.q[joint]) - derivative * state.dq[joint]
                + self.feed_forward[joint];
        }
        if !self.solve(&mut state) {
            return None;
        }
        let mut sample = state;
        let (q, dq, ddq) = (state.q, state.dq, state.ddq);
        sample.q = self.sensors.positions(q, dq, ddq);
        let step_s = self.sample_period_s / self.substeps as f64;
        self.state = state;
        for _ in 0..self.substeps {
            self.step(step_s)?;
        }
        let from = std::array::from_fn(|joint| [q[joint], dq[joint]]);
        let to = std::array::from_fn(|joint| [self.state.q[joint], self.state.dq[joint]]);
        self.sensors.advance(from, to, self.sample_period_s);
        self.sensors.measure(&mut sample);
        self.k += 1;
        let finite = self.state.q.iter().chain(&self.state.dq).all(|x| x.is_finite());
        finite.then_some(sample)
    }

    /// One Runge-Kutta step of the state under the held input.
    fn step(&mut self, h: f64) -> Option<()> {
        let start = self.state;
        // slopes of q, q̇ and, with r = 2, q̈
        let mut sum = [[0.0; MAX_JOINTS]; 3];
        let mut slope = [[0.0; MAX_JOINTS]; 3];
        for (share, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            let mut at = start;
            for d in 0..=self.order {
                for joint in 0..self.joints {
                    Self::derivative(&mut at, d)[joint] += share * h * slope[d][joint];
                }
            }
            if !self.solve(&mut at) {
                return None;
            }
            for d in 0..=self.order {
                slope[d] = *Self::derivative(&mut at, d + 1);
                for joint in 0..self.joints {
                    sum[d][joint] += weight * slope[d][joint];
                }
            }
        }
        for d in 0..=self.order {
            for joint in 0..self.joints {
                Self::derivative(&mut self.state, d)[joint] += h / 6.0 * sum[d][joint];
            }
        }
        Some(())
    }
}

impl<P: Plant> Commanded for PlantSimulator<P> {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        self.feed_forward = *feed_forward;
    }
}

impl<P: Plant> Iterator for PlantSimulator<P> {
    type Item = JointSample;

    fn next(&mut self) -> Option<JointSample> {
        self.next_sample()
    }
}
