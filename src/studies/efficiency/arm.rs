//! The estimators on a run of the arm.

use super::estimators::{Contest, Outcome, Published};
use super::instruments::{Regression, derivatives, held_means, refined};
use super::prediction::{Record, Start};
use crate::messages::Sample;
use crate::model::{JointSample, MANIPULATOR_PARAMS, Manipulator, PointwiseModel};
use crate::node::simulated_plant::sample_stream;
use crate::sim::SimOptions;
use crate::studies::CompareError;
use crate::studies::states::{ArmStates, SensorVariance, StateSpace};
use crate::studies::trials::CramerRaoBound;
use nalgebra::SVector;

type Theta = SVector<f64, MANIPULATOR_PARAMS>;

/// Edge of the low-pass before differentiation \[Hz\]: the arm resonates near 13 Hz.
const DIFFERENTIATED_HZ: f64 = 60.0;
/// Edge of the low-pass over both sides of an equation \[Hz\].
const EQUATION_HZ: f64 = 15.0;
/// Samples at either end that the filters need.
const ENDS: usize = 200;
/// Standard deviations of the state at the start: rad, and p and a in their units, beyond what the
/// arm reaches.
const STATE_STD: [f64; 6] = [1e-3, 1.0, 10.0, 1e-3, 1.0, 10.0];

/// Runs every estimator on the arm with its sampled controller; `start` are the start values of θ,
/// `identify` is our estimator and receives all samples.
///
/// # Errors
/// If the simulation's options are invalid.
pub fn arm_run(
    sim: &SimOptions,
    start: &[f64],
    identify: impl FnOnce(&[Sample]) -> Option<Published>,
) -> Result<Outcome, CompareError> {
    let mut plant = sample_stream(sim, 1)?;
    let samples: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).collect();
    let variance = SensorVariance {
        position: sim.sensors.resolution_rad().powi(2) / 12.0 + sim.sensors.position_noise_rad.powi(2),
        input: sim.sensors.input_noise_v.powi(2),
    };
    let mut bound = CramerRaoBound::new(sim, variance.position.sqrt(), sim.sensors.input_noise_v).with_unknown_start();
    for sample in &samples {
        bound.advance([sample.setpoint[0], sample.setpoint[1]]);
    }
    let machine = ArmStates {
        gravity_m_s2: sim.arm.gravity_m_s2,
        sample_period_s: sim.sample_period_s,
    };
    let record = Record {
        positions: samples.iter().map(|s| [s.q[0], s.q[1]]).collect(),
        inputs: samples.iter().map(|s| [s.input[0], s.input[1]].into()).collect(),
        variance,
    };
    let regression = ArmRegression::new(sim, machine, &samples);
    let least_squares = regression.solve(None);
    let contest = Contest {
        machine: &machine,
        record: &record,
        start: Start {
            state: SVector::zeros(),
            state_std: SVector::from(STATE_STD),
            theta: Theta::from_fn(|i, _| start.get(i).copied().unwrap_or(f64::NAN)),
            either_sign: Theta::zeros(),
        },
        truth: Theta::from(sim.true_theta(0.0)),
        least_squares,
        instruments: refined(least_squares, |theta| regression.solve(Some(theta))),
    };
    Ok(contest.outcome(bound.std().to_vec(), identify(&samples)))
}

/// Both equations of a run, linear in θ₁ … θ₅ and θ₆, θ₇, θ₈, θ₆θ₉, θ₇θ₉.
struct ArmRegression<'a> {
    sim: &'a SimOptions,
    machine: ArmStates,
    setpoints: Vec<[f64; 2]>,
    equations: [Regression<5>; 2],
}

impl<'a> ArmRegression<'a> {
    fn new(sim: &'a SimOptions, machine: ArmStates, samples: &[Sample]) -> Self {
        let positions: Vec<[f64; 2]> = samples.iter().map(|s| [s.q[0], s.q[1]]).collect();
        let voltages = [0, 1].map(|joint| held_means(samples.iter().map(|s| s.input[joint])));
        Self {
            sim,
            machine,
            setpoints: samples.iter().map(|s| [s.setpoint[0], s.setpoint[1]]).collect(),
            equations: equations(sim, &positions, &voltages),
        }
    }

    /// θ by least squares, or with the instruments of a simulation with another θ.
    fn solve(&self, simulated_with: Option<&Theta>) -> Option<Theta> {
        let instruments = match simulated_with {
            None => self.equations.clone(),
            Some(theta) => {
                let positions = self.simulate(theta)?;
                let voltages = [0, 1].map(|_| vec![0.0; positions.len()]);
                equations(self.sim, &positions, &voltages)
            }
        };
        let one = self.equations[0].solve(&instruments[0])?;
        let two = self.equations[1].solve(&instruments[1])?;
        let theta_9 = two[4] / two[1];
        Some(Theta::from([
            one[0], one[1], one[2], one[3], one[4], two[0], two[1], two[2], theta_9,
        ]))
    }

    /// Positions without noise for the recorded setpoints; `None` if the loop is unstable with this
    /// θ.
    fn simulate(&self, theta: &Theta) -> Option<Vec<[f64; 2]>> {
        let controller = &self.sim.controller;
        let mut x = self.machine.at_rest(self.sim.initial_q_rad, theta);
        let mut positions = Vec::with_capacity(self.setpoints.len());
        for setpoint in &self.setpoints {
            let q = ArmStates::POSITIONS.map(|place| x[place]);
            if !q.iter().all(|q| q.abs() < 10.0) {
                return None;
            }
            positions.push(q);
            let dq = ArmStates::velocities(&x, theta);
            let input: [f64; 2] = std::array::from_fn(|j| {
                controller.proportional_gain_v_per_rad[j] * (setpoint[j] - q[j])
                    - controller.derivative_gain_v_s_per_rad[j] * dq[j]
            });
            x = self.machine.advance(&x, theta, &input.into()).0;
        }
        Some(positions)
    }
}

/// (26) over a run, both sides low-pass filtered.
fn equations(sim: &SimOptions, positions: &[[f64; 2]], voltages: &[Vec<f64>; 2]) -> [Regression<5>; 2] {
    let h = sim.sample_period_s;
    let joints = [0, 1].map(|joint| derivatives(positions.iter().map(|q| q[joint]).collect(), DIFFERENTIATED_HZ, h));
    let model = Manipulator::new(sim.arm.gravity_m_s2).unwrap_or_default();
    let features: Vec<_> = (0..positions.len())
        .map(|k| {
            let mut sample = JointSample::default();
            for (joint, [q, dq, ddq, dddq]) in joints.iter().enumerate() {
                (sample.q[joint], sample.dq[joint]) = (q[k], dq[k]);
                (sample.ddq[joint], sample.dddq[joint]) = (ddq[k], dddq[k]);
                sample.input[joint] = voltages[joint][k];
            }
            model.features(&sample)
        })
        .collect();
    let count = positions.len();
    [0, 1].map(|equation| {
        Regression {
            columns: std::array::from_fn(|i| features.iter().map(|f| f.linear_row(equation).0[i]).collect()),
            y: features.iter().map(|f| f.linear_row(equation).1).collect(),
            counts: (0..count).map(|k| k >= ENDS && k + ENDS < count).collect(),
        }
        .smoothed(EQUATION_HZ, h)
    })
}
