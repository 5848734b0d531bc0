//! Effects of the simulated arm beyond its equations, and effects of its sensors on samples, each
//! against an independent result.

use std::f64::consts::TAU;
use thetabus::model::{AutoDiff, JointSample, Manipulator, PointwiseModel};
use thetabus::node::simulated_plant::sample_stream;
use thetabus::sim::{
    ArmDynamics, ArmParameters, ArmSimulator, ControllerKind, Losses, MassSchedule, MoveProfile, Moves, SampleInstants,
    SensorOptions, Setpoint, SimOptions, Tone, Unmodelled, rk4_step,
};

/// A smooth run of the paper's arm with its analog controller.
fn smooth() -> SimOptions {
    let sines = |frequency_hz: f64| Setpoint::Sines {
        offset_rad: 0.1,
        tones: vec![Tone {
            frequency_hz,
            amplitude_rad: 0.6,
            phase_rad: 0.3,
        }],
    };
    SimOptions {
        duration_s: 4.0,
        mass_2: MassSchedule::constant(150.0),
        setpoint: [sines(0.7), sines(0.9)],
        ..SimOptions::cedro2022()
    }
}

fn run(options: &SimOptions) -> Vec<JointSample> {
    ArmSimulator::new(options)
        .unwrap()
        .take(options.sample_count() as usize)
        .collect()
}

#[test]
fn val_a_tilted_base_turns_gravity_and_keeps_the_energy() {
    let arm = ArmParameters::cedro2022();
    let tilt = 0.3;
    let dynamics = ArmDynamics::new(&arm.with_mass_2(150.0), arm.gravity_m_s2).tilted(tilt);
    // The height of the centre of gravity: its vector onto the vertical, which leans by the tilt
    // against the base's axis.
    let weight = 150.0 * 9.81 * 0.5;
    let height = |q: [f64; 2]| {
        let along = [q[1].cos() * q[0].cos(), q[1].cos() * q[0].sin(), q[1].sin()];
        let up = [0.0, f64::sin(tilt), f64::cos(tilt)];
        along.iter().zip(up).map(|(a, u)| a * u).sum::<f64>()
    };
    for q in [[0.0, 0.0], [0.4, -0.7], [-1.2, 0.9]] {
        assert!((dynamics.energy(q, [0.0; 2]) - weight * height(q)).abs() < 1e-10);
        let holding = dynamics.holding_torques(q);
        for joint in 0..2 {
            let mut ends = [q, q];
            ends[0][joint] -= 1e-5;
            ends[1][joint] += 1e-5;
            // Central difference: (1e-5)²/6 of a third derivative of 736 N m, rounding 1e-13/1e-5.
            let slope = weight * (height(ends[1]) - height(ends[0])) / 2e-5;
            assert!((holding[joint] - slope).abs() < 1e-6, "{slope}, {}", holding[joint]);
        }
    }
    let mut x = [0.0, 1.0, 2.0, -0.5];
    let energy = |x: &[f64; 4]| dynamics.energy([x[0], x[1]], [x[2], x[3]]);
    let start = energy(&x);
    for _ in 0..5000 {
        x = rk4_step(&x, 1e-3, |_, x| {
            let [a1, a2] = dynamics.accelerations([x[0], x[1]], [x[2], x[3]], [0.0, 0.0]);
            [x[2], x[3], a1, a2]
        });
        // As for the upright arm: 1e-6 of the 1500 J that are turned over.
        assert!((energy(&x) - start).abs() < 1.5e-3, "{}", energy(&x) - start);
    }
}

