//! A running identifier receives commands, is stopped, and continues from its checkpoint.

use crate::support::{Process, Program, QUICK, Site, eventually, text};
use nix::sys::signal::Signal;
use std::fs;
use std::time::{Duration, Instant};
use thetabus::bus::monotonic_ns;
use thetabus::messages::{ErrorCode, State, estimate_flags, status_flags};

fn ctl(site: &Site, args: &[&str]) -> Process {
    site.start(Program::Thetabus, &[&["ctl"], args].concat())
}

/// Runs a command, expects an exit code, and returns the text of both outputs.
#[track_caller]
fn ask(site: &Site, args: &[&str], code: i32) -> String {
    let mut process = ctl(site, args);
    process.expect_code(code);
    process.said()
}

/// A plant in real time and an identifier.
fn running(site: &Site, identifier: &[&str]) -> (Process, Process) {
    let plant = site.start(Program::Plant, &["--speed", "1", "--duration", "600"]);
    let identifier = site.start(Program::Identifier, &[&QUICK, identifier].concat());
    (plant, identifier)
}

#[test]
fn e2e_every_command_is_acknowledged_takes_effect_and_shows_in_estimate_and_status() {
    let site = Site::new();
    let (_plant, _identifier) = running(&site, &[]);
    let mut observer = site.observer();
    observer.estimate("an estimate that may be used", |e| e.use_ok == 1);

    assert!(ask(&site, &["pause"], 0).contains("paused, from block"));
    let paused = observer.estimate("a paused estimate", |e| e.state == State::Paused as u32);
    assert_eq!((paused.use_ok, paused.flags & estimate_flags::HELD != 0), (0, true));
    observer.status("a paused status", |s| {
        s.flags & status_flags::PAUSED != 0 && s.process.commands == 1
    });
    ask(&site, &["resume"], 0);
    observer.estimate("it goes on", |e| e.state == State::Converged as u32);

    let before = observer.last_estimate.expect("an estimate");
    ask(&site, &["set", "forgetting_factor=0.8"], 0);
    let after = observer.estimate("another configuration", |e| e.config_hash != before.config_hash);
    assert_ne!(after.flags & estimate_flags::COMMANDED, 0);
    assert!(ask(&site, &["set", "estimator.block_len=250"], 0).contains("block_len is 250"));
    observer.estimate("blocks of 250 samples", |e| e.t_last_ns - e.t_first_ns == 249_000_000);

    ask(&site, &["fix", "theta_3=4.5"], 0);
    observer.estimate("theta_3 held", |e| e.fixed.bits() == 4 && e.theta[2] == 4.5);
    ask(&site, &["free", "theta_3"], 0);
    observer.estimate("theta_3 estimated", |e| e.fixed.is_empty() && e.theta[2] != 4.5);
    ask(&site, &["reset"], 0);
    let status = observer.status("six commands more", |s| s.process.commands == 7);
    assert_ne!(status.flags & status_flags::COMMANDED, 0);

    let described = ask(&site, &["describe", "--format", "json"], 0);
    for part in [
        "\"model\": \"manipulator\"",
        "\"theta_9\"",
        "\"forgetting_factor\"",
        "\"value\": 0.8",
        "\"V\"",
    ] {
        assert!(described.contains(part), "{part} is not in\n{described}");
    }
    assert!(status.process.resident_bytes > 1_000_000, "{status:?}");
    assert!(status.step.count > 1000 && status.step.mean_ns > 0 && status.step.max_ns >= status.step.p99_ns);
    assert!(status.block.count > 5 && status.asymmetry < 1e-9 && status.information_ln.is_finite());
}

