//! Section `[plant]` and those below it: the simulation's options.

use super::check::{Check, joints};
use super::layers::cut;
use super::schema::{FaultForm, FileForm, RealOrWord};
use super::sections::{PlantConfig, Speed};
use super::setpoint_csv;
use crate::model::PlantDefinition;
use crate::node::model::SharedModel;
use crate::sim::{
    ARM_JOINTS, ArmParameters, ControllerKind, ControllerOptions, Fault, FaultKind, FaultSignal, Interpolation,
    Machine, MassSchedule, MoveProfile, Moves, PlantMachine, PositionFeedback, SensorOptions, ServoAxisOptions,
    Setpoint, SimError, SimOptions, Tone, Unmodelled,
};
use std::path::Path;

fn interpolation(word: &str) -> Interpolation {
    if word == "linear" {
        Interpolation::Linear
    } else {
        Interpolation::Step
    }
}

/// Points of a mass over time, from two lists.
fn schedule(section: &str, masses: &str, t_s: &[f64], mass: &[f64], check: &mut Check<'_>) -> Option<Vec<(f64, f64)>> {
    if t_s.len() == mass.len() {
        return Some(t_s.iter().copied().zip(mass.iter().copied()).collect());
    }
    let [masses, times] = [masses, "t_s"].map(|name| format!("{section}.{name}"));
    let key = if check.stated(&masses) { masses } else { times };
    let message = format!(
        "expected as many times as masses, got {} times and {} masses",
        t_s.len(),
        mass.len()
    );
    check.wrong(&key, message);
    None
}

