//! The simulation against golden data, theorems, and itself.

mod axis;
mod sensors;
mod setpoints;

use crate::support::golden_rows;
use std::array::from_fn;
use thetabus::model::{AutoDiff, DriveInput, JointSample, Manipulator, Motion, PointwiseModel, ServoAxis};
use thetabus::sim::{
    ArmDynamics, ArmParameters, ArmSimulator, ControllerKind, Interpolation, Losses, Machine, MachineSimulator,
    MassSchedule, PositionFeedback, SensorOptions, ServoAxisOptions, Setpoint, SimOptions, Tone, rk4_step,
};

/// The recipe of tests/data/golden/README.md.
fn golden_options() -> SimOptions {
    SimOptions {
        duration_s: 4.0,
        substeps: 20,
        mass_2: MassSchedule::jump(150.0, 2.5, 170.0),
        setpoint: [
            Setpoint::Steps {
                levels_rad: vec![0.0, 0.6, -0.4, 0.8, 0.1, -0.7, 0.5, -0.2],
                dwell_s: 0.5,
                shift_s: 0.0,
            },
            Setpoint::Steps {
                levels_rad: vec![0.0, -0.5, 0.4, 0.7, -0.6, 0.2, 0.9, -0.3],
                dwell_s: 0.7,
                shift_s: 0.25,
            },
        ],
        ..SimOptions::cedro2022()
    }
}

fn run(options: &SimOptions) -> Vec<JointSample> {
    ArmSimulator::new(options)
        .unwrap()
        .take(options.sample_count() as usize)
        .collect()
}

/// A sample in the columns of the golden data.
fn golden_row(sample: &JointSample) -> [f64; 12] {
    let [z, q, dq] = [sample.setpoint, sample.q, sample.dq];
    let [ddq, dddq, u] = [sample.ddq, sample.dddq, sample.input];
    [
        z[0], z[1], q[0], q[1], dq[0], dq[1], ddq[0], ddq[1], dddq[0], dddq[1], u[0], u[1],
    ]
}

#[test]
fn regress_simulated_samples_equal_the_golden_ones() {
    let golden = golden_rows();
    let samples = run(&golden_options());
    assert_eq!((golden.len(), samples.len()), (4000, 4000));
    for column in 0..12 {
        let values = || golden.iter().map(|row| row[column]);
        let range = values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min);
        // From the golden data's recipe: 1e-7 of each column's range, 1e-5 for the jerk.
        let tolerance = if (8..10).contains(&column) { 1e-5 } else { 1e-7 };
        let worst = golden
            .iter()
            .zip(&samples)
            .map(|(row, sample)| (row[column] - golden_row(sample)[column]).abs())
            .fold(0.0, f64::max);
        assert!(worst <= tolerance * range, "column {column}: {worst} of {range}");
    }
}

#[test]
fn prop_rk4_converges_with_order_4() {
    // Harmonic oscillator with a drive: x'' = −x + cos 3t, x(0) = 0, x'(0) = 0; x = (cos t − cos
    // 3t)/8.
    let error = |steps: usize| {
        let h = 2.0 / steps as f64;
        let mut x = [0.0, 0.0];
        for step in 0..steps {
            x = rk4_step(&x, h, |fraction, x| {
                [x[1], -x[0] + (3.0 * h * (step as f64 + fraction)).cos()]
            });
        }
        (x[0] - (2f64.cos() - 6f64.cos()) / 8.0).abs()
    };
    let orders: Vec<f64> = [20, 40, 80]
        .iter()
        .map(|&steps| (error(steps) / error(2 * steps)).log2())
        .collect();
    // The next term of the error makes the observed order differ from 4 by O(h): 0.1 is twice what
    // h = 0.1 gives.
    assert!(orders.iter().all(|order| (order - 4.0).abs() < 0.1), "{orders:?}");
}