#[test]
fn fault_requests_that_cannot_be_met_are_refused_with_the_reason_and_exit_code() {
    let site = Site::new();
    let nobody = ask(&site, &["pause"], 1);
    assert!(nobody.contains("no identifier of robot \"arm\" runs"), "{nobody}");
    let mut identifier = site.start(Program::Identifier, &QUICK);
    identifier.wait_for_log("identifier");
    for (args, words) in [
        (&["set", "block_len=0"][..], "expected a whole number from 1"),
        (&["set", "block_len=1.5"], "expected a whole number"),
        (&["set", "colour=1"], "expected a tunable out of block_len"),
        (&["set", "forgetting_factor"], "expected KEY=NUMBER"),
        (&["set", "forgetting_factor=nan"], "forgetting_factor"),
        (&["set", "gate_limit=5"], "has no effect unless estimator.outliers"),
        (&["fix", "theta_33"], "expected a parameter out of theta_1"),
        (&["fix", "theta_3=abc"], "expected KEY=NUMBER"),
        (&["fix", "theta_3", "inf"], "expected a number from"),
        (&["free", "mass"], "expected a parameter out of"),
        (&["save"], "checkpoint.dir is not set"),
    ] {
        let said = ask(&site, args, 2);
        assert!(said.contains(words), "{args:?}:\n{said}");
        assert!(
            !said.contains("--set"),
            "an argument that nobody wrote, {args:?}:\n{said}"
        );
    }
    let mut observer = site.observer();
    let status = observer.status("the refusals are counted", |s| s.process.refused == 9);
    assert_eq!(ErrorCode::from_wire(status.error.code), Some(ErrorCode::Refused));
    assert!(
        status.error.words().contains("checkpoint.dir"),
        "{}",
        status.error.words()
    );
    // without a plant a command takes effect at once
    assert!(ask(&site, &["pause"], 0).contains("from block 1 on (sample 0)"));

    // a stopped identifier does not answer, and a command waits no longer than its limit
    identifier.signal(Signal::SIGSTOP);
    let silent = ask(&site, &["describe", "--timeout", "0.3"], 1);
    assert!(silent.contains("did not answer within 0.3 s"), "{silent}");
    identifier.signal(Signal::SIGCONT);
    ask(&site, &["describe"], 0);
    identifier.signal(Signal::SIGKILL);
    identifier.wait();
    let gone = ask(&site, &["describe", "--timeout", "1"], 1);
    assert!(
        gone.contains("no identifier") || gone.contains("did not answer"),
        "{gone}"
    );
}

#[test]
fn e2e_an_identifier_killed_with_9_goes_on_warm_within_a_block() {
    let site = Site::new();
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    let keys = ["--set", &dir, "--set", "checkpoint.period_s=0.2"];
    let (_plant, mut identifier) = running(&site, &keys);
    let mut observer = site.observer();
    // use_ok may fall to 0 for a block when the second joint is learnt
    observer.estimate("an estimate that may be used whole", |e| {
        e.use_ok == 1 && (0..9).all(|i| e.is_usable(i))
    });
    let written = observer.last_status.map_or(0, |s| s.process.checkpoints);
    observer.status("two checkpoints later", |s| s.process.checkpoints >= written + 2);
    identifier.signal(Signal::SIGKILL);
    identifier.wait();
    observer.look();
    let last = observer.last_estimate.expect("an estimate");

    let begun_ns = monotonic_ns();
    let mut second = site.start(Program::Identifier, &[&QUICK, &keys[..], &["--warm"]].concat());
    let first = observer.estimate("an estimate of the second", |e| e.flags & estimate_flags::WARM != 0);
    // within one block: the first one that it gives
    assert_eq!(first.use_ok, 1, "{first:?}");
    for i in 0..9 {
        let (error, std) = (
            (first.theta[i] - last.theta[i]).abs(),
            first.theta_std[i] + last.theta_std[i],
        );
        // exact data: standard deviations are almost 0, and θ̂ is right to rounding
        assert!(
            error <= 3.0 * std + 1e-6 * last.theta[i].abs(),
            "theta_{}: {error:e}",
            i + 1
        );
    }
    let status = observer.status("a sample of the second", |s| {
        s.pid == second.pid() && s.process.first_sample_ns > 0 && s.flags & status_flags::WARM != 0
    });
    let start = Duration::from_nanos(status.process.first_sample_ns - begun_ns);
    // 200 ms on a machine that does nothing else; this one compiles and tests meanwhile
    eprintln!("from start to the first sample: {start:?}");
    assert!(start < Duration::from_secs(5), "{start:?}");
    second.signal(Signal::SIGTERM);
    second.expect_code(0);
}

