//! The settings of a trial, as `section.key=value` on top of `config/encoder_only.toml`.

use super::disturbance::Disturbance;
use super::spec::{Motion, TrialSpec};
use super::spread::spread;
use crate::sim::ArmDynamics;
use std::f64::consts::TAU;

impl TrialSpec {
    /// Overrides of the configuration `encoder_only`, as `section.key=value`.
    pub fn settings(&self) -> Vec<String> {
        let arm = self.arm.parameters();
        let (first_kg, then_kg) = self.arm.masses_kg();
        let then_kg = self.disturbance.mass_after(first_kg, then_kg);
        let (kp, kd) = self.arm.gains(self.period_us);
        let period_s = self.period_s();
        let resolution = std::f64::consts::TAU / f64::from(self.bits).exp2();
        let known = [
            ("winding_resistance_ohm", arm.winding_resistance_ohm),
            ("torque_constant_n_m_per_a", arm.torque_constant_n_m_per_a),
        ];
        let motors = [
            ("winding_inductance_h", arm.winding_inductance_h),
            ("back_emf_constant_v_s_per_rad", arm.back_emf_constant_v_s_per_rad),
        ];
        let mut settings = vec![
            format!("plant.seed={}", self.seed),
            format!("plant.sample_period_s={period_s:?}"),
            format!(
                "plant.duration_s={:?}",
                (self.blocks * Self::BLOCK_LEN) as f64 * period_s
            ),
            format!("plant.mass_2.t_s=[0.0, {:?}]", self.change_s()),
            format!("plant.mass_2.mass_kg=[{first_kg:?}, {then_kg:?}]"),
            format!("plant.sensors.encoder_bits={}", self.bits),
            format!("plant.sensors.input_noise_v={:?}", self.noise_v),
            format!("identifier.projected.position_resolution=[{resolution:?}]"),
            format!("identifier.projected.input_noise=[{:?}]", self.noise_v),
            format!("estimator.block_len={}", Self::BLOCK_LEN),
            format!("estimator.theta_start={:?}", self.start()),
            format!("plant.controller.proportional_gain_v_per_rad={kp:?}"),
            format!("plant.controller.derivative_gain_v_s_per_rad={kd:?}"),
            format!("plant.arm.length_1_m={:?}", arm.length_1_m),
            format!("plant.arm.mass_1_kg={:?}", arm.mass_1_kg),
            format!("plant.arm.length_2_m={:?}", arm.length_2_m),
            format!("model.known.length_1_m={:?}", arm.length_1_m),
        ];
        settings.extend(
            known
                .iter()
                .map(|(key, values)| format!("model.known.{key}={values:?}")),
        );
        let motors = known.iter().chain(&motors);
        settings.extend(motors.map(|(key, values)| format!("plant.arm.{key}={values:?}")));
        settings.extend(motion_settings(self.motion, self.seed));
        settings.extend(disturbance_settings(self));
        settings
    }
}

/// Settings of `plant.setpoint`.
fn motion_settings(motion: Motion, seed: u64) -> Vec<String> {
    let moves = |profile: &str, reach: f64, moves_s: (f64, f64), rests_s: (f64, f64)| {
        let both = |value: f64| format!("[{value:?}, {value:?}]");
        vec![
            "plant.setpoint.kind=\"moves\"".to_owned(),
            format!("plant.setpoint.moves.profile=\"{profile}\""),
            format!("plant.setpoint.moves.min_rad=[{:?}, {:?}]", -reach, -0.8 * reach),
            format!("plant.setpoint.moves.max_rad=[{:?}, {:?}]", reach, 0.8 * reach),
            format!("plant.setpoint.moves.min_move_s={}", both(moves_s.0)),
            format!("plant.setpoint.moves.max_move_s={}", both(moves_s.1)),
            format!("plant.setpoint.moves.min_rest_s={}", both(rests_s.0)),
            format!("plant.setpoint.moves.max_rest_s={}", both(rests_s.1)),
        ]
    };
    match motion {
        // as in config/encoder_only.toml
        Motion::Steps => vec!["plant.setpoint.kind=\"random\"".to_owned()],
        Motion::MinimumJerk => moves("minimum_jerk", 1.0, (0.6, 1.6), (0.0, 0.5)),
        Motion::Trapezoidal => moves("trapezoidal", 1.0, (0.6, 1.6), (0.0, 0.5)),
        Motion::Rests => moves("minimum_jerk", 1.0, (0.6, 1.6), (1.0, 20.0)),
        Motion::Creeping => moves("trapezoidal", 0.3, (10.0, 30.0), (0.0, 1.0)),
        Motion::Multisine => sines(seed),
        Motion::Tiny => {
            let reach = 0.01 + 0.04 * spread(seed, 0);
            vec![
                "plant.setpoint.kind=\"random_sines\"".to_owned(),
                format!("plant.setpoint.random_sines.amplitude_rad=[{reach:?}, {reach:?}]"),
            ]
        }
    }
}