#[test]
fn val_jerks_with_friction_tilt_and_heating_are_the_derivatives_of_the_accelerations() {
    let options = SimOptions {
        sample_period_s: 1e-4,
        duration_s: 2.0,
        substeps: 1,
        unmodelled: Unmodelled {
            coulomb_friction_n_m: [60.0, 40.0],
            // so slow a change of sign that a difference can follow it
            friction_speed_rad_per_s: 0.5,
            base_tilt_rad: 0.2,
            ..Unmodelled::none()
        },
        ..smooth()
    };
    // The step at the start has died down after a second.
    let samples = &run(&options)[10_000..];
    for joint in 0..2 {
        let largest = samples.iter().map(|s| s.dddq[joint].abs()).fold(0.0, f64::max);
        assert!(largest > 10.0, "{largest}");
        for trio in samples.windows(3) {
            let difference = (trio[2].ddq[joint] - trio[0].ddq[joint]) / 2e-4;
            // (1e-4)²/6 of the second derivative of the jerk, which the fastest mode of 90 rad/s
            // makes at most 90² jerks; rounding of 1e-13/1e-4.
            let tolerance = 1e-8 / 6.0 * 8100.0 * largest + 1e-9;
            let error = (difference - trio[1].dddq[joint]).abs();
            assert!(error < tolerance, "joint {joint}: {error} of {difference}");
        }
    }
}

/// Joint 1 alone, link 2 level and without weight, with friction that sticks: small steps of
/// Euler's method with the event in between.
fn stick_slip(options: &SimOptions, friction: f64, end_s: f64) -> Vec<f64> {
    let h = 2e-6f64;
    let arm = &options.arm;
    let [k, ke] = [arm.torque_constant_n_m_per_a[0], arm.back_emf_constant_v_s_per_rad[0]];
    let [r, l] = [arm.winding_resistance_ohm[0], arm.winding_inductance_h[0]];
    let inertia = 100.0 * 0.25 / 12.0 + 150.0 / 4.0;
    let [kp, kd] = [191.304, 31.6957];
    let (mut q, mut v, mut i) = (0.0f64, 0.0f64, 0.0f64);
    let every = (1e-3 / h).round() as usize;
    let mut positions = Vec::new();
    for step in 0..(end_s / h).round() as usize {
        if step % every == 0 {
            positions.push(q);
        }
        let t = step as f64 * h;
        let u = kp * (0.3 * (TAU * 0.4 * t).sin() - q) - kd * v;
        let di = (u - r * i - ke * v) / l;
        let torque = k * i;
        if v == 0.0 && torque.abs() <= friction {
            i += h * di;
            continue;
        }
        let sign = if v == 0.0 { torque.signum() } else { v.signum() };
        let after = v + h * (torque - friction * sign) / inertia;
        q += h * v;
        v = if after * sign < 0.0 { 0.0 } else { after };
        i += h * di;
    }
    positions
}

#[test]
fn val_smooth_friction_moves_as_friction_that_sticks() {
    let friction = 150.0;
    let mut options = smooth();
    options.arm.gravity_m_s2 = 0.0;
    options.setpoint = [
        Setpoint::Sines {
            offset_rad: 0.0,
            tones: vec![Tone {
                frequency_hz: 0.4,
                amplitude_rad: 0.3,
                phase_rad: 0.0,
            }],
        },
        Setpoint::constant(0.0),
    ];
    options.unmodelled.coulomb_friction_n_m = [friction, 0.0];
    options.unmodelled.friction_speed_rad_per_s = 1e-3;
    let slippery = SimOptions {
        unmodelled: Unmodelled::none(),
        ..options.clone()
    };
    let expected = stick_slip(&options, friction, 4.0);
    let distance = |samples: &[JointSample]| {
        let pairs = samples.iter().zip(&expected);
        pairs.map(|(s, q)| (s.q[0] - q).abs()).fold(0.0, f64::max)
    };
    let (with, without) = (distance(&run(&options)), distance(&run(&slippery)));
    // At rest it creeps at no more than 1e-3 rad/s instead of sticking, for some 0.2 s of each
    // turn, and its controller takes that back.
    assert!(with < 2e-4, "{with} rad");
    assert!(
        without > 20.0 * with,
        "friction matters: {without} rad without, {with} rad with"
    );
}

