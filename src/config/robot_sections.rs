//! The own sections of a robot's file → options of its model, identification and simulation.

use super::check::Check;
use super::schema::{
    DriveForm, ExciteForm, FrictionForm, IdentifyForm, LogForm, MotionKind, RobotControllerKind, RobotForm,
    SimulateForm,
};
use crate::pipe::{MAX_TABLE_BYTES, read_text};
use crate::robot::{
    Drives, DrivesError, ExcitationOptions, FrictionError, IdentifyError, IdentifyOptions, JointFriction, JointRange,
    LogColumns, MotionError, MotionLimits, MotionTable, Motions, PayloadChange, Robot, RobotController,
    RobotIdentifier, RobotModel, RobotSimError, RobotSimOptions, RobotSimulator, WindowOptions,
};
use nalgebra::Vector3;
use std::path::Path;
use std::sync::Arc;

/// Valid magnitudes of gravity \[m/s²\].
const GRAVITY: std::ops::Range<f64> = 1.5..30.0;

/// Gravity in the base's frame \[m/s²\]: zero, or between that of the Moon and of Jupiter. In units
/// of g its length would be 1, and with the factor applied twice 96.
pub(super) fn gravity(form: &RobotForm, check: &mut Check<'_>) -> Option<Vector3<f64>> {
    let gravity = Vector3::from_column_slice(form.model.gravity_m_per_s2.as_deref()?);
    let size = gravity.norm();
    if size == 0.0 || GRAVITY.contains(&size) {
        return Some(gravity);
    }
    let problem = format!(
        "expected the acceleration of gravity in m/s² in the base's frame, as [0.0, 0.0, -9.81], or zeros for none, got \
         {:?} of length {size:.3}",
        gravity.as_slice()
    );
    check.wrong("model.gravity_m_per_s2", problem);
    None
}

/// Friction of each joint; the default after reporting a problem.
pub(super) fn friction(section: &FrictionForm, check: &mut Check<'_>) -> JointFriction {
    let friction = JointFriction {
        terms: section.terms.clone(),
        presliding: section.presliding,
        rest_speed: section.rest_speed,
        stribeck_speed: section.stribeck_speed,
    };
    match friction.validate() {
        Ok(()) => return friction,
        Err(FrictionError::Twice(term)) => check.wrong(
            "friction.terms",
            format!("expected each term once, got \"{term}\" twice"),
        ),
        Err(error) => check.wrong("friction", error.to_string()),
    }
    JointFriction::default()
}

/// A list with an entry per joint; `None` after reporting a problem.
fn per_joint<T: Clone>(key: &str, list: &Option<Vec<T>>, joints: usize, check: &mut Check<'_>) -> Option<Vec<T>> {
    let list = list.as_ref()?;
    if list.len() == joints {
        return Some(list.clone());
    }
    let problem = format!("expected {joints} numbers, one per joint, got {}", list.len());
    check.wrong(key, problem);
    None
}

/// From the inputs of a log to torques; `None` after reporting a problem.
pub(super) fn drives(section: &DriveForm, joints: usize, check: &mut Check<'_>) -> Option<Drives> {
    let drives = Drives {
        gain: section.gain.clone().unwrap_or_else(|| vec![1.0; joints]),
        coupling: section.coupling.clone(),
    };
    match drives.validate(joints) {
        Ok(()) => return Some(drives),
        Err(DrivesError::Gain { joints, got }) => check.wrong(
            "drive.gain",
            format!("expected {joints} finite numbers other than 0, one per joint, got {got:?}"),
        ),
        Err(DrivesError::Coupling { joints, got }) => check.wrong(
            "drive.coupling",
            format!("expected {joints} rows of {joints} finite numbers, got {got:?}"),
        ),
    }
    None
}

/// The windows as stated in a file \[s\].
#[derive(Debug, Clone, Copy)]
pub(super) struct StatedWindows {
    length_s: Option<f64>,
    stride_s: Option<f64>,
    max_gap_s: Option<f64>,
}

impl StatedWindows {
    pub fn of(section: &IdentifyForm) -> Self {
        Self {
            length_s: section.window_s,
            stride_s: section.stride_s,
            max_gap_s: section.max_gap_s,
        }
    }

    /// True if the service chooses their length.
    fn are_free(&self) -> bool {
        self.length_s.is_none() && self.stride_s.is_none()
    }

    /// The windows for this sample period \[s\].
    pub fn at(&self, period_s: f64) -> WindowOptions {
        let mut windows = self
            .length_s
            .map_or_else(|| WindowOptions::for_period(period_s), WindowOptions::of_length);
        windows.stride_s = self.stride_s.unwrap_or(windows.stride_s);
        windows.max_gap_s = self.max_gap_s.unwrap_or(windows.max_gap_s);
        windows
    }
}

