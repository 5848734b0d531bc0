//! `thetabus run` starts what dies again, where it may, and says so.

use crate::support::{Dice, Observer, QUICK, Site, column, eventually};
use nix::sys::signal::{Signal, kill};
use std::time::Duration;
use thetabus::messages::{Estimate, estimate_flags};
use thetabus::model::MANIPULATOR_PARAMS;
use thetabus::sim::SimOptions;

/// Restarts without much of a pause.
const SUPERVISED: [&str; 6] = [
    "--set",
    "supervision.restarts=100",
    "--set",
    "supervision.backoff_s=0.02",
    "--set",
    "supervision.backoff_limit_s=0.05",
];

/// A plant that does not change, so that every stream has the same truth.
const CONSTANT: [&str; 4] = [
    "--set",
    "plant.mass_2.t_s=[0.0]",
    "--set",
    "plant.mass_2.mass_kg=[150.0]",
];

/// An estimate that says it may be used is right, whatever died before it; none holds a NaN.
fn check(estimate: &Estimate, truth: &[f64; MANIPULATOR_PARAMS]) {
    let theta = &estimate.theta[..truth.len()];
    assert!(
        theta.iter().all(|value| value.is_finite()),
        "block {}: {theta:?}",
        estimate.block
    );
    if estimate.use_ok != 0 {
        for (i, (value, truth)) in theta.iter().zip(truth).enumerate() {
            // If a parameter may be used, 3 standard deviations are below 5 % of it; exact signals
            // give far more.
            if estimate.usable.contains(i) {
                assert!(
                    (value / truth - 1.0).abs() < 0.01,
                    "block {}: theta_{} = {value}",
                    estimate.block,
                    i + 1
                );
            }
        }
    }
}

/// The next estimate that may be used and differs from the last one, with all on the way checked.
fn next_good(observer: &mut Observer, truth: &[f64; MANIPULATOR_PARAMS], what: &str) -> Estimate {
    observer.last_estimate = None;
    observer.estimate(what, |estimate| {
        check(estimate, truth);
        estimate.use_ok != 0
    })
}

#[test]
fn fault_twenty_kills_of_each_process_in_random_order_and_no_estimate_is_wrong() {
    const KILLS: usize = 20;
    let site = Site::new();
    let mut observer = site.observer();
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let args = [
        &["--speed", "2", "--duration", "900"],
        &QUICK[..],
        &SUPERVISED,
        &CONSTANT,
    ]
    .concat();
    let run = site.start_run(&args);
    next_good(&mut observer, &truth, "the first estimate that may be used");
    let mut left: Vec<&str> = ["plant", "identifier", "monitor"].repeat(KILLS);
    let mut dice = Dice(2_026);
    while !left.is_empty() {
        let role = left.swap_remove(dice.below(left.len()));
        let victim = site.child(&run, role);
        kill(victim, Signal::SIGKILL).expect("it lives");
        let successor = eventually("its successor", || {
            let successor = site.child(&run, role);
            (successor != victim).then_some(successor)
        });
        assert_ne!(successor, victim);
        // Nobody is blocked: estimates come again, of samples that were made since.
        next_good(
            &mut observer,
            &truth,
            &format!("an estimate after the {role} was killed"),
        );
    }
    // The last plant's stream goes to its end.
    run.signal(Signal::SIGTERM);
    let mut run = run;
    run.expect_code(3);
    let restarts = site.summary().restarts.expect("a launcher counts");
    for role in ["plant", "identifier", "monitor"] {
        assert_eq!(restarts[role], KILLS as u64, "{role}: {restarts:?}");
    }
    assert!(
        run.stdout()
            .contains(&format!("started again: identifier {KILLS}, monitor {KILLS}")),
        "{}",
        run.said()
    );
    drop(observer);
    assert_eq!(site.processes(), Vec::<u32>::new());
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn fault_a_process_that_keeps_dying_ends_the_run_at_the_limit() {
    let site = Site::new();
    let mut observer = site.observer();
    let limit = ["--set", "supervision.restarts=2", "--set", "supervision.backoff_s=0.01"];
    let mut run = site.start_run(&[&["--speed", "1"], &QUICK[..], &limit].concat());
    observer.estimate("a first block", |_| true);
    let mut last = None;
    for _ in 0..3 {
        let victim = eventually("another identifier", || {
            let child = site.child(&run, "identifier");
            (Some(child) != last).then_some(child)
        });
        kill(victim, Signal::SIGKILL).expect("it lives");
        last = Some(victim);
    }
    run.expect_code(1);
    run.expect_stderr(&[
        "restart=2",
        &format!(
            "the identifier, process {}, was killed by signal 9",
            last.expect("killed")
        ),
    ]);
    assert_eq!(site.processes(), Vec::<u32>::new());
}

#[test]
fn fault_an_identifier_started_again_goes_on_warm_where_checkpoints_are_written() {
    let site = Site::new();
    let mut observer = site.observer();
    let checkpoints = site.dir.path().join("checkpoints");
    std::fs::create_dir(&checkpoints).expect("create");
    let dir = format!("checkpoint.dir={}", checkpoints.display());
    let keep = ["--set", &dir, "--set", "checkpoint.period_s=0.2"];
    let args = [
        &["--speed", "2", "--duration", "900"],
        &QUICK[..],
        &SUPERVISED,
        &CONSTANT,
        &keep,
    ]
    .concat();
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let mut run = site.start_run(&args);
    let before = observer.estimate("a tenth block that may be used", |estimate| {
        check(estimate, &truth);
        estimate.block >= 10 && estimate.use_ok != 0
    });
    eventually("a checkpoint", || {
        let files = std::fs::read_dir(&checkpoints).expect("there").count();
        (files > 0).then_some(())
    });
    assert_eq!(before.flags & estimate_flags::WARM, 0);
    kill(site.child(&run, "identifier"), Signal::SIGKILL).expect("it lives");
    let after = observer.estimate("the successor's first estimate", |estimate| {
        check(estimate, &truth);
        estimate.block > before.block && estimate.flags & estimate_flags::WARM != 0
    });
    // It knows at once what the first one knew.
    assert_eq!(after.use_ok, 1, "block {} state {}", after.block, after.state);
    run.signal(Signal::SIGTERM);
    run.expect_code(3);
}

#[test]
fn fault_an_identifier_that_somebody_else_ends_is_started_again_and_a_plant_that_said_end_is_not() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut run = site.start_run(&[&["--speed", "2", "--duration", "900"], &QUICK[..], &SUPERVISED].concat());
    let before = observer.estimate("a second block", |estimate| estimate.block >= 2);
    kill(site.child(&run, "identifier"), Signal::SIGTERM).expect("it lives");
    observer.estimate("its successor's estimates", |estimate| {
        estimate.block > before.block + 3 && estimate.stream_id == before.stream_id
    });
    kill(site.child(&run, "plant"), Signal::SIGTERM).expect("it lives");
    run.expect_code(1);
    run.expect_stderr(&["the plant, process", "before the plant's stream had come to its end"]);
    let restarts = site.summary().restarts.expect("counted");
    assert_eq!((restarts["identifier"], restarts["plant"]), (1, 0));
}

