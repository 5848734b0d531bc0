//! `thetabus identify LOG.csv` for a robot from its URDF.

use crate::support::{Process, Program, Site};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;
use thetabus::robot::{Robot, Selection, inverse_dynamics};

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");

/// Twenty seconds at 100 Hz of the six-axis arm without friction; `shift` makes another motion.
fn log(shift: f64) -> String {
    let path = Path::new(CONFIG).with_file_name("six_axis.urdf");
    log_of(
        &Robot::from_file(&path, &Selection::default()).expect("a sound URDF"),
        shift,
        1.0,
    )
}

/// The same of any arm of six joints, with inputs that are its torques times a factor.
fn log_of(robot: &Robot, shift: f64, factor: f64) -> String {
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
        inverse_dynamics(robot, &robot.bodies, &state[0], &state[1], &state[2], &mut tau);
        let _ = write!(text, "{t}");
        for x in state[0]
            .iter()
            .chain(&state[1])
            .copied()
            .chain(tau.map(|tau| factor * tau))
        {
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
    let read = identify.stderr();
    assert!(
        read.contains("joint 6 \"joint_6\": position (column 7) ") && !read.contains("WARN"),
        "{read}"
    );
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
            "robot.toml:3: model.urdf: expected a URDF that can be read, got ",
        ),
        (
            model("arm.urdf") + "tips = 3\n",
            "log.csv",
            "robot.toml:4: model.tips: unknown key; did you mean model.tip?",
        ),
        (
            model("arm.urdf") + "[drive]\ngain = [1.0]\n",
            "log.csv",
            "robot.toml:5: drive.gain: expected 6 finite numbers",
        ),
        (
            model("arm.urdf") + "[friction]\nterms = [\"dry\"]\n",
            "log.csv",
            "robot.toml:5: friction.terms: expected a list of words among",
        ),
        (
            model("arm.urdf") + "[identify]\nwindow_s = 0\n",
            "log.csv",
            "robot.toml:5: identify.window_s: expected a number above 0 [s], got 0",
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

/// The robot of the configuration simulated, identified while it runs, and once more from its
/// recording.
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

/// A tool that takes no part in a domain.
fn tool(args: &[&str]) -> Process {
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.args(args);
    Process::start(command)
}

/// A copy of the shipped configuration beside its URDF, with other lines at its end.
fn own_config(site: &Site, name: &str, sections: &str) -> String {
    let dir = site.dir.path();
    fs::copy(
        Path::new(CONFIG).with_file_name("six_axis.urdf"),
        dir.join("six_axis.urdf"),
    )
    .expect("copied");
    let text = format!("[model]\nkind = \"robot\"\nurdf = \"six_axis.urdf\"\ntip = \"flange\"\n{sections}");
    let path = dir.join(name);
    fs::write(&path, text).expect("written");
    path.to_str().expect("UTF-8").to_owned()
}

/// A motion is designed, checked, played by the simulated robot, identified, and what was found is
/// written into the URDF.
#[test]
fn e2e_a_designed_motion_is_played_and_its_result_is_written_into_the_urdf() {
    let site = Site::new();
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let config = own_config(&site, "robot.toml", "");
    let motion = at("motion.csv");
    let design = [
        "excite",
        &config,
        "--duration",
        "12",
        "--harmonics",
        "5",
        "--tries",
        "40",
        "--out",
        &motion,
    ];
    let mut excite = tool(&design);
    excite.expect_code(0);
    let said = excite.stdout();
    assert!(
        said.contains("coulomb_6") && said.contains("the motion determines"),
        "{said}"
    );
    // Nothing is written over.
    let mut again = tool(&design);
    again.expect_code(2);
    assert!(
        again.stderr().contains("exists and is not written over"),
        "{}",
        again.stderr()
    );

    let mut check = tool(&["config", "check", &config, "--motion", &motion]);
    check.expect_code(0);
    let told = |said: &str| {
        said.lines()
            .find(|line| line.starts_with("the motion determines"))
            .map(str::to_owned)
    };
    assert_eq!(told(&check.stdout()), told(&said));

    let played = own_config(&site, "played.toml", "[simulate]\nmotion_csv = \"motion.csv\"\n");
    let out = site.out();
    let out_dir = out.to_str().expect("UTF-8");
    let mut run = site.start(
        Program::Thetabus,
        &["run", &played, "--speed", "max", "--duration", "24", "--out", out_dir],
    );
    run.expect_code(0);
    assert!(out.join("motion.csv").exists());

    let urdf = at("identified.urdf");
    let mut write = site.start(Program::Thetabus, &["urdf", out_dir, "--out", &urdf]);
    write.expect_code(0);
    let text = fs::read_to_string(&urdf).expect("a URDF");
    assert!(
        text.contains("identified by thetabus") && text.contains("<dynamics damping="),
        "{text}"
    );
    // The upper arm's first moment is that of the simulated machine, which differs from the URDF.
    let robot = |path: &str| Robot::from_file(Path::new(path), &Selection::default()).expect("a sound URDF");
    let (old, new) = (robot(&at("six_axis.urdf")), robot(&urdf));
    let hz2 = site
        .summary()
        .parameters
        .into_iter()
        .find(|p| p.name == "hz2")
        .expect("a parameter");
    let base = |robot: &Robot| -> f64 {
        let model = thetabus::robot::BaseParameters::of(robot, true);
        let values = model.nominal(robot, &[0.0; 6]);
        let at = model
            .parameters
            .iter()
            .position(|p| p.leading.name() == "hz2")
            .expect("hz2");
        values[at]
    };
    let (truth, was, is) = (hz2.truth.expect("simulated"), base(&old), base(&new));
    assert!(
        (is / truth - 1.0).abs() < 0.02 && (is - truth).abs() < (was - truth).abs(),
        "{truth} {was} {is}"
    );
}

#[test]
fn e2e_a_urdf_is_refused_if_nothing_was_identified() {
    let site = Site::new();
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let config = own_config(&site, "robot.toml", "[simulate]\nmotion = \"rest\"\n");
    let out = site.out();
    let out_dir = out.to_str().expect("UTF-8");
    let mut run = site.start(
        Program::Thetabus,
        &["run", &config, "--speed", "max", "--duration", "2", "--out", out_dir],
    );
    run.expect_code(0);
    let mut write = site.start(Program::Thetabus, &["urdf", out_dir, "--out", &at("none.urdf")]);
    write.expect_code(2);
    assert!(
        write.stderr().contains("nothing has been identified"),
        "{}",
        write.stderr()
    );
    assert!(!Path::new(&at("none.urdf")).exists());
}

/// Log, gains, URDF: the tools for logs, one after the other.
#[test]
fn e2e_gains_are_calibrated_from_logs_with_a_known_load() {
    let site = Site::new();
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let config = own_config(&site, "robot.toml", "");
    // 2 kg at the flange; currents are a tenth too large for the gains so far.
    let mut loaded = Robot::from_file(Path::new(&at("six_axis.urdf")), &Selection::default()).expect("a sound URDF");
    let load = thetabus::robot::declared_load(2.0, [0.0, 0.0, 0.05], None).expect("a load");
    loaded.bodies[5] = loaded.bodies[5].plus(&load.moved(&loaded.flange));
    let empty = Robot::from_file(Path::new(&at("six_axis.urdf")), &Selection::default()).expect("a sound URDF");
    fs::write(at("empty.csv"), log_of(&empty, 0.0, 1.1)).expect("written");
    fs::write(at("loaded.csv"), log_of(&loaded, 0.7, 1.1)).expect("written");
    let mut calibrate = tool(&[
        "calibrate",
        &at("empty.csv"),
        &at("loaded.csv"),
        "--config",
        &config,
        "--mass",
        "2",
        "--format",
        "json",
    ]);
    calibrate.expect_code(0);
    let found: serde_json::Value = serde_json::from_str(&calibrate.stdout()).expect("JSON");
    for joint in &found["joints"].as_array().expect("a list")[1..3] {
        assert!(
            (joint["gain"].as_f64().expect("a number") * 1.1 - 1.0).abs() < 0.02,
            "{found}"
        );
    }
    let mut wrong = tool(&[
        "calibrate",
        &at("empty.csv"),
        &at("loaded.csv"),
        "--config",
        &config,
        "--mass",
        "-2",
    ]);
    wrong.expect_code(2);
    assert!(
        wrong.stderr().contains("a finite number above 0, got -2"),
        "{}",
        wrong.stderr()
    );

    let out = at("result");
    let mut identify = site.start(
        Program::Thetabus,
        &["identify", &at("empty.csv"), "--config", &config, "--out", &out],
    );
    identify.expect_code(0);
    let urdf = at("identified.urdf");
    let mut write = site.start(Program::Thetabus, &["urdf", &out, "--config", &config, "--out", &urdf]);
    write.expect_code(0);
    assert!(fs::read_to_string(urdf).expect("a URDF").contains("blocks of a log"));
}

/// An operator says what the flange carries, and takes it back.
#[test]
fn e2e_a_load_is_declared_by_a_command() {
    let site = Site::new();
    // It is there from the start, or the watch would find out.
    let load = "[[simulate.payload]]\nt_s = 0.0\nmass_kg = 1.5\ncenter_m = [0.0, 0.0, 0.05]\n";
    let config = own_config(&site, "robot.toml", load);
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let recording = at("declared.mcap");
    let mut monitor = site.start(Program::Monitor, &["--config", &config, "--record", &recording]);
    monitor.wait_for_log("monitor");
    let mut identifier = site.start(Program::Identifier, &["--config", &config]);
    let mut observer = site.observer();
    observer.status("it is there", |_| true);
    let ctl = |args: &[&str]| {
        site.start(
            Program::Thetabus,
            &[&["ctl"][..], args, &["--config", &config]].concat(),
        )
    };
    let mut declare = ctl(&["payload", "--mass", "1.5", "--com", "0,0,0.05"]);
    declare.expect_code(0);
    assert!(
        declare.stdout().contains("a load of 1.5 kg is carried"),
        "{}",
        declare.stdout()
    );
    let _plant = site.start(
        Program::Plant,
        &["--config", &config, "--speed", "1", "--duration", "60"],
    );
    let loaded = observer.estimate("a declared load", |estimate| (estimate.derived[0] - 1.5).abs() < 1e-6);
    assert!((loaded.derived[3] - 0.05).abs() < 1e-6);
    let mut none = ctl(&["payload", "none"]);
    none.expect_code(0);
    assert!(none.stdout().contains("nothing is carried"), "{}", none.stdout());
    observer.estimate("another load than the declared one", |estimate| {
        (estimate.derived[0] - 1.5).abs() > 1e-6
    });
    for (args, said) in [
        (&["payload", "--mass", "-1"][..], "a finite number above 0, got -1"),
        (
            &["payload", "--mass", "1", "--inertia", "1,0,0.1,0,0,0.1"],
            "inertia that a body can have",
        ),
        (&["payload"], "none"),
    ] {
        let mut refused = ctl(args);
        refused.expect_code(2);
        assert!(refused.stderr().contains(said), "{}", refused.stderr());
    }
    for program in [&mut identifier, &mut monitor] {
        program.signal(nix::sys::signal::Signal::SIGTERM);
        program.expect_code(0);
    }

    // A replay declares the same at the same places.
    let again = at("again");
    let identify = ["identify", &recording, "--config", &config, "--out", &again];
    let mut replayed = site.start(Program::Thetabus, &identify);
    replayed.expect_code(0);
    let stderr = replayed.stderr();
    assert!(!stderr.contains("the recording is of"), "its own model: {stderr}");
    let table = fs::read_to_string(Path::new(&again).join("estimates.csv")).expect("estimates");
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    let mass = header.iter().position(|name| *name == "payload_m").expect("a column");
    let declared = |fields: &Vec<&str>| (fields[mass].parse::<f64>().expect("a number") - 1.5).abs() < 1e-6;
    let blocks: Vec<bool> = lines.map(|fields| declared(&fields)).collect();
    assert!(blocks.contains(&true) && blocks.last() == Some(&false), "{blocks:?}");
}

/// A bag as a driver's topic `joint_states` is recorded: CDR by hand, the joints in another order
/// than the robot's, no velocities.
fn bag(path: &Path, log: &str) {
    const ORDER: [usize; 6] = [2, 0, 1, 5, 4, 3];
    let file = std::io::BufWriter::new(fs::File::create(path).expect("created"));
    let mut writer = mcap::Writer::new(file).expect("a writer");
    let schema = writer
        .add_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        .expect("a schema");
    let channel = writer
        .add_channel(schema, "/joint_states", "cdr", &std::collections::BTreeMap::new())
        .expect("a channel");
    for (k, line) in log.lines().enumerate() {
        let x: Vec<f64> = line.split(',').map(|x| x.parse().expect("a number")).collect();
        let mut body: Vec<u8> = Vec::new();
        let pad = |body: &mut Vec<u8>, size: usize| body.resize(body.len().next_multiple_of(size), 0);
        let stamp = 1_700_000_000_000_000_000_u64 + (x[0] * 1e9).round() as u64;
        body.extend(((stamp / 1_000_000_000) as i32).to_le_bytes());
        body.extend(((stamp % 1_000_000_000) as u32).to_le_bytes());
        // An empty frame name, then the names.
        body.extend([1, 0, 0, 0, 0]);
        pad(&mut body, 4);
        body.extend(6_u32.to_le_bytes());
        for joint in ORDER {
            pad(&mut body, 4);
            body.extend(8_u32.to_le_bytes());
            body.extend(format!("joint_{}\0", joint + 1).bytes());
        }
        for first in [Some(1), None, Some(13)] {
            pad(&mut body, 4);
            body.extend(if first.is_some() { 6_u32 } else { 0 }.to_le_bytes());
            for joint in ORDER.iter().filter(|_| first.is_some()) {
                pad(&mut body, 8);
                body.extend(x[first.unwrap_or(0) + joint].to_le_bytes());
            }
        }
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: k as u32,
            log_time: stamp,
            publish_time: stamp,
        };
        let message = [&[0, 1, 0, 0][..], &body].concat();
        writer.write_to_known_channel(&header, &message).expect("written");
    }
    writer.finish().expect("finished");
}

#[test]
fn e2e_a_bag_with_joint_states_is_identified_like_a_log() {
    let site = Site::new();
    let at = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let log = log(0.0);
    fs::write(at("log.csv"), &log).expect("written");
    bag(Path::new(&at("bag.mcap")), &log);
    let config = own_config(&site, "robot.toml", "");
    let [from_log, from_bag] = ["log.csv", "bag.mcap"].map(|name| -> serde_json::Value {
        let args = ["identify", &at(name), "--config", &config, "--format", "json"];
        let mut identify = site.start(Program::Thetabus, &args);
        identify.expect_code(0);
        serde_json::from_str(&identify.stdout()).expect("JSON")
    });
    // Velocities are formed from positions; the motion is below 1 Hz and free of noise, so that
    // both agree to a per cent of what they are off by at most.
    let hz2 = |summary: &serde_json::Value| -> f64 {
        let all = summary["parameters"].as_array().expect("a list");
        all.iter().find(|p| p["name"] == "hz2").expect("hz2")["estimate"]
            .as_f64()
            .expect("a number")
    };
    assert!(
        (hz2(&from_bag) / hz2(&from_log) - 1.0).abs() < 0.01,
        "{} {}",
        hz2(&from_bag),
        hz2(&from_log)
    );
}
