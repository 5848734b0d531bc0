//! The own sections of the file of a robot from its URDF. `config/robots/six_axis.toml` shows them.

use super::super::choice::choices;
use super::super::kind::{Interval, Key, Kind, Len};
use super::table::{FINITE, Field, NOT_NEGATIVE, POSITIVE, choice, sections, table};
use crate::robot::{
    ExcitationOptions, FrictionTerm, IdentifyOptions, JointFriction, MAX_EXCITATION_HARMONICS, MAX_HARMONICS,
    MotionLimits,
};

choices! {
    /// The model of a robot's file.
    RobotKind {
        /// A robot from its URDF.
        Robot = "robot",
    }

    /// Source of the velocities on line.
    VelocityKind {
        /// The samples.
        Measured = "measured",
        /// The positions.
        Differentiated = "differentiated",
    }

    /// The motion of the simulated robot.
    MotionKind {
        /// None.
        Rest = "rest",
        /// A sum of harmonics.
        Fourier = "fourier",
        /// From posture to posture.
        Moves = "moves",
    }

    /// The controller of the simulated robot.
    RobotControllerKind {
        /// Inverse dynamics.
        ComputedTorque = "computed_torque",
        /// Independent joints with gravity compensation.
        Pd = "pd",
        /// Independent joints.
        Servo = "servo",
    }
}

/// Largest whole number of TOML.
const ANY_WHOLE: u64 = i64::MAX as u64;
/// Share of the URDF's limits.
const PART: Interval = Interval::above(0.0, 1.0);
/// Distance from the middle of a joint's range.
const REACH: Interval = Interval::above(0.0, 100.0);
const ACCELERATION: Interval = Interval::above(0.0, 1e4);
/// Friction or inertia of a simulated drive.
const DRIVE: Interval = Interval::closed(0.0, 1e6);

/// A number per joint of the robot.
const fn each(interval: Interval) -> Kind {
    Kind::Reals(Len::RobotJoints, interval)
}

/// A column per joint of the robot.
const COLUMNS: Kind = Kind::Wholes(Len::RobotJoints, 1, ANY_WHOLE);

table! {
    /// Section `[model]`.
    RobotModelForm {
        kind: RobotKind = RobotKind::Robot, choice::<RobotKind>(), "",
            "robot: an arm from its URDF";
        urdf: Option<String> = None, Kind::Path, "",
            "The URDF, relative to this file; needed";
        base: Option<String> = None, Kind::Label, "",
            "The link that stands still; the URDF's root if not set";
        tip: Option<String> = None, Kind::Label, "",
            "The link at the end, if the robot branches";
        joints: Option<Vec<String>> = None, Kind::Words, "",
            "The joints that move, instead of tip";
        gravity_m_per_s2: Option<Vec<f64>> = None, Kind::Reals(Len::From(3, 3), FINITE), "m/s²",
            "Gravity in the base's frame; zeros for none, else 1.5 to 30 m/s²; [0.0, 0.0, -9.81] if not set";
        rotor_inertia: bool = true, Kind::Flag, "",
            "Whether the inertias of the drives' rotors are estimated, too";
    }
}

table! {
    /// Section `[drive]`.
    DriveForm {
        gain: Option<Vec<f64>> = None, each(FINITE), "N m or N per unit of input",
            "Torque per input, other than 0; 1 if not set, for torques";
        coupling: Option<Vec<Vec<f64>>> = None, Kind::Matrix(FINITE), "",
            "Torque at joint i per torque of drive j, if joints share drives";
        gain_std: f64 = IdentifyOptions::default().gain_std, Kind::Real(NOT_NEGATIVE), "",
            "Relative standard deviation of masses by these gains";
    }
}

table! {
    /// Section `[friction]`.
    FrictionForm where friction = JointFriction::default(); {
        terms: Vec<FrictionTerm> = friction.terms, Kind::Choices(<FrictionTerm as super::super::choice::Choice>::WORDS), "",
            "The terms of friction, each once";
        presliding: f64 = friction.presliding, Kind::Real(POSITIVE), "rad or m",
            "Travel of a reversal; the term reversal estimates its error";
        rest_speed: f64 = friction.rest_speed, Kind::Real(NOT_NEGATIVE), "rad/s or m/s",
            "Speed below which a joint rests";
        stribeck_speed: f64 = friction.stribeck_speed, Kind::Real(POSITIVE), "rad/s or m/s",
            "Speed at which the Stribeck term has fallen to 1/e";
    }
}

