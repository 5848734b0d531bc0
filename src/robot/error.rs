//! Errors of a robot's description, with the element and its line, and of the options for its
//! identification and simulation, with the number that was given.

use crate::model::MAX_JOINTS;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why a URDF does not describe a robot that can be identified.
///
/// It is displayed as `arm.urdf:12: <joint name="elbow">: expected …, got …`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UrdfError {
    /// The file, if the text is from one.
    pub file: Option<PathBuf>,
    /// Line of the element, counted from 1, if the error belongs to one.
    pub line: Option<usize>,
    /// The element, such as `<joint name="elbow">`.
    pub element: String,
    /// What was expected there.
    pub expected: String,
    /// What was found instead.
    pub got: String,
}

/// The element of an error that concerns the whole file.
pub(super) const FILE: &str = "the file";

impl UrdfError {
    /// An error of one element.
    pub(super) fn new(
        line: impl Into<Option<usize>>,
        element: impl Into<String>,
        expected: impl Into<String>,
        got: impl Into<String>,
    ) -> Self {
        Self {
            file: None,
            line: line.into(),
            element: element.into(),
            expected: expected.into(),
            got: got.into(),
        }
    }

    /// True if the file could not be read at all.
    pub fn is_of_file(&self) -> bool {
        self.element == FILE
    }

    /// The same with the file.
    pub(super) fn in_file(mut self, file: &Path) -> Self {
        self.file = Some(file.to_owned());
        self
    }
}

impl fmt::Display for UrdfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.file, self.line) {
            (Some(file), Some(line)) => write!(f, "{}:{line}: ", file.display())?,
            (Some(file), None) => write!(f, "{}: ", file.display())?,
            (None, Some(line)) => write!(f, "line {line}: ")?,
            (None, None) => {}
        }
        let Self {
            element, expected, got, ..
        } = self;
        write!(f, "{element}: expected {expected}, got {got}")
    }
}

impl std::error::Error for UrdfError {}

/// Friction that a model cannot have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrictionError {
    /// The speed of a joint at rest is negative or not finite \[rad/s or m/s\].
    #[error("rest_speed: expected a speed of at least 0, got {0}")]
    RestSpeed(f64),
    /// The way of a reversal is not above 0 \[rad or m\].
    #[error("presliding: expected a way above 0, got {0}")]
    Presliding(f64),
    /// The speed of the Stribeck term is not above 0 \[rad/s or m/s\].
    #[error("stribeck_speed: expected a speed above 0, got {0}")]
    StribeckSpeed(f64),
    /// A term is listed twice.
    #[error("friction: expected each term once, got {0} twice")]
    Twice(&'static str),
    /// Friction is not given for each joint.
    #[error("friction: expected an entry for each of {expected} joints, got {got}")]
    Joints {
        /// Number of joints.
        expected: usize,
        /// Entries given.
        got: usize,
    },
    /// The friction of one joint.
    #[error("joint \"{joint}\": {source}")]
    Joint {
        /// Its name.
        joint: String,
        /// What is wrong with it.
        source: Box<FrictionError>,
    },
}

/// Drives that do not fit a robot.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DrivesError {
    /// Gains that are not one per joint, finite and other than 0.
    #[error("gain: expected {joints} finite numbers other than 0, got {got:?}")]
    Gain {
        /// Number of joints.
        joints: usize,
        /// What was given.
        got: Vec<f64>,
    },
    /// A coupling that is not square, one row per joint, and finite.
    #[error("coupling: expected {joints} rows of {joints} finite numbers, got {got:?}")]
    Coupling {
        /// Number of joints.
        joints: usize,
        /// What was given.
        got: Vec<Vec<f64>>,
    },
}

/// Options with which a robot cannot be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// A time that is not above 0.
    #[error("{name}: expected a time above 0 [s], got {got}")]
    Time {
        /// Which one.
        name: &'static str,
        /// What was given \[s\].
        got: f64,
    },
    /// Windows that follow each other, or overlap, too often.
    #[error("window stride: expected at least {least_s:.4} s and 1/{part} of the window, got {got_s} s")]
    Stride {
        /// Smallest stride \[s\].
        least_s: f64,
        /// Largest number of strides in a window.
        part: usize,
        /// What was given \[s\].
        got_s: f64,
    },
    /// A block that is too short, or that has too many windows for the memory that keeps them.
    #[error("block length: expected {least_s} to {most_s} s, {most} strides of the windows, got {got_s} s")]
    Block {
        /// Shortest block \[s\].
        least_s: f64,
        /// Longest block \[s\].
        most_s: f64,
        /// Largest number of strides.
        most: usize,
        /// What was given \[s\].
        got_s: f64,
    },
    /// A share of rest beyond 0 to 1.
    #[error("rest: expected a part from 0 to 1, got {0}")]
    Rest(f64),
    /// A number that is negative or not finite.
    #[error("{name}: expected a number of at least 0, got {got}")]
    Negative {
        /// Which one.
        name: &'static str,
        /// What was given.
        got: f64,
    },
    /// An expected misfit that does not fit the robot.
    #[error(
        "misfit: expected {joints} standard deviations above 0 and {joints} factors of at least 1, got {std:?} and {correlation:?}"
    )]
    Misfit {
        /// Number of joints.
        joints: usize,
        /// Standard deviations given.
        std: Vec<f64>,
        /// Factors given.
        correlation: Vec<f64>,
    },
}

