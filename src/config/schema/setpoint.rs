//! Section `[plant.setpoint]` and those below it: commanded positions.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind, Len};
use super::table::{FINITE, LONGEST_S, NOT_NEGATIVE, POSITIVE, choice, joints, table};
use crate::sim::{self, ARM_JOINTS, Interpolation, MoveProfile, SimOptions};

choices! {
    /// The kind of commanded motion, each with a section of its name.
    SetpointKind {
        /// A cycle of levels.
        Steps = "steps",
        /// A square wave.
        Square = "square",
        /// Given sines.
        Sines = "sines",
        /// Sines drawn from the seed.
        RandomSines = "random_sines",
        /// Levels and times drawn from the seed.
        Random = "random",
        /// Moves from point to point.
        Moves = "moves",
        /// A sine whose frequency moves.
        Chirp = "chirp",
        /// Values read from a file.
        Csv = "csv",
    }
}

table! {
    /// Section `[plant.setpoint]`.
    Setpoint {
        kind: SetpointKind = SetpointKind::Steps, choice::<SetpointKind>(), "",
            "Kind of commanded motion, for both joints";
    }
}

/// The paper's levels, dwell times and shifts, joint by joint.
fn cedro2022_steps() -> (Vec<Vec<f64>>, Vec<f64>, Vec<f64>) {
    let joints = SimOptions::cedro2022().setpoint.into_iter();
    let steps = joints.filter_map(|setpoint| match setpoint {
        sim::Setpoint::Steps {
            levels_rad,
            dwell_s,
            shift_s,
        } => Some((levels_rad, dwell_s, shift_s)),
        _ => None,
    });
    steps.collect()
}

table! {
    /// Section `[plant.setpoint.steps]`.
    Steps where (levels_rad, dwell_s, shift_s) = cedro2022_steps(); {
        levels_rad: Vec<Vec<f64>> = levels_rad, Kind::RealsPerJoint(Len::From(1, 10_000), FINITE), "rad",
            "Levels of each joint, in turn";
        dwell_s: Vec<f64> = dwell_s, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Time on each level, at least one sample period; whole samples";
        shift_s: Vec<f64> = shift_s, joints(Interval::closed(0.0, LONGEST_S)), "s",
            "How far into the cycle the run starts";
    }
}

table! {
    /// Section `[plant.setpoint.square]`.
    Square {
        amplitude_rad: Vec<f64> = vec![0.7; ARM_JOINTS], joints(FINITE), "rad",
            "Amplitude of each joint";
        offset_rad: Vec<f64> = vec![0.0; ARM_JOINTS], joints(FINITE), "rad",
            "Mean of each joint";
        period_s: Vec<f64> = vec![2.6, 3.4], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Period of each joint, at least two sample periods";
        shift_s: Vec<f64> = vec![0.0; ARM_JOINTS], joints(Interval::closed(0.0, LONGEST_S)), "s",
            "How far into the period the run starts";
    }
}

table! {
    /// Section `[plant.setpoint.sines]`.
    Sines {
        offset_rad: Vec<f64> = vec![0.0; ARM_JOINTS], joints(FINITE), "rad",
            "Mean of each joint";
        frequency_hz: Vec<Vec<f64>> = vec![vec![0.23, 0.71, 1.9, 4.3], vec![0.31, 0.97, 2.3, 5.3]],
            Kind::RealsPerJoint(Len::From(1, 64), POSITIVE), "Hz",
            "Frequencies of each joint";
        amplitude_rad: Vec<Vec<f64>> = vec![vec![0.4, 0.2, 0.1, 0.05]; ARM_JOINTS],
            Kind::RealsPerJoint(Len::From(1, 64), FINITE), "rad",
            "Amplitudes, as many as frequencies";
        phase_rad: Vec<Vec<f64>> = vec![vec![0.0, 1.0, 2.0, 3.0]; ARM_JOINTS],
            Kind::RealsPerJoint(Len::From(1, 64), FINITE), "rad",
            "Phases at the start, as many as frequencies";
    }
}

