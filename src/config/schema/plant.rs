//! Section `[plant]` and those below it but for the setpoints: the simulated machine.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind};
use super::faults::{self, FaultForm};
use super::table::{
    FINITE, LIST, LONGEST_S, NOT_NEGATIVE, POSITIVE, RealOr, choice, joints, model_joints, parameters, real_or, table,
};
use crate::model::SAMPLE_PERIODS_S;
use crate::sim::{ControllerKind, Interpolation, PositionFeedback, ServoAxisOptions, SimOptions};

choices! {
    /// What is simulated.
    MachineKind {
        /// The arm of two joints.
        Arm = "arm",
        /// A servo axis.
        ServoAxis = "servo_axis",
        /// The equations of the model itself.
        Model = "model",
    }

    /// The word for a run without a pace.
    Fastest {
        /// As fast as it can be computed and consumed.
        Max = "max",
    }
}

table! {
    /// Section `[plant]`.
    Plant where sim = SimOptions::cedro2022(); {
        duration_s: f64 = sim.duration_s, Kind::Real(POSITIVE), "s",
            "Length of the run in simulated time, 1 to 1e9 sample periods";
        machine: MachineKind = MachineKind::Arm, choice::<MachineKind>(), "",
            "arm: two joints, sections plant.arm, plant.mass_2, plant.controller. servo_axis: one joint, section plant.servo_axis; the first joint's values of lists count, in m for a linear axis. model: the equations of the model itself, section plant.model; what a program with a model of its own simulates by default";
        speed: RealOr<Fastest> = RealOr::Word(Fastest::Max), real_or::<Fastest>(Interval::closed(1e-3, 1e3)), "",
            "Simulated seconds per second; \"max\" is as fast as it can be computed and consumed";
        seed: u64 = sim.seed, Kind::Whole(0, i64::MAX as u64), "",
            "Seed of everything random; the same seed gives the same samples, bit by bit";
        sample_period_s: f64 = sim.sample_period_s, Kind::Real(Interval::closed(SAMPLE_PERIODS_S.0, SAMPLE_PERIODS_S.1)), "s",
            "Time between two samples, the paper's Δ; also converts estimator.time_constant_s";
        substeps: u64 = sim.substeps as u64, Kind::Whole(1, 1000), "",
            "Runge-Kutta steps per sample";
        initial_q_rad: Vec<f64> = sim.initial_q_rad.to_vec(), joints(Interval::closed(-100.0, 100.0)), "rad",
            "Joint positions at the start; the arm starts at rest, its weight held by the motors";
        faults: Vec<FaultForm> = Vec::new(), Kind::Tables(faults::KEYS), "",
            "What goes wrong on the way from the machine to its listeners, a table [[plant.faults]] for each fault, in order; the machine and its controller are not concerned";
    }
}

table! {
    /// Section `[plant.arm]`.
    Arm where arm = SimOptions::cedro2022().arm; {
        length_1_m: f64 = arm.length_1_m, Kind::Real(POSITIVE), "m",
            "Length l1 of link 1, the column";
        mass_1_kg: f64 = arm.mass_1_kg, Kind::Real(POSITIVE), "kg",
            "Mass m1 of link 1";
        length_2_m: f64 = arm.length_2_m, Kind::Real(POSITIVE), "m",
            "Length l2 of link 2, the arm";
        gravity_m_s2: f64 = arm.gravity_m_s2, Kind::Real(NOT_NEGATIVE), "m/s²",
            "Acceleration of gravity g";
        winding_resistance_ohm: Vec<f64> = arm.winding_resistance_ohm.to_vec(), joints(POSITIVE), "Ω",
            "Resistance R_w of each motor";
        winding_inductance_h: Vec<f64> = arm.winding_inductance_h.to_vec(), joints(POSITIVE), "H",
            "Inductance L of each motor";
        torque_constant_n_m_per_a: Vec<f64> = arm.torque_constant_n_m_per_a.to_vec(), joints(POSITIVE), "N m/A",
            "Torque constant k_m of each motor";
        back_emf_constant_v_s_per_rad: Vec<f64> = arm.back_emf_constant_v_s_per_rad.to_vec(),
            joints(NOT_NEGATIVE), "V s/rad",
            "Back-EMF constant k_e of each motor";
    }
}

table! {
    /// Section `[plant.mass_2]`.
    Mass2 where mass = SimOptions::cedro2022().mass_2; {
        t_s: Vec<f64> = mass.points.iter().map(|point| point.0).collect(),
            Kind::Reals(LIST, Interval::closed(0.0, LONGEST_S)), "s",
            "Times of the points, rising, the first one 0";
        mass_kg: Vec<f64> = mass.points.iter().map(|point| point.1).collect(), Kind::Reals(LIST, POSITIVE), "kg",
            "Masses from these times on, as many as t_s";
        between: Interpolation = mass.interpolation, choice::<Interpolation>(), "",
            "Between two points the mass keeps the value of the first (step) or follows the straight line (linear)";
    }
}