/// Options of the identification, with windows for this sample period \[s\].
pub(super) fn identification(
    section: &IdentifyForm,
    windows: &StatedWindows,
    period_s: f64,
    model: &RobotModel,
    check: &mut Check<'_>,
) -> IdentifyOptions {
    let options = IdentifyOptions {
        windows: windows.at(period_s),
        lengthens: windows.are_free(),
        block_s: section.block_s,
        settle_blocks: section.settle_blocks as usize,
        friction_walk: section.friction_walk,
        payload_friction: section.payload_friction,
        zero_rad: section.zero_rad,
        delay_s: section.delay_s,
        friction_shape: section.friction_shape,
        spring_share: section.spring_share,
        ..IdentifyOptions::default()
    };
    // Reports errors of the options now, not after the log has been read.
    match RobotIdentifier::new(model.clone(), options) {
        Ok(_) => {}
        Err(IdentifyError::Stride { least_s, part, got_s }) => {
            let key = check.culprit(&["identify.stride_s", "identify.window_s"]);
            let problem =
                format!("expected a stride of at least {least_s:.4} s and 1/{part} of the window, got {got_s} s");
            check.wrong(key, problem);
        }
        Err(IdentifyError::Block {
            least_s,
            most_s,
            most,
            got_s,
        }) => {
            let problem = format!("expected {least_s} to {most_s} s, {most} strides of the windows, got {got_s} s");
            check.wrong("identify.block_s", problem);
        }
        Err(error) => check.wrong("identify", error.to_string()),
    }
    options
}

/// A motion in a file; `None` after reporting a problem.
fn motion(path: &Path, joints: usize, check: &mut Check<'_>) -> Option<MotionTable> {
    let text = read_text(path, MAX_TABLE_BYTES).map_err(|e| e.to_string());
    let table = text.and_then(|text| MotionTable::parse(&text, joints).map_err(|e| e.to_string()));
    table
        .map_err(|problem| check.wrong("simulate.motion_csv", format!("{}: {problem}", path.display())))
        .ok()
}

/// Options of a simulated robot; `None` after reporting a problem. Paths are relative to `dir`.
pub(super) fn simulation(
    section: &SimulateForm,
    model: &RobotModel,
    has_velocity: bool,
    dir: &Path,
    check: &mut Check<'_>,
) -> Option<RobotSimOptions> {
    let (robot, before) = (model.robot(), check.problems.len());
    let default = RobotSimOptions::new(robot);
    let mut drives = default.drives.clone();
    let n = drives.len();
    let lists = [
        per_joint("simulate.viscous", &section.viscous, n, check),
        per_joint("simulate.coulomb", &section.coulomb, n, check),
        per_joint("simulate.offset", &section.offset, n, check),
        per_joint("simulate.rotor_inertia", &section.rotor_inertia, n, check),
    ];
    for (joint, drive) in drives.iter_mut().enumerate() {
        let members = [
            &mut drive.viscous,
            &mut drive.coulomb,
            &mut drive.offset,
            &mut drive.rotor_inertia,
        ];
        for (member, list) in members.into_iter().zip(&lists) {
            *member = list.as_ref().map_or(*member, |list| list[joint]);
        }
    }
    let mut options = RobotSimOptions {
        motions: match section.motion {
            MotionKind::Rest => Motions::Rest,
            MotionKind::Fourier => Motions::Fourier {
                harmonics: section.harmonics as usize,
                period_s: section.period_s,
            },
            MotionKind::Moves => Motions::Moves { rest_s: section.rest_s },
        },
        limits: MotionLimits {
            part: section.part_of_limits,
            reach: section.reach,
            acceleration: section.acceleration,
        },
        controller: match section.controller {
            RobotControllerKind::ComputedTorque => RobotController::ComputedTorque,
            RobotControllerKind::Pd => RobotController::Pd,
            RobotControllerKind::Servo => RobotController::Servo,
        },
        bandwidth_rad_per_s: section.bandwidth_rad_per_s,
        drives,
        difference: section.difference,
        machine_seed: section.machine_seed,
        encoder_bits: if has_velocity { 0 } else { section.encoder_bits as u32 },
        has_velocity,
        torque_noise: section.torque_noise,
        payloads: section.payload.iter().map(payload).collect(),
        ..default
    };
    // Reports errors now, not when the robot is simulated.
    match RobotSimulator::new(robot, options.clone()) {
        Ok(_) => {}
        Err(RobotSimError::PayloadTime(t_s)) => {
            check.wrong("simulate.payload", format!("expected rising times, got {t_s} s"));
        }
        Err(error) => check.wrong("simulate", error.to_string()),
    }
    if let Some(name) = &section.motion_csv {
        options.motions = Motions::Table(Arc::new(motion(&dir.join(name), n, check)?));
    }
    (check.problems.len() == before).then_some(options)
}

