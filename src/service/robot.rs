//! Converts the configuration of a robot from its URDF for all programs: its model for the catalog,
//! and its other sections as an ordinary source.

use super::Failure;
use crate::config::{Catalog, Config, RobotConfig, Source, is_robot_override};
use crate::node::model::SharedModel;
use crate::node::robot_model::{RobotPlant, RobotSettings};
use crate::pipe::{MAX_SETTINGS_BYTES, read_text};
use crate::robot::{IdentifyOptions, RobotSimulator};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Name of the URDF in a directory of results.
const URDF: &str = "robot.urdf";
/// Name of the simulated robot's motion there.
const MOTION: &str = "motion.csv";
/// Default length of a run \[s\].
const DURATION_S: f64 = 60.0;

/// A robot's file, converted for ordinary programs.
pub(super) struct RobotSource {
    /// The given models and the robot's.
    pub catalog: Catalog,
    /// The other sections.
    pub source: Source,
    /// Sample period by which the length of a block was converted to samples \[s\]; `None` if the
    /// file states that length in samples.
    pub counted_with_s: Option<f64>,
}

/// The text of a file that is the configuration of a robot; `None` for another file. The ordinary
/// loader reports files that cannot be read.
pub(super) fn robot_text(path: &Path) -> Option<String> {
    // A pipe can be read only once, by the ordinary loader.
    if !path.is_file() {
        return None;
    }
    let text = read_text(path, MAX_SETTINGS_BYTES).ok()?;
    RobotConfig::is_robot(&text).then_some(text)
}

/// The model and the other sections of a robot's file, with those arguments of `--set` applied that
/// are for a robot's own sections; `None` for another file. The samples of a block follow from
/// `identify.block_s` and `period_s`, the sample period in use; if that is not yet known, from the
/// file's.
///
/// # Errors
/// Errors of the file, its URDF or the arguments.
pub(super) fn source(
    path: &Path,
    catalog: &Catalog,
    set: &[String],
    period_s: Option<f64>,
) -> Result<Option<RobotSource>, Failure> {
    let Some(text) = robot_text(path) else {
        return Ok(None);
    };
    let config = RobotConfig::parse_with(&text, path, set)?;
    let in_file = |problem: &dyn std::fmt::Display| Failure::Usage(format!("{}: {problem}", path.display()));
    let own_period_s = config.sample_period_s;
    let period_s = period_s.unwrap_or(own_period_s);
    let counts_samples = config.is_stated("estimator.block_len");
    let settings = RobotSettings {
        options: IdentifyOptions {
            payload: config.payload,
            windows: config.windows_at(period_s),
            ..config.options
        },
        model: config.model,
        drives: config.drives,
        velocity_s: config.velocity_s,
        simulation: config.simulation,
    };
    let (block_s, simulation) = (settings.options.block_s, settings.simulation.clone());
    let robot = RobotPlant::new(settings).map_err(|e| in_file(&e))?;
    let mut defaults = Table::new();
    let plant = section(&mut defaults, "plant");
    set_to(plant, "sample_period_s", own_period_s);
    set_to(plant, "duration_s", DURATION_S);
    set_to(plant, "machine", "model");
    let block_len = ((block_s / period_s).round() as i64).max(1);
    set_to(section(&mut defaults, "estimator"), "block_len", block_len);
    let mut derived = Table::new();
    // A lower layer, such as the configuration of a recording, may name another robot.
    let name = crate::node::model::Model::definition(&robot).name.clone();
    set_to(section(&mut derived, "model"), "kind", name);
    let plant = section(&mut derived, "plant");
    set_to(
        section(plant, "sensors"),
        "encoder_bits",
        i64::from(simulation.encoder_bits),
    );
    // The truth for the table: at the start, and after the first change of the payload.
    let machine = RobotSimulator::new(robot.settings().model.robot(), simulation.clone()).map_err(|e| in_file(&e))?;
    let theta = |t_s: f64| -> Value {
        let all = machine.truth(&robot.settings().model, t_s);
        let count = crate::node::model::Model::parameters(&robot).len();
        Value::Array(all.into_iter().take(count).map(Value::Float).collect())
    };
    let truth = section(plant, "model");
    set_to(truth, "theta", theta(0.0));
    if let Some(change) = simulation.payloads.iter().find(|change| change.t_s > 0.0) {
        set_to(truth, "change_s", change.t_s);
        set_to(truth, "theta_after", theta(change.t_s));
    }
    let source = Source::Robot {
        path: path.to_owned(),
        defaults: toml::to_string(&defaults).map_err(|e| in_file(&e))?,
        derived: toml::to_string(&derived).map_err(|e| in_file(&e))?,
    };
    Ok(Some(RobotSource {
        catalog: catalog.clone().with_latest(SharedModel::new(robot)),
        source,
        counted_with_s: (!counts_samples).then_some(period_s),
    }))
}

