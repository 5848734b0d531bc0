//! What the sensors do to the signals.

use super::*;

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
