//! The estimators on a run of the servo axis, and its Cramér–Rao bound.

use super::estimators::{Contest, Outcome, Published};
use super::instruments::{Regression, derivatives, held_means, refined};
use super::prediction::{Record, Start};
use crate::messages::Sample;
use crate::model::{JointSample, SERVO_PARAMS};
use crate::node::simulated_plant::sample_stream;
use crate::sim::{Machine, MachineSimulator, MassSchedule, SensorOptions, ServoAxisOptions, SimOptions};
use crate::studies::CompareError;
use crate::studies::states::{AXIS_STATES, AxisStates, JointCovariance, SensorVariance, StateSpace};
use nalgebra::SVector;

type Theta = SVector<f64, SERVO_PARAMS>;

/// Standard deviation of the prior, relative.
const PRIOR: f64 = 0.5;
/// Standard deviations of q and v at the start \[m, m/s\], which count as unknown.
const UNKNOWN: [f64; AXIS_STATES] = [1e-3, 0.1];
/// Standard deviation of the offset at the start \[N\], the only parameter of either sign: as large
/// as friction.
const OFFSET_STD: f64 = 20.0;
/// Edge of the low-pass before differentiation \[Hz\].
const DIFFERENTIATED_HZ: f64 = 100.0;
/// Edge of the low-pass over both sides of the equation \[Hz\].
const EQUATION_HZ: f64 = 30.0;
/// Samples at either end that the filters need.
const ENDS: usize = 200;
/// Speed below which there is standstill or a reversal \[m/s\], and the number of samples around it
/// that also count.
const SLOW: f64 = 2e-3;
const AROUND: usize = 25;

/// Runs every estimator on the axis with a sampled controller; `start` are the start values of θ,
/// `identify` is our estimator and receives all samples.
///
/// With an analog controller the input between samples is not recorded: states computed with a held
/// input are then wrong by more than the bound.
///
/// # Errors
/// If the simulation's options are invalid.
pub fn axis_run(
    sim: &SimOptions,
    axis: &ServoAxisOptions,
    start: &[f64],
    identify: impl FnOnce(&[Sample]) -> Option<Published>,
) -> Result<Outcome, CompareError> {
    let mut plant = sample_stream(sim, 1)?;
    let samples: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).collect();
    let measured: Vec<JointSample> = samples.iter().map(Sample::joint_sample).collect();
    let count = measured.len();
    let record = Record {
        positions: measured.iter().map(|s| [s.q[0]]).collect(),
        inputs: measured.iter().map(|s| [s.input[0]].into()).collect(),
        variance: SensorVariance {
            position: axis.position_resolution.powi(2) / 12.0 + sim.sensors.position_noise_rad.powi(2),
            input: sim.sensors.input_noise_v.powi(2),
        },
    };
    let machine = AxisStates {
        gain: axis.gain,
        sample_period_s: sim.sample_period_s,
    };
    let truth = Theta::from(axis.true_theta(0.0));
    let equation = regression(sim, axis, &measured);
    let least_squares = equation.solve(&equation);
    let contest = Contest {
        machine: &machine,
        record: &record,
        start: Start {
            state: SVector::zeros(),
            state_std: SVector::from(UNKNOWN),
            theta: Theta::from_fn(|i, _| start.get(i).copied().unwrap_or(f64::NAN)),
            either_sign: Theta::from([0.0, 0.0, 0.0, OFFSET_STD]),
        },
        truth,
        least_squares,
        instruments: refined(least_squares, |theta| {
            equation.solve(&regression(sim, axis, &noiseless(sim, axis, theta, count)?))
        }),
    };
    let exact = noiseless(sim, axis, &truth, count).unwrap_or_default();
    let bound = bound(machine, &truth, record.variance, &exact);
    Ok(contest.outcome(bound, identify(&samples)))
}

/// The axis with these parameters, without noise; `None` if they are no valid machine.
fn noiseless(sim: &SimOptions, axis: &ServoAxisOptions, theta: &Theta, count: usize) -> Option<Vec<JointSample>> {
    let axis = ServoAxisOptions {
        mass: MassSchedule::constant(theta[0]),
        viscous_friction: theta[1],
        coulomb_friction: theta[2],
        offset: theta[3],
        position_resolution: 0.0,
        ..axis.clone()
    };
    let ideal = SimOptions {
        sensors: SensorOptions::exact(),
        machine: Machine::ServoAxis(axis),
        ..sim.clone()
    };
    let samples: Vec<JointSample> = MachineSimulator::new(&ideal).ok()?.take(count).collect();
    (samples.len() == count).then_some(samples)
}

/// The covariance recursion along the true motion, see
/// [`CramerRaoBound`](crate::studies::trials::CramerRaoBound), from an unknown initial state.
fn bound(machine: AxisStates, theta: &Theta, variance: SensorVariance, exact: &[JointSample]) -> Vec<f64> {
    let prior = theta.map(|value| PRIOR * value.abs());
    let mut covariance = JointCovariance::independent(&SVector::from(UNKNOWN), &prior);
    for sample in exact {
        covariance.measure(AxisStates::POSITIONS[0], variance.position);
        let state = SVector::from([sample.q[0], sample.dq[0]]);
        let (_, jacobian) = machine.advance(&state, theta, &[sample.input[0]].into());
        covariance.propagate(&jacobian, variance.input);
    }
    covariance.theta_std().as_slice().to_vec()
}

/// M q̈ + F_v q̇ + F_c sign q̇ + b = k u over a run, for the samples in motion.
fn regression(sim: &SimOptions, axis: &ServoAxisOptions, samples: &[JointSample]) -> Regression<SERVO_PARAMS> {
    let h = sim.sample_period_s;
    let [_, dq, ddq, _] = derivatives(samples.iter().map(|s| s.q[0]).collect(), DIFFERENTIATED_HZ, h);
    let count = samples.len();
    let slow: Vec<bool> = dq.iter().map(|v| v.abs() < SLOW).collect();
    let counts = (0..count)
        .map(|k| k >= ENDS && k + ENDS < count && !slow[k - AROUND..=k + AROUND].contains(&true))
        .collect();
    Regression {
        columns: [
            ddq,
            dq.clone(),
            dq.iter().map(|v| v.signum()).collect(),
            vec![1.0; count],
        ],
        y: held_means(samples.iter().map(|s| axis.gain * s.input[0])),
        counts,
    }
    .smoothed(EQUATION_HZ, h)
}
