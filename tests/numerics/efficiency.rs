//! Machines as first-order equations against their simulators, and the Cramér–Rao bound against an
//! estimator that reaches it.

use nalgebra::SVector;
use thetabus::config::{Config, Source};
use thetabus::sim::{Machine, MachineSimulator, SensorOptions, ServoAxisOptions, SimOptions};
use thetabus::studies::efficiency::{KNOWABLE, Method, Outcome, arm_run, axis_run};
use thetabus::studies::for_each_index;
use thetabus::studies::states::{ArmStates, AxisStates, Jacobian, StateSpace};
use thetabus::studies::trials::{AxisMotion, AxisSpec, Disturbance, Motion, TrialSpec};

fn load(basis: &str, settings: &[String]) -> Config {
    let sources: Vec<Source> = Config::embedded(basis).into_iter().collect();
    Config::load(&sources, settings).unwrap()
}

/// The servo axis under a sampled controller, whose input is held, and the values to start from.
fn axis_sim(motion: AxisMotion, seed: u64, blocks: u64) -> (SimOptions, ServoAxisOptions, Vec<f64>) {
    let mut settings = AxisSpec {
        motion,
        disturbance: Disturbance::None,
        blocks,
        seed,
    }
    .settings();
    settings.push("plant.controller.kind=\"sampled\"".to_owned());
    settings.push("identifier.projected.timing=\"held\"".to_owned());
    let config = load("servo_axis", &settings);
    let Machine::ServoAxis(axis) = config.plant.sim.machine.clone() else {
        panic!("servo_axis.toml simulates a servo axis");
    };
    (config.plant.sim, axis, config.estimator.options.theta_start())
}

/// Central differences of everything that a Jacobian holds.
fn differences<const X: usize, const P: usize, const U: usize>(
    machine: &impl StateSpace<X, P, U>,
    x: SVector<f64, X>,
    theta: SVector<f64, P>,
    input: SVector<f64, U>,
    step: f64,
) -> Jacobian<X, P, U> {
    let mut jacobian = machine.advance(&x, &theta, &input).1;
    let of = |dx: SVector<f64, X>, dtheta: SVector<f64, P>, du: SVector<f64, U>, size: f64| {
        let ahead = machine.advance(&(x + dx), &(theta + dtheta), &(input + du)).0;
        let behind = machine.advance(&(x - dx), &(theta - dtheta), &(input - du)).0;
        (ahead - behind) / (2.0 * size)
    };
    let (no_x, no_theta, no_u) = (SVector::zeros(), SVector::zeros(), SVector::zeros());
    for i in 0..X {
        let size = step * x[i].abs().max(1e-3);
        let mut dx = no_x;
        dx[i] = size;
        jacobian.state.set_column(i, &of(dx, no_theta, no_u, size));
    }
    for i in 0..P {
        let size = step * theta[i].abs();
        let mut dtheta = no_theta;
        dtheta[i] = size;
        jacobian.theta.set_column(i, &of(no_x, dtheta, no_u, size));
    }
    for i in 0..U {
        let mut du = no_u;
        du[i] = step;
        jacobian.input.set_column(i, &of(no_x, no_theta, du, step));
    }
    jacobian
}

fn assert_close<const X: usize, const P: usize, const U: usize>(
    got: &Jacobian<X, P, U>,
    expected: &Jacobian<X, P, U>,
    tolerance: f64,
    at: &str,
) {
    let all = |j: &Jacobian<X, P, U>| -> Vec<(usize, f64)> {
        let rows = |m: Vec<f64>| m.into_iter().enumerate().map(|(k, v)| (k % X, v)).collect::<Vec<_>>();
        [
            rows(j.state.iter().copied().collect()),
            rows(j.theta.iter().copied().collect()),
            rows(j.input.iter().copied().collect()),
        ]
        .concat()
    };
    let expected = all(expected);
    let scale = |row: usize| {
        expected
            .iter()
            .filter(|(r, _)| *r == row)
            .map(|(_, v)| v.abs())
            .fold(0.0, f64::max)
    };
    for ((row, got), (_, expected)) in all(got).into_iter().zip(&expected) {
        assert!(
            (got - expected).abs() <= tolerance * scale(row),
            "{at}: row {row}, {got} instead of {expected}"
        );
    }
}