/// A motion that a robot cannot follow, or that cannot be designed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// A number out of its range, whose lower end belongs to it.
    #[error("{name}: expected {low} to {high}, got {got}")]
    Range {
        /// Which one.
        name: &'static str,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
        /// What was given.
        got: f64,
    },
    /// A number out of its range, whose lower end does not belong to it.
    #[error("{name}: expected a number above {low} and up to {high}, got {got}")]
    Above {
        /// Which one.
        name: &'static str,
        /// The value must be above this.
        low: f64,
        /// Largest value.
        high: f64,
        /// What was given.
        got: f64,
    },
    /// The number of harmonics.
    #[error("harmonics: expected 1 to {most}, got {got}")]
    Harmonics {
        /// Largest number.
        most: usize,
        /// What was given.
        got: usize,
    },
    /// A table with too few points, or with more instants than postures.
    #[error(
        "motion: expected 1 to {MAX_JOINTS} joints at 3 instants or more, got {joints} joints at {postures} of {instants} instants"
    )]
    Size {
        /// Joints given.
        joints: usize,
        /// Postures given.
        postures: usize,
        /// Instants given.
        instants: usize,
    },
    /// Times that do not increase.
    #[error("motion: expected a time after {before_s} s, got {got_s} s")]
    NotLater {
        /// A time \[s\].
        before_s: f64,
        /// The next one \[s\].
        got_s: f64,
    },
    /// Times or positions that are not finite.
    #[error("motion: expected finite numbers, got NaN or an infinity")]
    NotFinite,
    /// A table for another robot.
    #[error("motion: expected a table of {expected} joints, got {got}")]
    Joints {
        /// Joints of the robot.
        expected: usize,
        /// Joints of the table.
        got: usize,
    },
    /// Limits that are not one per joint.
    #[error("limits: expected one for each of {expected} joints, got {got}")]
    Limits {
        /// Joints of the robot.
        expected: usize,
        /// Limits given.
        got: usize,
    },
    /// Limits of a joint between which there is no position.
    #[error("limits of joint \"{joint}\": expected a finite lower below a finite upper, got {lower} and {upper}")]
    Empty {
        /// Name of the joint.
        joint: String,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// A limit of a joint that is not above 0.
    #[error("limits of joint \"{joint}\": {name}: expected a number above 0, got {got}")]
    Limit {
        /// Name of the joint.
        joint: String,
        /// Which limit.
        name: &'static str,
        /// What was given.
        got: f64,
    },
    /// No motion within the limits says anything about the robot.
    #[error("excitation: expected rows that can be solved, got none; widen the limits")]
    NoRows,
    /// Every motion needs more torque than a joint may have.
    #[error(
        "excitation: expected torques of joint \"{joint}\" up to {limit:.4}, got {got:.4} with every motion; lower its \
         accelerations or narrow its range"
    )]
    Effort {
        /// Name of the joint.
        joint: String,
        /// Its largest torque or force \[N m or N\].
        limit: f64,
        /// That of the best motion \[N m or N\].
        got: f64,
    },
    /// The time from point to point of a table.
    #[error("step: expected 1e-5 to {most_s} s, got {got_s} s")]
    Step {
        /// Largest step \[s\].
        most_s: f64,
        /// What was given \[s\].
        got_s: f64,
    },
}

/// Options with which a robot cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotSimError {
    /// A number out of its range.
    #[error("{name}: expected {low} to {high}, got {got}")]
    Range {
        /// Which one.
        name: &'static str,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
        /// What was given.
        got: f64,
    },
    /// Drives that are not one per joint.
    #[error("drives: expected one for each of {expected} joints, got {got}")]
    Drives {
        /// Joints of the robot.
        expected: usize,
        /// Drives given.
        got: usize,
    },
    /// Numbers of a payload that are not finite.
    #[error("payload: {name}: expected finite numbers, got {got:?}")]
    Payload {
        /// Which ones.
        name: &'static str,
        /// What was given.
        got: Vec<f64>,
    },
    /// Payloads that are not in the order of their times.
    #[error("payload: expected rising times, got {0} s")]
    PayloadTime(f64),
    /// The motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// A load that no body can be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// A mass that is not above 0 or too large, or a centre that is not finite or too far.
    #[error("load: {}", numbers(*mass_kg, Some(*center_m), None))]
    Mass {
        /// Mass given \[kg\].
        mass_kg: f64,
        /// Centre of mass given \[m\].
        center_m: [f64; 3],
    },
    /// An inertia that no distribution of mass has \[kg m²\].
    #[error(
        "load: expected an inertia that a body can have, each principal one below the sum of the others, got {0:?}"
    )]
    Inertia([f64; 6]),
    /// Numbers of a partly known load.
    #[error("load: {}", numbers(*mass_kg, *center_m, *inertia_kg_m2))]
    Numbers {
        /// Mass given \[kg\].
        mass_kg: f64,
        /// Centre of mass given \[m\].
        center_m: Option<[f64; 3]>,
        /// Inertia given \[kg m²\].
        inertia_kg_m2: Option<[f64; 6]>,
    },
}

