//! All keys, each described once: name, type, default, range, unit and meaning, in the file of its
//! section.
//!
//! The structures of the file, the checks with their messages, and `config/default.toml` are
//! generated from these tables.

mod bus;
mod cell;
mod estimator;
mod faults;
mod identifier;
mod model;
mod needs;
mod plant;
mod programs;
#[cfg(feature = "robot")]
mod robot;
mod setpoint;
mod table;

pub use bus::{Bus, Delivery};
pub(super) use cell::{MAX_ROBOTS, ROBOTS};
pub use estimator::{BoundsKind, Estimator, OutliersKind, RelationsKind};
pub use faults::{FaultChoice, FaultForm};
pub use identifier::{Automatic, ConsideredErrors, Identifier, InputKind, Projected, RowsKind};
pub use model::{Known, Model, ServoAxisModel};
pub(super) use needs::Need;
pub use plant::{Arm, Controller, Fastest, MachineKind, Mass2, ModelPlant, Plant, Sensors, ServoAxisPlant, Unmodelled};
pub use programs::{Checkpoint, Control, FeedForward, Log, Monitor, PositionUnit, Realtime, Supervision};
#[cfg(feature = "robot")]
pub use robot::{
    DriveForm, ExciteForm, FrictionForm, IdentifyForm, LogForm, MotionKind, PayloadForm, RobotControllerKind,
    RobotForm, SimulateForm, VelocityKind,
};
pub use setpoint::{Chirp, Csv, Moves, Random, RandomSines, Setpoint, SetpointKind, Sines, Square, Steps};
pub use table::RealOr;
use table::sections;

use super::kind::{Key, Section};

/// Groups of mutually exclusive keys.
pub(super) const EXCLUSIVE: &[&[&str]] = &[
    &["estimator.forgetting_factor", "estimator.time_constant_s"],
    &["plant.setpoint.csv.path", "plant.setpoint.csv.rows"],
];

/// Keys of earlier versions, with what to write now.
const RETIRED: &[(&str, &str)] = &[(
    "identifier.projected.velocity_half_width",
    "is a time now: write velocity_half_width_s, the samples times plant.sample_period_s, for example 0.01 for 10 samples at 1 ms",
)];

/// All keys, in the order of `config/default.toml`.
pub fn keys() -> impl Iterator<Item = &'static Key> {
    ORDINARY.keys()
}

/// The key with this full name.
pub(super) fn key(path: &str) -> Option<&'static Key> {
    ORDINARY.key(path)
}

/// The keys of one kind of file.
#[derive(Debug)]
pub(super) struct Schema {
    /// Sections that only this kind has, or that have another meaning in it.
    own: &'static [Section],
    /// Whether it has this one of the other sections.
    shares: fn(&str) -> bool,
    /// The file that lists its own keys.
    list: &'static str,
}

/// A configuration.
pub(super) static ORDINARY: Schema = Schema {
    own: &[],
    shares: |_| true,
    list: DEFAULTS,
};

/// What is shared by the robots of a cell, and their `[[robot]]` entries.
pub(super) static CELL: Schema = Schema {
    own: cell::OWN,
    shares: |_| true,
    list: DEFAULTS,
};

/// The file with all keys of a configuration.
const DEFAULTS: &str = "config/default.toml";

/// The configuration of a robot from its URDF.
#[cfg(feature = "robot")]
pub(super) static ROBOT: Schema = Schema {
    own: robot::OWN,
    shares: |section| !["model", "identifier", "log"].contains(&section.split('.').next().unwrap_or("")),
    list: "config/robots/six_axis.toml",
};

/// Names of the sections that only a robot's file has, or that have another meaning there.
#[cfg(feature = "robot")]
pub(super) fn own_sections_of_robots() -> impl Iterator<Item = &'static str> {
    robot::OWN.iter().map(|section| section.name)
}

impl Schema {
    /// All keys, its own first.
    pub fn keys(&self) -> impl Iterator<Item = &'static Key> {
        let shares = self.shares;
        let shared = SECTIONS.iter().filter(move |section| shares(section.name));
        self.own.iter().chain(shared).flat_map(|section| section.keys)
    }

    /// The key with this full name.
    pub fn key(&self, path: &str) -> Option<&'static Key> {
        let (section, name) = path.rsplit_once('.').unwrap_or(("", path));
        self.keys().find(|key| key.section == section && key.name == name)
    }

    /// Its own sections.
    #[cfg(feature = "service")]
    pub fn own_sections(&self) -> &'static [Section] {
        self.own
    }

    /// The file that lists the keys near this one.
    pub fn list_of(&self, path: &str) -> &'static str {
        let section = path.split('.').next().unwrap_or("");
        let is_shared = SECTIONS.iter().any(|other| other.name == section) && (self.shares)(section);
        if is_shared { DEFAULTS } else { self.list }
    }

    /// What to write instead of a key of earlier versions.
    pub fn retired(&self, path: &str) -> Option<&'static str> {
        let found = RETIRED.iter().find(|(retired, _)| *retired == path);
        found.map(|(_, what)| *what).filter(|_| (self.shares)(path))
    }
}