/// Six sines of joint 1, six others of joint 2.
fn sines(seed: u64) -> Vec<String> {
    let base = [0.23, 0.43, 0.81, 1.51, 2.83, 5.3f64];
    let size = |frequency: f64| frequency.powf(-0.25);
    let total: f64 = base.iter().copied().map(size).sum();
    let lists = |value: &dyn Fn(usize, usize) -> f64| {
        let list = |joint: usize| (0..base.len()).map(|k| value(joint, k)).collect::<Vec<f64>>();
        format!("[{:?}, {:?}]", list(0), list(1))
    };
    let reach = [1.0, 0.8];
    vec![
        "plant.setpoint.kind=\"sines\"".to_owned(),
        // the joints share no frequency
        format!(
            "plant.setpoint.sines.frequency_hz={}",
            lists(&|joint, k| base[k] * (1.0 + 0.07 * joint as f64))
        ),
        format!(
            "plant.setpoint.sines.amplitude_rad={}",
            lists(&|joint, k| reach[joint] * size(base[k]) / total)
        ),
        format!(
            "plant.setpoint.sines.phase_rad={}",
            lists(&|joint, k| std::f64::consts::TAU * spread(seed, 1 + 7 * k as u64 + 5 * joint as u64))
        ),
    ]
}

impl TrialSpec {
    /// A fault of a joint's signal from the middle of the run on.
    fn fault_later(&self, signal: &str, joint: usize, by: &str) -> String {
        let from_s = self.change_s();
        format!("plant.faults=[{{kind=\"wrong\",signal=\"{signal}\",joint={joint},from_s={from_s:?},{by}}}]")
    }
}

/// Start values of a model whose joints have further parameters with these start values, each
/// behind the joint's own.
fn start_with(spec: &TrialSpec, further: &[f64]) -> String {
    let start = spec.start();
    let (joint_1, joint_2) = start.split_at(5);
    let start = [joint_1, further, joint_2, further].concat();
    format!("estimator.theta_start={start:?}")
}

/// Keys of the errors that the identifier considers.
const ERRORS: [&str; 16] = [
    "input_delay_s",
    "gain",
    "coulomb",
    "stribeck",
    "offset",
    "dead_band",
    "spring",
    "gain_by_direction",
    "viscous_by_direction",
    "load_friction",
    "inertia",
    "viscous",
    "resonance_hz",
    "drift_per_s",
    "zero_rad",
    "eccentricity_rad",
];

