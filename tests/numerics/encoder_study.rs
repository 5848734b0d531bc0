//! The study of encoders and voltages reaches the figures in the documents.

use super::projected::{estimator_options, start};
use thetabus::model::Manipulator;
use thetabus::rows::{ProjectedOptions, SmoothedOptions, Smoothing};
use thetabus::sim::{ControllerKind, MassSchedule, SimOptions};
use thetabus::studies::encoder::{Answer, Skew, calibration, judge, run_projected, run_smoothed, skew_run};
use thetabus::studies::{EncoderSetup, Signals};

fn setup() -> EncoderSetup {
    let mut sim = SimOptions::cedro2022();
    sim.duration_s = 57.0;
    let plant = Manipulator::default();
    EncoderSetup {
        options: estimator_options(&plant, start()),
        rows: ProjectedOptions::recommended(),
        block_len: 1900,
        sim,
    }
}

#[test]
fn ident_encoders_and_voltages_reach_the_figures_of_the_documents() {
    for (bits, noise_v) in [(16, 0.05), (20, 0.0)] {
        for kind in [ControllerKind::Sampled, ControllerKind::Analog] {
            let mut setup = setup().with(bits, noise_v, kind);
            setup.sim.mass_2 = MassSchedule::jump(150.0, 45.0, 170.0);
            for signals in Signals::MAIN {
                let answers = run_projected(&setup, Some(signals), 5).unwrap();
                let run = judge(&setup, &answers, 45.0);
                assert!(
                    run.payload_to_1.is_some_and(|blocks| blocks <= 4),
                    "{bits} {kind:?} {signals:?} {run:?}"
                );
                assert!(
                    run.off_s.is_some_and(|off| off <= 0.05),
                    "{bits} {kind:?} {signals:?} {run:?}"
                );
                assert!(
                    run.usable_error < 0.05 && run.other_alarms == 0,
                    "{bits} {kind:?} {signals:?} {run:?}"
                );
                // seven blocks after the jump: three standard deviations of what these data give
                // θ6…θ9, and θ5 is far better
                for p in 4..9 {
                    assert!(
                        run.end[p] < 2e-3,
                        "{bits} {kind:?} {signals:?} theta_{}: {:.2e}",
                        p + 1,
                        run.end[p]
                    );
                }
            }
        }
    }
}

#[test]
fn ident_noise_levels_learnt_from_the_signals_serve_as_well_as_known_ones() {
    for (bits, noise_v) in [(16, 0.05), (20, 0.0)] {
        let setup = setup().with(bits, noise_v, ControllerKind::Sampled).learning();
        let (shares, alarms, blocks) = calibration(&setup, Signals::Steps, 12).unwrap();
        let mean = shares.iter().sum::<f64>() / 9.0;
        // 108 intervals, correlated within a run: as good as about 50, standard deviation 3 points
        assert!(mean > 0.86, "{bits}: {shares:?}");
        assert!(alarms == 0 && blocks == 120, "{alarms}");
    }
}

#[test]
fn ident_a_delay_is_found_within_ten_blocks() {
    let mut setup = setup().with(16, 0.05, ControllerKind::Sampled);
    (setup.sim.duration_s, setup.sim.mass_2) = (19.0, MassSchedule::constant(150.0));
    for signals in Signals::MAIN {
        let answers = skew_run(&setup, signals, 3, 0.5e-3, Skew::Estimated).unwrap();
        let last = answers.last().unwrap();
        let off_s = (last.theta[9] - 0.5e-3).abs();
        assert!(off_s < 20e-6, "{signals:?}: {off_s}");
        assert!(off_s < 4.5 * last.std[9], "{signals:?}: {off_s} {}", last.std[9]);
    }
}

#[test]
fn ident_the_plain_fallback_works_where_raw_derivatives_do_not() {
    let mut setup = setup().with(16, 0.05, ControllerKind::Sampled);
    (setup.sim.duration_s, setup.sim.mass_2) = (19.0, MassSchedule::constant(150.0));
    let errors = |answers: Vec<Answer>| -> f64 {
        let last = answers.last().unwrap();
        (4..9)
            .map(|p| (last.theta[p] / last.truth[p] - 1.0).abs())
            .fold(0.0, f64::max)
    };
    for signals in [Signals::Steps, Signals::Sines] {
        let fallback = errors(run_smoothed(&setup, SmoothedOptions::recommended(), signals, 1).unwrap());
        let projected = errors(run_projected(&setup, Some(signals), 1).unwrap());
        // smoothing costs a factor of some three against integration by parts
        assert!(fallback < 0.01, "{signals:?}: {fallback}");
        assert!(projected < 0.002, "{signals:?}: {projected}");
        let raw = SmoothedOptions {
            window_s: 0.0,
            stride_s: 1e-3,
            smoothing: Smoothing::Causal,
            ..SmoothedOptions::recommended()
        };
        assert!(errors(run_smoothed(&setup, raw, signals, 1).unwrap()) > 0.1);
    }
}
