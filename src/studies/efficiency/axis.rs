//! The estimators on a run of the servo axis, and its Cramér–Rao bound.

use super::instruments::{ROUNDS, Regression, derivatives};
use super::prediction::{Record, Start, augmented_filter, maximum_likelihood};
use super::{Outcome, Published, finite};
use crate::messages::Sample;
use crate::model::{JointSample, SERVO_PARAMS};
use crate::node::simulated_plant::sample_stream;
use crate::sim::{
    ControllerKind, Machine, MachineSimulator, MassSchedule, SensorOptions, ServoAxisOptions, SimOptions,
};
use crate::studies::CompareError;
use crate::studies::states::{AXIS_STATES, AxisStates, JointCovariance, SensorVariance, StateSpace};
use nalgebra::SVector;

type Theta = SVector<f64, SERVO_PARAMS>;

/// Standard deviation of the prior, relative.
const PRIOR: f64 = 0.5;
/// Standard deviation of each state at the start if it is known.
const KNOWN: f64 = 1e-10;
/// The same of q and v if it is not \[m, m/s\].
const UNKNOWN: [f64; AXIS_STATES] = [1e-3, 0.1];
/// Edge of the low-pass before differentiation \[Hz\].
const DIFFERENTIATED_HZ: f64 = 100.0;
/// Edge of the low-pass over both sides of the equation \[Hz\].
const EQUATION_HZ: f64 = 30.0;
/// Samples at either end that the filters need.
const ENDS: usize = 200;
/// Slower is standstill or a reversal \[m/s\], and so are the samples within this distance.
const SLOW: f64 = 2e-3;
const NEAR: usize = 25;

/// Runs every estimator on the axis; `identify` is ours.
///
/// # Errors
/// The simulation's options are not valid.
pub fn axis_run(
    sim: &SimOptions,
    axis: &ServoAxisOptions,
    start: &[f64],
    identify: impl FnOnce(&[Sample]) -> Option<Published>,
) -> Result<Outcome, CompareError> {
    let mut plant = sample_stream(sim, 1)?;
    let samples: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).collect();
    let measured: Vec<JointSample> = samples.iter().map(Sample::joint_sample).collect();
    let variance = SensorVariance {
        position: axis.position_resolution.powi(2) / 12.0 + sim.sensors.position_noise_rad.powi(2),
        input: sim.sensors.input_noise_v.powi(2),
    };
    let record = Record {
        positions: measured.iter().map(|s| [s.q[0]]).collect(),
        inputs: mean_inputs(sim, &measured),
        variance,
    };
    let exact_input = Record {
        variance: SensorVariance { input: 0.0, ..variance },
        ..record.clone()
    };
    let theta = Theta::from_fn(|i, _| start.get(i).copied().unwrap_or(f64::NAN));
    let start = Start {
        state: SVector::zeros(),
        state_std: SVector::from(UNKNOWN),
        theta,
        // the offset alone has either sign: as uncertain as friction is large
        either_sign: Theta::from([0.0, 0.0, 0.0, 20.0]),
    };
    let machine = AxisStates {
        gain: axis.gain,
        sample_period_s: sim.sample_period_s,
    };
    let [bound, bound_unknown_start] = bounds(sim, axis, machine, variance, measured.len())?;
    let ours = identify(&samples);
    let equation = regression(sim, axis, &measured);
    let least_squares = equation.solve(&equation);
    let mut instruments = least_squares;
    for _ in 0..ROUNDS {
        instruments = instruments.and_then(|theta| {
            let simulated = simulate(sim, axis, &theta, measured.len())?;
            equation.solve(&regression(sim, axis, &simulated))
        });
    }
    let found = |theta: Option<Theta>| theta.and_then(|theta| finite(theta.as_slice()));
    Ok(Outcome {
        truth: axis.true_theta(0.0).to_vec(),
        bound,
        bound_unknown_start,
        estimates: [
            ours.as_ref().and_then(|published| finite(&published.theta)),
            found(Some(augmented_filter(&machine, &record, &start))),
            found(maximum_likelihood(&machine, &record, &start)),
            found(maximum_likelihood(&machine, &exact_input, &start)),
            found(least_squares),
            found(instruments),
        ],
        own_std: ours.map(|published| published.std).unwrap_or_default(),
    })
}