/// Settings of the simulation and, if it is configured for the disturbance, of the identifier.
fn disturbance_settings(spec: &TrialSpec) -> Vec<String> {
    let sensors = |key: &str, value: f64| format!("plant.sensors.{key}={value:?}");
    match spec.disturbance {
        Disturbance::None | Disturbance::AtRest | Disturbance::Jump(_) | Disturbance::JumpAtEnd(_) => Vec::new(),
        Disturbance::Loss { permille, burst } => vec![
            sensors("loss_probability", f64::from(permille) / 1000.0),
            format!("plant.sensors.loss_burst={burst}"),
        ],
        Disturbance::Jitter(us) => vec![sensors("stamp_jitter_s", f64::from(us) * 1e-6)],
        Disturbance::PositionSpikes => vec![
            sensors("position_spike_probability", 0.01),
            sensors("position_spike_rad", 0.01 * 100f64.powf(spread(spec.seed, 50))),
        ],
        Disturbance::InputSpikes => vec![
            sensors("spike_probability", 0.01),
            sensors("spike_v", 100.0 * spec.noise_v),
        ],
        Disturbance::InputBits(bits) => vec![sensors("input_resolution_v", 800.0 / f64::from(bits).exp2())],
        Disturbance::Friction { joint, percent } => {
            let (mass_kg, _) = spec.arm.masses_kg();
            let arm = spec.arm.parameters();
            let dynamics = ArmDynamics::new(&arm.with_mass_2(mass_kg), arm.gravity_m_s2);
            let size = dynamics.holding_torque(0.0) * f64::from(percent) / 100.0;
            let sizes = [1, 2].map(|j| if j == joint { size } else { 0.0 });
            vec![
                format!("plant.unmodelled.coulomb_friction_n_m={sizes:?}"),
                "plant.substeps=10".to_owned(),
            ]
        }
        Disturbance::FrictionModelled { joint, percent } => {
            let mut settings = disturbance_settings(&spec.disturbed(Disturbance::Friction { joint, percent }));
            settings.push("model.coulomb_friction=true".to_owned());
            settings.push(start_with(spec, &[1.0, 0.1]));
            settings
        }
        Disturbance::Delay(us) => vec![sensors("input_delay_s", f64::from(us) * 1e-6)],
        Disturbance::DelayEstimated(us) => vec![
            sensors("input_delay_s", f64::from(us) * 1e-6),
            "identifier.projected.estimate_input_delay=true".to_owned(),
            // the delay is the last parameter
            format!("estimator.theta_start={:?}", [&spec.start()[..], &[0.0]].concat()),
        ],
        Disturbance::Resonance => vec![sensors("resonance_hz", 40.0)],
        Disturbance::Eccentricity(arcsec) => vec![
            sensors("eccentricity_rad", f64::from(arcsec) * TAU / (360.0 * 3600.0)),
            sensors("eccentricity_phase_rad", TAU * spread(spec.seed, 51)),
        ],
        Disturbance::Tilt => vec![format!("plant.unmodelled.base_tilt_rad={:?}", TAU / 360.0)],
        Disturbance::InputOffset { joint, millivolts } => vec![format!(
            "plant.faults=[{{kind=\"wrong\",signal=\"input\",joint={joint},from_s=0.0,offset={:?}}}]",
            f64::from(millivolts) * 1e-3
        )],
        Disturbance::InputOffsetModelled { joint, millivolts } => {
            let mut settings = disturbance_settings(&spec.disturbed(Disturbance::InputOffset { joint, millivolts }));
            settings.push("model.offset=true".to_owned());
            settings.push(start_with(spec, &[0.0]));
            settings
        }
        Disturbance::FrictionAndOffsetModelled {
            joint,
            percent,
            millivolts,
        } => {
            let mut settings = disturbance_settings(&spec.disturbed(Disturbance::InputOffset { joint, millivolts }));
            settings.extend(disturbance_settings(
                &spec.disturbed(Disturbance::Friction { joint, percent }),
            ));
            settings.push("model.coulomb_friction=true".to_owned());
            settings.push("model.offset=true".to_owned());
            settings.push(start_with(spec, &[1.0, 0.1, 0.0]));
            settings
        }
        Disturbance::Heating => vec![
            "plant.unmodelled.heating_share=0.1".to_owned(),
            "plant.unmodelled.heating_s=60.0".to_owned(),
        ],
        Disturbance::Rotor(percent) => {
            let own = spec.arm.masses_kg().0 * spec.arm.parameters().length_2_m.powi(2) / 3.0;
            let rotors = [0.0, own * f64::from(percent) / 100.0];
            vec![format!("plant.unmodelled.rotor_inertia_kg_m2={rotors:?}")]
        }
        Disturbance::Viscous(b) => {
            let friction = [f64::from(b) * 1e-3; 2];
            vec![format!("plant.unmodelled.viscous_friction_n_m_s_per_rad={friction:?}")]
        }
        Disturbance::GainLater { joint, percent } => {
            let gain = 1.0 + f64::from(percent) / 100.0;
            vec![spec.fault_later("input", joint, &format!("gain={gain:?}"))]
        }
        Disturbance::OffsetLater { joint, millivolts } => {
            let offset = f64::from(millivolts) * 1e-3;
            vec![spec.fault_later("input", joint, &format!("offset={offset:?}"))]
        }
        Disturbance::ZeroLater { joint, milliradians } => {
            let offset = f64::from(milliradians) * 1e-3;
            vec![spec.fault_later("q", joint, &format!("offset={offset:?}"))]
        }
        Disturbance::ScaleLater { joint, permille } => {
            let gain = 1.0 + f64::from(permille) / 1000.0;
            vec![spec.fault_later("q", joint, &format!("gain={gain:?}"))]
        }
        Disturbance::ClockLater(permille) => {
            let gain = 1.0 + f64::from(permille) / 1000.0;
            vec![spec.fault_later("time", 0, &format!("gain={gain:?}"))]
        }
        Disturbance::FrictionLater { joint, percent } => {
            let mut settings = disturbance_settings(&spec.disturbed(Disturbance::Friction { joint, percent }));
            settings.push(format!("plant.unmodelled.friction_from_s={:?}", spec.change_s()));
            settings
        }
        Disturbance::NoiseAlone => ERRORS
            .into_iter()
            .map(|key| format!("identifier.considered.{key}=0.0"))
            .collect(),
        // from the identifier's prior, see `drawn.rs`
        Disturbance::Drawn => Vec::new(),
        // only for the axis
        Disturbance::Stribeck(_) => Vec::new(),
    }
}