#[test]
fn prop_the_closed_loop_converges_with_order_4_in_the_substeps() {
    // A smooth reference, so that the order is not limited by jumps; against 64 sub-steps.
    let sines = |frequency_hz| Setpoint::Sines {
        offset_rad: 0.1,
        tones: vec![Tone {
            frequency_hz,
            amplitude_rad: 0.5,
            phase_rad: 0.3,
        }],
    };
    // A coarse sample period keeps the error above rounding.
    let end = |substeps| {
        let options = SimOptions {
            substeps,
            sample_period_s: 0.01,
            duration_s: 1.0,
            setpoint: [sines(1.3), sines(2.1)],
            ..SimOptions::cedro2022()
        };
        run(&options).pop().unwrap()
    };
    let reference = end(64);
    let error = |substeps| (end(substeps).q[1] - reference.q[1]).abs();
    let order = (error(4) / error(8)).log2();
    // An integrator that held the reference over a sample would show order 1 or not converge at
    // all.
    assert!((order - 4.0).abs() < 0.3, "order {order}");
}

#[test]
fn prop_the_arm_without_motors_keeps_its_energy() {
    let arm = ArmParameters::cedro2022();
    let dynamics = ArmDynamics::new(&arm.with_mass_2(150.0), arm.gravity_m_s2);
    // Let go at 1 rad with both joints moving: link 2 swings freely for 5 s.
    let mut x = [0.0, 1.0, 2.0, -0.5];
    let energy = |x: &[f64; 4]| dynamics.energy([x[0], x[1]], [x[2], x[3]]);
    let (start, h) = (energy(&x), 1e-3);
    let mut worst = 0.0f64;
    for _ in 0..5000 {
        x = rk4_step(&x, h, |_, x| {
            let [a1, a2] = dynamics.accelerations([x[0], x[1]], [x[2], x[3]], [0.0, 0.0]);
            [x[2], x[3], a1, a2]
        });
        worst = worst.max((energy(&x) - start).abs());
    }
    // Swinging through the lowest point turns some 1500 J over with rates of at most 20/s; the
    // method's energy error over time T is about T (ωh)⁵/h/100 relative: 2e-7 here. A wrong sign or
    // factor in any term shows as a change of order 1.
    assert!(worst < 1e-6 * 1500.0, "{worst} J of {start} J");
    assert!((x[1] - 1.0).abs() > 0.01, "the arm did not move");
}

#[test]
fn val_torques_do_the_work_that_the_energy_gains() {
    let arm = ArmParameters::cedro2022();
    let dynamics = ArmDynamics::new(&arm.with_mass_2(150.0), arm.gravity_m_s2);
    let torque = |t: f64| [200.0 * (3.0 * t).sin(), 700.0 + 100.0 * (5.0 * t).cos()];
    // The work ∫ M·q̇ dt rides along as a fifth state.
    let mut x = [0.0, 0.3, 0.0, 0.0, 0.0];
    let energy = |x: &[f64; 5]| dynamics.energy([x[0], x[1]], [x[2], x[3]]);
    let (start, h) = (energy(&x), 1e-3);
    for step in 0..2000 {
        x = rk4_step(&x, h, |fraction, x| {
            let m = torque(h * (step as f64 + fraction));
            let [a1, a2] = dynamics.accelerations([x[0], x[1]], [x[2], x[3]], m);
            [x[2], x[3], a1, a2, m[0] * x[2] + m[1] * x[3]]
        });
    }
    let gained = energy(&x) - start;
    assert!(gained.abs() > 10.0, "hardly any work was done: {gained} J");
    assert!(
        (gained - x[4]).abs() < 1e-7 * gained.abs().max(x[4].abs()),
        "{gained} J, work {} J",
        x[4]
    );
}

