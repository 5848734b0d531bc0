//! The file of a robot: it is read like any other configuration.

use super::{SIX_AXIS, robot};
use crate::support::{edited, edits};
use proptest::prelude::*;
use std::path::Path;
use thetabus::config::RobotConfig;
use thetabus::robot::{
    Drives, ExcitationOptions, IdentifyOptions, JointFriction, JointRange, LogColumns, MotionLimits, RobotSimOptions,
    WindowOptions,
};

/// A file beside the URDF of six axes.
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/mine.toml");

fn read(sections: &str, set: &[&str]) -> Result<RobotConfig, String> {
    let text = format!("[model]\nkind = \"robot\"\nurdf = \"six_axis.urdf\"\n{sections}");
    let set: Vec<String> = set.iter().map(|one| (*one).to_owned()).collect();
    RobotConfig::parse_with(&text, Path::new(FILE), &set).map_err(|e| e.to_string())
}

/// The tables of the keys state the defaults of a simulated robot once more.
#[test]
fn prop_defaults_are_those_of_the_core_types() {
    let config = read("", &[]).unwrap();
    let robot = robot(SIX_AXIS);
    assert_eq!(config.model.friction(), vec![JointFriction::default(); 6]);
    assert_eq!(config.columns, LogColumns::in_order(6, true));
    assert_eq!(config.drives, Drives::torque(6));
    let identify = IdentifyOptions {
        windows: WindowOptions::for_period(0.001),
        lengthens: true,
        formed_over_s: Some(0.02),
        ..IdentifyOptions::default()
    };
    assert_eq!(config.options, identify);
    let simulation = RobotSimOptions {
        difference: 0.15,
        ..RobotSimOptions::new(&robot)
    };
    assert_eq!(config.simulation, simulation);
    let limits = MotionLimits::default();
    let ranges = JointRange::of(&robot, limits.part, limits.reach, limits.acceleration);
    assert_eq!(config.excitation, ExcitationOptions::new(ranges));
    assert!(config.payload && !config.names_columns && !config.is_stated("plant"));
}

#[test]
fn fault_all_errors_of_a_robots_file_are_told_at_once() {
    let sections = r#"tips = "flange"
[drive]
gain = [1.0, 2.0]
[friction]
terms = ["viscous", "coulom"]
[identify]
window_s = 0
velocity = "measurd"
[simulate]
viscous = [1.0]
[[simulate.payload]]
t_s = 5.0
mass_kg = 3.0
center_m = [0.0, 0.1]
[plant]
duration = 3.0
sample_period_s = "fast"
[log]
velocity_columns = [1, 2]
[excite]
lower = [-100, 0, 0, 0, 0, 0]
"#;
    let error = read(sections, &["simulate.motion=rst", "identify.blok_s=1"]).unwrap_err();
    for said in [
        "mine.toml:4: model.tips: unknown key; did you mean model.tip?",
        "mine.toml:6: drive.gain: expected 6 finite numbers other than 0, one per joint, got [1.0, 2.0]",
        "mine.toml:8: friction.terms: expected a list of words among \"viscous\", ",
        "got [\"viscous\", \"coulom\"] (a list of 2); did you mean \"coulomb\"?",
        "mine.toml:10: identify.window_s: expected a number above 0 [s], got 0 (a whole number)",
        "mine.toml:11: identify.velocity: expected one of \"measured\" or \"differentiated\", got \"measurd\" (a string); did you mean",
        "mine.toml:13: simulate.viscous: expected 6 numbers, one per joint, got 1",
        "mine.toml:17: simulate.payload[1].center_m: expected a list of 3 numbers of any size [m], got [0.0, 0.1] (a list of 2)",
        "mine.toml:19: plant.duration: unknown key; did you mean plant.duration_s?",
        "mine.toml:20: plant.sample_period_s: expected a number from 1e-5 to 1 [s], got \"fast\" (a string)",
        "mine.toml:22: log.velocity_columns: expected 6 columns",
        "mine.toml:24: excite.lower: joint \"joint_1\": expected -2.88 to 2.88 as the URDF says, got -100",
        "--set simulate.motion=rst: simulate.motion: expected one of \"rest\", \"fourier\" or \"moves\", got \"rst\" (a string); did you mean",
        "--set identify.blok_s=1: identify.blok_s: unknown key; did you mean identify.block_s?",
    ] {
        assert!(error.contains(said), "{said}\n{error}");
    }
    assert_eq!(error.lines().count(), 13, "{error}");
}

