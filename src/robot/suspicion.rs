//! Probable mistakes in a robot's log, with messages that say what to do.

use super::doubt::RobotDoubt;
use super::drive_gain_room::WrongGain;
use super::echo::Echo;
use super::left_out_room::LeftOutCause;
use super::other_travel::OtherTravel;
use super::unmodelled::Unmodelled;
use super::urdf_prior::UrdfContradiction;
use super::velocity_ratio::WrongVelocities;
use std::f64::consts::{PI, TAU};
use std::fmt;

/// Ratios that are taken for an error of units or sign alone.
const FACTOR: std::ops::Range<f64> = 0.8..1.25;

/// A probable mistake; joints are counted from 0.
#[derive(Debug, Clone, PartialEq)]
pub enum RobotSuspicion {
    /// Samples so far apart that time is probably not in seconds.
    Time {
        /// Median distance \[s\].
        step_s: f64,
    },
    /// Implausible positions.
    Positions {
        /// The joint.
        joint: usize,
        /// It turns.
        turns: bool,
        /// Lowest and highest position \[rad or m\].
        reach: [f64; 2],
        /// Limits of the URDF, if it states them.
        limits: Option<[f64; 2]>,
    },
    /// Implausible velocities.
    Speed {
        /// The joint.
        joint: usize,
        /// It turns.
        turns: bool,
        /// Root mean square \[rad/s or m/s\].
        rms: f64,
        /// Largest speed of the URDF, if it states one.
        limit: Option<f64>,
    },
    /// Positions wrapped into one turn.
    Wraps {
        /// The joint.
        joint: usize,
    },
    /// Velocities that contradict the positions.
    Rate {
        /// The joint.
        joint: usize,
        /// It turns.
        turns: bool,
        /// Ratio of the velocity to the rate of change of the position.
        factor: f64,
    },
    /// Velocities that are later than the positions.
    Late(WrongVelocities),
    /// A signal that never changes although the other one shows that the joint moves.
    Constant {
        /// The joint.
        joint: usize,
        /// `position` or `torque`.
        signal: &'static str,
        /// Its value.
        value: f64,
    },
    /// Torques that are another signal of their joints.
    Echo(Echo),
    /// A clipped torque.
    Clipped {
        /// The joint.
        joint: usize,
        /// Its largest magnitude \[N m or N\].
        value: f64,
        /// Share of the samples at it \[%\].
        percent: f64,
    },
    /// Negative friction, which drives the joint.
    Sign {
        /// The joint.
        joint: usize,
        /// Name, estimate and standard deviation of each parameter with the wrong sign.
        parameters: Vec<(String, f64, f64)>,
    },
    /// A negative inertia.
    NegativeInertia {
        /// The joint.
        joint: usize,
    },
    /// A term missing in the model.
    LeftOut(LeftOutCause),
    /// Reversals that take far longer than in the model.
    Travel(OtherTravel),
    /// A drive or an encoder that has changed within the log.
    Changed(RobotDoubt),
    /// A gain that contradicts the other joints' torques.
    Gain(WrongGain),
    /// A gravity or a zero that contradicts the URDF.
    Contradiction(UrdfContradiction),
    /// A torque that the model does not explain: the misfit lasts as long as movements do.
    Unexplained {
        /// The joint.
        joint: usize,
        /// Share of the power of its torque that is explained \[%\].
        explained: f64,
    },
    /// A torque that is mostly noise.
    Noise {
        /// The joint.
        joint: usize,
        /// Relative residual \[%\].
        percent: f64,
    },
    /// A torque that the model hardly predicts, although most of the misfit is short-lived.
    Residual {
        /// The joint.
        joint: usize,
        /// Relative residual \[%\].
        percent: f64,
    },
}

impl fmt::Display for RobotSuspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Time { step_s } => write!(
                f,
                "samples are {step_s} s apart: if time is in milliseconds or less, convert it to seconds, or is another column the time (log.time_column)?"
            ),
            Self::Positions {
                joint,
                turns,
                reach,
                limits,
            } => positions(f, joint + 1, &Units::of(turns), reach, limits),
            Self::Speed {
                joint,
                turns,
                rms,
                limit,
            } => speed(f, joint + 1, &Units::of(turns), rms, limit),
            Self::Wraps { joint } => write!(
                f,
                "positions of joint {} jump by a whole turn between samples: they must go on beyond a turn, unwrapped",
                joint + 1
            ),
            Self::Rate { joint, turns, factor } => rate(f, joint + 1, &Units::of(turns), factor),
            Self::Constant { joint, signal, value } => write!(
                f,
                "{signal} of joint {} is {value} in every sample though the joint moves: is it the column that was meant?",
                joint + 1
            ),
            Self::Echo(signal) => write!(
                f,
                "the torque of every joint that moves is its {signal} times a factor: the log seems to hold no measured torques, \
                 and then what follows describes no robot; check log.input_columns"
            ),
            Self::Clipped { joint, value, percent } => write!(
                f,
                "torque of joint {} is {value} or -{value} in {percent:.0} % of the samples in motion, its largest, so \
                 that nothing may be used: if the signal is clipped there, estimates are wrong; if the drive is at its limit, use slower motion",
                joint + 1,
            ),
            Self::Sign { joint, ref parameters } => sign(f, joint + 1, parameters),
            Self::NegativeInertia { joint } => write!(
                f,
                "the inertia at joint {} comes out negative, so that nothing may be used: its torque or its position has the wrong \
                 sign, or its axis in the URDF is the other way round",
                joint + 1
            ),
            Self::LeftOut(ref cause) => left_out(f, cause),
            Self::Travel(what) => write!(f, "{what} as friction.presliding; nothing may be used"),
            Self::Late(what) => write!(f, "{what}; nothing may be used"),
            Self::Changed(doubt) => write!(f, "{doubt}"),
            Self::Gain(what) => write!(f, "{what}; nothing may be used"),
            Self::Contradiction(what) => write!(f, "{what}; nothing may be used"),
            Self::Unexplained { joint, explained } => write!(
                f,
                "the model explains little of joint {}'s torque ({explained:.0} % of its power, without noise), so that nothing may be used: \
                 a load that changes during the log, or the sign, unit or columns of its torque and position, or axes and frames \
                 of the URDF up to it",
                joint + 1
            ),
            Self::Noise { joint, percent } => write!(
                f,
                "torque of joint {} is mostly noise (residual {percent:.0} %, from sample to sample): average it at the source if you can; \
                 standard deviations hold it",
                joint + 1
            ),
            Self::Residual { joint, percent } => write!(
                f,
                "the model explains little of joint {}'s torque (residual {percent:.0} %): columns swapped, another unit, or a sign?",
                joint + 1
            ),
        }
    }
}

