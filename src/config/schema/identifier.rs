//! Section `[identifier]` and those below it: from samples to rows.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind, Len};
use super::table::{FINITE, NOT_NEGATIVE, POSITIVE, RealOr, choice, real_or, table};
use crate::rows::{InputTiming, ProjectedOptions};
use crate::sim::SimOptions;

choices! {
    /// The form of the rows.
    RowsKind {
        /// One row per sample and equation.
        Pointwise = "pointwise",
        /// One row per window and equation.
        Projected = "projected",
    }

    /// Where the drives' input comes from.
    InputKind {
        /// It is measured.
        Measured = "measured",
        /// It is computed as the controller does.
        Controller = "controller",
    }

    /// The word for a window that is chosen from the signals.
    Automatic {
        /// Chosen from the first motion and reviewed.
        Auto = "auto",
    }
}

table! {
    /// Section `[identifier]`.
    Identifier where controller = SimOptions::cedro2022().controller; {
        rows: RowsKind = RowsKind::Pointwise, choice::<RowsKind>(), "",
            "pointwise: one row per sample and equation, from measured q, dq, ddq, dddq. projected: one row per window and equation, from q and the input alone";
        input: InputKind = InputKind::Measured, choice::<InputKind>(), "",
            "Where the drives' voltage comes from: measured, or computed from setpoint, q and dq by the PD law as in (27)";
        proportional_gain_v_per_rad: Vec<f64> = controller.proportional_gain_v_per_rad.to_vec(),
            Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V/rad",
            "Gain Kp of each joint of the model for input = \"controller\"";
        derivative_gain_v_s_per_rad: Vec<f64> = controller.derivative_gain_v_s_per_rad.to_vec(),
            Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V s/rad",
            "Gain Kd of each joint of the model for input = \"controller\"";
        input_limit: Vec<f64> = vec![f64::INFINITY],
            Kind::Reals(Len::From(1, 8), POSITIVE.or_infinite()), "V, A, N or N m",
            "Magnitude at which the measurement of the inputs ends, one number or one per joint: samples there are refused and counted as saturated; inf: no limit";
        frozen_after_s: f64 = 0.2, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "A position or input that stands still to the bit for so long, and at least 20 samples, although the other one says that it must move is frozen: its samples are refused, its block left out; 0: never";
    }
}

table! {
    /// Section `[identifier.projected]`.
    Projected where rows = ProjectedOptions::recommended(); {
        window_s: RealOr<Automatic> = RealOr::Real(rows.window_s), real_or::<Automatic>(POSITIVE), "s",
            "Length of a window, 8 to 2000 sample periods; about 1.3 periods of the fastest motion that matters. \"auto\": chosen from the first motion and reviewed, 25 to 200 ms and at least 20 sample periods, below 100 Hz 20 to 160 sample periods; stride_s and velocity_half_width_s are upper limits then, but below 100 Hz they grow with the window";
        stride_s: f64 = rows.stride_s, Kind::Real(POSITIVE), "s",
            "Time from a window to the next; a fifth of the window loses little, more than 0.02 s loses much";
        velocity_half_width_s: f64 = rows.velocity_half_width as f64 * rows.sample_period_s, Kind::Real(POSITIVE), "s",
            "Time on either side that the velocity filter uses, rounded to 3 to 100 sample periods; 0.008 serves encoders of 13 to 20 bits; more smooths away jumps of the jerk, less makes noise of the direction of a slow joint";
        timing: InputTiming = rows.timing, choice::<InputTiming>(), "",
            "Input between samples: held by a sampled controller, or continuous except for jumps at sample instants";
        input_delay_s: f64 = rows.input_delay_s, Kind::Real(FINITE), "s",
            "The recorded input acts on the plant this much later; negative if it was recorded late";
        estimate_input_delay: bool = false, Kind::Flag, "",
            "Identify the delay too, as the parameter input_delay [s], starting at input_delay_s";
        input_delay_limit_s: Option<f64> = None, Kind::Real(POSITIVE), "s",
            "Largest magnitude of an identified delay, best as small as is safe, because in slow motion a delay looks like an inertia; not set: two sample periods, and at least 1e-3 s, beyond the magnitude of input_delay_s";
        position_resolution: Option<Vec<f64>> = None, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "rad or m",
            "One count of the encoders, one number for all joints or one per joint; 0 if positions are not rounded";
        position_noise: Option<Vec<f64>> = None, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "rad or m",
            "Standard deviation of white noise on the positions, one number or one per joint; 0 if only position_resolution is set";
        input_noise: Option<Vec<f64>> = None, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V, A, N or N m",
            "Standard deviation of white noise on the inputs, one number or one per joint; 0 if only input_resolution is set";
        input_resolution: Option<Vec<f64>> = None, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V, A, N or N m",
            "One count of the measured inputs, one number or one per joint; 0 if they are not rounded";
        learn_noise: Option<bool> = None, Kind::Flag, "",
            "Take the noise from the signals, block by block, instead of the four levels above; not set: true if none of them is set";
    }
}

