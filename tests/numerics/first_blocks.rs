//! Machines and motions whose first blocks, each by itself, hardly determine θ.

use thetabus::config::{Config, Source};
use thetabus::studies::trials::{Trial, TrialResult};

/// A right model throughout: a chirp that begins so slowly that the first blocks show no inertia.
const CHIRP: &str = r#"
plant.seed=2013
plant.duration_s=30.0
plant.mass_2.t_s=[0.0]
plant.mass_2.mass_kg=[133.0]
plant.sensors.encoder_bits=15
plant.sensors.input_noise_v=0.0914
plant.controller.proportional_gain_v_per_rad=[74.6, 105.0]
plant.controller.derivative_gain_v_s_per_rad=[7.58, 7.1]
plant.arm.length_1_m=0.588
plant.arm.mass_1_kg=9.07
plant.arm.length_2_m=0.317
plant.arm.winding_resistance_ohm=[0.0496, 0.809]
plant.arm.winding_inductance_h=[0.000678, 0.00227]
plant.arm.torque_constant_n_m_per_a=[4.73, 14.9]
plant.arm.back_emf_constant_v_s_per_rad=[4.73, 14.9]
plant.setpoint.kind="chirp"
plant.setpoint.chirp.amplitude_rad=[0.516, 0.4]
plant.setpoint.chirp.end_frequency_hz=[1.95, 1.01]
plant.setpoint.chirp.sweep_s=[20.7, 21.6]
model.known.length_1_m=0.588
model.known.winding_resistance_ohm=[0.0496, 0.809]
model.known.torque_constant_n_m_per_a=[4.73, 14.9]
identifier.projected.window_s="auto"
identifier.projected.position_resolution=[1.91748e-4]
identifier.projected.input_noise=[0.0914]
estimator.block_len=1000
estimator.theta_start=[0.001, 0.001, 0.03, 0.2, 5.0, 0.01, 2.0, 10.0, 0.5]
"#;

/// Slow trapezoids in blocks of half a second.
const TRAPEZOIDS: &str = r#"
plant.seed=2074
plant.duration_s=20.0
plant.mass_2.t_s=[0.0]
plant.mass_2.mass_kg=[10.960137964010485]
plant.sensors.encoder_bits=20
plant.sensors.input_noise_v=0.1987176174299477
plant.controller.proportional_gain_v_per_rad=[118.39649768363817, 43.356676959315976]
plant.controller.derivative_gain_v_s_per_rad=[19.363525138782798, 5.279941783062844]
plant.arm.length_1_m=0.9087093077287348
plant.arm.mass_1_kg=179.275723096644
plant.arm.length_2_m=0.9942495080448125
plant.arm.winding_resistance_ohm=[1.5966160522329562, 0.5532933110816087]
plant.arm.winding_inductance_h=[0.004926469335525204, 0.00448519125462928]
plant.arm.torque_constant_n_m_per_a=[10.828581114400356, 5.860679107178214]
plant.arm.back_emf_constant_v_s_per_rad=[10.828581114400356, 5.860679107178214]
plant.setpoint.kind="moves"
plant.setpoint.moves.profile="trapezoidal"
plant.setpoint.moves.min_rad=[-0.9938544258075224, -0.8]
plant.setpoint.moves.max_rad=[0.9938544258075224, 0.8]
plant.setpoint.moves.min_move_s=[2.2042354000338387, 2.2042354000338387]
plant.setpoint.moves.max_move_s=[4.267521591093785, 4.267521591093785]
plant.setpoint.moves.min_rest_s=[0.2, 0.2]
plant.setpoint.moves.max_rest_s=[2.0, 2.0]
model.known.length_1_m=0.9087093077287348
model.known.winding_resistance_ohm=[1.5966160522329562, 0.5532933110816087]
model.known.torque_constant_n_m_per_a=[10.828581114400356, 5.860679107178214]
identifier.projected.window_s="auto"
identifier.projected.position_resolution=[5.992112452678286e-6]
identifier.projected.input_noise=[0.1987176174299477]
estimator.block_len=500
estimator.theta_start=[0.13926835500408719, 0.0075989042096208164, 38.910184749169744, 1.1317561417239526, 17.105788632977635, 0.00927719242591352, 2.5019689566675325, 9.798831228163646, 0.7622791394959659]
"#;

fn run(settings: &str) -> TrialResult {
    let sources: Vec<Source> = Config::embedded("encoder_only").into_iter().collect();
    let settings: Vec<String> = settings
        .lines()
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .collect();
    let config = Config::load(&sources, &settings).unwrap();
    let parameters = config.model.parameters();
    let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.to_string()).collect();
    let mut node = config.identifier().unwrap();
    let trial = Trial {
        sim: &config.plant.sim,
        block_len: config.estimator.block_len as u64,
        names: &names,
        known: config.known,
    };
    let learn = |sample: &_, estimates: &mut Vec<_>| node.on_sample(sample, &mut |estimate| estimates.push(*estimate));
    trial.run(learn).unwrap()
}

/// Learnt one after the other, these blocks gave an inductance of joint 2 of a quarter and of twice
/// its value, usable in 20 blocks, at 20 to 130 standard deviations.
#[test]
fn prop_what_short_first_blocks_leave_open_does_not_look_like_knowledge() {
    for (name, settings) in [("chirp", CHIRP), ("trapezoids", TRAPEZOIDS)] {
        let result = run(settings);
        assert_eq!(result.dangerous, 0, "{name}: {:?}", result.worst);
        // silence is no solution
        assert!(
            2 * result.use_ok > result.blocks && 2 * result.usable > result.excited,
            "{name}: {result:?}"
        );
    }
}