/// The required unit of positions, and the one often found instead.
struct Units {
    wrong: &'static str,
    right: &'static str,
    symbol: &'static str,
    /// Value of the wrong unit in the right one.
    factor: f64,
}

impl Units {
    /// For a revolute or prismatic joint.
    fn of(turns: bool) -> Self {
        match turns {
            true => Self {
                wrong: "degrees",
                right: "radians",
                symbol: "rad",
                factor: 180.0 / PI,
            },
            false => Self {
                wrong: "millimetres",
                right: "metres",
                symbol: "m",
                factor: 1000.0,
            },
        }
    }
}

fn positions(
    f: &mut fmt::Formatter<'_>,
    joint: usize,
    units: &Units,
    [least, most]: [f64; 2],
    limits: Option<[f64; 2]>,
) -> fmt::Result {
    let Units {
        wrong, right, symbol, ..
    } = units;
    write!(
        f,
        "positions of joint {joint} reach from {least:.4} to {most:.4} {symbol}"
    )?;
    match limits {
        Some([lower, upper]) => write!(f, ", the URDF's limits are {lower:.4} and {upper:.4} {symbol}")?,
        None => write!(f, ", {:.1} turns", (most - least) / TAU)?,
    }
    write!(
        f,
        ": if they are in {wrong}, convert them to {right}; else check log.position_columns"
    )
}

fn speed(f: &mut fmt::Formatter<'_>, joint: usize, units: &Units, rms: f64, limit: Option<f64>) -> fmt::Result {
    let Units {
        wrong, right, symbol, ..
    } = units;
    write!(
        f,
        "velocities of joint {joint} are {rms:.4} {symbol}/s in root mean square"
    )?;
    if let Some(limit) = limit {
        write!(f, ", the URDF's largest is {limit:.4} {symbol}/s")?;
    }
    write!(
        f,
        ": if they are in {wrong} per second, convert them to {right} per second; else check log.velocity_columns"
    )
}

fn rate(f: &mut fmt::Formatter<'_>, joint: usize, units: &Units, factor: f64) -> fmt::Result {
    let Units { wrong, right, .. } = units;
    write!(
        f,
        "velocities of joint {joint} are {factor:.3} times the rate of change of its positions: "
    )?;
    if FACTOR.contains(&(factor / units.factor)) {
        write!(
            f,
            "if they are in {wrong} per second, convert them to {right} per second"
        )
    } else if FACTOR.contains(&(factor * units.factor)) {
        write!(f, "if its positions are in {wrong}, convert them to {right}")
    } else if FACTOR.contains(&-factor) {
        write!(f, "if they have the opposite sign, turn it round")
    } else {
        write!(
            f,
            "check log.velocity_columns, log.position_columns, and the units of both and of time"
        )
    }
}

fn sign(f: &mut fmt::Formatter<'_>, joint: usize, parameters: &[(String, f64, f64)]) -> fmt::Result {
    let parameters: Vec<String> = parameters
        .iter()
        .map(|(name, estimate, std)| format!("{name} = {estimate:.3} +- {std:.3}"))
        .collect();
    write!(
        f,
        "torque of joint {joint} may have the opposite sign ({}): friction would drive the joint",
        parameters.join(", ")
    )
}

fn left_out(f: &mut fmt::Formatter<'_>, cause: &LeftOutCause) -> fmt::Result {
    match cause.harm > 0.0 {
        true => write!(
            f,
            "{cause}, and a parameter is {:.1} standard deviations off: ",
            cause.harm
        )?,
        false => write!(f, "{cause}, and no parameter may be used: ")?,
    }
    match cause.what {
        Unmodelled::Friction { term, .. } => write!(f, "add \"{}\" to friction.terms", term.name()),
        Unmodelled::StribeckSpeed { joint, higher } => {
            let speed = if higher { "a higher" } else { "a lower" };
            write!(f, "try {speed} friction.stribeck_speed for joint {}", joint + 1)
        }
        Unmodelled::Zero { .. } | Unmodelled::Tilt => write!(
            f,
            "some {:.1} degrees; look at the zeros and at model.gravity_m_per_s2",
            cause.amplitude.abs().to_degrees()
        ),
        Unmodelled::Delay => write!(
            f,
            "{:.1} ms; torques, positions and velocities must be of the same instants",
            1e3 * cause.amplitude
        ),
    }
}
