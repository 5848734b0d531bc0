//! What the tools for recordings make of a robot: its configuration comes from the recording's
//! directory, from the command line, or from both.

use crate::support::{Process, Program, Site};
use std::fs;
use std::path::Path;
use std::process::Command;

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");

/// Six seconds of the simulated robot, in `site.out()`.
fn run(site: &Site) -> String {
    let out = site.out().to_str().expect("UTF-8").to_owned();
    let args = ["run", CONFIG, "--speed", "max", "--duration", "6", "--out", &out];
    site.start(Program::Thetabus, &args).expect_code(0);
    out
}

/// The recording holds the robot that the command line names once more.
#[test]
fn regress_a_robots_recording_is_read_with_its_own_configuration_on_the_command_line() {
    let site = Site::new();
    let out = run(&site);
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let recording = site.out().join("recording.mcap").to_str().expect("UTF-8").to_owned();
    let urdf = |name: &str, input: &str, more: &[&str]| {
        let args = ["urdf", input, "--out", &at(name)];
        site.start(Program::Thetabus, &[&args[..], more].concat())
            .expect_code(0);
        // The header names the input.
        let text = fs::read_to_string(at(name)).expect("a URDF");
        text.lines()
            .filter(|line| !line.contains("blocks,"))
            .collect::<String>()
    };
    let expected = urdf("dir.urdf", &out, &[]);
    assert_eq!(expected, urdf("dir_config.urdf", &out, &["--config", CONFIG]));
    assert_eq!(expected, urdf("file.urdf", &recording, &[]));
    assert_eq!(expected, urdf("file_config.urdf", &recording, &["--config", CONFIG]));

    for (name, input) in [("again", &out), ("again_file", &recording)] {
        let args = ["identify", input, "--config", CONFIG, "--out", &at(name)];
        site.start(Program::Thetabus, &args).expect_code(0);
        let [live, again] =
            [&out, &at(name)].map(|dir| fs::read_to_string(Path::new(dir).join("estimates.csv")).expect("estimates"));
        assert_eq!(live, again);
    }
}

/// Its model stands in the directory of the recording only.
#[test]
fn regress_a_robots_recording_is_replayed() {
    let site = Site::new();
    let out = run(&site);
    let config = site.out().join("config.toml").to_str().expect("UTF-8").to_owned();
    let _identifier = site.start(Program::Identifier, &["--config", &config]);
    let mut replay = site.start(Program::Thetabus, &["replay", &out]);
    replay.expect_code(0);
    assert!(replay.stdout().contains("6000 samples replayed"), "{}", replay.stdout());
}

/// A robot's state takes more entries of the journal than its readers hold at once.
#[test]
fn regress_a_robots_warm_start_is_recorded_whole_and_repeated_to_the_bit() {
    let site = Site::new();
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    for (out, more) in [(at("cold"), &[][..]), (at("warm"), &["--warm"])] {
        let args = [
            "run",
            CONFIG,
            "--speed",
            "max",
            "--duration",
            "6",
            "--set",
            &dir,
            "--out",
            &out,
        ];
        let args = [&args[..], more].concat();
        site.start(Program::Thetabus, &args).expect_code(0);
    }
    let state = fs::metadata(at("arm.checkpoint")).expect("a checkpoint").len();
    assert!(state > 64 * 1024, "{state}");
    let args = ["identify", &at("warm"), "--out", &at("again")];
    site.start(Program::Thetabus, &args).expect_code(0);
    let [live, again] =
        ["warm", "again"].map(|dir| fs::read_to_string(Path::new(&at(dir)).join("estimates.csv")).expect("estimates"));
    assert_eq!(live, again);
}

/// The file on the command line holds, not the recording's: blocks of three seconds are two.
#[test]
fn regress_a_robots_file_on_the_command_line_replaces_the_recorded_one() {
    let site = Site::new();
    let out = run(&site);
    let args = [
        "--config",
        CONFIG,
        "--set",
        "identify.block_s=3",
        "--set",
        "identify.payload=false",
    ];
    let mut identify = site.start(Program::Thetabus, &[&["identify", &out][..], &args].concat());
    identify.expect_code(0);
    let said = identify.stdout();
    assert!(said.contains("\n2 blocks,"), "{said}");
    assert!(!said.contains("payload_m"), "{said}");
}

#[test]
fn fault_a_recording_without_its_configuration_says_what_the_urdf_needs() {
    let site = Site::new();
    let out = run(&site);
    let alone = site.dir.path().join("alone");
    fs::create_dir(&alone).expect("created");
    fs::copy(Path::new(&out).join("recording.mcap"), alone.join("recording.mcap")).expect("copied");
    let alone = alone.join("recording.mcap").to_str().expect("UTF-8").to_owned();
    let new = site.dir.path().join("new.urdf").to_str().expect("UTF-8").to_owned();
    let mut refused = site.start(Program::Thetabus, &["urdf", &alone, "--out", &new]);
    refused.expect_code(2);
    let said = refused.stderr();
    assert!(
        said.contains("expected the configuration of the run beside its recording") && said.contains("--config"),
        "{said}"
    );
    let mut written = site.start(Program::Thetabus, &["urdf", &alone, "--config", CONFIG, "--out", &new]);
    written.expect_code(0);
    assert!(!written.stderr().contains("WARN"), "{}", written.stderr());
}