fn payload(form: &super::schema::PayloadForm) -> PayloadChange {
    let numbers = |list: &Option<Vec<f64>>, i: usize| list.as_ref().map_or(0.0, |list| list[i]);
    PayloadChange {
        t_s: form.t_s,
        mass_kg: form.mass_kg,
        center_m: std::array::from_fn(|i| numbers(&form.center_m, i)),
        inertia_kg_m2: std::array::from_fn(|i| numbers(&form.inertia_kg_m2, i)),
    }
}

/// Options of designed motions; `None` after reporting a problem.
pub(super) fn excitation(section: &ExciteForm, robot: &Robot, check: &mut Check<'_>) -> Option<ExcitationOptions> {
    let (n, before) = (robot.len(), check.problems.len());
    let acceleration = MotionLimits::default().acceleration;
    let mut ranges = JointRange::of(robot, section.part_of_limits, section.reach, acceleration);
    let lists = [
        ("excite.lower", &section.lower),
        ("excite.upper", &section.upper),
        ("excite.velocity", &section.velocity),
        ("excite.acceleration", &section.acceleration),
    ];
    for (key, list) in lists {
        let Some(list) = per_joint(key, list, n, check) else {
            continue;
        };
        for ((range, value), joint) in ranges.iter_mut().zip(list).zip(&robot.joints) {
            let limits = &joint.limits;
            let (least, most) = match key {
                "excite.velocity" => (0.0, limits.velocity.filter(|x| *x > 0.0)),
                "excite.acceleration" => (0.0, None),
                _ => (limits.lower.unwrap_or(f64::NEG_INFINITY), limits.upper),
            };
            let most = most.unwrap_or(f64::INFINITY);
            if !(value >= least && value <= most) {
                let problem = format!(
                    "joint \"{}\": expected {least} to {most} as the URDF says, got {value}",
                    joint.name
                );
                check.wrong(key, problem);
                continue;
            }
            match key {
                "excite.lower" => range.lower = value,
                "excite.upper" => range.upper = value,
                "excite.velocity" => range.velocity = value,
                _ => range.acceleration = value,
            }
        }
    }
    let options = ExcitationOptions {
        duration_s: section.duration_s,
        harmonics: section.harmonics as usize,
        tries: section.tries as usize,
        seed: section.seed,
        ranges,
    };
    if check.problems.len() == before {
        match options.validate(robot) {
            Ok(()) => return Some(options),
            Err(MotionError::Empty { joint, lower, upper }) => {
                let key = check.culprit(&["excite.lower", "excite.upper"]);
                let problem = format!("joint \"{joint}\": expected lower below upper, got {lower} and {upper}");
                check.wrong(key, problem);
            }
            Err(error) => check.wrong("excite", error.to_string()),
        }
    }
    None
}

/// Default columns: t, then all positions, all velocities, all inputs. A section that names the
/// columns of the inputs must also name those of the velocities, if there are any. `None` after
/// reporting a problem.
pub(super) fn columns(section: &LogForm, n: usize, check: &mut Check<'_>) -> Option<LogColumns> {
    let before = check.problems.len();
    let mut list = |name: &str, given: &Option<Vec<u64>>, default: Vec<usize>, hint: &str| {
        let columns = given
            .as_ref()
            .map_or(default, |given| given.iter().map(|column| *column as usize).collect());
        if columns.len() != n {
            let problem = format!("expected {n} columns counted from 1, one per joint, got {columns:?}{hint}");
            check.wrong(&format!("log.{name}"), problem);
        }
        columns
    };
    let default = LogColumns::in_order(n, section.input_columns.is_none());
    let velocity = match &section.velocity_columns {
        None => default.velocity,
        Some(columns) if columns.is_empty() => Vec::new(),
        given => {
            let hint = "; leave it out, or empty, if the log holds no velocities";
            list("velocity_columns", given, Vec::new(), hint)
        }
    };
    let in_order = LogColumns::in_order(n, !velocity.is_empty());
    let columns = LogColumns {
        time: section.time_column as usize,
        position: list("position_columns", &section.position_columns, in_order.position, ""),
        input: list("input_columns", &section.input_columns, in_order.input, ""),
        velocity,
    };
    if check.problems.len() == before
        && let Some(twice) = named_twice(&columns)
    {
        let keys = [
            "log.input_columns",
            "log.velocity_columns",
            "log.position_columns",
            "log.time_column",
        ];
        let message = format!("expected a column of its own for time and for each signal, got column {twice} twice");
        check.wrong(check.culprit(&keys), message);
    }
    (check.problems.len() == before).then_some(columns)
}

/// A column that the section names for two purposes.
fn named_twice(columns: &LogColumns) -> Option<usize> {
    let signals = [&columns.position, &columns.velocity, &columns.input];
    let mut all: Vec<usize> = signals.into_iter().flatten().copied().chain([columns.time]).collect();
    all.sort_unstable();
    all.windows(2).find_map(|pair| (pair[0] == pair[1]).then_some(pair[0]))
}