#[test]
fn val_derivatives_of_samples_are_the_derivatives_of_the_motion() {
    // A smooth reference and central differences of neighbouring samples: the error is h²/6 of the
    // derivative two orders up.
    let options = SimOptions {
        sample_period_s: 1e-4,
        duration_s: 1.0,
        substeps: 2,
        setpoint: from_fn(|joint| Setpoint::Sines {
            offset_rad: 0.2,
            tones: vec![Tone {
                frequency_hz: 1.0 + joint as f64,
                amplitude_rad: 0.4,
                phase_rad: 0.0,
            }],
        }),
        ..SimOptions::cedro2022()
    };
    let samples = run(&options);
    let h = options.sample_period_s;
    for joint in 0..2 {
        let signals = |s: &JointSample| [s.q[joint], s.dq[joint], s.ddq[joint], s.dddq[joint]];
        for order in 0..3 {
            let peak = samples.iter().map(|s| signals(s)[order + 1].abs()).fold(0.0, f64::max);
            // The start excites the 90 rad/s mode: (90 h)²/6 = 1.4e-5 of the peak; twice that.
            let worst = (1..samples.len() - 1)
                .map(|k| {
                    let slope = (signals(&samples[k + 1])[order] - signals(&samples[k - 1])[order]) / (2.0 * h);
                    (slope - signals(&samples[k])[order + 1]).abs()
                })
                .fold(0.0, f64::max);
            assert!(worst <= 3e-5 * peak, "joint {joint}, order {order}: {worst} of {peak}");
        }
    }
}

fn seeded() -> [Setpoint; 2] {
    [
        Setpoint::Random {
            min_rad: -0.8,
            max_rad: 0.8,
            min_dwell_s: 0.1,
            max_dwell_s: 0.3,
        },
        Setpoint::RandomSines {
            count: 6,
            min_frequency_hz: 0.23,
            max_frequency_hz: 5.3,
            amplitude_rad: 0.8,
        },
    ]
}

#[test]
fn prop_residuals_vanish_at_the_true_parameters_for_every_reference_and_mass_schedule() {
    let arm = Manipulator::default();
    let ramp = MassSchedule {
        points: vec![(0.0, 150.0), (0.2, 150.0), (0.9, 180.0)],
        interpolation: Interpolation::Linear,
    };
    for kind in [ControllerKind::Analog, ControllerKind::Sampled] {
        let mut options = SimOptions {
            duration_s: 1.0,
            mass_2: ramp.clone(),
            setpoint: seeded(),
            ..SimOptions::cedro2022()
        };
        options.controller.kind = kind;
        for (k, sample) in run(&options).iter().enumerate() {
            let theta = options.true_theta(k as f64 * options.sample_period_s);
            let features = arm.features(sample);
            for equation in 0..2 {
                let mut regressor = [0.0; 5];
                let residual = arm.row(equation, &features, &theta, &mut regressor);
                let own = if equation == 0 { &theta[..5] } else { &theta[5..] };
                let scale: f64 = own.iter().zip(regressor).map(|(t, r)| (t * r).abs()).sum::<f64>()
                    + 12.0 * sample.input[equation].abs();
                assert!(
                    residual.abs() <= 1e-12 * (scale + 1.0),
                    "{kind:?} sample {k}: {residual} of {scale}"
                );
            }
        }
    }
}