/// A warning about a robot's file of the command line, if its URDF is hardly in metres and radians.
pub(super) fn suspicious_unit(path: &Path, set: &[String]) -> Option<String> {
    let config = RobotConfig::parse_with(&robot_text(path)?, path, set).ok()?;
    let words = config.model.robot().suspicious_unit()?;
    Some(format!("{}: {words}", config.urdf.display()))
}

/// Refuses an argument of `--set` for a section that only a robot's file has.
///
/// # Errors
/// If there is such an argument.
pub(super) fn refuse_overrides(set: &[String]) -> Result<(), Failure> {
    // Sections [model] and [log] also exist in other configurations.
    let shared = |argument: &str| ["model.", "log."].iter().any(|section| argument.starts_with(section));
    match set.iter().find(|one| is_robot_override(one) && !shared(one.trim())) {
        Some(argument) => Err(Failure::Usage(format!(
            "--set {argument}: sections drive, friction, identify, simulate and excite are those of a robot's file, model.kind = \"robot\": expected one by --config, got none"
        ))),
        None => Ok(()),
    }
}

/// Writes the configuration of a run, including `--set`, to its directory, with the URDF next to
/// it; `None` if no file is a robot's.
///
/// # Errors
/// If the URDF cannot be copied.
pub(super) fn as_file<'a>(
    files: impl Iterator<Item = &'a PathBuf>,
    set: &[String],
    config: &Config,
    dir: &Path,
) -> Result<Option<String>, Failure> {
    let mut robot = None;
    for path in files {
        if let Some(text) = robot_text(path) {
            robot = Some((path, RobotConfig::own_sections(&text, path, set)?));
        }
    }
    let Some((path, mut own)) = robot else {
        return Ok(None);
    };
    let beside = path.parent().unwrap_or(Path::new(""));
    if let Some(urdf) = own.model.urdf.replace(URDF.to_owned()) {
        copy(&beside.join(urdf), &dir.join(URDF))?;
    }
    if let Some(motion) = &mut own.simulate.motion_csv {
        copy(&beside.join(&*motion), &dir.join(MOTION))?;
        *motion = MOTION.to_owned();
    }
    let failed = |e: &dyn std::fmt::Display| {
        Failure::Failed(format!(
            "{}: the configuration cannot be written as TOML: {e}",
            path.display()
        ))
    };
    let mut shared: Table = config.to_toml().parse().map_err(|e| failed(&e))?;
    for name in ["model", "identifier", "log"] {
        shared.remove(name);
    }
    let shared = toml::to_string(&shared).map_err(|e| failed(&e))?;
    Ok(Some(own.to_toml() + &shared))
}

/// Copies a file that was read before, so it is not a pipe.
fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    let bytes = std::fs::read(from).map_err(|e| {
        Failure::Failed(format!(
            "{}: cannot be read: {e}; it is copied to {}",
            from.display(),
            to.display()
        ))
    })?;
    crate::files::write(to, &bytes).map_err(|e| Failure::Failed(format!("{}: cannot be written: {e}", to.display())))
}

/// These models and, if the directory has results of a robot, the robot's.
///
/// # Errors
/// Errors of the configuration in the directory.
pub(super) fn beside(input: &Path, catalog: &Catalog) -> Result<Catalog, Failure> {
    let dir = if input.is_dir() { Some(input) } else { input.parent() };
    let of_dir = |dir: &Path| source(&dir.join("config.toml"), catalog, &[], None);
    let found = dir.map(of_dir).transpose()?.flatten();
    Ok(found.map_or_else(|| catalog.clone(), |robot| robot.catalog))
}

