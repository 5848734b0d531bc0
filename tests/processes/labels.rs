//! Estimates and recordings of one model never appear under the names of another.

use crate::support::{Process, Program, SERVO, Site, column, text};
use nix::sys::signal::Signal;
use std::path::Path;
use std::process::Command;
use thetabus::bus::{Bus, Subscriber};
use thetabus::config::{Config, Source};
use thetabus::messages::Description;
use thetabus::node::monitor::Label;
use thetabus::recording::{Entry, Recorder, RecordingLimits, RecordingReader, RunInfo, Span};

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
fn e2e_a_monitor_takes_the_names_of_another_model_from_the_identifier() {
    let site = Site::new();
    let out = site.out();
    // both have the arm's names in their configuration; one is there before the identifier, the
    // other comes late
    let mut first = site.start(Program::Monitor, &["--out", text(&out)]);
    first.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &["--config", SERVO]);
    site.start(Program::Plant, &["--config", SERVO, "--duration", "6"])
        .expect_code(0);
    let late = site.start(Program::Monitor, &[]);
    for monitor in [&first, &late] {
        monitor.expect_stderr(&[
            "identifies servo_axis (mass [kg], viscous_friction [N s/m]",
            "names the parameters of manipulator (theta_1 [V s^3/rad]",
            "  mass=",
        ]);
        // no line under a wrong name
        assert!(!monitor.said().contains("theta_1="), "{}", monitor.said());
    }
    first.signal(Signal::SIGTERM);
    first.expect_code(0);
    // nor a row or a table
    assert!(!column(&out.join("estimates.csv"), "mass").is_empty());
    let summary = site.summary();
    assert_eq!((&*summary.model, &*summary.parameters[0].name), ("servo_axis", "mass"));
}

#[test]
fn fault_a_recorder_with_the_configuration_of_another_model_refuses_and_names_both() {
    let site = Site::new();
    let recording = site.dir.path().join("wrong.mcap");
    let mut recorder = site.start(Program::Monitor, &["--record", text(&recording)]);
    recorder.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &["--config", SERVO]);
    recorder.expect_code(2);
    recorder.expect_stderr(&[
        "identifies servo_axis (mass [kg], viscous_friction [N s/m]",
        "names the parameters of manipulator (theta_1 [V s^3/rad]",
        "--config FILE",
    ]);
}

#[test]
fn e2e_an_identifier_describes_its_model_to_whoever_comes() {
    let site = Site::new();
    let _identifier = site.start(Program::Identifier, &["--config", SERVO]);
    let bus = Bus::join(&site.domain, "arm", "reader").expect("join");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribe");
    let description = crate::support::eventually("a description", || {
        let mut found = None;
        descriptions.drain(|d| found = Some(*d)).expect("drain");
        found
    });
    let config = Config::load(&[Source::File(SERVO.into())], &[]).expect("valid");
    assert_eq!(description.model(), "servo_axis");
    assert_eq!(description.config_hash, config.config_hash());
    assert_eq!(description.model_hash, config.model.definition().hash());
    assert_eq!(description.block_len, config.estimator.block_len as u64);
    assert_eq!(description.sample_period_ns, 1_000_000);
    assert_eq!(
        (
            description.input_kind(),
            description.joints().len(),
            description.equations
        ),
        ("voltage", 1, 1)
    );
    let joint = description.joints()[0];
    assert_eq!(
        (joint.name(), joint.position_unit(), joint.input_unit()),
        ("joint_1", "m", "V")
    );
    let mass = description.parameters()[0];
    assert_eq!(
        (mass.name(), mass.unit(), mass.lower, mass.upper),
        ("mass", "kg", 0.0, f64::INFINITY)
    );
    assert!(
        !mass.meaning().is_empty() && mass.start > 0.0,
        "{} {}",
        mass.meaning(),
        mass.start
    );
    assert_eq!(description.parameters().len(), config.model.parameters().len());
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
