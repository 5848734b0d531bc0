//! Estimates and recordings of one model never appear under the names of another.

use crate::support::{Process, Program, SERVO, Site, column};
use std::path::Path;
use std::process::Command;
use thetabus::node::monitor::Label;
use thetabus::recording::{Entry, Recorder, RecordingLimits, RecordingReader, RunInfo, Span};

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// The samples and estimates of a recording with another description.
fn described_as(from: &Path, to: &Path, change: impl FnOnce(&mut RunInfo)) {
    let mut reader = RecordingReader::open(from, Span::default()).expect("a recording");
    let mut info = reader.info().clone();
    change(&mut info);
    let limits = RecordingLimits {
        file_bytes: 0,
        files: 0,
    };
    let mut recorder = Recorder::create(to, info, limits).expect("a new recording");
    while let Some(entry) = reader.next_entry().expect("readable") {
        match entry {
            Entry::Sample { sample, sent_ns } => recorder.sample(sample, sent_ns).expect("written"),
            Entry::Estimate { estimate, sent_ns } => recorder.estimate(estimate, sent_ns).expect("written"),
            _ => {}
        }
    }
    recorder.finish().expect("written");
}

#[test]
fn fault_a_monitor_refuses_the_estimates_of_another_model_and_names_both() {
    let site = Site::new();
    let out = site.out();
    let mut monitor = site.start(Program::Monitor, &["--out", text(&out)]);
    monitor.wait_for_log("monitor");
    let own = site.dir.path().join("own");
    let own_monitor = site.start(Program::Monitor, &["--config", SERVO, "--out", text(&own)]);
    own_monitor.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &["--config", SERVO]);
    site.start(Program::Plant, &["--config", SERVO, "--duration", "6"])
        .expect_code(0);
    monitor.expect_code(2);
    monitor.expect_stderr(&[
        "identifies servo_axis (mass [kg], viscous_friction [N s/m]",
        "names the parameters of manipulator (theta_1 [V s^3/rad]",
        "--config FILE",
    ]);
    // no line, no row, no table under a wrong name
    assert!(!monitor.said().contains("theta_1="), "{}", monitor.said());
    assert_eq!(column(&out.join("estimates.csv"), "theta_1").len(), 0);
    crate::support::eventually("the monitor with the identifier's configuration shows it", || {
        own_monitor.stderr().contains("mass=").then_some(())
    });
}

#[test]
fn fault_a_recording_of_a_foreign_plant_is_refused_unless_a_model_is_named() {
    let site = Site::new();
    site.start_run(&[SERVO, "--duration", "8"]).expect_code(0);
    let recording = site.out().join("recording.mcap");
    let foreign = site.dir.path().join("foreign.mcap");
    described_as(&recording, &foreign, |info| {
        info.model = "pendulum".to_owned();
        info.model_hash ^= 1;
        info.simulated = false;
        info.parameters = vec![Label {
            name: "inertia".to_owned(),
            unit: "kg m^2".to_owned(),
        }];
        info.config_toml = info
            .config_toml
            .replace("kind = \"servo_axis\"", "kind = \"manipulator\"")
            .replace("position_unit = \"m\"", "position_unit = \"rad\"");
    });
    let mut identify = site.start(Program::Thetabus, &["identify", text(&foreign)]);
    identify.expect_code(2);
    identify.expect_stderr(&[
        "the recording is of pendulum (inertia [kg m^2])",
        "the program that has them",
        "--set model.kind=",
    ]);
    assert_eq!(identify.stdout(), "");
    // whoever names a model means it
    let named = [
        "identify",
        text(&foreign),
        "--set",
        "model.kind=\"servo_axis\"",
        "--set",
        "log.position_unit=\"m\"",
    ];
    let mut identify = site.start(Program::Thetabus, &named);
    identify.expect_code(0);
    identify.expect_stderr(&["it is identified as servo_axis (mass [kg]"]);
    assert!(identify.stdout().contains("mass"), "{}", identify.said());

    // The estimates are the servo axis's, the description is not: a report has no names for them.
    let mut report = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    report.args(["report", text(&foreign)]);
    let mut report = Process::start(report);
    report.expect_code(2);
    report.expect_stderr(&["the recording describes pendulum", "estimates of another model"]);
}