pub(super) fn plant(form: &FileForm, model: Option<&SharedModel>, check: &mut Check<'_>) -> Option<PlantConfig> {
    let mass_2 = schedule("plant.mass_2", "mass_kg", &form.mass_2.t_s, &form.mass_2.mass_kg, check)?;
    let axis = &form.servo_plant;
    let machine = if form.plant.machine == "servo_axis" {
        Machine::ServoAxis(ServoAxisOptions {
            gain: axis.gain,
            mass: MassSchedule {
                points: schedule("plant.servo_axis", "mass", &axis.t_s, &axis.mass, check)?,
                interpolation: Interpolation::Step,
            },
            viscous_friction: axis.viscous_friction,
            coulomb_friction: axis.coulomb_friction,
            offset: axis.offset,
            proportional_gain: axis.proportional_gain,
            derivative_gain: axis.derivative_gain,
            input_limit: axis.input_limit,
            position_resolution: axis.position_resolution,
        })
    } else if form.plant.machine == "model" {
        Machine::Plant(own_machine(form, model?.definition(), check)?)
    } else {
        Machine::Arm
    };
    let setpoint = setpoint(form, check)?;
    let arm = &form.arm;
    let sim = SimOptions {
        sample_period_s: form.plant.sample_period_s,
        duration_s: form.plant.duration_s,
        substeps: form.plant.substeps as usize,
        machine,
        arm: ArmParameters {
            length_1_m: arm.length_1_m,
            mass_1_kg: arm.mass_1_kg,
            length_2_m: arm.length_2_m,
            gravity_m_s2: arm.gravity_m_s2,
            winding_resistance_ohm: joints(&arm.winding_resistance_ohm),
            winding_inductance_h: joints(&arm.winding_inductance_h),
            torque_constant_n_m_per_a: joints(&arm.torque_constant_n_m_per_a),
            back_emf_constant_v_s_per_rad: joints(&arm.back_emf_constant_v_s_per_rad),
        },
        mass_2: MassSchedule {
            points: mass_2,
            interpolation: interpolation(&form.mass_2.between),
        },
        controller: ControllerOptions {
            kind: if form.controller.kind == "sampled" {
                ControllerKind::Sampled
            } else {
                ControllerKind::Analog
            },
            feedback: if form.controller.feedback == "measured" {
                PositionFeedback::Measured
            } else {
                PositionFeedback::True
            },
            proportional_gain_v_per_rad: joints(&form.controller.proportional_gain_v_per_rad),
            derivative_gain_v_s_per_rad: joints(&form.controller.derivative_gain_v_s_per_rad),
            voltage_limit_v: form.controller.voltage_limit_v,
        },
        setpoint,
        initial_q_rad: joints(&form.plant.initial_q_rad),
        seed: form.plant.seed,
        sensors: SensorOptions {
            input_noise_v: form.sensors.input_noise_v,
            spike_probability: form.sensors.spike_probability,
            spike_v: form.sensors.spike_v,
            input_limit_v: form.sensors.input_limit_v,
            input_resolution_v: form.sensors.input_resolution_v,
            encoder_bits: form.sensors.encoder_bits as u32,
            position_noise_rad: form.sensors.position_noise_rad,
            position_spike_probability: form.sensors.position_spike_probability,
            position_spike_rad: form.sensors.position_spike_rad,
            eccentricity_rad: form.sensors.eccentricity_rad,
            eccentricity_phase_rad: form.sensors.eccentricity_phase_rad,
            resonance_hz: form.sensors.resonance_hz,
            resonance_damping: form.sensors.resonance_damping,
            input_delay_s: form.sensors.input_delay_s,
            jitter_s: form.sensors.jitter_s,
            stamp_jitter_s: form.sensors.stamp_jitter_s,
            loss_probability: form.sensors.loss_probability,
            loss_burst: form.sensors.loss_burst,
        },
        unmodelled: Unmodelled {
            coulomb_friction_n_m: joints(&form.unmodelled.coulomb_friction_n_m),
            friction_speed_rad_per_s: form.unmodelled.friction_speed_rad_per_s,
            base_tilt_rad: form.unmodelled.base_tilt_rad,
            heating_share: form.unmodelled.heating_share,
            heating_s: form.unmodelled.heating_s,
        },
        faults: form.plant.faults.iter().map(fault).collect(),
    };
    let period_ns = sim.sample_period_s * 1e9;
    if (period_ns - period_ns.round()).abs() > 1e-6 * period_ns {
        let message = format!("expected a whole number of nanoseconds, got {period_ns} ns");
        check.wrong("plant.sample_period_s", message);
    }
    for (index, fault) in sim.faults.iter().enumerate() {
        if let Err(error) = fault.validate() {
            let name = error.field.strip_prefix("faults.").unwrap_or(error.field);
            let message = format!(
                "table {}, {name}: expected {}, got {}",
                index + 1,
                error.expected,
                error.got
            );
            check.wrong("plant.faults", message);
        }
        if fault.signal.bit() != 0 && sim.signals() & fault.signal.bit() == 0 {
            let message = format!(
                "table {}: has no effect, because positions come from a sensor and the machine reports no derivatives",
                index + 1
            );
            check.warn("plant.faults", message);
        }
    }
    let without_faults = SimOptions {
        faults: Vec::new(),
        ..sim.clone()
    };
    if let Err(error) = without_faults.validate() {
        let key = sim_key(&error, &form.setpoint.kind);
        let joint = error
            .joint
            .map(|joint| format!(" for joint {}", joint + 1))
            .unwrap_or_default();
        check.wrong(&key, format!("expected {}{joint}, got {}", error.expected, error.got));
    }
    let speed = match form.plant.speed {
        RealOrWord::Word(_) => Speed::Max,
        RealOrWord::Real(factor) => Speed::Factor(factor),
    };
    Some(PlantConfig { sim, speed })
}

/// True values are this much above the start values unless the configuration has others: a machine with something to find out.
const TRUE_SHARE: f64 = 1.25;