#[test]
fn fault_checkpoints_that_do_not_fit_are_refused_loudly_and_the_start_is_cold() {
    let site = Site::new();
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    let file = site.dir.path().join("arm.checkpoint");
    {
        let (_plant, identifier) = running(&site, &["--set", &dir]);
        site.observer().estimate("an estimate", |e| e.block > 2);
        assert!(ask(&site, &["save"], 0).contains("arm.checkpoint"));
        identifier.signal(Signal::SIGTERM);
    }
    let good = fs::read(&file).expect("a checkpoint");
    let flipped = {
        let mut bytes = good.clone();
        bytes[100] ^= 4;
        bytes
    };
    let older = {
        let mut bytes = good.clone();
        bytes[8] = 0;
        bytes
    };
    let cases: [(&[u8], &[&str], &str); 6] = [
        (&good[..good.len() / 2], &[], "it is damaged"),
        (&flipped, &[], "expected CRC"),
        (&older, &[], "it has version 0"),
        (&[], &[], "it is damaged"),
        (
            &good,
            &["--set", "estimator.forgetting_factor=0.8"],
            "another configuration",
        ),
        (
            &good,
            &[
                "--config",
                concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml"),
            ],
            "another model",
        ),
    ];
    for (bytes, args, words) in cases {
        fs::write(&file, bytes).expect("write");
        let mut cold = site.start(
            Program::Identifier,
            &[&QUICK, args, &["--warm", "--set", &dir]].concat(),
        );
        cold.wait_for_log("starting cold");
        assert!(cold.stderr().contains(words), "{words}: {}", cold.said());
        let mut observer = site.observer();
        let status = observer.status("it says so", |s| {
            s.pid == cold.pid() && s.process.checkpoints_failed == 1
        });
        assert_eq!(
            ErrorCode::from_wire(status.error.code),
            Some(ErrorCode::CheckpointUnused)
        );
        assert_eq!(status.flags & status_flags::WARM, 0);
        cold.signal(Signal::SIGKILL);
        cold.wait();
    }
    let mut nowhere = site.start(Program::Identifier, &["--warm"]);
    nowhere.expect_code(2);
    nowhere.expect_stderr(&["--warm needs checkpoint.dir"]);
}

#[test]
fn fault_a_link_in_the_way_and_a_directory_that_is_gone_leave_the_identifier_running_and_the_old_checkpoint() {
    let site = Site::new();
    let gone = site.dir.path().join("gone");
    fs::create_dir(&gone).expect("a directory");
    let dir = format!("checkpoint.dir=\"{}\"", text(&gone));
    let (_plant, mut identifier) = running(&site, &["--set", &dir, "--set", "checkpoint.period_s=0.2"]);
    let mut observer = site.observer();
    observer.status("a checkpoint", |s| s.process.checkpoints > 0);
    let old = fs::read(gone.join("arm.checkpoint")).expect("a checkpoint");
    // A link at the name of the temporary file is neither followed nor in the way.
    let victim = site.dir.path().join("victim");
    let temporary = gone.join(format!("arm.checkpoint.{}.tmp", identifier.pid()));
    std::os::unix::fs::symlink(&victim, &temporary).expect("a link");
    let written = observer.last_status.map_or(0, |s| s.process.checkpoints);
    observer.status("checkpoints go on", |s| s.process.checkpoints > written + 2);
    assert!(!victim.exists() && identifier.is_running());
    fs::remove_file(&temporary).expect("the link");
    let kept = fs::read(gone.join("arm.checkpoint")).expect("a checkpoint");
    assert_eq!(kept.len(), old.len());
    // in one go, for the next checkpoint may be on its way into it
    fs::rename(&gone, site.dir.path().join("moved")).expect("rename");
    let failed = observer.last_status.map_or(0, |s| s.process.checkpoints_failed);
    let status = observer.status("it goes on failing", |s| s.process.checkpoints_failed > failed);
    assert_eq!(
        ErrorCode::from_wire(status.error.code),
        Some(ErrorCode::CheckpointFailed)
    );
    let block = observer.last_estimate.expect("an estimate").block;
    observer.estimate("estimates go on", |e| e.block > block);
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    identifier.expect_stderr(&["the previous checkpoint stays"]);
}