table! {
    /// Section `[plant.servo_axis]`.
    ServoAxisPlant where axis = ServoAxisOptions::emps(); {
        t_s: Vec<f64> = axis.mass.points.iter().map(|point| point.0).collect(),
            Kind::Reals(LIST, Interval::closed(0.0, LONGEST_S)), "s",
            "Times from which on the masses hold, rising, the first one 0";
        mass: Vec<f64> = axis.mass.points.iter().map(|point| point.1).collect(),
            Kind::Reals(LIST, POSITIVE), "kg or kg m²",
            "Masses or moments of inertia from these times on, as many as t_s";
        viscous_friction: f64 = axis.viscous_friction, Kind::Real(NOT_NEGATIVE), "N s/m or N m s/rad",
            "Viscous friction, proportional to the speed";
        coulomb_friction: f64 = axis.coulomb_friction, Kind::Real(NOT_NEGATIVE), "N or N m",
            "Coulomb friction, which does not depend on the speed; the axis sticks until the force exceeds it";
        stribeck_friction: f64 = axis.stribeck_friction, Kind::Real(NOT_NEGATIVE), "N or N m",
            "Further friction that falls with the speed v as exp(−(v/stribeck_speed)²), which the identified model does not have";
        stribeck_speed: f64 = axis.stribeck_speed, Kind::Real(POSITIVE), "m/s or rad/s",
            "Speed at which 37 % of stribeck_friction are left";
        offset: f64 = axis.offset, Kind::Real(FINITE), "N or N m",
            "Constant force or torque against positive motion";
        gain: f64 = axis.gain, Kind::Real(FINITE), "N or N m per unit of input",
            "What the drive gives for one unit of input, not 0";
        proportional_gain: f64 = axis.proportional_gain, Kind::Real(NOT_NEGATIVE), "input per m or rad",
            "Gain Kp of the controller u = Kp (setpoint − q) − Kd v, analog or sampled as plant.controller.kind says";
        derivative_gain: f64 = axis.derivative_gain, Kind::Real(NOT_NEGATIVE), "input per m/s or rad/s",
            "Gain Kd of the controller";
        input_limit: f64 = axis.input_limit, Kind::Real(POSITIVE.or_infinite()), "unit of the input",
            "Most that the drive gives, either sign; inf: no limit";
        position_resolution: f64 = axis.position_resolution, Kind::Real(NOT_NEGATIVE), "m or rad",
            "One count of the position sensor, and no measured derivatives; 0: as plant.sensors.encoder_bits says";
    }
}

table! {
    /// Section `[plant.model]`.
    ModelPlant {
        theta: Vec<f64> = Vec::new(), parameters(FINITE), "the parameters' own",
            "True values of the parameters in their order; none: a quarter above their start values";
        change_s: Option<f64> = None, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "Time of a change of the true values";
        theta_after: Vec<f64> = Vec::new(), parameters(FINITE), "the parameters' own",
            "True values from change_s on";
        proportional_gain: Vec<f64> = Vec::new(), model_joints(NOT_NEGATIVE), "input per rad or m",
            "Gain Kp of each joint's controller u = Kp (setpoint - q) - Kd dq, sampled and held; none: from the joint's inertia";
        derivative_gain: Vec<f64> = Vec::new(), model_joints(NOT_NEGATIVE), "input per rad/s or m/s",
            "Gain Kd of each joint; none: from the joint's inertia";
    }
}

table! {
    /// Section `[plant.controller]`.
    Controller where controller = SimOptions::cedro2022().controller; {
        kind: Option<ControllerKind> = None, choice::<ControllerKind>(), "",
            "analog: continuous, as in the paper, and what is simulated if nothing is stated. sampled: computed once per sample and held; unstable for |q2| near π/2 at 1 kHz. If stated, identifier.projected.timing follows it, or must agree";
        feedback: PositionFeedback = controller.feedback, choice::<PositionFeedback>(), "",
            "Position that the controller works with: the true one, or as its sample has it (sampled only); the velocity is true, as from a tachometer";
        proportional_gain_v_per_rad: Vec<f64> = controller.proportional_gain_v_per_rad.to_vec(),
            joints(NOT_NEGATIVE), "V/rad",
            "Gain Kp of each joint";
        derivative_gain_v_s_per_rad: Vec<f64> = controller.derivative_gain_v_s_per_rad.to_vec(),
            joints(NOT_NEGATIVE), "V s/rad",
            "Gain Kd of each joint";
        voltage_limit_v: f64 = controller.voltage_limit_v, Kind::Real(POSITIVE.or_infinite()), "V",
            "Most that each drive gives, either sign, feed-forward included; inf: no limit";
    }
}