/// A section, empty if there is none.
fn section<'a>(table: &'a mut Table, name: &str) -> &'a mut Table {
    let entry = table.entry(name).or_insert_with(|| Value::Table(Table::new()));
    if !entry.is_table() {
        *entry = Value::Table(Table::new());
    }
    match entry {
        Value::Table(section) => section,
        _ => unreachable!("it was just made one"),
    }
}

fn set_to(section: &mut Table, key: &str, value: impl Into<Value>) {
    section.insert(key.to_owned(), value.into());
}

#[cfg(test)]
mod tests {
    use super::super::CommonArgs;
    use super::*;

    const SIX_AXIS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");

    fn load(file: &Path, set: &[&str]) -> Result<Config, String> {
        let common = CommonArgs {
            config: vec![file.to_owned()],
            set: set.iter().map(|one| (*one).to_owned()).collect(),
            ..CommonArgs::default()
        };
        common.load(Vec::new(), &[]).map_err(|failure| failure.to_string())
    }

    /// A directory with the URDF and a file of these sections beside it.
    fn beside_the_urdf(name: &str, sections: &str) -> PathBuf {
        let dir = std::env::temp_dir().join(format!("thetabus-robot-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("a directory");
        let urdf = Path::new(SIX_AXIS).with_file_name("six_axis.urdf");
        std::fs::copy(urdf, dir.join("arm.urdf")).expect("copied");
        let model = "[model]\nkind = \"robot\"\nurdf = \"arm.urdf\"\n";
        std::fs::write(dir.join("robot.toml"), format!("{model}{sections}")).expect("written");
        dir.join("robot.toml")
    }

    #[test]
    fn regress_a_block_keeps_its_time_whoever_states_the_sample_period() {
        let len = |config: Result<Config, String>| config.expect("valid").estimator.block_len;
        let six_axis = Path::new(SIX_AXIS);
        assert_eq!(len(load(six_axis, &[])), 1000);
        assert_eq!(len(load(six_axis, &["plant.sample_period_s=0.004"])), 250);
        let file = beside_the_urdf("period", "[plant]\nsample_period_s = 0.004\n");
        assert_eq!(len(load(&file, &[])), 250);
        assert_eq!(len(load(&file, &["plant.sample_period_s=0.001"])), 1000);
        // A stated number of samples takes precedence.
        let both = ["plant.sample_period_s=0.004", "estimator.block_len=300"];
        assert_eq!(len(load(six_axis, &both)), 300);
        std::fs::remove_dir_all(file.parent().expect("a directory")).expect("removed");
        let file = beside_the_urdf("length", "[estimator]\nblock_len = 700\n");
        assert_eq!(len(load(&file, &["plant.sample_period_s=0.004"])), 700);
        std::fs::remove_dir_all(file.parent().expect("a directory")).expect("removed");
    }

    #[test]
    fn regress_the_sample_period_is_read_by_one_rule() {
        for (written, said) in [("0.004", "0.004"), ("2", "got 2"), ("\"fast\"", "got \"fast\"")] {
            let file = beside_the_urdf("rule", &format!("[plant]\nsample_period_s = {written}\n"));
            let config = RobotConfig::from_file(&file).map(|config| config.sample_period_s.to_string());
            let text = config.unwrap_or_else(|error| error.to_string());
            assert!(text.contains(said), "{text}");
            std::fs::remove_dir_all(file.parent().expect("a directory")).expect("removed");
        }
    }

    #[test]
    fn regress_the_other_sections_keep_their_lines() {
        let file = beside_the_urdf(
            "lines",
            "\n[plant.arm]\nlength_1_m = 0.7\n\n[controller]\nmax_std = 3\n",
        );
        let config = load(&file, &[]).expect("valid");
        let said = config.warnings().first().expect("a warning").to_string();
        assert!(
            said.contains("robot.toml:6: plant.arm.length_1_m: has no effect"),
            "{said}"
        );
        let sections = "[plant]\nduration_s = \"long\"\n[identify]\nblok_s = 1\n";
        let file = beside_the_urdf("lines", sections);
        let error = load(&file, &[]).expect_err("two errors");
        for said in [
            "robot.toml:5: plant.duration_s: expected",
            "robot.toml:7: identify.blok_s: unknown key",
        ] {
            assert!(error.contains(said), "{error}");
        }
        std::fs::remove_dir_all(file.parent().expect("a directory")).expect("removed");
    }

    #[test]
    fn regress_a_file_that_cannot_be_copied_is_named() {
        let file = beside_the_urdf("copy", "");
        let config = load(&file, &[]).expect("valid");
        let dir = file.parent().expect("a directory");
        std::fs::remove_file(dir.join("arm.urdf")).expect("removed");
        let out = std::env::temp_dir();
        let error = as_file([file.clone()].iter(), &[], &config, &out).expect_err("no URDF");
        let text = error.to_string();
        assert!(
            text.contains(&format!("{}: cannot be read", dir.join("arm.urdf").display())),
            "{text}"
        );
        std::fs::remove_dir_all(dir).expect("removed");
    }

    #[test]
    fn regress_set_reaches_a_robots_own_sections_and_the_file_of_its_run() {
        let path = PathBuf::from(SIX_AXIS);
        let set = [
            "identify.block_s=0.5",
            "plant.seed=3",
            "simulate.motion=rest",
            "plant.sample_period_s=0.002",
        ];
        let config = load(&path, &set).expect("valid");
        assert_eq!((config.estimator.block_len, config.plant.sim.seed), (250, 3));
        let dir = std::env::temp_dir().join(format!("thetabus-robot-set-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("a directory");
        let set = set.map(str::to_owned);
        let text = as_file([path].iter(), &set, &config, &dir)
            .expect("written")
            .expect("a robot");
        std::fs::write(dir.join("config.toml"), &text).expect("written");
        let again = load(&dir.join("config.toml"), &[]).expect("valid");
        assert_eq!(
            (again.estimator.block_len, again.config_hash()),
            (250, config.config_hash())
        );
        let table: Table = text.parse().expect("TOML");
        assert_eq!(table["identify"]["block_s"].as_float(), Some(0.5));
        assert_eq!(table["simulate"]["motion"].as_str(), Some("rest"));
        std::fs::remove_dir_all(dir).expect("removed");
    }

    #[test]
    fn regress_another_machine_is_warned_of_and_no_key_that_nobody_wrote() {
        let warnings = |config: Config| {
            let all = config.warnings().iter().map(ToString::to_string);
            all.collect::<Vec<_>>()
        };
        let six_axis = Path::new(SIX_AXIS);
        let other = warnings(load(six_axis, &["plant.machine=servo_axis"]).expect("valid"));
        assert_eq!(other.len(), 1, "{other:?}");
        assert!(
            other[0].starts_with("--set plant.machine=servo_axis: plant.machine: simulates a machine"),
            "{other:?}"
        );
        assert!(warnings(load(six_axis, &["plant.machine=model"]).expect("valid")).is_empty());
    }

    #[test]
    fn fault_a_wrong_key_or_a_robots_key_without_a_robot_is_refused_with_what_to_do() {
        let six_axis = Path::new(SIX_AXIS);
        for (set, words) in [
            (
                "identify.block=1",
                "--set identify.block=1: identify.block: unknown key; did you mean identify.block_s?",
            ),
            (
                "identify.block_s=x",
                "--set identify.block_s=x: identify.block_s: expected a number above 0 [s], got \"x\" (a string)",
            ),
            (
                "identify.block_s=-1",
                "identify.block_s: expected a number above 0 [s], got -1 (a whole number)",
            ),
            (
                "identifyer.block_s=1",
                "--set identifyer.block_s=1: identifyer.block_s: unknown key; did you mean identify.block_s?",
            ),
        ] {
            let error = load(six_axis, &[set]).expect_err(set);
            assert!(error.contains(words), "{error}");
        }
        let plain = Path::new(SIX_AXIS).with_file_name("../servo_axis.toml");
        let error = load(&plain, &["identify.block_s=0.5"]).expect_err("no robot");
        assert!(
            error.contains("--set identify.block_s=0.5") && error.contains("a robot's file"),
            "{error}"
        );
    }
}