#[test]
fn fault_a_plant_that_is_silent_is_seen_and_the_heartbeat_goes_on() {
    let site = Site::new();
    let (plant, _identifier) = running(&site, &[]);
    let mut observer = site.observer();
    observer.estimate("an estimate", |e| e.block > 1);
    plant.signal(Signal::SIGSTOP);
    let begun = Instant::now();
    let status = observer.status("silence", |s| s.flags & status_flags::SILENT != 0);
    assert!(
        status.process.silent_ns >= 1_000_000_000 && status.process.pauses == 1,
        "{status:?}"
    );
    assert_eq!(status.error.words(), ErrorCode::Silent.describe());
    // silent_ns grows from heartbeat to heartbeat
    observer.status("the heartbeat goes on", |s| {
        s.process.silent_ns > status.process.silent_ns
    });
    assert!(begun.elapsed() >= Duration::from_secs(1));
    plant.signal(Signal::SIGCONT);
    let back = observer.status("samples again", |s| s.flags & status_flags::SILENT == 0);
    assert_eq!((back.missing, back.rejected), (0, 0), "simulated time has no gap");
}

#[test]
fn replay_commands_and_a_warm_start_are_recorded_and_repeated_to_the_bit() {
    let site = Site::new();
    let dir = format!("checkpoint.dir=\"{}\"", site.dir.path().display());
    // something to start from
    let seed = [&QUICK[..], &["--set", &dir, "--duration", "3", "--speed", "max"]].concat();
    site.start_run(&seed).expect_code(0);
    assert!(site.dir.path().join("arm.checkpoint").exists());
    fs::rename(site.out(), site.dir.path().join("first")).expect("rename");

    let warm = [
        &QUICK[..],
        &["--set", &dir, "--duration", "8", "--speed", "2", "--warm"],
    ]
    .concat();
    let mut run = site.start_run(&warm);
    let mut observer = site.observer();
    observer.estimate("an estimate", |e| e.block > 2);
    for command in [
        &["set", "forgetting_factor=0.8"][..],
        &["fix", "theta_5"],
        &["set", "block_len=150"],
        &["pause"],
        &["resume"],
        &["free", "theta_5"],
        &["reset"],
    ] {
        ask(&site, command, 0);
        let block = observer.last_estimate.expect("an estimate").block;
        observer.estimate("a block later", |e| e.block > block);
    }
    run.expect_code(0);
    let live = fs::read_to_string(site.out().join("estimates.csv")).expect("estimates.csv");
    let recording = site.out().join("recording.mcap");

    let out = site.dir.path().join("offline");
    let mut identify = site.start(Program::Thetabus, &["identify", text(&recording), "--out", text(&out)]);
    identify.expect_code(0);
    let offline = fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    assert!(offline == live, "off line differs\n{}", identify.said());

    let config = site.out().join("config.toml");
    let replayed = site.dir.path().join("replayed");
    let monitor = site.start(Program::Monitor, &["--config", text(&config), "--out", text(&replayed)]);
    monitor.wait_for_log("monitor");
    let identifier = site.start(Program::Identifier, &["--config", text(&config)]);
    identifier.wait_for_log("identifier");
    let set = ["--set", "bus.lockstep_consumers=1"];
    let mut replay = site.start(Program::Thetabus, &[&["replay", text(&recording)], &set[..]].concat());
    replay.expect_code(0);
    let lines = live.lines().count();
    eventually("the replayed estimates are those of the run", || {
        let again = fs::read_to_string(replayed.join("estimates.csv")).ok()?;
        (again.lines().count() == lines).then(|| assert!(again == live, "the replay differs\n{}", replay.said()))
    });
}
