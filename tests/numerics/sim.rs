//! The simulation against golden data, theorems, and itself.

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

fn every_setpoint() -> Vec<Setpoint> {
    let [random, random_sines] = seeded();
    let table = |interpolation| Setpoint::Table {
        t_s: vec![0.1, 0.25, 0.6],
        values_rad: vec![0.2, -0.3, 0.4],
        interpolation,
    };
    vec![
        random,
        random_sines,
        Setpoint::Steps {
            levels_rad: vec![0.1, -0.4],
            dwell_s: 0.2,
            shift_s: 0.05,
        },
        Setpoint::Square {
            amplitude_rad: 0.3,
            offset_rad: 0.1,
            period_s: 0.3,
            shift_s: 0.0,
        },
        Setpoint::Sines {
            offset_rad: 0.0,
            tones: vec![Tone {
                frequency_hz: 2.0,
                amplitude_rad: 0.4,
                phase_rad: 1.0,
            }],
        },
        Setpoint::Chirp {
            amplitude_rad: 0.3,
            offset_rad: 0.0,
            start_frequency_hz: 0.5,
            end_frequency_hz: 8.0,
            sweep_s: 0.7,
        },
        Setpoint::Chirp {
            amplitude_rad: 0.3,
            offset_rad: 0.0,
            start_frequency_hz: 2.0,
            end_frequency_hz: 2.0,
            sweep_s: 0.7,
        },
        table(Interpolation::Step),
        table(Interpolation::Linear),
        Setpoint::constant(0.2),
    ]
}

#[test]
fn prop_every_setpoint_is_the_same_bytes_for_the_same_seed_and_only_the_seeded_ones_change_with_it() {
    for (kind, setpoint) in every_setpoint().into_iter().enumerate() {
        let options = |seed, duration_s| SimOptions {
            seed,
            duration_s,
            setpoint: [setpoint.clone(), setpoint.clone()],
            ..SimOptions::cedro2022()
        };
        let bytes = |options: &SimOptions| -> Vec<[u64; 12]> {
            run(options)
                .iter()
                .map(|sample| golden_row(sample).map(f64::to_bits))
                .collect()
        };
        let first = bytes(&options(7, 1.0));
        assert_eq!(first, bytes(&options(7, 1.0)), "{setpoint:?}");
        // A longer run begins with the same samples.
        assert_eq!(first[..], bytes(&options(7, 1.5))[..1000], "{setpoint:?}");
        assert_eq!(first != bytes(&options(8, 1.0)), kind < 2, "{setpoint:?}");
        if kind < 2 {
            // The two joints draw from streams of their own.
            assert!(first.iter().any(|row| row[0] != row[1]), "{setpoint:?}");
        }
    }
}

fn setpoints_of(setpoint: Setpoint, duration_s: f64) -> Vec<f64> {
    let options = SimOptions {
        duration_s,
        setpoint: [setpoint.clone(), setpoint],
        ..SimOptions::cedro2022()
    };
    run(&options).iter().map(|sample| sample.setpoint[0]).collect()
}

