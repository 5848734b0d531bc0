//! Wrong usage and configuration: exit code 2, and how to correct it.

use crate::support::{Process, Program, Site};
use std::process::Command;

#[test]
fn fault_a_bad_configuration_gives_2_and_the_keys_name_in_each_program() {
    let site = Site::new();
    let file = site.dir.path().join("bad.toml");
    std::fs::write(&file, "[estimator]\nforgetting_factor = 1.5\nblock_lenght = 3\n").expect("write");
    let file = file.to_str().expect("UTF-8");
    for (program, args) in [
        (Program::Plant, vec!["--config", file]),
        (Program::Identifier, vec!["--config", file]),
        (Program::Monitor, vec!["--config", file]),
        (Program::Thetabus, vec!["run", file]),
    ] {
        let mut process = site.start(program, &args);
        process.expect_code(2);
        process.expect_stderr(&[
            "bad.toml:2",
            "estimator.forgetting_factor",
            "1.5",
            "bad.toml:3",
            "block_lenght",
        ]);
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.args(["config", "check", file]);
    let mut check = Process::start(command);
    check.expect_code(2);
    check.expect_stderr(&["bad.toml:2", "estimator.forgetting_factor"]);
}

#[test]
fn e2e_config_check_accepts_what_run_has_written() {
    let site = Site::new();
    site.start_run(&["--duration", "1"]).expect_code(0);
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.args(["config", "check"]).arg(site.out().join("config.toml"));
    let mut check = Process::start(command);
    check.expect_code(0);
    assert!(check.stdout().contains("ok"), "{}", check.said());
}

#[test]
fn fault_a_robot_that_gives_no_rows_is_told_why() {
    const ROBOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.args(["config", "check", ROBOT, "--set", "plant.sample_period_s=0.1"]);
    let mut check = Process::start(command);
    check.expect_code(2);
    check.expect_stderr(&["samples come every 0.100 s, rows bridge 0.050 s: expected window_s 1.000"]);

    let site = Site::new();
    let out = site.out();
    let out = out.to_str().expect("UTF-8");
    let quick = ["--set", "simulate.motion=\"rest\"", "--speed", "max", "--duration", "3"];
    let args = [&["run", ROBOT, "--out", out][..], &quick].concat();
    let mut run = site.start(Program::Thetabus, &args);
    run.expect_code(0);
    let table = run.stdout();
    assert!(
        table.contains("no estimate: no joint has moved for long enough"),
        "{table}"
    );
}

#[test]
fn fault_a_warm_run_without_checkpoints_is_refused_before_anything_starts() {
    let site = Site::new();
    let mut run = site.start_run(&["--warm"]);
    run.expect_code(2);
    run.expect_stderr(&["--warm needs checkpoint.dir"]);
    assert!(!site.out().exists());
}

#[test]
fn fault_wrong_usage_gives_2_and_names_the_argument() {
    let site = Site::new();
    for (program, args, part) in [
        (Program::Plant, &["--sped", "1"][..], "--sped"),
        (Program::Plant, &["--speed", "fast"], "plant.speed"),
        (Program::Plant, &["--speed", "-1"], "plant.speed"),
        (Program::Plant, &["--duration", "nan"], "plant.duration_s"),
        (Program::Plant, &["--seed", "x"], "plant.seed"),
        (Program::Identifier, &["--robot", "Big Arm"], "bus.robot"),
        (Program::Identifier, &["--config", "absent.toml"], "absent.toml"),
        (
            Program::Monitor,
            &["--set", "estimator.block_len"],
            "estimator.block_len",
        ),
        (Program::Thetabus, &["run", "absent.toml"], "absent.toml"),
        (Program::Thetabus, &["run", "--set", "nonsense.key=1"], "nonsense"),
    ] {
        let mut process = site.start(program, args);
        process.expect_code(2);
        process.expect_stderr(&[part]);
    }
    for args in [&["dance"][..], &[], &["config"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
        command.args(args);
        Process::start(command).expect_code(2);
    }
    // A domain is part of the command line: said twice, or badly, is wrong usage as well.
    let mut command = Command::new(env!("CARGO_BIN_EXE_identifier"));
    command.args(["--domain", "No Domain"]);
    let mut process = Process::start(command);
    process.expect_code(2);
    process.expect_stderr(&["domain"]);
}

#[test]
fn e2e_help_lists_the_exit_codes_and_version_names_schema_and_iceoryx2() {
    for program in [
        env!("CARGO_BIN_EXE_thetabus"),
        env!("CARGO_BIN_EXE_plant_simulator"),
        env!("CARGO_BIN_EXE_identifier"),
        env!("CARGO_BIN_EXE_monitor"),
    ] {
        let output = |arg: &str| {
            let output = Command::new(program).arg(arg).output().expect("it runs");
            assert!(output.status.success());
            String::from_utf8(output.stdout).expect("UTF-8")
        };
        let help = output("--help");
        for part in ["Exit codes", "130", "data were lost"] {
            assert!(help.contains(part), "{part:?} is not in\n{help}");
        }
        let version = output("--version");
        for part in [env!("CARGO_PKG_VERSION"), "schema 3", "iceoryx2 0.10.0"] {
            assert!(version.contains(part), "{part:?} is not in {version}");
        }
    }
    let output = Command::new(env!("CARGO_BIN_EXE_thetabus"))
        .args(["run", "--help"])
        .output()
        .expect("it runs");
    let help = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(help.contains("Exit codes") && !help.contains("launched-by"), "{help}");
}

#[test]
fn e2e_a_configuration_that_is_built_in_can_be_shown_and_begun_with() {
    let site = Site::new();
    let thetabus = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
        command.current_dir(site.dir.path()).args(args);
        Process::start(command)
    };
    let mut names = thetabus(&["config", "show"]);
    names.expect_code(0);
    assert!(
        names.stdout().lines().any(|name| name == "servo_axis"),
        "{}",
        names.said()
    );
    thetabus(&["config", "new", "mine.toml", "--from", "servo_axis"]).expect_code(0);
    let written = std::fs::read_to_string(site.dir.path().join("mine.toml")).expect("written");
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml");
    assert_eq!(written, std::fs::read_to_string(shipped).expect("shipped"));
    thetabus(&["config", "check", "mine.toml"]).expect_code(0);
    let mut again = thetabus(&["config", "new", "mine.toml"]);
    again.expect_code(2);
    again.expect_stderr(&["mine.toml", "exists"]);
    let mut unknown = thetabus(&["config", "show", "servo"]);
    unknown.expect_code(2);
    unknown.expect_stderr(&["servo_axis", "\"servo\""]);
    for (args, part) in [(&["completions", "bash"][..], "_thetabus"), (&["man"], ".TH thetabus")] {
        let mut page = thetabus(args);
        page.expect_code(0);
        assert!(page.stdout().contains(part), "{}", page.said());
    }
}

/// A robot's configuration is nothing without its URDF.
#[test]
fn e2e_a_robots_configuration_is_begun_with_its_urdf() {
    let site = Site::new();
    let thetabus = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
        command.current_dir(site.dir.path()).args(args);
        Process::start(command)
    };
    let mut names = thetabus(&["config", "show"]);
    names.expect_code(0);
    assert!(
        names.stdout().lines().any(|name| name == "six_axis"),
        "{}",
        names.said()
    );
    let mut new = thetabus(&["config", "new", "robot.toml", "--from", "six_axis"]);
    new.expect_code(0);
    assert!(
        new.stdout().contains("robot.toml: written") && new.stdout().contains("six_axis.urdf: written"),
        "{}",
        new.said()
    );
    thetabus(&["config", "check", "robot.toml"]).expect_code(0);
    // The same URDF may stay, another one is not written over, and then nothing is written.
    thetabus(&["config", "new", "second.toml", "--from", "six_axis"]).expect_code(0);
    std::fs::write(site.dir.path().join("six_axis.urdf"), "<robot/>").expect("written");
    let mut refused = thetabus(&["config", "new", "third.toml", "--from", "six_axis"]);
    refused.expect_code(2);
    refused.expect_stderr(&["six_axis.urdf exists and is not written over"]);
    assert!(!site.dir.path().join("third.toml").exists());
}
