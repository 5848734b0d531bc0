//! The built-in defaults: the paper's experiment, from the presets of the core types into the form
//! of the file.

use super::schema::{self, FileForm, RealOr};
use crate::control::AdaptiveOptions;
use crate::estimator::{CEDRO2022_BLOCK_LEN, ChangeDetection, cedro2022_estimator};
use crate::model::{DriveInput, Motion};
use crate::rows::ProjectedOptions;
use crate::sim::{ARM_JOINTS, Interpolation, MoveProfile, ServoAxisOptions, Setpoint, SimOptions};

impl Default for FileForm {
    /// The paper's experiment, from the presets of the core types.
    fn default() -> Self {
        let sim = SimOptions::cedro2022();
        let estimator = cedro2022_estimator();
        let rows = ProjectedOptions::recommended();
        let arm = &sim.arm;
        let axis = ServoAxisOptions::emps();
        let follow = AdaptiveOptions::default();
        let [kp, kd] = [
            &sim.controller.proportional_gain_v_per_rad,
            &sim.controller.derivative_gain_v_s_per_rad,
        ]
        .map(|gains| gains.to_vec());
        let mut steps = schema::Steps {
            levels_rad: Vec::new(),
            dwell_s: Vec::new(),
            shift_s: Vec::new(),
        };
        for setpoint in &sim.setpoint {
            if let Setpoint::Steps {
                levels_rad,
                dwell_s,
                shift_s,
            } = setpoint
            {
                steps.levels_rad.push(levels_rad.clone());
                steps.dwell_s.push(*dwell_s);
                steps.shift_s.push(*shift_s);
            }
        }
        let realtime = || schema::Realtime {
            scheduler_priority: 0,
            cpu_affinity: Vec::new(),
            lock_memory: false,
        };
        let both = |value: f64| vec![value; ARM_JOINTS];
        Self {
            bus: schema::Bus {
                robot: "arm".to_owned(),
                domain: "default".to_owned(),
                delivery: schema::Delivery::Auto,
                lockstep_consumers: 1,
                lockstep_limit_s: 10.0,
                sample_buffer: 4096,
                max_sample_subscribers: 16,
                max_estimate_subscribers: 32,
                max_programs: 64,
            },
            plant: schema::Plant {
                duration_s: sim.duration_s,
                machine: schema::MachineKind::Arm,
                speed: RealOr::Word(schema::Fastest::Max),
                seed: sim.seed,
                sample_period_s: sim.sample_period_s,
                substeps: sim.substeps as u64,
                initial_q_rad: sim.initial_q_rad.to_vec(),
                faults: Vec::new(),
            },
            arm: schema::Arm {
                length_1_m: arm.length_1_m,
                mass_1_kg: arm.mass_1_kg,
                length_2_m: arm.length_2_m,
                gravity_m_s2: arm.gravity_m_s2,
                winding_resistance_ohm: arm.winding_resistance_ohm.to_vec(),
                winding_inductance_h: arm.winding_inductance_h.to_vec(),
                torque_constant_n_m_per_a: arm.torque_constant_n_m_per_a.to_vec(),
                back_emf_constant_v_s_per_rad: arm.back_emf_constant_v_s_per_rad.to_vec(),
            },
            mass_2: schema::Mass2 {
                t_s: sim.mass_2.points.iter().map(|point| point.0).collect(),
                mass_kg: sim.mass_2.points.iter().map(|point| point.1).collect(),
                between: sim.mass_2.interpolation,
            },
            servo_plant: schema::ServoAxisPlant {
                t_s: axis.mass.points.iter().map(|point| point.0).collect(),
                mass: axis.mass.points.iter().map(|point| point.1).collect(),
                viscous_friction: axis.viscous_friction,
                coulomb_friction: axis.coulomb_friction,
                stribeck_friction: axis.stribeck_friction,
                stribeck_speed: axis.stribeck_speed,
                offset: axis.offset,
                gain: axis.gain,
                proportional_gain: axis.proportional_gain,
                derivative_gain: axis.derivative_gain,
                input_limit: axis.input_limit,
                position_resolution: axis.position_resolution,
            },
            model_plant: schema::ModelPlant {
                theta: Vec::new(),
                change_s: None,
                theta_after: Vec::new(),
                proportional_gain: Vec::new(),
                derivative_gain: Vec::new(),
            },
            controller: schema::Controller {
                kind: None,
                feedback: sim.controller.feedback,
                proportional_gain_v_per_rad: kp.clone(),
                derivative_gain_v_s_per_rad: kd.clone(),
                voltage_limit_v: sim.controller.voltage_limit_v,
            },
            sensors: schema::Sensors {
                input_noise_v: sim.sensors.input_noise_v,
                spike_probability: sim.sensors.spike_probability,
                spike_v: sim.sensors.spike_v,
                input_limit_v: sim.sensors.input_limit_v,
                input_resolution_v: sim.sensors.input_resolution_v,
                encoder_bits: u64::from(sim.sensors.encoder_bits),
                position_noise_rad: sim.sensors.position_noise_rad,
                position_spike_probability: sim.sensors.position_spike_probability,
                position_spike_rad: sim.sensors.position_spike_rad,
                eccentricity_rad: sim.sensors.eccentricity_rad,
                eccentricity_phase_rad: sim.sensors.eccentricity_phase_rad,
                resonance_hz: sim.sensors.resonance_hz,
                resonance_damping: sim.sensors.resonance_damping,
                input_delay_s: sim.sensors.input_delay_s,
                jitter_s: sim.sensors.jitter_s,
                stamp_jitter_s: sim.sensors.stamp_jitter_s,
                loss_probability: sim.sensors.loss_probability,
                loss_burst: sim.sensors.loss_burst,
            },
            unmodelled: schema::Unmodelled {
                coulomb_friction_n_m: sim.unmodelled.coulomb_friction_n_m.to_vec(),
                friction_speed_rad_per_s: sim.unmodelled.friction_speed_rad_per_s,
                base_tilt_rad: sim.unmodelled.base_tilt_rad,
                heating_share: sim.unmodelled.heating_share,
                heating_s: sim.unmodelled.heating_s,
            },
            setpoint: schema::Setpoint {
                kind: schema::SetpointKind::Steps,
            },
            steps,
            square: schema::Square {
                amplitude_rad: both(0.7),
                offset_rad: both(0.0),
                period_s: vec![2.6, 3.4],
                shift_s: both(0.0),
            },
            sines: schema::Sines {
                offset_rad: both(0.0),
                frequency_hz: vec![vec![0.23, 0.71, 1.9, 4.3], vec![0.31, 0.97, 2.3, 5.3]],
                amplitude_rad: vec![vec![0.4, 0.2, 0.1, 0.05]; ARM_JOINTS],
                phase_rad: vec![vec![0.0, 1.0, 2.0, 3.0]; ARM_JOINTS],
            },
            random_sines: schema::RandomSines {
                count: 6,
                min_frequency_hz: both(0.23),
                max_frequency_hz: both(5.3),
                amplitude_rad: both(0.8),
            },
            random: schema::Random {
                min_rad: vec![-1.0, -0.8],
                max_rad: vec![1.0, 0.8],
                min_dwell_s: both(1.0),
                max_dwell_s: both(3.0),
            },
            moves: schema::Moves {
                profile: MoveProfile::default(),
                min_rad: vec![-1.0, -0.8],
                max_rad: vec![1.0, 0.8],
                min_move_s: both(0.6),
                max_move_s: both(1.6),
                min_rest_s: both(0.0),
                max_rest_s: both(0.5),
            },
            chirp: schema::Chirp {
                amplitude_rad: both(0.3),
                offset_rad: both(0.0),
                start_frequency_hz: vec![0.1, 0.13],
                end_frequency_hz: vec![5.0, 6.5],
                sweep_s: vec![20.0, 23.0],
            },
            csv: schema::Csv {
                path: None,
                rows: None,
                between: Interpolation::Step,
            },
            model: schema::Model {
                kind: "manipulator".to_owned(),
                gravity_m_s2: arm.gravity_m_s2,
                coulomb_friction: false,
                offset: false,
            },
            servo_axis: schema::ServoAxisModel {
                motion: Motion::default(),
                input: DriveInput::default(),
                gain: 1.0,
            },
            known: schema::Known {
                length_1_m: None,
                winding_resistance_ohm: None,
                torque_constant_n_m_per_a: None,
            },
            identifier: schema::Identifier {
                rows: schema::RowsKind::Pointwise,
                input: schema::InputKind::Measured,
                proportional_gain_v_per_rad: kp,
                derivative_gain_v_s_per_rad: kd,
                input_limit: vec![f64::INFINITY],
                frozen_after_s: 0.2,
            },
            projected: schema::Projected {
                window_s: RealOr::Real(rows.window_s),
                stride_s: rows.stride_s,
                velocity_half_width_s: rows.velocity_half_width as f64 * rows.sample_period_s,
                timing: rows.timing,
                input_delay_s: rows.input_delay_s,
                estimate_input_delay: false,
                input_delay_limit_s: 5e-3,
                position_resolution: None,
                position_noise: None,
                input_noise: None,
                input_resolution: None,
                learn_noise: None,
            },
            considered: schema::ConsideredErrors {
                input_delay_s: rows.considered.input_delay_s,
                gain: rows.considered.gain,
                coulomb: rows.considered.coulomb,
                stribeck: rows.considered.stribeck,
                offset: rows.considered.offset,
                dead_band: rows.considered.dead_band,
                spring: rows.considered.spring,
                resonance_hz: rows.considered.resonance_hz,
                drift_per_s: rows.considered.drift_per_s,
                zero_rad: rows.considered.zero_rad,
                eccentricity_rad: rows.considered.eccentricity_rad.unwrap_or(0.0),
            },
            estimator: schema::Estimator {
                block_len: CEDRO2022_BLOCK_LEN as u64,
                theta_start: Vec::new(),
                start_std: Vec::new(),
                forgetting: estimator.forgetting,
                bound: estimator.bound,
                forgetting_factor: Some(estimator.forgetting_factor),
                time_constant_s: None,
                information_floor: estimator.information_floor,
                max_iterations: estimator.max_iterations as u64,
                step_factor: estimator.step_factor,
                bounds: schema::BoundsKind::None,
                lower: Vec::new(),
                upper: Vec::new(),
                relations: schema::RelationsKind::None,
                fixed: Vec::new(),
                noise_std: Vec::new(),
                noise_floor: Vec::new(),
                noise_floor_relative: estimator.noise_floor_relative,
                random_walk: Vec::new(),
                outliers: schema::OutliersKind::Keep,
                huber_limit: 1.345,
                gate_limit: 6.0,
                change_detection: false,
                false_alarm_rate: ChangeDetection::default().false_alarm_rate,
                change_margin_s: 0.0,
            },
            supervision: schema::Supervision {
                restarts: 0,
                backoff_s: 0.1,
                backoff_limit_s: 5.0,
                healthy_s: 60.0,
            },
            realtime_plant: realtime(),
            realtime_identifier: realtime(),
            realtime_monitor: realtime(),
            log: schema::Log {
                time: None,
                time_unit: schema::TimeUnit::Seconds,
                q: Vec::new(),
                position_unit: schema::PositionUnit::Radians,
                input: Vec::new(),
                input_unit: 1.0,
                setpoint: Vec::new(),
            },
            monitor: schema::Monitor {
                out_dir: None,
                record_file_mib: 1024,
                record_files: 16,
                record_joint_states: true,
            },
            control: schema::Control {
                feed_forward: schema::FeedForward::None,
                theta: Vec::new(),
                max_std: follow.max_std,
                blend_s: follow.blend_s,
                silence_s: follow.silence_s,
                deadline_s: 0.005,
                input_limit: Vec::new(),
                derivative_gain: Vec::new(),
            },
            checkpoint: schema::Checkpoint {
                dir: None,
                period_s: 10.0,
            },
        }
    }
}