sections! {
    /// The configuration in the form of its file: every section with its keys. The defaults are the
    /// paper's experiment, from the presets of the core types.
    FileForm, pub(super) SECTIONS;
    bus: Bus = "bus", "Which topics, and how samples are delivered";
    plant: Plant = "plant", "The simulated machine";
    arm: Arm = "plant.arm", "The simulated arm: two uniform beams, a DC motor at each joint";
    mass_2: Mass2 = "plant.mass_2", "Mass m2 of link 2 with its payload over time, as points";
    servo_plant: ServoAxisPlant = "plant.servo_axis", "The simulated servo axis, in m and N or in rad and N m: M dv/dt = gain u − viscous_friction v − coulomb_friction sign v − offset";
    model_plant: ModelPlant = "plant.model", "The simulated machine of the model's own equations; joint j follows the setpoint of joint j mod 2";
    controller: Controller = "plant.controller", "The PD controllers (13): u = Kp (setpoint − q) − Kd dq";
    sensors: Sensors = "plant.sensors", "What stands between the machine's exact signals and its samples";
    unmodelled: Unmodelled = "plant.unmodelled", "What the arm does beyond the equations that are identified; all off by default";
    setpoint: Setpoint = "plant.setpoint", "Commanded positions; only the section of the chosen kind is used";
    steps: Steps = "plant.setpoint.steps", "A cycle of levels";
    square: Square = "plant.setpoint.square", "Between offset + amplitude and offset − amplitude";
    sines: Sines = "plant.setpoint.sines", "A sum of given sines";
    random_sines: RandomSines = "plant.setpoint.random_sines", "A sum of sines drawn from the seed, velocities equal";
    random: Random = "plant.setpoint.random", "Levels and dwell times drawn uniformly from the seed";
    moves: Moves = "plant.setpoint.moves", "Moves from point to point, each followed by a rest; levels and times drawn uniformly from the seed";
    chirp: Chirp = "plant.setpoint.chirp", "A sine whose frequency moves exponentially, again and again";
    csv: Csv = "plant.setpoint.csv", "Values at given times, read from a file";
    model: Model = "model", "The equations whose parameters are identified";
    servo_axis: ServoAxisModel = "model.servo_axis", "What is known of a servo axis";
    known: Known = "model.known", "What is known of the machine; with all three, physical values are derived from the estimate, such as mass_2 in kg";
    identifier: Identifier = "identifier", "How samples become rows of the estimation problem";
    projected: Projected = "identifier.projected", "Rows from positions and inputs; for rows = \"projected\"";
    considered: ConsideredErrors = "identifier.considered", "Standard deviations of errors that the machine may have and the model leaves out: not estimated, but sigma allows for what they could do as far as the data leave them open; for rows = \"projected\"";
    estimator: Estimator = "estimator", "The recursion over blocks of samples";
    supervision: Supervision = "supervision", "What `thetabus run` does about a process that fails or is killed";
    realtime_plant: Realtime = "realtime.plant", "Real-time settings of the plant simulator";
    realtime_identifier: Realtime = "realtime.identifier", "Real-time settings of the identifier";
    realtime_monitor: Realtime = "realtime.monitor", "Real-time settings of the monitor";
    log: Log = "log", "Columns of a log file for `thetabus identify`";
    monitor: Monitor = "monitor", "What is kept of a run";
    control: Control = "controller", "The controller that uses estimates: feed-forward beside the machine's own loop";
    checkpoint: Checkpoint = "checkpoint", "What the identifier keeps, so that its next start can be warm";
}

#[cfg(test)]
mod tests {
    use super::super::kind::Kind;
    use super::*;
    use serde::Deserialize as _;
    use toml::Value;

    /// The value of a key after it was set to a word, read and written.
    fn read_and_written(key: &Key, word: &str) -> Option<Value> {
        let mut table = toml::Table::try_from(FileForm::default()).expect("serialises");
        let section = table.get_mut(key.section)?.as_table_mut()?;
        section.insert(key.name.to_owned(), Value::from(word));
        let form = FileForm::deserialize(Value::Table(table)).expect(word);
        let written = toml::Table::try_from(form).expect("serialises");
        written.get(key.section)?.get(key.name).cloned()
    }

    #[test]
    fn prop_serde_reads_each_word_that_the_checks_let_through_and_no_other() {
        let mut choices = 0;
        for key in keys() {
            let words = match &key.kind {
                Kind::Choice(words) => *words,
                Kind::RealOr(_, word) => std::slice::from_ref(word),
                _ => continue,
            };
            choices += 1;
            for word in words {
                assert_eq!(read_and_written(key, word), Some(Value::from(*word)), "{}", key.path());
            }
            let other = std::panic::catch_unwind(|| read_and_written(key, "another"));
            assert!(other.is_err(), "{} takes any word", key.path());
        }
        assert!(choices > 20, "{choices}");
        for key in faults::KEYS {
            let Kind::Choice(words) = key.kind else { continue };
            for word in words {
                let mut table: toml::Table = "kind = \"off\"\nfrom_s = 1.0".parse().expect("valid");
                table.insert(key.name.to_owned(), Value::from(*word));
                let form = FaultForm::deserialize(Value::Table(table)).expect(word);
                let written = toml::Table::try_from(form).expect("serialises");
                assert_eq!(written.get(key.name), Some(&Value::from(*word)), "{}", key.path());
            }
        }
    }
}