table! {
    /// Section `[identifier.considered]`.
    ConsideredErrors where considered = ProjectedOptions::recommended().considered; {
        input_delay_s: Option<f64> = considered.input_delay_s, Kind::Real(NOT_NEGATIVE), "s",
            "Delay of the recorded input beyond identifier.projected.input_delay_s; not set: a quarter of the sample period, and at least 5e-5 s";
        gain: f64 = considered.gain, Kind::Real(NOT_NEGATIVE), "",
            "Relative error of each drive's gain; 0 if parameters are meant in units of the drive as it reports itself";
        coulomb: f64 = considered.coulomb, Kind::Real(NOT_NEGATIVE), "",
            "Coulomb friction at each joint whose model has none, as a share of the largest root mean square of its input so far";
        stribeck: f64 = considered.stribeck, Kind::Real(NOT_NEGATIVE), "",
            "Friction that falls with speed at each joint whose model has Coulomb friction, as a share of the same size";
        offset: f64 = considered.offset, Kind::Real(NOT_NEGATIVE), "",
            "Offset of each recorded input, or constant force, whose model has none, as a share of the same size, and at least of 400 standard deviations of the input's noise";
        dead_band: f64 = considered.dead_band, Kind::Real(NOT_NEGATIVE), "",
            "Dead band of each drive whose joint's model has Coulomb friction, or dead time if it has back EMF and an inductance: what it gives less, either sign, as a share of the same size";
        spring: f64 = considered.spring, Kind::Real(NOT_NEGATIVE), "",
            "Spring, such as a cable, at each joint whose model has none: its input at the root mean square of the travel, as a share of the same size";
        gain_by_direction: f64 = considered.gain_by_direction, Kind::Real(NOT_NEGATIVE), "",
            "Gain of each drive by the sign of its input, half the relative difference, if the joint's model has Coulomb friction";
        viscous_by_direction: f64 = considered.viscous_by_direction, Kind::Real(NOT_NEGATIVE), "",
            "Viscous friction by direction, half the difference, at each joint whose model has Coulomb friction: its input at the root mean square of the velocity, as a share of the same size";
        load_friction: f64 = considered.load_friction, Kind::Real(NOT_NEGATIVE), "",
            "Friction that grows with the load, such as that of a screw or a gear, as a share of the input, at each joint whose model has Coulomb friction";
        inertia: f64 = considered.inertia, Kind::Real(NOT_NEGATIVE), "",
            "Inertia without weight, such as a rotor's, at each joint whose model has no parameter for it, as a share of the joint's inertia in the model";
        viscous: f64 = considered.viscous, Kind::Real(NOT_NEGATIVE), "",
            "Viscous friction at each joint whose model has none, or whose drive has an inductance: its input at the root mean square of the velocity, as a share of the same size";
        friction_in_back_emf: f64 = considered.friction_in_back_emf, Kind::Real(NOT_NEGATIVE), "",
            "Viscous friction that a parameter of back EMF contains if the drive has an inductance, because it acts exactly like it: its input at the largest root mean square of the velocity so far, as a share of the same size";
        resonance_hz: f64 = considered.resonance_hz, Kind::Real(NOT_NEGATIVE), "Hz",
            "Natural frequency of the flexibility between each motor and its load; 0 if the joints are rigid";
        drift_per_s: f64 = considered.drift_per_s, Kind::Real(Interval::closed(0.0, 1.0)), "1/s",
            "Rate of change of each parameter, relative to the parameter: how far the estimate may lag behind a machine that warms up";
        zero_rad: f64 = considered.zero_rad, Kind::Real(NOT_NEGATIVE), "rad",
            "Error of each encoder's zero, or of gravity's direction; without effect on an axis that moves along a line";
        eccentricity_rad: f64 = considered.eccentricity_rad, Kind::Real(NOT_NEGATIVE), "rad",
            "Amplitude of an encoder error of one period per turn; 1e-4 is 20 arc seconds; without effect on an axis that moves along a line";
    }
}