/// The machine of the model's own equations.
fn own_machine(form: &FileForm, definition: &PlantDefinition, check: &mut Check<'_>) -> Option<PlantMachine> {
    let section = &form.model_plant;
    let (joints, params) = (definition.joints, definition.parameters.len());
    let mut ok = true;
    let mut count = |key: &str, got: usize, wanted: usize, what: &str| {
        if got != 0 && got != wanted {
            let message = format!(
                "expected {wanted} numbers, one per {what} of {}, or none, got {got}",
                definition.name
            );
            check.wrong(&format!("plant.model.{key}"), message);
            ok = false;
        }
    };
    count("theta", section.theta.len(), params, "parameter");
    count("theta_after", section.theta_after.len(), params, "parameter");
    count("proportional_gain", section.proportional_gain.len(), joints, "joint");
    count("derivative_gain", section.derivative_gain.len(), joints, "joint");
    let truth = match section.theta.is_empty() {
        true => definition
            .parameters
            .iter()
            .map(|p| (TRUE_SHARE * p.start).clamp(p.lower, p.upper))
            .collect(),
        false => section.theta.clone(),
    };
    let mut truth = vec![(0.0, truth)];
    match (section.change_s, section.theta_after.is_empty()) {
        (None, true) => {}
        (Some(change_s), false) => truth.push((change_s, section.theta_after.clone())),
        _ => {
            let message = "expected both plant.model.change_s and plant.model.theta_after, or neither, got one";
            check.wrong(
                check.culprit(&["plant.model.change_s", "plant.model.theta_after"]),
                message,
            );
            ok = false;
        }
    }
    ok.then(|| PlantMachine {
        model: definition.name.clone(),
        joints,
        order: definition.equations.iter().map(|e| e.order).max().unwrap_or(0),
        names: definition.parameters.iter().map(|p| p.name.to_string()).collect(),
        truth,
        proportional_gain: section.proportional_gain.clone(),
        derivative_gain: section.derivative_gain.clone(),
    })
}

/// The schema has let only known words through.
fn fault(form: &FaultForm) -> Fault {
    let kind = match form.kind.as_str() {
        "stuck" => FaultKind::Stuck,
        "garbage" => FaultKind::Garbage,
        "wrong" => FaultKind::Wrong {
            gain: form.gain,
            offset: form.offset,
        },
        "slow" => FaultKind::Slow {
            period_s: form.period_s,
        },
        "delayed" => FaultKind::Delayed { delay_s: form.delay_s },
        "intermittent" => FaultKind::Intermittent {
            share: form.share,
            period_s: form.period_s,
        },
        _ => FaultKind::Off,
    };
    let signal = FaultSignal::NAMES.iter().find(|(_, name)| *name == form.signal);
    Fault {
        kind,
        signal: signal.map_or(FaultSignal::Sample, |(signal, _)| *signal),
        joint: (form.joint as usize).checked_sub(1),
        from_s: form.from_s,
        to_s: form.to_s,
    }
}

/// The key behind a field of the simulation's options.
fn sim_key(error: &SimError, setpoint_kind: &str) -> String {
    match error.field.split_once('.') {
        Some(("setpoint", rest)) => {
            let rest = rest.rsplit('.').next().unwrap_or(rest);
            format!("plant.setpoint.{setpoint_kind}.{rest}")
        }
        Some(("mass_2", _)) => "plant.mass_2.t_s".to_owned(),
        Some(("servo_axis", "mass")) => "plant.servo_axis.t_s".to_owned(),
        _ => format!("plant.{}", error.field),
    }
}

