//! Sections of the programs: restarts, real time, logs, results, controller, checkpoints.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind, Len};
use super::table::{FINITE, LONGEST_S, NOT_NEGATIVE, POSITIVE, choice, model_joints, parameters, table};
use crate::control::AdaptiveOptions;

choices! {
    /// The unit of a time column.
    TimeUnit {
        /// Seconds.
        Seconds = "s",
        /// Milliseconds.
        Milliseconds = "ms",
        /// Microseconds.
        Microseconds = "us",
        /// Nanoseconds.
        Nanoseconds = "ns",
    }

    /// The unit of position columns.
    PositionUnit {
        /// Radians.
        Radians = "rad",
        /// Degrees.
        Degrees = "deg",
        /// Turns.
        Turns = "turn",
        /// Metres.
        Metres = "m",
        /// Millimetres.
        Millimetres = "mm",
        /// Micrometres.
        Micrometres = "um",
    }

    /// How a controller makes its feed-forward.
    FeedForward {
        /// There is no controller.
        None = "none",
        /// From the parameters that it began with.
        Fixed = "fixed",
        /// From estimates that may be used.
        Adaptive = "adaptive",
    }
}

impl TimeUnit {
    /// One unit \[s\].
    pub fn seconds(self) -> f64 {
        match self {
            Self::Seconds => 1.0,
            Self::Milliseconds => 1e-3,
            Self::Microseconds => 1e-6,
            Self::Nanoseconds => 1e-9,
        }
    }
}

impl PositionUnit {
    /// One unit \[rad or m\].
    pub fn si(self) -> f64 {
        match self {
            Self::Radians | Self::Metres => 1.0,
            Self::Degrees => std::f64::consts::TAU / 360.0,
            Self::Turns => std::f64::consts::TAU,
            Self::Millimetres => 1e-3,
            Self::Micrometres => 1e-6,
        }
    }

    /// True for units of length, false for those of angle.
    pub fn is_length(self) -> bool {
        match self {
            Self::Metres | Self::Millimetres | Self::Micrometres => true,
            Self::Radians | Self::Degrees | Self::Turns => false,
        }
    }

    /// The unit of a joint's positions in a log with this unit. If some joints turn and others do
    /// not, this is the unit of the joints that it suits, and the others are in rad or m.
    pub fn of_joint(self, turns: &[bool], joint: usize) -> Self {
        let is_mixed = turns.contains(&true) && turns.contains(&false);
        match turns.get(joint) {
            Some(true) if is_mixed && self.is_length() => Self::Radians,
            Some(false) if is_mixed && !self.is_length() => Self::Metres,
            _ => self,
        }
    }
}

table! {
    /// Section `[supervision]`.
    Supervision {
        restarts: u64 = 0, Kind::Whole(0, 1_000_000), "",
            "Times that each process is started again before the run gives up; 0: the run fails with the first one. A run with restarts ends with exit code 3, because something was lost with each";
        backoff_s: f64 = 0.1, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "Pause before the first restart; twice as long before each further one";
        backoff_limit_s: f64 = 5.0, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "Longest pause";
        healthy_s: f64 = 60.0, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "After running this long, a process has its restart count and its pause reset";
    }
}

table! {
    /// Section `[realtime.*]`.
    Realtime {
        scheduler_priority: u64 = 0, Kind::Whole(0, 99), "",
            "Priority of the real-time policy SCHED_FIFO, 1 to 99; 0: the system's default policy. If the system refuses, the program warns and continues";
        cpu_affinity: Vec<u64> = Vec::new(), Kind::Wholes(Len::From(0, 64), 0, 1023), "",
            "Numbers of the CPUs to run on; none: all that the system gives";
        lock_memory: bool = false, Kind::Flag, "",
            "Keep all memory from being swapped out";
    }
}