table! {
    /// Section `[log]`.
    LogForm {
        time_column: u64 = 1, Kind::Whole(1, ANY_WHOLE), "",
            "Column of the time, counted from 1";
        position_columns: Option<Vec<u64>> = None, COLUMNS, "",
            "Columns of the positions, one per joint; behind the time if not set";
        velocity_columns: Option<Vec<u64>> = None, Kind::Wholes(Len::From(0, crate::model::MAX_JOINTS), 1, ANY_WHOLE), "",
            "Columns of the velocities, one per joint; none if the log holds no velocities";
        input_columns: Option<Vec<u64>> = None, COLUMNS, "",
            "Columns of the torques or currents, one per joint; the last ones if not set";
    }
}

table! {
    /// Section `[identify]`.
    IdentifyForm where identify = IdentifyOptions::default(); {
        window_s: Option<f64> = None, Kind::Real(POSITIVE), "s",
            "Length of a window; 25 samples if not set, 0.1 to 0.25 s";
        stride_s: Option<f64> = None, Kind::Real(POSITIVE), "s",
            "Time from a window to the next; a fifth of the window if not set";
        max_gap_s: Option<f64> = None, Kind::Real(POSITIVE), "s",
            "Longest time between two samples that a window may span; a fifth of the window if not set";
        block_s: f64 = identify.block_s, Kind::Real(POSITIVE), "s",
            "Length of a block: there is one estimate per block";
        settle_blocks: u64 = identify.settle_blocks as u64, Kind::Whole(0, ANY_WHOLE), "blocks",
            "Blocks after which the weights of past blocks no longer change";
        friction_walk: f64 = identify.friction_walk, Kind::Real(NOT_NEGATIVE), "1/√s",
            "Random walk of the friction after settling, as a share of its size";
        payload_friction: f64 = identify.payload_friction, Kind::Real(NOT_NEGATIVE), "",
            "Standard deviation of the relative change of friction with the payload";
        zero_rad: f64 = identify.zero_rad, Kind::Real(NOT_NEGATIVE), "rad",
            "Standard deviation of the encoders' zeros and of the direction of gravity";
        delay_s: f64 = identify.delay_s, Kind::Real(NOT_NEGATIVE), "s",
            "Standard deviation of the delay of the torques against positions and velocities";
        friction_shape: f64 = identify.friction_shape, Kind::Real(NOT_NEGATIVE), "",
            "Standard deviation of what drag, asymmetric friction or another Stribeck speed adds if no term describes it, as a share of the friction";
        spring_share: f64 = identify.spring_share, Kind::Real(NOT_NEGATIVE), "",
            "Standard deviation of the torque of a spring that is not among the terms, as a share of the friction";
        velocity: VelocityKind = VelocityKind::Differentiated, choice::<VelocityKind>(), "",
            "Where velocities come from while it runs";
        velocity_s: f64 = 0.02, Kind::Real(PART), "s",
            "Time to either side over which velocities are formed from positions";
        payload: bool = true, Kind::Flag, "",
            "Whether a payload at the flange is looked for and estimated while it runs";
    }
}