/// Largest mass of a load \[kg\].
const HEAVIEST_KG: f64 = 1e6;
/// Largest distance of its centre from the flange \[m\]; one in millimetres is mostly farther.
const FARTHEST_M: f64 = 5.0;

/// True for the mass \[kg\] and, if it is known, the centre of mass \[m\] of a load that an arm may
/// carry.
pub(super) fn is_load(mass_kg: f64, center_m: Option<[f64; 3]>) -> bool {
    let is_near = |center: [f64; 3]| center.iter().map(|x| x * x).sum::<f64>() <= FARTHEST_M * FARTHEST_M;
    mass_kg > 0.0 && mass_kg <= HEAVIEST_KG && center_m.is_none_or(is_near)
}

/// Which of the numbers of a load is wrong.
fn numbers(mass_kg: f64, center_m: Option<[f64; 3]>, inertia_kg_m2: Option<[f64; 6]>) -> String {
    if !(mass_kg > 0.0 && mass_kg.is_finite()) {
        return format!("mass: expected the mass of the load in kg, a finite number above 0, got {mass_kg}");
    }
    if mass_kg > HEAVIEST_KG {
        return format!("mass: expected the mass of the load in kg, at most {HEAVIEST_KG}, got {mass_kg}");
    }
    match (center_m, inertia_kg_m2) {
        (Some(center), _) if center.iter().all(|x| x.is_finite()) && !is_load(mass_kg, center_m) => format!(
            "com: expected the centre of mass in m, at most {FARTHEST_M} m from the flange, got {center:?}; divide millimetres by 1000"
        ),
        (Some(center), _) if center.iter().any(|x| !x.is_finite()) => {
            format!("com: expected three finite numbers in m, got {center:?}")
        }
        (_, Some(inertia)) => format!("inertia: expected six finite numbers in kg m², got {inertia:?}"),
        _ => format!("expected finite numbers, got {mass_kg} kg at {center_m:?} m"),
    }
}

/// Estimates from which no physically possible robot follows.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StandardError {
    /// Too few estimates, a covariance of another size, or numbers that are not finite.
    #[error("estimates: expected at least {least} finite numbers with their covariance, got {got} with {covariance}")]
    Estimates {
        /// Number of base parameters.
        least: usize,
        /// Estimates given.
        got: usize,
        /// Entries of the covariance given.
        covariance: usize,
    },
    /// The estimates are as uncertain as before any data.
    #[error(
        "nothing has been identified: expected base parameters that data say something of, got the standard deviations of before \
         any data; identify with a motion that moves the joints"
    )]
    NothingIdentified,
    /// The covariance is not positive definite.
    #[error("estimates: expected a positive definite covariance, got another matrix")]
    Covariance,
    /// A joint has no link of its own that could take the values.
    #[error(
        "joint \"{0}\": expected a link with <inertial> that is fixed to it, got one behind a joint that is held only; add an \
         <inertial> to its child link"
    )]
    NoLink(String),
    /// An inertia of the URDF cannot be inverted.
    #[error("the URDF: expected inertias that can be inverted, got a singular one")]
    Urdf,
    /// No physically possible robot is near the estimates.
    #[error("no robot that can exist is near what was identified; is the log that of this URDF?")]
    Impossible,
}

/// Why a sample was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SampleFault {
    /// A number is not finite.
    #[error("expected finite numbers, got NaN or an infinity")]
    NotFinite,
    /// Its time is not after that of the sample before it.
    #[error("expected a time after that of the sample before, got an earlier or equal one")]
    NotLater,
}

/// Any of the errors on the way from a URDF to estimates, for a caller that treats them alike.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The URDF.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// The friction of the model.
    #[error(transparent)]
    Friction(#[from] FrictionError),
    /// The options of the identification.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The options of the simulation.
    #[error(transparent)]
    Simulation(#[from] RobotSimError),
    /// A sample.
    #[error(transparent)]
    Sample(#[from] SampleFault),
}