table! {
    /// Section `[log]`.
    Log {
        time: Option<String> = None, Kind::Label, "",
            "Column of the time; without it rows follow each other at plant.sample_period_s";
        time_unit: TimeUnit = TimeUnit::Seconds, choice::<TimeUnit>(), "",
            "Unit of the time column";
        q: Vec<String> = Vec::new(), Kind::Words, "",
            "Columns of the positions, one per joint";
        position_unit: PositionUnit = PositionUnit::Radians, choice::<PositionUnit>(), "",
            "Unit of the position columns: of length if the model moves along a line, else of angle. If some joints turn and others do not, it is the unit of the joints that it suits; the others are in rad or m";
        input: Vec<String> = Vec::new(), Kind::Words, "",
            "Columns of the inputs, one per joint; \"0\" for a joint that nothing drives";
        input_unit: f64 = 1.0, Kind::Real(FINITE), "",
            "One unit of the input columns in the model's unit, 0.001 for millivolts; negative if a positive input drives the machine backwards, not 0";
        setpoint: Vec<String> = Vec::new(), Kind::Words, "",
            "Columns of the setpoints, one per joint in the unit of the positions, or none";
    }
}

table! {
    /// Section `[monitor]`.
    Monitor {
        out_dir: Option<String> = None, Kind::Path, "",
            "Directory for estimates.csv and summary.json, which must not hold files yet; not set: `run` takes thetabus-out/TIME, `monitor` writes none";
        record_file_mib: u64 = 1024, Kind::Whole(0, 1_048_576), "MiB",
            "A recording goes on in a new file when one has this size; 0 for no limit";
        record_files: u64 = 16, Kind::Whole(0, 1_000_000), "",
            "Files of a recording that are kept, the oldest making room for a new one; 0 for all";
        record_joint_states: bool = true, Kind::Flag, "",
            "Samples are recorded as sensor_msgs/msg/JointState, too, on the topic /ROBOT/joint_states, which tools of ROS 2 know";
    }
}

table! {
    /// Section `[controller]`.
    Control where follow = AdaptiveOptions::default(); {
        feed_forward: FeedForward = FeedForward::None, choice::<FeedForward>(), "",
            "adaptive: from estimates with use_ok 1, see max_std. fixed: from controller.theta throughout. none: no controller; `run` starts one otherwise";
        theta: Vec<f64> = Vec::new(), parameters(FINITE), "the parameters' own",
            "Parameters that the controller begins with; none: estimator.theta_start";
        max_std: f64 = follow.max_std, Kind::Real(Interval::closed(1e-6, 10.0)), "",
            "A parameter is taken if its standard deviation is at most this share of it";
        blend_s: f64 = follow.blend_s, Kind::Real(Interval::closed(1e-3, 1e3)), "s",
            "Time in which a parameter may move by its own size: a new estimate never steps the input";
        silence_s: f64 = follow.silence_s, Kind::Real(Interval::closed(0.1, 1e6)), "s",
            "An identifier that has not been heard for so long is silent; the last estimates hold";
        deadline_s: f64 = 0.005, Kind::Real(Interval::closed(1e-3, 10.0)), "s",
            "Stream time for which a command holds; without a newer one the machine goes on with its own loop alone";
        input_limit: Vec<f64> = Vec::new(), model_joints(POSITIVE.or_infinite()), "unit of the input",
            "Most feed-forward of each joint, either sign; none: no limit";
        derivative_gain: Vec<f64> = Vec::new(), model_joints(NOT_NEGATIVE), "input per rad/s or m/s",
            "Gain Kd of each joint's own loop, which brakes the wanted velocity, too; none: that of plant.controller for an arm, else 0";
    }
}

table! {
    /// Section `[checkpoint]`.
    Checkpoint {
        dir: Option<String> = None, Kind::Path, "",
            "Directory of the checkpoints, made if it is missing; not set: none are written, and --warm is refused";
        period_s: f64 = 10.0, Kind::Real(Interval::closed(0.1, 1e6)), "s",
            "Time from one checkpoint to the next; another is written at the end, and on `thetabus ctl save`";
    }
}
