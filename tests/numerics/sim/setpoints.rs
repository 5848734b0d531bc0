//! Setpoints and the schedule of the payload.

use super::*;

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