#[test]
fn val_irregular_samples_show_the_state_at_the_time_that_their_stamps_tell() {
    let regular = smooth();
    let mut irregular = smooth();
    irregular.sensors.stamp_jitter_s = 1e-4;
    irregular.seed = 4;
    let grid = run(&regular);
    let mut stream = sample_stream(&irregular, 1).unwrap();
    let mut instants = SampleInstants::new(&irregular);
    let (mut square, mut count) = (0.0, 0.0);
    while let Some(sample) = stream.next_sample() {
        let k = sample.seq as usize;
        let offset_ns = instants.next_offset_ns();
        assert_eq!(sample.t_ns as i64, k as i64 * 1_000_000 + offset_ns);
        let t = offset_ns as f64 * 1e-9;
        square += t * t;
        count += 1.0;
        let at = &grid[k];
        for joint in 0..2 {
            // Under an analog controller the motion does not know of samples: Taylor from the
            // sample on the grid, rest τ⁴/24 of 1e5 rad/s⁴.
            let expected = at.q[joint] + t * (at.dq[joint] + t * (at.ddq[joint] / 2.0 + t * at.dddq[joint] / 6.0));
            let error = (sample.q[joint] - expected).abs();
            assert!(error < 4e-4f64.powi(4) / 24.0 * 1e5 + 1e-9, "sample {k}: {error}");
            assert!((sample.setpoint[joint] - at.setpoint[joint]).abs() < 0.6 * TAU * 0.9 * 4e-4 + 1e-12);
        }
    }
    assert_eq!(count, 4000.0);
    // A variance of 4000 values is right to 2.2 %; five of them.
    assert!((square / count / 1e-8 - 1.0).abs() < 0.11, "{square}");
}

#[test]
fn val_a_held_voltage_lasts_from_stamp_to_stamp() {
    // Between two samples the motor's current under a held voltage at rest is known in closed form:
    // an arm too heavy to move.
    let mut options = smooth();
    options.controller.kind = ControllerKind::Sampled;
    options.sensors.stamp_jitter_s = 2e-4;
    options.arm.mass_1_kg = 1e15;
    options.arm.gravity_m_s2 = 0.0;
    options.duration_s = 0.3;
    let stamps: Vec<u64> = {
        let mut stream = sample_stream(&options, 1).unwrap();
        std::iter::from_fn(|| stream.next_sample()).map(|s| s.t_ns).collect()
    };
    let samples = run(&options);
    let [r, l, k] = [0.04, 0.004, 23.0];
    let inertia = 1e15 * 0.25 / 12.0;
    let mut current = 0.0;
    for (pair, times) in samples.windows(2).zip(stamps.windows(2)) {
        // Link 2 adds 37 kg m² to 2e13; Runge-Kutta steps of 2.5e-3 time constants err by 1e-15
        // each.
        let expected = k * current / inertia;
        assert!((pair[0].ddq[0] - expected).abs() <= 1e-9 * expected.abs(), "{expected}");
        let h = (times[1] - times[0]) as f64 * 1e-9;
        let end = pair[0].input[0] / r;
        current = end + (current - end) * (-r / l * h).exp();
    }
    assert!(current.abs() > 1.0);
}

#[test]
fn val_a_warming_arm_obeys_its_equations_with_the_parameters_of_the_moment() {
    let options = SimOptions {
        unmodelled: Unmodelled {
            heating_share: 0.1,
            heating_s: 2.0,
            ..Unmodelled::none()
        },
        ..smooth()
    };
    let (cold, warm, late) = (
        options.true_theta(0.0),
        options.true_theta(1.0),
        options.true_theta(3.0),
    );
    for (i, factor) in [1.0, 1.0, 1.05, 1.05, 1.0, 1.0, 1.05, 1.0, 1.0].into_iter().enumerate() {
        assert!((warm[i] / cold[i] - factor).abs() < 1e-12, "theta_{}", i + 1);
        let end = 1.0 + 2.0 * (factor - 1.0);
        assert!((late[i] / cold[i] - end).abs() < 1e-12, "theta_{}", i + 1);
    }
    let plant = AutoDiff(Manipulator::default());
    for (k, sample) in run(&options).iter().enumerate() {
        let theta = options.true_theta(k as f64 * 1e-3);
        for equation in 0..2 {
            let residual = plant.row(equation, &plant.features(sample), &theta, &mut [0.0; 9]);
            // Terms of up to 5000 V, each rounded to 1e-16 of it, a dozen of them.
            assert!(residual.abs() < 1e-9, "{residual} at {k}");
        }
    }
}