#[test]
fn val_setpoints_have_the_values_that_their_options_say() {
    let steps = setpoints_of(
        Setpoint::Steps {
            levels_rad: vec![0.1, -0.4],
            dwell_s: 0.2,
            shift_s: 0.05,
        },
        0.5,
    );
    let expected = |k: usize| if (k + 50) % 400 < 200 { 0.1 } else { -0.4 };
    assert!(steps.iter().enumerate().all(|(k, &z)| z == expected(k)));

    let square = setpoints_of(
        Setpoint::Square {
            amplitude_rad: 0.3,
            offset_rad: 0.1,
            period_s: 0.3,
            shift_s: 0.0,
        },
        0.5,
    );
    assert!(
        square
            .iter()
            .enumerate()
            .all(|(k, &z)| z == if k / 150 % 2 == 0 { 0.1 + 0.3 } else { 0.1 - 0.3 })
    );

    let table = |interpolation| Setpoint::Table {
        t_s: vec![0.1, 0.25, 0.6],
        values_rad: vec![0.2, -0.3, 0.4],
        interpolation,
    };
    let held = setpoints_of(table(Interpolation::Step), 0.8);
    assert_eq!(
        [held[0], held[249], held[250], held[599], held[600], held[799]],
        [0.2, 0.2, -0.3, -0.3, 0.4, 0.4]
    );
    let line = setpoints_of(table(Interpolation::Linear), 0.8);
    for (k, expected) in [
        (0, 0.2),
        (100, 0.2),
        (175, -0.05),
        (250, -0.3),
        (425, 0.05),
        (600, 0.4),
        (799, 0.4),
    ] {
        assert!((line[k] - expected).abs() < 1e-12, "{k}: {} {expected}", line[k]);
    }

    // Zero crossings upward count the periods: the chirp's phase integral is sweep (f₁ −
    // f₀)/ln(f₁/f₀).
    let chirp = Setpoint::Chirp {
        amplitude_rad: 1.0,
        offset_rad: 0.0,
        start_frequency_hz: 1.0,
        end_frequency_hz: 8.0,
        sweep_s: 10.0,
    };
    let chirp = setpoints_of(chirp, 10.0);
    let crossings = chirp.windows(2).filter(|pair| pair[0] < 0.0 && pair[1] >= 0.0).count() as f64;
    assert!(
        (crossings - (10.0 * 7.0 / 8f64.ln()).floor()).abs() <= 1.0,
        "{crossings}"
    );

    for seed in 0..5 {
        let [random, sines] = seeded();
        let options = SimOptions {
            seed,
            duration_s: 20.0,
            setpoint: [random, sines],
            ..SimOptions::cedro2022()
        };
        let samples = run(&options);
        assert!(
            samples
                .iter()
                .all(|sample| sample.setpoint[..2].iter().all(|z| z.abs() <= 0.8))
        );
        let mut dwell = 0;
        for pair in samples.windows(2).skip(1) {
            dwell += 1;
            if pair[0].setpoint[0] != pair[1].setpoint[0] {
                assert!((99..=300).contains(&dwell), "{dwell} ms");
                dwell = 0;
            }
        }
        // Six tones use their amplitude: the peak over 20 s is not far below the bound.
        let peak = samples
            .iter()
            .map(|sample| sample.setpoint[1].abs())
            .fold(0.0, f64::max);
        assert!(peak > 0.4, "{peak}");
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
fn val_the_mean_voltage_over_a_cell_is_the_held_one_with_a_sampled_controller_only() {
    // (12) integrated over a cell of length h: h ū = R ∫i dt + L Δi + k_e Δq₂, the current from
    // (23) and (18). The trapezoid with its end correction h²/12 (i'(0) − i'(h)) leaves O(h⁵); i'
    // at the end is the next sample's less the jump of u there over L.
    let mean_voltages = |kind| -> Vec<[f64; 2]> {
        let mut options = SimOptions {
            duration_s: 0.5,
            mass_2: MassSchedule::constant(150.0),
            setpoint: seeded(),
            ..SimOptions::cedro2022()
        };
        options.controller.kind = kind;
        let arm = options.arm;
        let (km, r, l) = (23.0, 0.04, 0.004);
        let (coupling, inertia, weight) = (150.0 / 4.0, 150.0 / 3.0, 150.0 * arm.gravity_m_s2 / 2.0);
        let current_and_rate = |s: &JointSample| {
            let (sin_2q2, cos_2q2) = (2.0 * s.q[1]).sin_cos();
            let torque = inertia * s.ddq[1] + 0.5 * coupling * sin_2q2 * s.dq[0].powi(2) + weight * s.q[1].cos();
            let rate = inertia * s.dddq[1]
                + coupling * (cos_2q2 * s.dq[1] * s.dq[0].powi(2) + sin_2q2 * s.dq[0] * s.ddq[0])
                - weight * s.q[1].sin() * s.dq[1];
            (torque / km, rate / km)
        };
        let h = options.sample_period_s;
        run(&options)
            .windows(2)
            .map(|pair| {
                let ((i0, rate0), (i1, rate1)) = (current_and_rate(&pair[0]), current_and_rate(&pair[1]));
                let rate_before = match kind {
                    ControllerKind::Sampled => rate1 - (pair[1].input[1] - pair[0].input[1]) / l,
                    ControllerKind::Analog => rate1,
                };
                let integral = h / 2.0 * (i0 + i1) + h * h / 12.0 * (rate0 - rate_before);
                let mean = (r * integral + l * (i1 - i0) + 23.0 * (pair[1].q[1] - pair[0].q[1])) / h;
                [mean, pair[0].input[1]]
            })
            .collect()
    };
    let difference = |[mean, first]: &[f64; 2]| (mean - first).abs();
    let worst = |kind| mean_voltages(kind).iter().map(difference).fold(0.0, f64::max);
    // Rounding of L Δi/h with i ~ 100 A: 1e-13 V; the integration's own error (ωh)⁴ ~ 1e-7 of
    // changes of some volts per cell.
    assert!(
        worst(ControllerKind::Sampled) < 1e-5,
        "{}",
        worst(ControllerKind::Sampled)
    );
    assert!(worst(ControllerKind::Analog) > 0.1, "{}", worst(ControllerKind::Analog));
}

#[test]
fn val_input_noise_is_white_and_has_the_stated_deviation_and_leaves_the_motion_alone() {
    let exact = SimOptions {
        duration_s: 20.0,
        seed: 3,
        ..SimOptions::cedro2022()
    };
    let sensors = SensorOptions {
        input_noise_v: 0.05,
        ..SensorOptions::exact()
    };
    let (clean, noisy) = (
        run(&exact),
        run(&SimOptions {
            sensors,
            ..exact.clone()
        }),
    );
    let n = clean.len() as f64;
    for joint in 0..2 {
        let errors: Vec<f64> = clean
            .iter()
            .zip(&noisy)
            .map(|(a, b)| b.input[joint] - a.input[joint])
            .collect();
        assert!(clean.iter().zip(&noisy).all(|(a, b)| a.q == b.q && a.dddq == b.dddq));
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| e * e).sum::<f64>() / n;
        let neighbours = errors.windows(2).map(|e| e[0] * e[1]).sum::<f64>() / n;
        // Standard errors over n samples are σ/√n, σ²√(2/n) and σ²/√n; five of them.
        assert!(mean.abs() < 5.0 * 0.05 / n.sqrt(), "{mean}");
        assert!(
            (variance - 0.0025).abs() < 5.0 * 0.0025 * (2.0 / n).sqrt(),
            "{variance}"
        );
        assert!(neighbours.abs() < 5.0 * 0.0025 / n.sqrt(), "{neighbours}");
    }

    let sensors = SensorOptions {
        input_noise_v: 0.0,
        spike_probability: 0.01,
        spike_v: 5.0,
        ..SensorOptions::exact()
    };
    let spiked = run(&SimOptions { sensors, ..exact });
    let hit = clean
        .iter()
        .zip(&spiked)
        .filter(|(a, b)| a.input[0] != b.input[0])
        .count() as f64;
    // Binomial with n = 20 000, p = 0.01: standard deviation 14.
    assert!((hit - 200.0).abs() < 5.0 * 14.1, "{hit}");
}

#[test]
fn prop_the_mass_changes_at_its_own_sample_and_ramps_are_straight() {
    let jump = MassSchedule::cedro2022();
    for (k, mass) in [(44_999u64, 150.0), (45_000, 170.0), (45_001, 170.0)] {
        assert_eq!(jump.mass_kg(k as f64 * 0.001), mass, "sample {k}");
    }
    let ramp = MassSchedule {
        points: vec![(0.0, 150.0), (10.0, 150.0), (110.0, 180.0)],
        interpolation: Interpolation::Linear,
    };
    for (t, mass) in [
        (0.0, 150.0),
        (10.0, 150.0),
        (60.0, 165.0),
        (110.0, 180.0),
        (500.0, 180.0),
    ] {
        assert!((ramp.mass_kg(t) - mass).abs() < 1e-6, "{t}");
    }
    assert_eq!(MassSchedule::constant(99.0).mass_kg(1e6), 99.0);
}

#[test]
fn prop_the_count_of_samples_is_the_duration_over_the_period() {
    let options = |duration_s, sample_period_s| SimOptions {
        duration_s,
        sample_period_s,
        ..SimOptions::cedro2022()
    };
    assert_eq!(options(170.0, 0.001).sample_count(), 170_000);
    assert_eq!(options(0.3, 0.1).sample_count(), 3);
    assert_eq!(options(0.0015, 0.001).sample_count(), 2);
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

#[test]
fn val_sensors_do_to_the_signals_what_their_options_say() {
    let options = SimOptions {
        duration_s: 5.0,
        ..SimOptions::cedro2022()
    };
    let run = |sensors: SensorOptions| -> Vec<JointSample> {
        let options = SimOptions {
            sensors,
            ..options.clone()
        };
        ArmSimulator::new(&options).unwrap().take(5000).collect()
    };
    let exact = run(SensorOptions::exact());
    let worst = |samples: &[JointSample], wanted: &dyn Fn(&JointSample, usize) -> f64| -> f64 {
        exact.iter().zip(samples).fold(0.0, |worst, (e, s)| {
            (0..2).fold(worst, |worst: f64, j| worst.max((s.q[j] - wanted(e, j)).abs()))
        })
    };

    // An encoder is off by half a count at most, shows whole counts, and gives no derivative.
    let encoder = SensorOptions::encoder(12, 0.0);
    let count = encoder.resolution_rad();
    assert!((count - std::f64::consts::TAU / 4096.0).abs() < 1e-18);
    let rounded = run(encoder);
    let error = worst(&rounded, &|e, j| e.q[j]);
    assert!(error > 0.4 * count && error <= 0.500_001 * count);
    assert!(
        rounded
            .iter()
            .all(|s| s.dq == [0.0; 8] && ((s.q[1] / count).round() - s.q[1] / count).abs() < 1e-9)
    );
    assert_eq!(encoder.signals() & thetabus::messages::signals::DQ, 0);

    // With a delay of the input the positions are those of half a millisecond ago; 1e-7 rad is the
    // sensors' own approximation.
    let late = run(SensorOptions {
        input_delay_s: 0.5e-3,
        ..SensorOptions::exact()
    });
    let error = worst(&late, &|e, j| e.q[j] - 0.5e-3 * e.dq[j] + 0.125e-6 * e.ddq[j]);
    assert!(error < 1e-7, "{error}");

    // Jitter of 0.1 ms at speeds below 10 rad/s, six standard deviations at most in 5000 draws.
    let shaky = run(SensorOptions {
        jitter_s: 1e-4,
        ..SensorOptions::exact()
    });
    let error = worst(&shaky, &|e, j| e.q[j]);
    assert!(error > 1e-5 && error < 6e-3, "{error}");

    let limited = run(SensorOptions {
        input_limit_v: 20.0,
        ..SensorOptions::exact()
    });
    let peak = |samples: &[JointSample]| samples.iter().fold(0.0, |p: f64, s| p.max(s.input[0].abs()));
    assert!(peak(&exact) > 20.0 && peak(&limited) == 20.0);

    let noisy = run(SensorOptions {
        position_noise_rad: 1e-4,
        ..SensorOptions::exact()
    });
    let square: f64 = exact
        .iter()
        .zip(&noisy)
        .map(|(e, s)| (e.q[0] - s.q[0]).powi(2))
        .sum::<f64>()
        / 5000.0;
    // The standard error of a variance from 5000 values is 2 %; five of them.
    assert!((square / 1e-8 - 1.0).abs() < 0.1, "{square}");

    let mut losses = Losses::new(
        &SensorOptions {
            loss_probability: 0.01,
            ..SensorOptions::exact()
        },
        3,
    );
    let lost = (0..20_000).filter(|_| losses.next_is_lost()).count() as f64;
    // Binomial with n = 20 000, p = 0.01: standard deviation 14.
    assert!((lost - 200.0).abs() < 5.0 * 14.1, "{lost}");
}

#[test]
fn prop_a_controller_on_measured_positions_acts_on_their_rounding() {
    let mut options = SimOptions::cedro2022();
    options.duration_s = 2.0;
    options.controller.kind = ControllerKind::Sampled;
    options.sensors = SensorOptions::encoder(12, 0.0);
    options.controller.feedback = PositionFeedback::Measured;
    let kp = options.controller.proportional_gain_v_per_rad[0];
    let run = |options: &SimOptions| -> Vec<JointSample> { ArmSimulator::new(options).unwrap().take(2000).collect() };
    let measured = run(&options);
    options.controller.feedback = PositionFeedback::True;
    let blind = run(&options);
    // Up to the first sample that differs both machines are in one state, so there the voltages
    // differ by the rounding alone.
    let k = (0..2000).find(|&k| measured[k].input != blind[k].input).unwrap();
    options.sensors = SensorOptions::exact();
    let exact = run(&options)[k];
    for joint in 0..2 {
        let difference = measured[k].input[joint] - blind[k].input[joint];
        let rounding = exact.q[joint] - measured[k].q[joint];
        assert!((difference - kp * rounding).abs() < 1e-9, "joint {joint}: {difference}");
    }

    options.controller.kind = ControllerKind::Analog;
    options.controller.feedback = PositionFeedback::Measured;
    assert!(
        options.validate().is_err(),
        "an analog controller has no measured position"
    );
}

/// An axis that is pushed by its offset alone.
fn pushed(offset: f64) -> (SimOptions, ServoAxisOptions) {
    let axis = ServoAxisOptions {
        offset,
        proportional_gain: 0.0,
        derivative_gain: 0.0,
        position_resolution: 0.0,
        ..ServoAxisOptions::emps()
    };
    let options = SimOptions {
        machine: Machine::ServoAxis(axis.clone()),
        ..SimOptions::cedro2022()
    };
    (options, axis)
}

#[test]
fn val_an_axis_under_a_constant_force_follows_the_closed_form() {
    let (options, axis) = pushed(-50.0);
    let end_speed = (50.0 - axis.coulomb_friction) / axis.viscous_friction;
    let rate = axis.viscous_friction / axis.mass.mass_kg(0.0);
    for (k, sample) in MachineSimulator::new(&options).unwrap().take(3000).enumerate() {
        let t = k as f64 * 1e-3;
        let decay = (-rate * t).exp_m1();
        // Runge-Kutta steps of 0.25 ms: (rate h)^5/120 a step, below 1e-17; what is left is
        // rounding of 12 000 sums.
        assert!((sample.dq[0] + end_speed * decay).abs() < 1e-12, "{t}");
        assert!((sample.q[0] - end_speed * (t + decay / rate)).abs() < 1e-12, "{t}");
    }
}

#[test]
fn val_an_axis_sticks_until_friction_is_overcome() {
    let (options, _) = pushed(-20.0);
    assert!(
        MachineSimulator::new(&options)
            .unwrap()
            .take(1000)
            .all(|s| s.q[0] == 0.0 && s.dq[0] == 0.0)
    );
}

#[test]
fn prop_a_moving_axis_obeys_its_model_at_every_sample_and_turns_at_full_stops() {
    let axis = ServoAxisOptions {
        position_resolution: 0.0,
        ..ServoAxisOptions::emps()
    };
    let tones = |amplitude_rad, frequency_hz| Tone {
        amplitude_rad,
        frequency_hz,
        phase_rad: 0.3,
    };
    let sines = Setpoint::Sines {
        offset_rad: 0.0,
        tones: vec![tones(0.05, 0.4), tones(0.008, 1.7)],
    };
    for kind in [ControllerKind::Analog, ControllerKind::Sampled] {
        let mut options = SimOptions {
            machine: Machine::ServoAxis(axis.clone()),
            setpoint: [sines.clone(), sines.clone()],
            ..SimOptions::cedro2022()
        };
        options.controller.kind = kind;
        let plant = AutoDiff(ServoAxis::new(Motion::Linear, DriveInput::Voltage, axis.gain).unwrap());
        let theta = axis.true_theta(0.0);
        let (mut moving, mut stuck) = (0, 0);
        for sample in MachineSimulator::new(&options).unwrap().take(20_000) {
            if sample.dq[0] == 0.0 {
                stuck += 1;
                continue;
            }
            moving += 1;
            let residual = plant.row(0, &plant.features(&sample), &theta, &mut [0.0; 4]);
            // Forces of up to 350 N, each rounded to 1e-16 of it.
            assert!(residual.abs() < 1e-11, "{residual}");
        }
        assert!(moving > 19_000 && stuck > 0, "{moving} moving, {stuck} stuck");
    }
}
