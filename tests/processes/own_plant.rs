//! A user's own plant over the bus: the examples, as real processes.

use crate::support::{Process, Site, column, eventually};
use nix::sys::signal::Signal;
use std::path::PathBuf;
use std::process::Command;

/// An example of this build. `cargo test` builds them; asked for this test alone, cargo does not.
fn example(name: &str) -> Option<PathBuf> {
    let test = std::env::current_exe().expect("this test");
    let path = test.ancestors().nth(2)?.join("examples").join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(
        std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"),
        "{} is not built: cargo build --examples with the same profile",
        path.display()
    );
    eprintln!("skipped: {} is not built", path.display());
    None
}

#[test]
fn e2e_the_examples_identify_a_users_own_plant_over_the_bus() {
    let (Some(own_plant), Some(own_machine)) = (example("own_plant"), example("own_machine")) else {
        return;
    };
    let site = Site::new();
    let start = |program: &PathBuf, args: &[&str]| {
        let mut command = Command::new(program);
        command.current_dir(site.dir.path()).args(args);
        Process::start(command)
    };
    let domain = site.domain.name();
    // blocks of half a second: the slowest tone of the torque turns once in 4.8 s
    let quick = ["--domain", domain, "--set", "estimator.block_len=500"];
    let out = site.out();
    let out = out.to_str().expect("UTF-8");
    let identifier = start(&own_plant, &[&["identifier"], &quick[..]].concat());
    let mut monitor = start(&own_plant, &[&["monitor", "--out", out], &quick[..]].concat());
    let mut observer = site.observer();
    identifier.wait_for_log("no plant yet");
    start(&own_machine, &["5", domain]).expect_code(0);
    observer.end();
    let last = observer.last_estimate.expect("estimates").block;
    let csv = site.out().join("estimates.csv");
    eventually("the monitor has the last block", || {
        let blocks = csv.exists().then(|| column(&csv, "block"))?;
        blocks.contains(&(last as f64)).then_some(())
    });
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(0);
    for (name, truth) in [("inertia", 2.5), ("damping", 0.8), ("weight", 12.0)] {
        let estimates = column(&csv, name);
        let deviations = column(&csv, &format!("{name}_std"));
        let (theta, std) = (estimates[estimates.len() - 1], deviations[deviations.len() - 1]);
        // Five standard deviations are exceeded once in a million runs; the noise is estimated from
        // few blocks, so twice that.
        assert!((theta - truth).abs() < 10.0 * std, "{name}: {theta} +- {std}");
        assert!(std < 0.01 * truth, "{name}: {theta} +- {std}");
    }
}

#[test]
fn e2e_a_users_own_plant_has_the_whole_command_line() {
    let Some(own_plant) = example("own_plant") else {
        return;
    };
    let site = Site::new();
    let dir = site.dir.path();
    let program = |args: &[&str]| {
        let mut command = Command::new(&own_plant);
        command.current_dir(dir).args(args);
        Process::start(command)
    };
    let domain = site.domain.name();
    // its equations are what is simulated, from true values a quarter above the start values of 1
    program(&["run", "--domain", domain, "--duration", "20", "--out", "own"]).expect_code(0);
    let csv = dir.join("own").join("estimates.csv");
    for name in ["inertia", "damping", "weight"] {
        let (theta, std) = (column(&csv, name), column(&csv, &format!("{name}_std")));
        let (theta, std) = (theta[theta.len() - 1], std[std.len() - 1]);
        // Exceeded once in a million runs: noise is learnt from ten blocks, so twice five standard
        // deviations.
        assert!((theta - 1.25).abs() < 10.0 * std, "{name}: {theta} +- {std}");
        assert!(std < 0.01, "{name}: {std}");
    }
    // off line, from its own recording, to the bit
    program(&["identify", "own", "--out", "again"]).expect_code(0);
    let again = dir.join("again").join("estimates.csv");
    assert_eq!(column(&csv, "inertia"), column(&again, "inertia"));
    program(&["report", "own/recording.mcap", "--out", "report"]).expect_code(0);
    let page = std::fs::read_to_string(dir.join("report").join("report.html")).expect("a page");
    assert!(page.contains("damping") && page.contains("friction that grows with speed"));
    // an identifier of its own tells its parameters
    let identifier = program(&["identifier", "--domain", domain]);
    identifier.wait_for_log("no plant yet");
    let mut ctl = Command::new(&own_plant);
    let described = ctl.args(["ctl", "describe", "--domain", domain]).output().expect("ctl");
    let text = String::from_utf8_lossy(&described.stdout).into_owned();
    assert!(text.contains("weight") && text.contains("kg m^2"), "{text}");
    // a program without the equations reports this
    let mut foreign = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    let refused = foreign
        .current_dir(dir)
        .args(["identify", "own"])
        .output()
        .expect("identify");
    assert_eq!(refused.status.code(), Some(2));
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(text.contains("pendulum (inertia [kg m^2]"), "{text}");
}