/// From each of the simulator's own states to the next one. 1e-3 s are 1/468 of the axis' time
/// constant M/F_v, and no acceleration is above 10 m/s²: what the series leaves out of the velocity,
/// 10 Δ (Δ F_v/M)³/24, is below 1e-12 m/s. The simulator halves its way to a stop to 1e-12 of a
/// substep, the velocity there to 1e-15 m/s. 1e-11 leaves room for rounding.
#[test]
fn val_the_axis_moves_as_its_simulator_does_stops_and_reversals_included() {
    let (sim, axis, _) = axis_sim(AxisMotion::Square, 3, 5);
    let exact = SimOptions {
        sensors: SensorOptions::exact(),
        machine: Machine::ServoAxis(ServoAxisOptions {
            position_resolution: 0.0,
            ..axis.clone()
        }),
        ..sim.clone()
    };
    let machine = AxisStates {
        gain: axis.gain,
        sample_period_s: sim.sample_period_s,
    };
    let theta = SVector::from(axis.true_theta(0.0));
    let samples: Vec<_> = MachineSimulator::new(&exact).unwrap().take(9500).collect();
    let (mut stopped, mut reversed) = (0, 0);
    for pair in samples.windows(2) {
        let (now, next) = (&pair[0], &pair[1]);
        let x = SVector::from([now.q[0], now.dq[0]]);
        let (ahead, _) = machine.advance(&x, &theta, &SVector::from([now.input[0]]));
        for (ahead, next) in [(ahead[0], next.q[0]), (ahead[1], next.dq[0])] {
            assert!((ahead - next).abs() < 1e-11, "{ahead} instead of {next}");
        }
        stopped += u32::from(now.dq[0] != 0.0 && next.dq[0] == 0.0);
        reversed += u32::from(now.dq[0] * next.dq[0] < 0.0);
    }
    assert!(stopped + reversed > 5, "{stopped} stops, {reversed} reversals");
}

/// Duals carry the instant of a stop or reversal along; differences with 1e-6 are right to 1e-6 or
/// so if nothing but this instant moves.
#[test]
fn val_jacobians_are_those_of_central_differences() {
    let axis = AxisStates {
        gain: 35.0,
        sample_period_s: 1e-3,
    };
    let theta = SVector::from([95.0, 203.0, 20.0, -3.0]);
    for (name, v, u) in [
        ("moving", 0.1, 1.0),
        ("back", -0.1, 2.0),
        ("reversing", 1e-3, -5.0),
        ("stopping", 1e-4, 0.0),
        ("setting off", 0.0, 3.0),
    ] {
        let (x, input) = (SVector::from([0.01, v]), SVector::from([u]));
        let got = axis.advance(&x, &theta, &input).1;
        // from rest a step of the state changes the direction of friction: no derivative in it
        let expected = differences(&axis, x, theta, input, 1e-6);
        if name == "setting off" {
            assert_close(
                &Jacobian {
                    state: expected.state,
                    ..got
                },
                &expected,
                1e-5,
                name,
            );
        } else {
            assert_close(&got, &expected, 1e-5, name);
        }
    }
    let sim = SimOptions::cedro2022();
    let arm = ArmStates {
        gravity_m_s2: 9.81,
        sample_period_s: 1e-3,
    };
    let theta = SVector::from(sim.true_theta(0.0));
    let x = SVector::from([0.3, 0.2, 1.0, -0.5, 0.1, 2.0]);
    let input = SVector::from([20.0, -30.0]);
    let got = arm.advance(&x, &theta, &input).1;
    assert_close(&got, &differences(&arm, x, theta, input, 1e-5), 1e-6, "arm");
}

/// Root mean square of error over bound, of prediction errors and of the parameters that count in
/// the tables.
fn lost_by_prediction_errors(outcomes: &[Outcome]) -> f64 {
    let knowable: Vec<usize> = (0..outcomes[0].truth.len())
        .filter(|&i| outcomes.iter().all(|run| run.bound[i] < KNOWABLE * run.truth[i].abs()))
        .collect();
    assert!(knowable.len() >= 4, "{knowable:?}");
    let ratios = outcomes.iter().flat_map(|run| {
        knowable
            .iter()
            .map(|&i| run.ratio(Method::PredictionError, i).expect("it settles"))
    });
    (ratios.map(|ratio| ratio * ratio).sum::<f64>() / (outcomes.len() * knowable.len()) as f64).sqrt()
}

/// Maximum likelihood reaches the bound, and nothing without bias is below it. Forty errors, of
/// which some hang together, tell a root mean square to 15 % or so: 0.6 to 1.5 are three of these
/// standard deviations.
#[test]
fn val_prediction_errors_reach_the_bound_of_the_servo_axis() {
    let outcomes = for_each_index(10, |seed| {
        let (sim, axis, start) = axis_sim(AxisMotion::Sines, seed as u64, 4);
        axis_run(&sim, &axis, &start, |_| None).unwrap()
    });
    let lost = lost_by_prediction_errors(&outcomes);
    assert!((0.6..1.5).contains(&lost), "{lost}");
}

/// The same for the arm. The bound has a prior of half of each parameter's size, of which the
/// likelihood knows nothing; that matters for what the run does not tell to 1 %, θ₁ … θ₄.
#[test]
fn val_prediction_errors_reach_the_bound_of_the_arm() {
    let outcomes = for_each_index(8, |seed| {
        let spec = TrialSpec {
            blocks: 5,
            ..TrialSpec::new(Motion::MinimumJerk, seed as u64)
        };
        let mut settings = spec.settings();
        settings.push("plant.mass_2.t_s=[0.0]".to_owned());
        settings.push("plant.mass_2.mass_kg=[150.0]".to_owned());
        let config = load("encoder_only", &settings);
        arm_run(&config.plant.sim, &config.estimator.options.theta_start(), |_| None).unwrap()
    });
    let lost = lost_by_prediction_errors(&outcomes);
    assert!((0.6..1.5).contains(&lost), "{lost}");
}