fn setpoint(form: &FileForm, check: &mut Check<'_>) -> Option<[Setpoint; ARM_JOINTS]> {
    if form.setpoint.kind == "csv" {
        return setpoint_from_csv(form, check);
    }
    if form.setpoint.kind == "sines" {
        let sines = &form.sines;
        for (key, lists) in [("amplitude_rad", &sines.amplitude_rad), ("phase_rad", &sines.phase_rad)] {
            for (joint, (list, frequencies)) in lists.iter().zip(&sines.frequency_hz).enumerate() {
                if list.len() != frequencies.len() {
                    let message = format!(
                        "expected as many values as frequency_hz has for joint {}, {}, got {}",
                        joint + 1,
                        frequencies.len(),
                        list.len()
                    );
                    check.wrong(&format!("plant.setpoint.sines.{key}"), message);
                    return None;
                }
            }
        }
    }
    Some(std::array::from_fn(|j| match form.setpoint.kind.as_str() {
        "square" => Setpoint::Square {
            amplitude_rad: form.square.amplitude_rad[j],
            offset_rad: form.square.offset_rad[j],
            period_s: form.square.period_s[j],
            shift_s: form.square.shift_s[j],
        },
        "sines" => {
            let sines = &form.sines;
            let tones = sines.frequency_hz[j]
                .iter()
                .zip(&sines.amplitude_rad[j])
                .zip(&sines.phase_rad[j]);
            Setpoint::Sines {
                offset_rad: sines.offset_rad[j],
                tones: tones
                    .map(|((&frequency_hz, &amplitude_rad), &phase_rad)| Tone {
                        frequency_hz,
                        amplitude_rad,
                        phase_rad,
                    })
                    .collect(),
            }
        }
        "random_sines" => Setpoint::RandomSines {
            count: form.random_sines.count as usize,
            min_frequency_hz: form.random_sines.min_frequency_hz[j],
            max_frequency_hz: form.random_sines.max_frequency_hz[j],
            amplitude_rad: form.random_sines.amplitude_rad[j],
        },
        "random" => Setpoint::Random {
            min_rad: form.random.min_rad[j],
            max_rad: form.random.max_rad[j],
            min_dwell_s: form.random.min_dwell_s[j],
            max_dwell_s: form.random.max_dwell_s[j],
        },
        "moves" => Setpoint::Moves(Moves {
            profile: MoveProfile::NAMES
                .iter()
                .find(|(_, name)| *name == form.moves.profile)
                .map_or(MoveProfile::default(), |(profile, _)| *profile),
            min_rad: form.moves.min_rad[j],
            max_rad: form.moves.max_rad[j],
            min_move_s: form.moves.min_move_s[j],
            max_move_s: form.moves.max_move_s[j],
            min_rest_s: form.moves.min_rest_s[j],
            max_rest_s: form.moves.max_rest_s[j],
        }),
        "chirp" => Setpoint::Chirp {
            amplitude_rad: form.chirp.amplitude_rad[j],
            offset_rad: form.chirp.offset_rad[j],
            start_frequency_hz: form.chirp.start_frequency_hz[j],
            end_frequency_hz: form.chirp.end_frequency_hz[j],
            sweep_s: form.chirp.sweep_s[j],
        },
        _ => Setpoint::Steps {
            levels_rad: form.steps.levels_rad[j].clone(),
            dwell_s: form.steps.dwell_s[j],
            shift_s: form.steps.shift_s[j],
        },
    }))
}

/// Puts the rows of a file of setpoints in the place of its path, so that a configuration that is written out, into a recording or for the processes of a run,
/// needs no other file.
pub(super) fn inline_setpoints(form: &mut FileForm, check: &mut Check<'_>) {
    const KEY: &str = "plant.setpoint.csv.path";
    let Some(path) = form.csv.path.take_if(|_| form.setpoint.kind == "csv") else {
        return;
    };
    if check.recorded(KEY) {
        let message = format!(
            "a recording's configuration opens no file, and it names \"{}\"; name the file on the command line, --set {KEY}=FILE",
            cut(&path, 60)
        );
        check.wrong(KEY, message);
        return;
    }
    match setpoint_csv::read(Path::new(&path)) {
        Ok(columns) => form.csv.rows = Some(columns.to_rows()),
        Err(message) => check.wrong(KEY, message),
    }
}

fn setpoint_from_csv(form: &FileForm, check: &mut Check<'_>) -> Option<[Setpoint; ARM_JOINTS]> {
    const KEY: &str = "plant.setpoint.csv.rows";
    let Some(rows) = &form.csv.rows else {
        // A path that could not be read has been told.
        if !check.stated("plant.setpoint.csv.path") {
            check.wrong(
                "plant.setpoint.kind",
                "\"csv\" needs plant.setpoint.csv.path, which is not set",
            );
        }
        return None;
    };
    match setpoint_csv::Columns::from_rows(rows) {
        Ok(columns) => {
            let interpolation = interpolation(&form.csv.between);
            Some(columns.q_rad.map(|values_rad| Setpoint::Table {
                t_s: columns.t_s.clone(),
                values_rad,
                interpolation,
            }))
        }
        Err(message) => {
            check.wrong(KEY, message);
            None
        }
    }
}
