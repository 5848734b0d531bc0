//! `thetabus identify LOG.csv` for a robot from its URDF.

use crate::support::{Program, Site};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use thetabus::robot::{Robot, Selection, inverse_dynamics};

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");

/// Twenty seconds at 100 Hz of the six-axis arm without friction; `shift` makes another motion.
fn log(shift: f64) -> String {
    let path = Path::new(CONFIG).with_file_name("six_axis.urdf");
    let robot = Robot::from_file(&path, &Selection::default()).expect("a sound URDF");
    let mut text = String::new();
    for k in 0..2000 {
        let t = 0.01 * f64::from(k);
        let mut state = [[0.0; 6]; 3];
        for i in 0..6 {
            for h in 1..=3 {
                let w = f64::from(h) * (0.9 + 0.17 * i as f64);
                let (sin, cos) = (w * t + shift + f64::from(h) * 1.3 + 2.1 * i as f64).sin_cos();
                state[0][i] += 0.4 * sin;
                state[1][i] += 0.4 * w * cos;
                state[2][i] -= 0.4 * w * w * sin;
            }
        }
        let mut tau = [0.0; 6];
        inverse_dynamics(&robot, &robot.bodies, &state[0], &state[1], &state[2], &mut tau);
        let _ = write!(text, "{t}");
        for x in state[0].iter().chain(&state[1]).chain(&tau) {
            let _ = write!(text, ",{x}");
        }
        text.push('\n');
    }
    text
}

#[test]
fn e2e_a_robot_is_identified_from_its_urdf_and_a_log() {
    let site = Site::new();
    let [train, other] = [("train.csv", 0.0), ("other.csv", 0.7)].map(|(name, shift)| {
        let path = site.dir.path().join(name);
        fs::write(&path, log(shift)).expect("written");
        path.to_str().expect("UTF-8").to_owned()
    });
    let out = site.out();
    let out_dir = out.to_str().expect("UTF-8");
    let args = [
        "identify",
        &train,
        "--config",
        CONFIG,
        "--validate",
        &other,
        "--out",
        out_dir,
    ];
    let mut identify = site.start(Program::Thetabus, &args);
    identify.expect_code(0);
    let said = identify.stdout();
    assert!(said.contains("held out [%]") && said.contains("joint_6"), "{said}");
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("summary.json")).expect("a summary")).expect("JSON");
    // The first moment of the upper arm with what it carries: its nominal value is the truth here.
    let parameters = summary["parameters"].as_array().expect("a list");
    let hz2 = parameters.iter().find(|p| p["name"] == "hz2").expect("hz2");
    let [estimate, truth] = ["estimate", "urdf"].map(|key| hz2[key].as_f64().expect("a number"));
    assert!((estimate / truth - 1.0).abs() < 0.01, "{hz2}");
    for joint in summary["joints"].as_array().expect("a list") {
        assert!(joint["validation_percent"].as_f64().expect("a number") < 2.0, "{joint}");
    }
    let lines = fs::read_to_string(out.join("estimates.csv"))
        .expect("estimates")
        .lines()
        .count();
    assert!((19..=22).contains(&lines), "{lines}");
}

#[test]
fn e2e_a_robot_with_a_wrong_file_is_refused_by_its_place() {
    let site = Site::new();
    let dir = site.dir.path();
    let at = |name: &str| dir.join(name).to_str().expect("UTF-8").to_owned();
    fs::write(at("log.csv"), log(0.0)).expect("written");
    fs::write(at("short.csv"), "0,1,2\n").expect("written");
    let urdf = fs::read_to_string(Path::new(CONFIG).with_file_name("six_axis.urdf")).expect("a URDF");
    fs::write(at("arm.urdf"), &urdf).expect("written");
    fs::write(
        at("broken.urdf"),
        urdf.replacen("mass value=\"3.9\"", "mass value=\"0\"", 1),
    )
    .expect("written");
    let model = |urdf: &str| format!("[model]\nkind = \"robot\"\nurdf = \"{urdf}\"\n");
    for (config, log, message) in [
        (model("broken.urdf"), "log.csv", "broken.urdf:"),
        (
            model("missing.urdf"),
            "log.csv",
            "missing.urdf: the file: expected a URDF that can be read",
        ),
        (
            model("arm.urdf") + "tips = 3\n",
            "log.csv",
            "robot.toml:4: unknown field `tips`",
        ),
        (
            model("arm.urdf") + "[drive]\ngain = [1.0]\n",
            "log.csv",
            "drive: gain: expected 6 finite numbers",
        ),
        (
            model("arm.urdf") + "[friction]\nterms = [\"dry\"]\n",
            "log.csv",
            "got \"dry\"",
        ),
        (
            model("arm.urdf") + "[identify]\nwindow_s = 0\n",
            "log.csv",
            "window length: expected a time above 0",
        ),
        (
            model("arm.urdf"),
            "short.csv",
            "short.csv: line 1: expected at least 19 columns, got 3",
        ),
        (model("arm.urdf"), "none.csv", "none.csv: "),
    ] {
        fs::write(at("robot.toml"), &config).expect("written");
        let mut identify = site.start(
            Program::Thetabus,
            &["identify", &at(log), "--config", &at("robot.toml")],
        );
        identify.expect_code(2);
        let said = identify.stderr();
        assert!(said.contains(message), "{config}: {said}");
    }
}

/// The robot of the configuration simulated, identified while it runs, and once more from its recording.
#[test]
fn e2e_a_robot_runs_on_the_bus_and_its_recording_gives_the_same() {
    let site = Site::new();
    let out = site.out();
    let out_dir = out.to_str().expect("UTF-8");
    let quick = ["--speed", "max", "--duration", "12", "--out", out_dir];
    let mut run = site.start(Program::Thetabus, &[&["run", CONFIG][..], &quick].concat());
    run.expect_code(0);
    let stdout = run.stdout();
    for part in [
        "payload_mass",
        "Ia3",
        "coulomb_3",
        "12 blocks, 12000 samples accepted, 0 missing, 0 rejected",
    ] {
        assert!(stdout.contains(part), "{part:?} is not in\n{stdout}");
    }
    let summary = site.summary();
    assert_eq!((summary.blocks, summary.samples.accepted), (12, 12_000));
    // Friction of joint 1 is what the simulated drive has, not what a URDF says.
    let coulomb = summary
        .parameters
        .iter()
        .find(|p| p.name == "coulomb_1")
        .expect("a parameter");
    let (estimate, truth) = (coulomb.estimate.expect("a number"), coulomb.truth.expect("simulated"));
    assert!(
        truth > 1.0 && (estimate / truth - 1.0).abs() < 0.2,
        "{estimate} {truth}"
    );
    for name in ["config.toml", "robot.urdf", "recording.mcap", "report.html"] {
        assert!(out.join(name).exists(), "{name}");
    }

    let again = site.dir.path().join("again");
    let again_dir = again.to_str().expect("UTF-8");
    let mut identify = site.start(Program::Thetabus, &["identify", out_dir, "--out", again_dir]);
    identify.expect_code(0);
    let [live, recorded] = [&out, &again].map(|dir| fs::read_to_string(dir.join("estimates.csv")).expect("estimates"));
    assert_eq!(live, recorded);
}
