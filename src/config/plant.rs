//! Section `[plant]` and its subsections: the simulation's options.

use super::check::{Check, joints};
use super::choice::Choice;
use super::schema::{
    self, Arm, Controller, Fastest, FaultChoice, FaultForm, FileForm, MachineKind, RealOr, Sensors, ServoAxisPlant,
    SetpointKind,
};
use super::sections::{PlantConfig, Speed};
use super::setpoint;
use crate::model::PlantDefinition;
use crate::node::model::SharedModel;
use crate::sim::{
    ArmParameters, ControllerOptions, Fault, FaultKind, FaultSignal, Interpolation, Machine, MassSchedule,
    PlantMachine, SensorOptions, ServoAxisOptions, SimError, SimOptions, Unmodelled,
};

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
    let sim = simulation(form, model, check)?;
    check_period(sim.sample_period_s, check);
    check_faults(&sim, check);
    check_without_faults(&sim, form.setpoint.kind, check);
    let speed = match form.plant.speed {
        RealOr::Word(Fastest::Max) => Speed::Max,
        RealOr::Real(factor) => Speed::Factor(factor),
    };
    Some(PlantConfig { sim, speed })
}

/// The options as the sections state them; only lists and files are checked already.
fn simulation(form: &FileForm, model: Option<&SharedModel>, check: &mut Check<'_>) -> Option<SimOptions> {
    let mass_2 = schedule("plant.mass_2", "mass_kg", &form.mass_2.t_s, &form.mass_2.mass_kg, check)?;
    let machine = match form.plant.machine {
        MachineKind::ServoAxis => Machine::ServoAxis(servo_axis(&form.servo_plant, check)?),
        MachineKind::Model => Machine::Plant(own_machine(form, model?.definition(), check)?),
        MachineKind::Arm => Machine::Arm,
    };
    Some(SimOptions {
        sample_period_s: form.plant.sample_period_s,
        duration_s: form.plant.duration_s,
        substeps: form.plant.substeps as usize,
        machine,
        arm: arm(&form.arm),
        mass_2: MassSchedule {
            points: mass_2,
            interpolation: form.mass_2.between,
        },
        controller: controller(&form.controller),
        setpoint: setpoint::setpoint(form, check)?,
        initial_q_rad: joints(&form.plant.initial_q_rad),
        seed: form.plant.seed,
        sensors: sensors(&form.sensors),
        unmodelled: unmodelled(&form.unmodelled),
        faults: form.plant.faults.iter().map(fault).collect(),
    })
}

fn servo_axis(axis: &ServoAxisPlant, check: &mut Check<'_>) -> Option<ServoAxisOptions> {
    Some(ServoAxisOptions {
        gain: axis.gain,
        mass: MassSchedule {
            points: schedule("plant.servo_axis", "mass", &axis.t_s, &axis.mass, check)?,
            interpolation: Interpolation::Step,
        },
        viscous_friction: axis.viscous_friction,
        coulomb_friction: axis.coulomb_friction,
        stribeck_friction: axis.stribeck_friction,
        stribeck_speed: axis.stribeck_speed,
        offset: axis.offset,
        proportional_gain: axis.proportional_gain,
        derivative_gain: axis.derivative_gain,
        input_limit: axis.input_limit,
        position_resolution: axis.position_resolution,
    })
}

fn arm(arm: &Arm) -> ArmParameters {
    ArmParameters {
        length_1_m: arm.length_1_m,
        mass_1_kg: arm.mass_1_kg,
        length_2_m: arm.length_2_m,
        gravity_m_s2: arm.gravity_m_s2,
        winding_resistance_ohm: joints(&arm.winding_resistance_ohm),
        winding_inductance_h: joints(&arm.winding_inductance_h),
        torque_constant_n_m_per_a: joints(&arm.torque_constant_n_m_per_a),
        back_emf_constant_v_s_per_rad: joints(&arm.back_emf_constant_v_s_per_rad),
    }
}

fn controller(controller: &Controller) -> ControllerOptions {
    ControllerOptions {
        kind: controller.kind.unwrap_or_default(),
        feedback: controller.feedback,
        proportional_gain_v_per_rad: joints(&controller.proportional_gain_v_per_rad),
        derivative_gain_v_s_per_rad: joints(&controller.derivative_gain_v_s_per_rad),
        voltage_limit_v: controller.voltage_limit_v,
    }
}