/// Samples of a robot hold no velocities, so that the columns of these are empty in an export.
#[test]
fn regress_an_export_and_a_log_without_velocities_are_identified() {
    let site = Site::new();
    let out = run(&site);
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let mut export = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    export.args(["export", &out, "--out", &at("export.csv")]);
    Process::start(export).expect_code(0);
    let export = fs::read_to_string(at("export.csv")).expect("an export");
    // The same samples as a log of one's own: t, q, input; behind them, as other loggers have it,
    // a column of zeros.
    let mut log = String::new();
    let mut wide = String::new();
    for line in export.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let nanoseconds: f64 = cells[1].parse().expect("a number");
        let line = format!(
            "{:e},{},{}",
            nanoseconds * 1e-9,
            cells[4..10].join(","),
            cells[34..40].join(",")
        );
        log += &format!("{line}\n");
        wide += &format!("{line},0\n");
    }
    fs::write(at("log.csv"), log).expect("written");
    fs::write(at("wide.csv"), wide).expect("written");
    let set = ["--set", "log.velocity_columns=[]"];
    let [export, log, wide] = [("export.csv", &[][..]), ("log.csv", &[]), ("wide.csv", &set)].map(|(name, set)| {
        let args = ["identify", &at(name), "--config", CONFIG, "--format", "json"];
        let mut identify = site.start(Program::Thetabus, &[&args[..], set].concat());
        identify.expect_code(0);
        let said = identify.stderr();
        assert!(
            said.contains("no velocities: they are formed from the positions over 0.02 s to either side"),
            "{said}"
        );
        assert!(!said.contains("WARN"), "{said}");
        identify.stdout()
    });
    assert_eq!(log, wide);
    let parameters = |text: &str| -> Vec<[f64; 2]> {
        let summary: serde_json::Value = serde_json::from_str(text).expect("JSON");
        let all = summary["parameters"].as_array().expect("a list");
        let number = |p: &serde_json::Value, key: &str| p[key].as_f64().expect("a number");
        all.iter().map(|p| [number(p, "estimate"), number(p, "std")]).collect()
    };
    // Times of the log are those of the export up to a rounding.
    for (export, log) in parameters(&export).into_iter().zip(parameters(&log)) {
        assert!((export[0] - log[0]).abs() < 1e-3 * export[1], "{export:?} {log:?}");
    }
    let mut short = site.start(Program::Thetabus, &["identify", &at("wide.csv"), "--config", CONFIG]);
    short.expect_code(2);
    assert!(
        short
            .stderr()
            .contains("expected at least 19 columns, got 14; a log without velocities"),
        "{}",
        short.stderr()
    );
}

/// Tools that take a robot's file take `--set`, too.
#[test]
fn e2e_keys_are_overridden_in_the_tools_for_motions() {
    let site = Site::new();
    let motion = site.dir.path().join("motion.csv").to_str().expect("UTF-8").to_owned();
    let run = |args: &[&str], code: i32| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
        command.args(args);
        let mut tool = Process::start(command);
        tool.expect_code(code);
        (tool.stdout(), tool.stderr())
    };
    let set = [
        "--set",
        "excite.tries=10",
        "--set",
        "excite.duration_s=8.0",
        "--set",
        "plant.sample_period_s=0.004",
    ];
    let excite = ["excite", CONFIG, "--out", &motion];
    let (said, _) = run(&[&excite[..], &set[..]].concat(), 0);
    assert!(said.contains("every 0.004 s"), "{said}");
    let text = fs::read_to_string(&motion).expect("a motion");
    assert_eq!(text.lines().count(), 802);

    let check = ["config", "check", CONFIG, "--motion", &motion];
    let (as_it_is, _) = run(&check, 0);
    assert!(as_it_is.contains("every 0.001 s"), "{as_it_is}");
    // Nothing counts as determined whose standard deviation exceeds its size.
    let (_, roughly) = as_it_is.split_once("no better than to their own size ").expect("some");
    let roughly: Vec<&str> = roughly.lines().next().expect("names").split(", ").collect();
    let percent = |line: &str| -> Option<f64> { line.split_whitespace().nth(3)?.parse().ok() };
    let exceed = as_it_is
        .lines()
        .filter(|line| percent(line).is_some_and(|percent| percent >= 100.0));
    let exceed: Vec<&str> = exceed.filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(exceed, roughly);
    let noise = [
        "--set",
        "simulate.torque_noise=0.02",
        "--set",
        "plant.sample_period_s=0.004",
    ];
    let (noisy, _) = run(&[&check[..], &noise[..]].concat(), 0);
    assert!(
        noisy.contains("torque noise of 2 %") && noisy.contains("every 0.004 s"),
        "{noisy}"
    );

    let wrong = ["--set", "excite.trise=10"];
    let (_, error) = run(&[&["excite", CONFIG], &wrong[..]].concat(), 2);
    assert!(error.contains("did you mean excite.tries?"), "{error}");
    let calibrate = ["calibrate", &motion, &motion, "--config", CONFIG, "--mass", "1"];
    let (_, error) = run(&[&calibrate[..], &["--set", "drive.gain=[1.0]"]].concat(), 2);
    assert!(error.contains("--set drive.gain=[1.0]"), "{error}");
}

/// A file without numbers is reported as no log, not as a log that is too short.
#[test]
fn fault_a_file_without_numbers_is_no_log() {
    let site = Site::new();
    let path = site.dir.path().join("notes.csv");
    let path = path.to_str().expect("UTF-8");
    for (text, words) in [
        ("", "expected rows of numbers, got none"),
        (
            "time,joint_1\nto be measured,tomorrow\n",
            "expected rows of numbers, got none",
        ),
        (
            &("0.0".to_owned() + &",1".repeat(18)),
            "expected at least 3 samples, got 1",
        ),
    ] {
        fs::write(path, text).expect("written");
        let mut identify = site.start(Program::Thetabus, &["identify", path, "--config", CONFIG]);
        identify.expect_code(2);
        assert!(identify.stderr().contains(words), "{}", identify.stderr());
    }
}
