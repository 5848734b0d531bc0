//! SIGINT and SIGTERM end each program cleanly.

use crate::support::{PAPER, Process, Program, QUICK, Site, eventually};
use nix::sys::signal::{Signal, kill};
use std::process::Command;
use std::time::{Duration, Instant};
use thetabus::recording::{Entry, RecordingReader, Span};
use thetabus::runner::TOGETHER;

/// A plant, an identifier and a monitor at work.
fn at_work(site: &Site) -> [Process; 3] {
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    let monitor = site.start(Program::Monitor, &QUICK);
    let plant = site.start(Program::Plant, &[&["--speed", "2"], &QUICK[..]].concat());
    monitor.wait_for_log(" usable");
    observer.estimate("a second block", |estimate| estimate.block >= 2);
    [plant, identifier, monitor]
}

#[test]
fn e2e_sigint_and_sigterm_end_each_program_with_exit_code_0_and_nothing_left_over() {
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let site = Site::new();
        let mut processes = at_work(&site);
        for process in &mut processes {
            process.signal(signal);
            process.expect_code(0);
        }
        let [plant, identifier, monitor] = &processes;
        assert!(plant.stdout().contains("samples sent"), "{}", plant.said());
        assert!(
            identifier.stdout().contains("samples accepted, 0 missing"),
            "{}",
            identifier.said()
        );
        assert!(monitor.stdout().contains("theta_1"), "{}", monitor.said());
        assert_eq!(site.shared_memory(), Vec::<String>::new());
    }
}

#[test]
fn e2e_an_interrupted_plant_ends_its_stream_so_that_everybody_knows() {
    let site = Site::new();
    let [mut plant, _identifier, _monitor] = at_work(&site);
    plant.signal(Signal::SIGINT);
    plant.expect_code(0);
    let status = site.observer().end();
    assert_eq!(status.missing, 0);
}

#[test]
fn e2e_services_without_anybody_to_talk_to_end_as_cleanly() {
    let site = Site::new();
    for (program, log) in [
        (Program::Identifier, "waiting for its samples"),
        (Program::Monitor, "monitor"),
        (Program::Plant, "plant simulator"),
    ] {
        let mut process = site.start(program, &["--set", "bus.lockstep_limit_s=60"]);
        process.wait_for_log(log);
        process.signal(Signal::SIGTERM);
        process.expect_code(0);
    }
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn e2e_a_second_signal_ends_a_program_at_once_with_130() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut identifier = site.start(Program::Identifier, &QUICK);
    observer.status("a heartbeat", |_| true);
    let plant = site.start(Program::Plant, &[&["--speed", "max"], &QUICK[..]].concat());
    observer.estimate("a block", |_| true);
    // In lockstep a plant that is asked to stop has two seconds of patience with a consumer that is
    // stopped.
    identifier.signal(Signal::SIGSTOP);
    std::thread::sleep(Duration::from_millis(200));
    let mut plant = plant;
    plant.signal(Signal::SIGINT);
    std::thread::sleep(TOGETHER + Duration::from_millis(200));
    plant.signal(Signal::SIGTERM);
    plant.expect_code(130);
    identifier.signal(Signal::SIGCONT);
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
}