#[test]
fn val_encoders_off_their_axes_and_coarse_voltages_are_off_by_what_they_say() {
    let exact = run(&smooth());
    let mut options = smooth();
    options.sensors.eccentricity_rad = 1e-3;
    options.sensors.eccentricity_phase_rad = 0.7;
    options.sensors.input_resolution_v = 0.2;
    assert_eq!(options.signals() & thetabus::messages::signals::DQ, 0);
    for (a, b) in exact.iter().zip(run(&options)) {
        for joint in 0..2 {
            let expected = a.q[joint] + 1e-3 * (a.q[joint] + 0.7).sin();
            assert!((b.q[joint] - expected).abs() < 1e-15);
            assert!((b.input[joint] - a.input[joint]).abs() <= 0.1 + 1e-12);
            let counts = b.input[joint] / 0.2;
            assert!((counts - counts.round()).abs() < 1e-9);
        }
    }
    let mut options = smooth();
    options.sensors.position_spike_probability = 0.01;
    options.sensors.position_spike_rad = 0.5;
    let spiked = run(&options);
    let hit = exact.iter().zip(&spiked).filter(|(a, b)| a.q[0] != b.q[0]).count();
    // Binomial with n = 4000, p = 0.01: deviation 6.3.
    assert!((hit as f64 - 40.0).abs() < 5.0 * 6.3, "{hit}");
    assert!(exact.iter().zip(&spiked).all(|(a, b)| a.input == b.input));
}

#[test]
fn prop_losses_in_bursts_keep_their_share_and_length() {
    for burst in [1u64, 5, 20] {
        let sensors = SensorOptions {
            loss_probability: 0.03,
            loss_burst: burst,
            ..SensorOptions::exact()
        };
        let mut losses = Losses::new(&sensors, 8);
        let lost: Vec<bool> = (0..400_000).map(|_| losses.next_is_lost()).collect();
        let share = lost.iter().filter(|&&lost| lost).count() as f64 / 400_000.0;
        // 12 000 lost samples come in 12 000/L bursts, whose number has a deviation of at most its
        // square root.
        let deviation = (burst as f64 / 12_000.0).sqrt();
        assert!((share / 0.03 - 1.0).abs() < 5.0 * deviation, "{burst}: {share}");
        // Bursts may follow each other at once; the last one may be cut.
        let end = lost.iter().rposition(|&lost| !lost).unwrap();
        let mut runs = lost[..end].chunk_by(|a, b| a == b).filter(|run| run[0]);
        assert!(runs.all(|run| (run.len() as u64).is_multiple_of(burst)));
    }
}

#[test]
fn prop_moves_are_followed_between_samples_as_well() {
    // A smooth reference that was held over a sample would put a staircase into the voltage: the
    // order in the substeps would be lost.
    let moves = Setpoint::Moves(Moves {
        profile: MoveProfile::MinimumJerk,
        min_rad: -0.5,
        max_rad: 0.5,
        min_move_s: 1.0,
        max_move_s: 1.0,
        min_rest_s: 0.0,
        max_rest_s: 0.0,
    });
    let end = |substeps| {
        let options = SimOptions {
            sample_period_s: 0.02,
            duration_s: 0.9,
            substeps,
            setpoint: [moves.clone(), moves.clone()],
            ..smooth()
        };
        let last = run(&options).pop().unwrap();
        last.q[1]
    };
    let reference = end(64);
    let order = ((end(4) - reference) / (end(8) - reference)).abs().log2();
    assert!((order - 4.0).abs() < 0.4, "order {order}");
}