table! {
    /// Section `[plant.sensors]`.
    Sensors where sensors = SimOptions::cedro2022().sensors; {
        input_noise_v: f64 = sensors.input_noise_v, Kind::Real(NOT_NEGATIVE), "V",
            "Standard deviation of white noise on the measured voltage; the motor itself does not see it";
        spike_probability: f64 = sensors.spike_probability, Kind::Real(Interval::closed(0.0, 1.0)), "",
            "Share of samples whose measured voltage carries a spike, per joint";
        spike_v: f64 = sensors.spike_v, Kind::Real(NOT_NEGATIVE), "V",
            "Standard deviation of the spikes";
        input_limit_v: f64 = sensors.input_limit_v, Kind::Real(POSITIVE.or_infinite()), "V",
            "Most that the voltage measurement shows, either sign; inf: no limit";
        input_resolution_v: f64 = sensors.input_resolution_v, Kind::Real(NOT_NEGATIVE), "V",
            "One count of the voltage measurement, the range by 2^bits; 0: voltages without rounding";
        encoder_bits: u64 = u64::from(sensors.encoder_bits), Kind::Whole(0, 40), "bits",
            "2^bits counts per turn on each joint, and no measured derivatives; 0: positions without rounding";
        position_noise_rad: f64 = sensors.position_noise_rad, Kind::Real(NOT_NEGATIVE), "rad",
            "Standard deviation of white noise on the measured positions, before they are rounded";
        position_spike_probability: f64 = sensors.position_spike_probability,
            Kind::Real(Interval::closed(0.0, 1.0)), "",
            "Share of samples whose measured position carries a spike, per joint";
        position_spike_rad: f64 = sensors.position_spike_rad, Kind::Real(NOT_NEGATIVE), "rad",
            "Standard deviation of the spikes on positions";
        eccentricity_rad: f64 = sensors.eccentricity_rad, Kind::Real(Interval::closed(-0.1, 0.1)), "rad",
            "Size a of the error of encoders mounted off their axes, which show q + a sin(q + eccentricity_phase_rad); 100 arc seconds are 4.8e-4";
        eccentricity_phase_rad: f64 = sensors.eccentricity_phase_rad, Kind::Real(FINITE), "rad",
            "Phase of this error: it is 0 and rises at q = −eccentricity_phase_rad";
        resonance_hz: f64 = sensors.resonance_hz, Kind::Real(Interval::closed(0.0, 1000.0)), "Hz",
            "Frequency of a resonance between each joint and its encoder, as of a soft coupling; 0: none";
        resonance_damping: f64 = sensors.resonance_damping, Kind::Real(Interval::closed(0.0, 10.0)), "",
            "Damping ratio of this resonance";
        input_delay_s: f64 = sensors.input_delay_s, Kind::Real(Interval::closed(-0.01, 0.01)), "s",
            "The recorded voltage acts this much later than the positions of its sample say";
        jitter_s: f64 = sensors.jitter_s, Kind::Real(Interval::closed(0.0, 1e-3)), "s",
            "Standard deviation of the instant at which the positions are read";
        stamp_jitter_s: f64 = sensors.stamp_jitter_s, Kind::Real(Interval::closed(0.0, 0.01)), "s",
            "Standard deviation of the samples' instants around their grid, at most 0.4 periods off; controller and time stamps keep to the true instants";
        loss_probability: f64 = sensors.loss_probability, Kind::Real(Interval::closed(0.0, 0.999)), "",
            "Share of samples that are lost on their way to everybody";
        loss_burst: u64 = sensors.loss_burst, Kind::Whole(1, 10_000), "samples",
            "Samples that are lost in one go";
    }
}

table! {
    /// Section `[plant.unmodelled]`.
    Unmodelled where unmodelled = SimOptions::cedro2022().unmodelled; {
        coulomb_friction_n_m: Vec<f64> = unmodelled.coulomb_friction_n_m.to_vec(), joints(NOT_NEGATIVE), "N m",
            "Friction of each joint that does not depend on speed";
        friction_speed_rad_per_s: f64 = unmodelled.friction_speed_rad_per_s, Kind::Real(POSITIVE), "rad/s",
            "Speed over which this friction changes its sign, as tanh(dq/speed); the smaller, the more plant.substeps it takes";
        viscous_friction_n_m_s_per_rad: Vec<f64> = unmodelled.viscous_friction_n_m_s_per_rad.to_vec(), joints(NOT_NEGATIVE), "N m s/rad",
            "Friction of each joint per speed";
        friction_from_s: f64 = unmodelled.friction_from_s, Kind::Real(NOT_NEGATIVE), "s",
            "Time from which on there is friction";
        base_tilt_rad: f64 = unmodelled.base_tilt_rad, Kind::Real(Interval::closed(-0.5, 0.5)), "rad",
            "How far the axis of joint 1 is off the vertical";
        heating_share: f64 = unmodelled.heating_share, Kind::Real(Interval::closed(-0.9, 10.0)), "",
            "Share by which both winding resistances grow from the start on, at a constant rate";
        heating_s: f64 = unmodelled.heating_s, Kind::Real(POSITIVE), "s",
            "Time in which the resistances grow; after it they are constant";
        rotor_inertia_kg_m2: Vec<f64> = unmodelled.rotor_inertia_kg_m2.to_vec(), joints(NOT_NEGATIVE), "kg m^2",
            "Inertia of each joint's rotor, times the square of the gear ratio";
    }
}
