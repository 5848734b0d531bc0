//! The closed loop as real processes: a controller that uses estimates, one that does not, one that
//! dies.

use crate::support::{Process, Program, Site, column, eventually};
use nix::sys::signal::Signal;
use std::path::Path;

const ADAPTIVE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/adaptive.toml");

/// The samples of a run in columns.
pub fn exported(site: &Site, out: &Path) -> std::path::PathBuf {
    let csv = out.with_extension("csv");
    let args = [
        "export",
        out.to_str().expect("UTF-8"),
        "--out",
        csv.to_str().expect("UTF-8"),
    ];
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.current_dir(site.dir.path()).args(args);
    Process::start(command).expect_code(0);
    csv
}

/// Root mean square of the tracking error of both joints together, between two times \[s\], in rad.
fn tracking_error(csv: &Path, from_s: f64, to_s: f64) -> f64 {
    tracking_error_of(2, csv, from_s, to_s)
}

/// The same of the first joints.
fn tracking_error_of(joints: usize, csv: &Path, from_s: f64, to_s: f64) -> f64 {
    let times = column(csv, "t_ns");
    let within: Vec<usize> = (0..times.len())
        .filter(|&k| (from_s..to_s).contains(&(times[k] * 1e-9)))
        .collect();
    let squares = (1..=joints).map(|joint| {
        let (setpoint, q) = (
            column(csv, &format!("setpoint_{joint}_rad")),
            column(csv, &format!("q_{joint}_rad")),
        );
        within.iter().map(|&k| (setpoint[k] - q[k]).powi(2)).sum::<f64>()
    });
    (squares.sum::<f64>() / within.len() as f64).sqrt()
}

#[test]
fn e2e_feed_forward_from_estimates_follows_a_payload_that_changed() {
    let site = Site::new();
    let run = |name: &str, feed_forward: &str| {
        let out = site.dir.path().join(name);
        let set = format!("controller.feed_forward={feed_forward}");
        let args = [
            "run",
            ADAPTIVE,
            "--duration",
            "70",
            "--set",
            &set,
            "--out",
            out.to_str().expect("UTF-8"),
        ];
        site.start(Program::Thetabus, &args).expect_code(0);
        exported(&site, &out)
    };
    let (adaptive, fixed) = (run("adaptive", "adaptive"), run("fixed", "fixed"));
    // The payload jumps at 45 s; the controllers begin with what holds before.
    let before = tracking_error(&adaptive, 20.0, 45.0) / tracking_error(&fixed, 20.0, 45.0);
    let after = tracking_error(&adaptive, 48.0, 70.0) / tracking_error(&fixed, 48.0, 70.0);
    assert!(before < 1.05, "{before}");
    // docs/adaptive.md has 24 % where identifier and machine go step by step; here estimates come
    // up to a queue later
    assert!(after < 0.45, "{after}");
}

#[test]
fn e2e_feed_forward_for_a_robot_begins_with_its_urdf_and_follows_a_payload() {
    let site = Site::new();
    let place = |name: &str| site.dir.path().join(name);
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/robots");
    let config = std::fs::read_to_string(robots.join("adaptive.toml")).expect("the configuration");
    assert!(config.contains("t_s = 45.0"));
    std::fs::write(place("robot.toml"), config.replace("t_s = 45.0", "t_s = 14.0")).expect("written");
    std::fs::copy(robots.join("six_axis.urdf"), place("six_axis.urdf")).expect("copied");
    let run = |feed_forward: &str| {
        let out = place(feed_forward);
        let set = format!("controller.feed_forward={feed_forward}");
        let duration = ["--duration", "26"];
        let args = [
            "run",
            "robot.toml",
            "--set",
            &set,
            "--out",
            out.to_str().expect("UTF-8"),
        ];
        site.start(Program::Thetabus, &[&args[..], &duration].concat())
            .expect_code(0);
        exported(&site, &out)
    };
    let (adaptive, fixed) = (run("adaptive"), run("fixed"));
    let ratio = |from_s: f64, to_s: f64| {
        tracking_error_of(6, &adaptive, from_s, to_s) / tracking_error_of(6, &fixed, from_s, to_s)
    };
    // The URDF's bodies are wrong by up to 15 % and it knows no friction. Estimates may be used
    // once the motion has informed on all of it: after ten seconds here, and nine seconds after the
    // flange has picked 3 kg up.
    let (before, after) = (ratio(11.5, 14.0), ratio(24.5, 26.0));
    println!("tracking error beside fixed feed-forward: {before:.3} before, {after:.3} after");
    // 0.009 and 0.004 on a machine that does nothing else; estimates that come half a second late
    // on a busy one cost the beginning of the first span
    assert!(before < 0.1, "{before}");
    assert!(after < 0.05, "{after}");
}

#[test]
fn fault_a_controller_that_is_killed_leaves_the_machine_to_its_own_loop_and_may_come_back() {
    let site = Site::new();
    let start = |program, more: &[&str]| site.start(program, &[&["--config", ADAPTIVE], more].concat());
    let identifier = start(Program::Identifier, &[]);
    let record = site.dir.path().join("run.mcap");
    let mut monitor = start(Program::Monitor, &["--record", record.to_str().expect("UTF-8")]);
    identifier.wait_for_log("no plant yet");
    // four times real time on a busy machine: an answer may take ten milliseconds of the machine's
    // time
    let patient = ["--set", "controller.deadline_s=0.1"];
    let mut controller = start(Program::Controller, &patient);
    controller.wait_for_log("controller");
    let mut plant = start(Program::Plant, &["--speed", "4", "--duration", "24"]);
    let mut observer = site.observer();
    observer.status("two seconds of motion", |status| status.last_seq > 4000);
    controller.signal(Signal::SIGKILL);
    controller.wait();
    observer.status("the machine goes on", |status| status.last_seq > 12_000);
    let mut second = start(Program::Controller, &patient);
    plant.expect_code(0);
    observer.end();
    second.signal(Signal::SIGTERM);
    second.expect_code(0);
    assert!(second.said().contains("samples answered"), "{}", second.said());
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(0);
    eventually("the recording is whole", || record.exists().then_some(()));
    let csv = exported(&site, &record);
    // The drive's limit holds throughout; measured voltages carry 0.05 V of noise, of which six
    // standard deviations do not occur.
    for joint in [1, 2] {
        let input = column(&csv, &format!("input_{joint}_v"));
        assert!(input.iter().all(|u| u.abs() <= 400.3));
    }
    // With feed-forward the arm follows within a millirad, some ten where an answer comes late; on
    // its own loop alone it lags by 0.2 rad.
    let errors = [(2.0, 4.0), (8.0, 12.0), (18.0, 24.0)].map(|(from, to)| tracking_error(&csv, from, to));
    assert!(errors[0] < 0.05 && errors[2] < 0.05, "{errors:?}");
    assert!(errors[1] > 0.1, "{errors:?}");
}

#[test]
fn fault_a_controller_without_a_task_says_what_it_needs() {
    let site = Site::new();
    let mut controller = site.start(Program::Controller, &["--config", crate::support::ENCODERS]);
    controller.expect_code(2);
    controller.expect_stderr(&["controller.feed_forward", "adaptive"]);
    let steps = [
        "--config",
        crate::support::ENCODERS,
        "--set",
        "controller.feed_forward=fixed",
    ];
    let mut controller = site.start(Program::Controller, &steps);
    controller.expect_code(2);
    controller.expect_stderr(&["plant.setpoint.kind", "without jumps"]);
}