table! {
    /// Section `[simulate]`; the numbers are those of `RobotSimOptions::new`.
    SimulateForm where limits = MotionLimits::default(); {
        motion: MotionKind = MotionKind::Fourier, choice::<MotionKind>(), "",
            "How the simulated robot moves";
        motion_csv: Option<String> = None, Kind::Path, "",
            "A file of `thetabus excite` to be played instead, relative to this file";
        harmonics: u64 = 5, Kind::Whole(1, MAX_HARMONICS as u64), "",
            "Harmonics of motion = \"fourier\"";
        period_s: f64 = 20.0, Kind::Real(Interval::above(0.0, 1e4)), "s",
            "Period of the first harmonic";
        rest_s: f64 = 0.5, Kind::Real(Interval::closed(0.0, 1e4 - 1.0)), "s",
            "Rest at each posture of motion = \"moves\"";
        part_of_limits: f64 = limits.part, Kind::Real(PART), "",
            "Share of the URDF's positions and speeds that is used";
        reach: f64 = limits.reach, Kind::Real(REACH), "rad or m",
            "Largest distance from the middle of each joint's range";
        acceleration: f64 = limits.acceleration, Kind::Real(ACCELERATION), "rad/s² or m/s²",
            "Largest acceleration";
        controller: RobotControllerKind = RobotControllerKind::ComputedTorque, choice::<RobotControllerKind>(), "",
            "servo: joints that rely on the feed-forward of [controller]";
        bandwidth_rad_per_s: f64 = 30.0, Kind::Real(Interval::closed(1e-3, 1e4)), "rad/s",
            "Bandwidth of the controller";
        difference: f64 = 0.15, Kind::Real(Interval::closed(0.0, 0.9)), "",
            "Each body differs from the URDF by a factor of up to 1 ± this";
        machine_seed: u64 = 0, Kind::Whole(0, ANY_WHOLE), "",
            "Seed of these differences";
        encoder_bits: u64 = 16, Kind::Whole(0, 48), "bits",
            "Resolution of the encoders; 0 for exact positions";
        torque_noise: f64 = 0.005, Kind::Real(Interval::closed(0.0, 10.0)), "",
            "Standard deviation of the torques as a share of the joint's largest one";
        viscous: Option<Vec<f64>> = None, each(DRIVE), "N m s/rad or N s/m",
            "Viscous friction; by the joint's largest torque if not set";
        coulomb: Option<Vec<f64>> = None, each(DRIVE), "N m or N",
            "Coulomb friction; by the joint's largest torque if not set";
        offset: Option<Vec<f64>> = None, each(Interval::closed(-1e6, 1e6)), "N m or N",
            "Offset of the torques; 0 if not set";
        rotor_inertia: Option<Vec<f64>> = None, each(DRIVE), "kg m² or kg",
            "Inertia of the rotors at the joints; by the joint's largest torque if not set";
        payload: Vec<PayloadForm> = Vec::new(), Kind::Tables(PAYLOAD_KEYS), "",
            "What the flange carries from a time on, in the order of the times";
    }
}

table! {
    /// One `[[simulate.payload]]`.
    PayloadForm {
        t_s: f64, Kind::Real(FINITE), "s",
            "From this time on";
        mass_kg: f64, Kind::Real(Interval::closed(0.0, 1e6)), "kg",
            "Mass; 0 for nothing";
        center_m: Option<Vec<f64>>, Kind::Reals(Len::From(3, 3), FINITE), "m",
            "Centre of mass in the flange's frame; zeros if not set";
        inertia_kg_m2: Option<Vec<f64>>, Kind::Reals(Len::From(6, 6), FINITE), "kg m²",
            "Inertia about the centre of mass: xx, xy, yy, xz, yz, zz; zeros if not set";
    }
}

impl Field for PayloadForm {}

/// The keys of each table.
const PAYLOAD_KEYS: &[Key] = &PayloadForm::keys("simulate.payload");

table! {
    /// Section `[excite]`.
    ExciteForm where (excite, limits) = (ExcitationOptions::new(Vec::new()), MotionLimits::default()); {
        duration_s: f64 = excite.duration_s, Kind::Real(Interval::closed(1.0, 600.0)), "s",
            "One period, from rest to rest";
        harmonics: u64 = excite.harmonics as u64, Kind::Whole(2, MAX_EXCITATION_HARMONICS as u64), "",
            "Harmonics of the motion";
        tries: u64 = excite.tries as u64, Kind::Whole(1, 1_000_000), "",
            "Motions to try";
        seed: u64 = excite.seed, Kind::Whole(0, ANY_WHOLE), "",
            "Seed of the random motions";
        part_of_limits: f64 = limits.part, Kind::Real(PART), "",
            "Share of the URDF's positions, speeds and torques that is used";
        reach: f64 = limits.reach, Kind::Real(POSITIVE), "rad or m",
            "Largest distance from the middle of each joint's range";
        lower: Option<Vec<f64>> = None, each(FINITE), "rad or m",
            "Lowest positions, instead of part_of_limits and reach";
        upper: Option<Vec<f64>> = None, each(FINITE), "rad or m",
            "Highest positions, instead of part_of_limits and reach";
        velocity: Option<Vec<f64>> = None, each(POSITIVE), "rad/s or m/s",
            "Largest speeds, instead of part_of_limits";
        acceleration: Option<Vec<f64>> = None, each(POSITIVE), "rad/s² or m/s²",
            "Largest accelerations; 4 if not set";
    }
}

sections! {
    /// The own sections of a robot's file.
    RobotForm, pub(super) OWN;
    model: RobotModelForm = "model", "The robot";
    drive: DriveForm = "drive", "From the inputs of a log to torques";
    friction: FrictionForm = "friction", "Friction of each joint";
    log: LogForm = "log", "Columns of a log, counted from 1";
    identify: IdentifyForm = "identify", "The identification";
    simulate: SimulateForm = "simulate", "The simulated robot";
    excite: ExciteForm = "excite", "The motion that `thetabus excite` designs";
}