#[test]
fn val_a_sampled_controller_approaches_the_analog_one_as_its_period_shrinks() {
    // Compared at common instants; the hold delays u by half a period on average, so the difference
    // shrinks with order 1.
    let motion = |kind, per_ms: usize| -> Vec<f64> {
        let mut options = SimOptions {
            sample_period_s: 1e-3 / per_ms as f64,
            duration_s: 0.5,
            setpoint: [Setpoint::constant(0.3), Setpoint::constant(0.4)],
            ..SimOptions::cedro2022()
        };
        options.controller.kind = kind;
        run(&options).iter().step_by(per_ms).map(|sample| sample.q[1]).collect()
    };
    let difference = |per_ms| {
        let (analog, sampled) = (
            motion(ControllerKind::Analog, per_ms),
            motion(ControllerKind::Sampled, per_ms),
        );
        analog
            .iter()
            .zip(&sampled)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    let (coarse, fine) = (difference(8), difference(32));
    assert!(coarse < 0.01, "{coarse}");
    let order = (coarse / fine).log2() / 2.0;
    assert!((order - 1.0).abs() < 0.15, "order {order}");
}

#[test]
fn fault_options_outside_their_domain_are_refused_by_name() {
    type Change = fn(&mut SimOptions);
    let cases: [(&str, Change); 19] = [
        ("sample_period_s", |o| o.sample_period_s = 0.0),
        ("sample_period_s", |o| o.sample_period_s = f64::NAN),
        ("duration_s", |o| o.duration_s = f64::INFINITY),
        ("duration_s", |o| o.duration_s = -1.0),
        ("substeps", |o| o.substeps = 0),
        ("arm.length_2_m", |o| o.arm.length_2_m = 0.0),
        ("arm.winding_inductance_h", |o| o.arm.winding_inductance_h[1] = -0.1),
        ("mass_2.points", |o| o.mass_2.points.clear()),
        ("mass_2.points", |o| o.mass_2.points = vec![(1.0, 150.0)]),
        ("mass_2.points", |o| {
            o.mass_2.points = vec![(0.0, 150.0), (5.0, 160.0), (5.0, 170.0)]
        }),
        ("mass_2.points", |o| o.mass_2.points = vec![(0.0, -1.0)]),
        ("controller.proportional_gain_v_per_rad", |o| {
            o.controller.proportional_gain_v_per_rad[0] = f64::NAN
        }),
        ("setpoint.levels_rad", |o| {
            o.setpoint[0] = Setpoint::Steps {
                levels_rad: vec![],
                dwell_s: 1.0,
                shift_s: 0.0,
            }
        }),
        ("setpoint.dwell_s", |o| {
            o.setpoint[1] = Setpoint::Steps {
                levels_rad: vec![0.0],
                dwell_s: 1e-4,
                shift_s: 0.0,
            }
        }),
        ("setpoint.tones", |o| {
            o.setpoint[1] = Setpoint::Sines {
                offset_rad: 0.0,
                tones: vec![],
            }
        }),
        ("setpoint.table.t_s", |o| {
            let interpolation = Interpolation::Step;
            o.setpoint[0] = Setpoint::Table {
                t_s: vec![1.0, 0.5],
                values_rad: vec![0.0, 0.1],
                interpolation,
            };
        }),
        ("initial_q_rad", |o| o.initial_q_rad[1] = f64::NAN),
        ("sensors.input_noise_v", |o| o.sensors.input_noise_v = -0.05),
        ("sensors.spike_probability", |o| o.sensors.spike_probability = 1.5),
    ];
    for (field, change) in cases {
        let mut options = SimOptions::cedro2022();
        change(&mut options);
        let error = ArmSimulator::new(&options).unwrap_err();
        assert_eq!(error.field, field, "{error}");
        assert!(
            error.to_string().contains("expected") && error.to_string().contains("got"),
            "{error}"
        );
    }
    let mut options = SimOptions::cedro2022();
    options.setpoint[1] = Setpoint::constant(f64::NAN);
    assert_eq!(ArmSimulator::new(&options).unwrap_err().joint, Some(1));
}

#[test]
fn fault_a_loop_that_is_unstable_ends_instead_of_giving_numbers_that_are_not_finite() {
    let mut options = SimOptions {
        duration_s: 100.0,
        ..SimOptions::cedro2022()
    };
    options.controller.kind = ControllerKind::Sampled;
    options.controller.derivative_gain_v_s_per_rad = [1e6; 2];
    let samples = run(&options);
    assert!((samples.len() as u64) < options.sample_count());
    assert!(samples.iter().all(|sample| sample.q[..2].iter().all(|q| q.is_finite())));
}
