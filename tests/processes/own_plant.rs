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
        // Five deviations are exceeded once in a million runs; the noise is estimated from few blocks, so twice that.
        assert!((theta - truth).abs() < 10.0 * std, "{name}: {theta} +- {std}");
        assert!(std < 0.01 * truth, "{name}: {theta} +- {std}");
    }
}