table! {
    /// Section `[plant.setpoint.random_sines]`.
    RandomSines {
        count: u64 = 6, Kind::Whole(1, 64), "",
            "Number of sines per joint, spread evenly over the logarithmic frequency range";
        min_frequency_hz: Vec<f64> = vec![0.23; ARM_JOINTS], joints(POSITIVE), "Hz",
            "Lowest frequency of each joint";
        max_frequency_hz: Vec<f64> = vec![5.3; ARM_JOINTS], joints(Interval::above(0.0, 1e6)), "Hz",
            "Highest frequency of each joint";
        amplitude_rad: Vec<f64> = vec![0.8; ARM_JOINTS], joints(NOT_NEGATIVE), "rad",
            "Bound of each joint's motion";
    }
}

table! {
    /// Section `[plant.setpoint.random]`.
    Random {
        min_rad: Vec<f64> = vec![-1.0, -0.8], joints(FINITE), "rad",
            "Lowest level of each joint";
        max_rad: Vec<f64> = vec![1.0, 0.8], joints(FINITE), "rad",
            "Highest level of each joint";
        min_dwell_s: Vec<f64> = vec![1.0; ARM_JOINTS], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Shortest time on a level, at least one sample period";
        max_dwell_s: Vec<f64> = vec![3.0; ARM_JOINTS], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Longest time on a level";
    }
}

table! {
    /// Section `[plant.setpoint.moves]`.
    Moves {
        profile: MoveProfile = MoveProfile::default(), choice::<MoveProfile>(), "",
            "minimum_jerk: a polynomial of degree 5. trapezoidal: a third of the time each to speed up, cruise and slow down";
        min_rad: Vec<f64> = vec![-1.0, -0.8], joints(FINITE), "rad",
            "Lowest level of each joint";
        max_rad: Vec<f64> = vec![1.0, 0.8], joints(FINITE), "rad",
            "Highest level of each joint";
        min_move_s: Vec<f64> = vec![0.6; ARM_JOINTS], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Shortest duration of a move, at least one sample period; whole samples";
        max_move_s: Vec<f64> = vec![1.6; ARM_JOINTS], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Longest duration of a move";
        min_rest_s: Vec<f64> = vec![0.0; ARM_JOINTS], joints(Interval::closed(0.0, LONGEST_S)), "s",
            "Shortest rest after a move; whole samples";
        max_rest_s: Vec<f64> = vec![0.5; ARM_JOINTS], joints(Interval::closed(0.0, LONGEST_S)), "s",
            "Longest rest after a move";
    }
}

table! {
    /// Section `[plant.setpoint.chirp]`.
    Chirp {
        amplitude_rad: Vec<f64> = vec![0.3; ARM_JOINTS], joints(FINITE), "rad",
            "Amplitude of each joint";
        offset_rad: Vec<f64> = vec![0.0; ARM_JOINTS], joints(FINITE), "rad",
            "Mean of each joint";
        start_frequency_hz: Vec<f64> = vec![0.1, 0.13], joints(POSITIVE), "Hz",
            "First frequency of each joint";
        end_frequency_hz: Vec<f64> = vec![5.0, 6.5], joints(POSITIVE), "Hz",
            "Last frequency of each joint";
        sweep_s: Vec<f64> = vec![20.0, 23.0], joints(Interval::above(0.0, LONGEST_S)), "s",
            "Time from the first to the last frequency";
    }
}

table! {
    /// Section `[plant.setpoint.csv]`.
    Csv {
        path: Option<String> = None, Kind::Path, "",
            "File with the columns t_s, q1_rad, q2_rad and rising times; relative to the configuration file's directory";
        rows: Option<String> = None, Kind::Rows, "",
            "The rows of such a file themselves: what a configuration that a program writes, into a recording for instance, has in the place of path";
        between: Interpolation = Interpolation::Step, choice::<Interpolation>(), "",
            "Between two rows the setpoint keeps the value of the first (step) or follows the straight line (linear)";
    }
}