#[test]
fn fault_what_single_keys_do_not_show_is_told_by_its_key() {
    for (sections, said) in [
        (
            "[friction]\nterms = [\"load\", \"load\"]\n",
            "mine.toml:5: friction.terms: expected each term once, got \"load\" twice",
        ),
        (
            "[log]\nvelocity_columns = [8, 9, 10, 11, 12, 13]\ninput_columns = [8, 15, 16, 17, 18, 19]\n",
            "log.input_columns: expected a column of its own for time and for each signal, got column 8 twice",
        ),
        (
            "[identify]\nwindow_s = 0.5\nstride_s = 0.001\n",
            "mine.toml:6: identify.stride_s: expected a stride of at least 0.0161 s",
        ),
        (
            "[identify]\nwindow_s = 1e-9\n",
            "mine.toml:5: identify.window_s: expected a stride of at least 0.0001 s and 1/31 of the window, got 0.0000000002 s",
        ),
        (
            "[identify]\nblock_s = 1e15\n",
            "mine.toml:5: identify.block_s: expected 0.0001 to 1000 s, 50000 strides of the windows, got",
        ),
        (
            "[identify]\nblock_s = 1e-9\n",
            "mine.toml:5: identify.block_s: expected 0.0001 to 1000 s",
        ),
        (
            "[drive]\ncoupling = [[1.0]]\n",
            "mine.toml:5: drive.coupling: expected 6 rows of 6 finite numbers, got [[1.0]]",
        ),
        (
            "[simulate]\npayload = [{ t_s = 2, mass_kg = 1 }, { t_s = 1, mass_kg = 0 }]\n",
            "mine.toml:5: simulate.payload: expected rising times, got 1 s",
        ),
        (
            "[simulate]\nmotion_csv = \"none.csv\"\n",
            "none.csv: cannot be opened: No such file",
        ),
        (
            "[excite]\nlower = [0.5, 0, 0, 0, 0, 0]\nupper = [0.5, 1, 1, 1, 1, 1]\n",
            "mine.toml:5: excite.lower: joint \"joint_1\": expected lower below upper, got 0.5 and 0.5",
        ),
        (
            "[log]\ntime_column = 0\n",
            "log.time_column: expected a whole number of at least 1, got 0",
        ),
    ] {
        let error = read(sections, &[]).unwrap_err();
        assert!(error.contains(said) && error.lines().count() == 1, "{said}\n{error}");
    }
}

#[test]
fn fault_a_file_that_is_not_a_robots_or_lacks_its_urdf_is_told_in_one_line() {
    for (text, said) in [
        (
            "[model]\nkind = \"servo_axis\"\n[identifier]\nrows = \"projected\"\n",
            "mine.toml:2: model.kind: expected \"robot\", got \"servo_axis\" (a string)",
        ),
        (
            "[plant]\nseed = 3\n",
            "mine.toml: model.kind: expected \"robot\", got none",
        ),
        (
            "[model]\nkind = \"robot\"\n",
            "mine.toml:2: model.urdf: expected the path of a URDF as a string, got none",
        ),
        ("[model\n", "mine.toml:1: not valid TOML: unclosed table"),
        (
            "[model]\nkind = \"robot\"\nurdf = \"none.urdf\"\n",
            "mine.toml:3: model.urdf: expected a URDF that can be read, got ",
        ),
    ] {
        let error = RobotConfig::parse(text, Path::new(FILE)).unwrap_err().to_string();
        assert!(error.contains(said) && error.lines().count() == 1, "{said}\n{error}");
    }
}

/// The last one wins, and a word needs no quotes.
#[test]
fn regress_arguments_are_laid_over_the_file() {
    let set = [
        "identify.block_s = 0.5",
        "simulate.encoder_bits=13",
        "identify.block_s=2",
    ];
    let config = read("[identify]\nblock_s = 1.5\n", &set).unwrap();
    assert_eq!((config.options.block_s, config.simulation.encoder_bits), (2.0, 13));
    let set = [
        "identify.velocity=measured",
        "drive.gain=[1, 2.5, 1, 1, 1, 1]",
        "plant.seed=3",
    ];
    let config = read("", &set).unwrap();
    assert_eq!((config.velocity_s, config.drives.gain[1]), (None, 2.5));
    let error = read("", &["drive.gain=[1,"]).unwrap_err();
    assert!(
        error.contains("--set drive.gain=[1,: drive.gain: expected a list of numbers") && error.contains("not TOML"),
        "{error}"
    );
}

/// The shipped file with the keys that it shows in comments.
fn shipped() -> String {
    let key = |line: &'static str| {
        let key = line.strip_prefix("# ")?;
        (key.contains(" = ") && !key.contains("…]") && !key.starts_with("motion_csv")).then_some(key)
    };
    let lines = include_str!("../../../config/robots/six_axis.toml").lines();
    lines.map(|line| format!("{}\n", key(line).unwrap_or(line))).collect()
}

#[test]
fn regress_the_commented_keys_of_the_shipped_file_are_right() {
    let config = RobotConfig::parse(&shipped(), Path::new(FILE)).unwrap();
    assert!(config.is_stated("excite.tries") && config.is_stated("log.input_columns"));
}

proptest! {
    // A file that is still right costs a model of six axes.
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    /// The shipped file with bytes changed: a model, or errors that name this file, its URDF or its
    /// motion, and the key.
    #[test]
    fn fault_corrupt_files_of_robots_never_panic(edits in edits()) {
        if let Err(error) = RobotConfig::parse(&edited(&shipped(), &edits), Path::new(FILE)) {
            for problem in error.problems {
                let said = problem.to_string();
                prop_assert!(said.contains("/config/robots/"), "{}", said);
                prop_assert!(said.contains("mine.toml:") || !problem.key.is_empty(), "{}", said);
            }
        }
    }
}