#[test]
fn fault_a_monitor_started_again_appends_to_table_and_recording() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut run = site.start_run(&[&["--speed", "2", "--duration", "6"], &QUICK[..], &SUPERVISED].concat());
    // A second of run is flushed to the recording.
    observer.estimate("a tenth block", |estimate| estimate.block >= 10);
    let monitor = site.child(&run, "monitor");
    kill(monitor, Signal::SIGKILL).expect("it lives");
    run.expect_code(3);
    let blocks = column(&site.out().join("estimates.csv"), "block");
    assert_eq!(blocks.first(), Some(&1.0), "what the first one wrote is still there");
    assert_eq!(blocks.last(), Some(&30.0), "and the second one went on to the end");
    assert!(blocks.windows(2).all(|pair| pair[0] < pair[1]), "{blocks:?}");
    assert!(site.out().join("recording_0001.mcap").exists());
    // Both files are read as one recording, and the page is made of both.
    assert!(site.out().join("report.html").exists());
    let mut identify = site.start(
        crate::support::Program::Thetabus,
        &["identify", site.out().join("recording.mcap").to_str().expect("UTF-8")],
    );
    identify.expect_code(3);
    let summary = site.summary();
    assert_eq!(summary.samples.missing, 0, "the identifier lost nothing: {summary:?}");
    assert_eq!(summary.restarts.expect("counted")["monitor"], 1);
}

#[test]
fn fault_a_plant_started_again_begins_a_new_stream_that_runs_to_its_end() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut run = site.start_run(&[&["--speed", "4", "--duration", "4"], &QUICK[..], &SUPERVISED].concat());
    let before = observer.estimate("a second block", |estimate| estimate.block >= 2);
    kill(site.child(&run, "plant"), Signal::SIGKILL).expect("it lives");
    run.expect_code(3);
    let status = observer.end();
    assert_ne!(status.stream_id, before.stream_id);
    assert_eq!((status.streams, status.last_seq), (2, 3_999));
    assert_eq!(site.summary().restarts.expect("counted")["plant"], 1);
}

#[test]
fn fault_each_process_stopped_for_three_seconds_goes_on() {
    let site = Site::new();
    let mut observer = site.observer();
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let room = ["--set", "bus.sample_buffer=8192"];
    let mut run = site.start_run(&[&["--speed", "1", "--duration", "40"], &QUICK[..], &room].concat());
    for role in ["identifier", "monitor", "plant"] {
        let before = next_good(&mut observer, &truth, "an estimate that may be used");
        let child = site.child(&run, role);
        kill(child, Signal::SIGSTOP).expect("it lives");
        std::thread::sleep(Duration::from_secs(3));
        kill(child, Signal::SIGCONT).expect("it lives");
        let after = observer.estimate("later blocks", |estimate| {
            check(estimate, &truth);
            estimate.block > before.block + 2 && estimate.use_ok != 0
        });
        // 3 s are 3000 samples; each queue holds 8192, so that a busy machine may take 5 s more.
        assert_eq!((after.missing, after.stream_id), (0, before.stream_id), "{role}");
    }
    run.signal(Signal::SIGTERM);
    run.expect_code(0);
    let summary = site.summary();
    assert_eq!(
        (summary.samples.missing, summary.samples.rejected),
        (0, 0),
        "{summary:?}"
    );
    // Nobody died, so nobody was started again.
    assert!(summary.restarts.expect("counted").values().all(|count| *count == 0));
    let blocks = column(&site.out().join("estimates.csv"), "block");
    assert!(blocks.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "{blocks:?}");
}