/// The input from each sample to the next: held, or on its way to the next one; a step of the setpoint belongs to what follows it.
fn mean_inputs(sim: &SimOptions, samples: &[JointSample]) -> Vec<SVector<f64, 1>> {
    let steps = sim.setpoint[0].has_steps();
    (0..samples.len())
        .map(|k| {
            let (now, next) = (&samples[k], samples.get(k + 1).unwrap_or(&samples[k]));
            let jumps = steps && next.setpoint[0] != now.setpoint[0];
            let held = sim.controller.kind == ControllerKind::Sampled || jumps;
            let end = if held { now.input[0] } else { next.input[0] };
            SVector::from([0.5 * (now.input[0] + end)])
        })
        .collect()
}

/// The axis with these parameters, everything known of it: a noiseless run; none if that is no machine.
fn simulate(sim: &SimOptions, axis: &ServoAxisOptions, theta: &Theta, count: usize) -> Option<Vec<JointSample>> {
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

/// The covariance recursion along the true motion, see [`CramerRaoBound`](crate::studies::trials::CramerRaoBound): standard deviations with a start that is known, and that is not.
///
/// The analog controller's input runs between samples; the noise of its mean over a period counts as independent from period to period, as for a held one.
fn bounds(
    sim: &SimOptions,
    axis: &ServoAxisOptions,
    machine: AxisStates,
    variance: SensorVariance,
    count: usize,
) -> Result<[Vec<f64>; 2], CompareError> {
    let theta = Theta::from(axis.true_theta(0.0));
    let prior = theta.map(|value| PRIOR * value.abs());
    let ideal = SimOptions {
        sensors: SensorOptions::exact(),
        machine: Machine::ServoAxis(ServoAxisOptions {
            position_resolution: 0.0,
            ..axis.clone()
        }),
        ..sim.clone()
    };
    let samples: Vec<JointSample> = MachineSimulator::new(&ideal)?.take(count).collect();
    let inputs = mean_inputs(&ideal, &samples);
    Ok([SVector::repeat(KNOWN), SVector::from(UNKNOWN)].map(|start| {
        let mut covariance = JointCovariance::independent(&start, &prior);
        for (sample, input) in samples.iter().zip(&inputs) {
            covariance.measure(AxisStates::POSITIONS[0], variance.position);
            let state = SVector::from([sample.q[0], sample.dq[0]]);
            let (_, jacobian) = machine.advance(&state, &theta, input);
            covariance.propagate(&jacobian, variance.input);
        }
        (0..SERVO_PARAMS)
            .map(|i| covariance.theta[(i, i)].max(0.0).sqrt())
            .collect()
    }))
}

/// M q̈ + F_v q̇ + F_c sign q̇ + b = k u over a run, where the axis moves.
fn regression(sim: &SimOptions, axis: &ServoAxisOptions, samples: &[JointSample]) -> Regression<SERVO_PARAMS> {
    let h = sim.sample_period_s;
    let [_, dq, ddq, _] = derivatives(samples.iter().map(|s| s.q[0]).collect(), DIFFERENTIATED_HZ, h);
    let count = samples.len();
    let slow: Vec<bool> = dq.iter().map(|v| v.abs() < SLOW).collect();
    let counts = (0..count)
        .map(|k| k >= ENDS && k + ENDS < count && !slow[k - NEAR..=k + NEAR].contains(&true))
        .collect();
    Regression {
        columns: [
            ddq,
            dq.clone(),
            dq.iter().map(|v| v.signum()).collect(),
            vec![1.0; count],
        ],
        y: samples.iter().map(|s| axis.gain * s.input[0]).collect(),
        counts,
    }
    .smoothed(EQUATION_HZ, h)
}