#[test]
fn e2e_signals_that_come_together_are_one_request() {
    let site = Site::new();
    let mut processes = at_work(&site);
    for process in &mut processes {
        for signal in [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP, Signal::SIGTERM] {
            process.signal(signal);
            // Handled one by one, so that they cannot become one in the kernel.
            std::thread::sleep(Duration::from_millis(10));
            if !process.is_running() {
                break;
            }
        }
        process.expect_code(0);
    }
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn fault_a_plant_whose_next_sample_is_far_away_ends_at_once_and_says_so_on_the_bus() {
    let site = Site::new();
    let mut observer = site.observer();
    let slow = ["--set", "plant.sample_period_s=0.01", "--set", "plant.substeps=100"];
    let _identifier = site.start(Program::Identifier, &[&slow[..], &QUICK].concat());
    observer.status("a heartbeat", |_| true);
    // A sample each 10 s. The first one goes out before anybody has found the topic.
    let mut plant = site.start(Program::Plant, &[&["--speed", "0.001"], &slow[..], &QUICK].concat());
    observer.status("the first sample", |status| status.accepted == 1);
    let asked = Instant::now();
    plant.signal(Signal::SIGTERM);
    plant.expect_code(0);
    // The next sample comes 10 s after the one that has just come.
    assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
    assert_eq!(observer.end().missing, 0);
}

#[test]
fn fault_an_overloaded_identifier_ends_soon_and_leaves_its_checkpoint() {
    let site = Site::new();
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    let mut observer = site.observer();
    // Blocks of one sample from a plant that waits for nobody: its queue of 4096 is never empty.
    let keys = ["--set", "estimator.block_len=1", "--set", "bus.delivery=\"realtime\""];
    let own = ["--set", &dir, "--set", "checkpoint.period_s=3600"];
    let mut identifier = site.start(Program::Identifier, &[&["--config", PAPER], &keys[..], &own].concat());
    observer.status("a heartbeat", |_| true);
    let endless = ["--config", PAPER, "--speed", "max", "--duration", "100000"];
    let _plant = site.start(Program::Plant, &[&endless[..], &keys].concat());
    observer.status("it falls behind", |status| status.missing > 0);
    let asked = Instant::now();
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    let took = asked.elapsed();
    // 0.2 s for what is in the queue, 0.2 s for late readers of the last estimate. The queue is
    // never empty: without the limit on its time the identifier would not end at all.
    assert!(took < Duration::from_secs(10), "{took:?}\n{}", identifier.said());
    assert!(site.dir.path().join("arm.checkpoint").exists(), "{}", identifier.said());
}

/// A run with checkpoints that is under way, its observer gone again.
fn under_way(site: &Site, args: &[&str], blocks: u64) -> Process {
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    let keys = ["--set", &dir, "--set", "checkpoint.period_s=3600"];
    let run = site.start_run(&[args, &QUICK, &keys].concat());
    let mut observer = site.observer();
    observer.estimate("blocks", |estimate| estimate.block >= blocks);
    run
}

/// What a run leaves behind, however it ended: a summary, a checkpoint, a recording that can be
/// read, and nothing else.
fn expect_whole(site: &Site, blocks: u64, what: &str) {
    eventually("its children have ended", || site.processes().is_empty().then_some(()));
    let summary = site.summary();
    assert!(summary.blocks >= blocks, "{what}: {summary:?}");
    assert_eq!(summary.samples.missing, 0, "{what}: {summary:?}");
    assert!(site.dir.path().join("arm.checkpoint").exists(), "{what}: no checkpoint");
    let mut reader = RecordingReader::open(&site.out().join("recording.mcap"), Span::default()).expect(what);
    let mut samples = 0;
    while let Some(entry) = reader.next_entry().expect(what) {
        samples += u64::from(matches!(entry, Entry::Sample { .. }));
    }
    assert!(samples >= 200 * blocks, "{what}: {samples} samples recorded");
    assert!(reader.loss().is_none(), "{what}: {}", reader.loss());
    assert_eq!(site.shared_memory(), Vec::<String>::new(), "{what}");
}

/// Kills launchers with 9, in real time and in lockstep, anywhere between two blocks and the end.
fn kill_launchers(count: u64) {
    for round in 0..count {
        let site = Site::new();
        let speed = if round % 2 == 0 { "4" } else { "max" };
        let mut run = under_way(&site, &["--speed", speed, "--duration", "100000"], 2);
        // spread over a block at speed 4 and more
        std::thread::sleep(Duration::from_millis(round * 37 % 200));
        run.signal(Signal::SIGKILL);
        run.wait();
        expect_whole(&site, 2, &format!("round {round}, speed {speed}: {}", run.said()));
    }
}

#[test]
fn fault_children_of_a_launcher_killed_with_9_leave_summary_checkpoint_and_nothing_else() {
    kill_launchers(8);
}

#[test]
#[ignore = "some four minutes"]
fn fault_a_hundred_launchers_killed_with_9() {
    kill_launchers(100);
}

/// Runs that `timeout` ends: it signals the launcher, and then its own group with the launcher in
/// it.
fn time_out(count: u32) {
    for round in 0..count {
        let site = Site::new();
        let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
        let out = site.out();
        let mut command = Command::new("timeout");
        command
            .current_dir(site.dir.path())
            .args(["4", env!("CARGO_BIN_EXE_thetabus"), "run", PAPER])
            .args(["--speed", "4", "--set", &dir, "--domain", site.domain.name(), "--out"])
            .arg(&out)
            .args(QUICK);
        let mut run = Process::start(command);
        run.expect_code(124);
        expect_whole(&site, 1, &format!("round {round}: {}", run.said()));
        assert!(run.stdout().contains("theta_9"), "round {round}: {}", run.said());
        assert!(out.join("report.html").exists(), "round {round}: {}", run.said());
    }
}

#[test]
fn e2e_a_run_ended_by_timeout_leaves_its_results() {
    time_out(5);
}

#[test]
#[ignore = "two minutes"]
fn e2e_twenty_runs_ended_by_timeout() {
    time_out(20);
}

#[test]
fn fault_a_child_that_somebody_else_ends_before_the_plants_end_has_failed() {
    for (role, speed) in [
        ("plant", "2"),
        ("identifier", "2"),
        ("monitor", "2"),
        ("identifier", "max"),
    ] {
        let site = Site::new();
        let mut run = under_way(&site, &["--speed", speed, "--duration", "100000"], 2);
        kill(site.child(&run, role), Signal::SIGTERM).expect("it lives");
        run.expect_code(1);
        run.expect_stderr(&[
            &format!("the {role}, process"),
            "was ended by a signal before the plant's stream had come to its end",
        ]);
        // What there is is shown all the same.
        assert!(run.stdout().contains("theta_9"), "{role}: {}", run.said());
        assert!(site.summary().blocks >= 2);
        assert_eq!(site.processes(), Vec::<u32>::new());
        assert_eq!(site.shared_memory(), Vec::<String>::new(), "{role}");
    }
}