fn sensors(sensors: &Sensors) -> SensorOptions {
    SensorOptions {
        input_noise_v: sensors.input_noise_v,
        spike_probability: sensors.spike_probability,
        spike_v: sensors.spike_v,
        input_limit_v: sensors.input_limit_v,
        input_resolution_v: sensors.input_resolution_v,
        encoder_bits: sensors.encoder_bits as u32,
        position_noise_rad: sensors.position_noise_rad,
        position_spike_probability: sensors.position_spike_probability,
        position_spike_rad: sensors.position_spike_rad,
        eccentricity_rad: sensors.eccentricity_rad,
        eccentricity_phase_rad: sensors.eccentricity_phase_rad,
        resonance_hz: sensors.resonance_hz,
        resonance_damping: sensors.resonance_damping,
        input_delay_s: sensors.input_delay_s,
        jitter_s: sensors.jitter_s,
        stamp_jitter_s: sensors.stamp_jitter_s,
        loss_probability: sensors.loss_probability,
        loss_burst: sensors.loss_burst,
    }
}

fn unmodelled(section: &schema::Unmodelled) -> Unmodelled {
    Unmodelled {
        coulomb_friction_n_m: joints(&section.coulomb_friction_n_m),
        friction_speed_rad_per_s: section.friction_speed_rad_per_s,
        viscous_friction_n_m_s_per_rad: joints(&section.viscous_friction_n_m_s_per_rad),
        friction_from_s: section.friction_from_s,
        base_tilt_rad: section.base_tilt_rad,
        heating_share: section.heating_share,
        heating_s: section.heating_s,
        rotor_inertia_kg_m2: joints(&section.rotor_inertia_kg_m2),
    }
}

/// Samples have their time in whole nanoseconds.
fn check_period(sample_period_s: f64, check: &mut Check<'_>) {
    let period_ns = sample_period_s * 1e9;
    if (period_ns - period_ns.round()).abs() > 1e-6 * period_ns {
        let message = format!("expected a whole number of nanoseconds, got {period_ns} ns");
        check.wrong("plant.sample_period_s", message);
    }
}

/// Checks each fault alone, because the message says which table of the file it is.
fn check_faults(sim: &SimOptions, check: &mut Check<'_>) {
    for (index, fault) in sim.faults.iter().enumerate() {
        if let Err(error) = fault.validate(sim.joints()) {
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
}

/// Checks everything except faults.
fn check_without_faults(sim: &SimOptions, setpoint_kind: SetpointKind, check: &mut Check<'_>) {
    let without_faults = SimOptions {
        faults: Vec::new(),
        ..sim.clone()
    };
    if let Err(error) = without_faults.validate() {
        let key = sim_key(&error, setpoint_kind);
        let joint = error
            .joint
            .map(|joint| format!(" for joint {}", joint + 1))
            .unwrap_or_default();
        check.wrong(&key, format!("expected {}{joint}, got {}", error.expected, error.got));
    }
}

/// Default ratio of true values to start values, so that there is something to identify.
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

/// A fault with defaults for keys that its table leaves out.
fn fault(form: &FaultForm) -> Fault {
    let period_s = form.period_s.unwrap_or(0.0);
    let kind = match form.kind {
        FaultChoice::Off => FaultKind::Off,
        FaultChoice::Stuck => FaultKind::Stuck,
        FaultChoice::Garbage => FaultKind::Garbage,
        FaultChoice::Wrong => FaultKind::Wrong {
            gain: form.gain.unwrap_or(1.0),
            offset: form.offset.unwrap_or(0.0),
        },
        FaultChoice::Slow => FaultKind::Slow { period_s },
        FaultChoice::Delayed => FaultKind::Delayed {
            delay_s: form.delay_s.unwrap_or(0.0),
        },
        FaultChoice::Intermittent => FaultKind::Intermittent {
            share: form.share.unwrap_or(0.5),
            period_s,
        },
    };
    Fault {
        kind,
        signal: form.signal.unwrap_or(FaultSignal::Sample),
        joint: form.joint.and_then(|joint| (joint as usize).checked_sub(1)),
        from_s: form.from_s,
        to_s: form.to_s.unwrap_or(f64::INFINITY),
    }
}

/// The key behind a field of the simulation's options.
fn sim_key(error: &SimError, setpoint_kind: SetpointKind) -> String {
    match error.field.split_once('.') {
        Some(("setpoint", rest)) => {
            let rest = rest.rsplit('.').next().unwrap_or(rest);
            format!("plant.setpoint.{}.{rest}", setpoint_kind.word())
        }
        Some(("mass_2", _)) => "plant.mass_2.t_s".to_owned(),
        Some(("servo_axis", "mass")) => "plant.servo_axis.t_s".to_owned(),
        _ => format!("plant.{}", error.field),
    }
}
