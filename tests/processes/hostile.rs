//! Difficult files and limits: full disks, pipes in place of files, recordings that ask for
//! gigabytes, no threads.

use crate::peers::{Place, User, permitted};
use crate::support::{PAPER, Process, Program, QUICK, Site};
use nix::sys::signal::Signal;
use std::process::Command;
use std::time::{Duration, Instant};

const IDENTIFIER: &str = env!("CARGO_BIN_EXE_identifier");
const THETABUS: &str = env!("CARGO_BIN_EXE_thetabus");

/// Half a file would stand in the way of the next try, because nothing is written over.
#[test]
fn fault_a_full_disk_leaves_no_half_file() {
    let try_it = r#"cd "$(mktemp -d)" && mkdir disk && mount -t tmpfs -o size=64k tmpfs disk"#;
    if !permitted("unshare", &["--mount", "--propagation", "private", "sh", "-c", try_it]) {
        return;
    }
    let site = Site::new();
    site.start_run(&["--speed", "max", "--duration", "10"]).expect_code(0);
    let script = r#"
        mkdir disk && mount -t tmpfs -o size=16k tmpfs disk || exit 3
        "$0" export "$1" --out disk/samples.csv; echo "export: $?"
        "$0" excite "$2" --duration 8 --tries 2 --out disk/motion.csv; echo "excite: $?"
        echo "files: $(ls disk)."
    "#;
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");
    let mut command = Command::new("unshare");
    command
        .current_dir(site.dir.path())
        .args(["--mount", "--propagation", "private", "sh", "-c", script, THETABUS])
        .arg(site.out())
        .arg(robot);
    let mut all = Process::start(command);
    all.expect_code(0);
    let (said, errors) = (all.stdout(), all.stderr());
    for line in ["export: 1", "excite: 1", "files: ."] {
        assert!(said.contains(line), "{line}: {said}{errors}");
    }
    assert_eq!(errors.matches("No space left").count(), 2, "{errors}");
}

#[test]
fn fault_a_full_disk_leaves_the_previous_checkpoint_and_the_identifier_running() {
    let mount = "mkdir disk && mount -t tmpfs -o size=256k tmpfs disk";
    let try_it = r#"cd "$(mktemp -d)" && mkdir disk && mount -t tmpfs -o size=64k tmpfs disk"#;
    if !permitted("unshare", &["--mount", "--propagation", "private", "sh", "-c", try_it]) {
        return;
    }
    let site = Site::new();
    // Each message waits for what it says; the watchdog of this test ends a wait that is in vain.
    let script = r#"
        plant=$0; identifier=$1; thetabus=$2; shift 3
        "$plant" --speed 4 --duration 100000 "$@" 2>plant.log & plant_pid=$!
        "$identifier" "$@" 2>identifier.log & identifier_pid=$!
        until [ -s disk/arm.checkpoint ]; do sleep 0.05; done
        # A checkpoint that takes the place of the last one frees that one's pages: fill again until none is left.
        until grep -q "the previous checkpoint stays" identifier.log; do
            head -c 300k /dev/zero >> disk/stranger 2>/dev/null; sleep 0.05
        done
        grep -q "No space left on device" identifier.log && echo "said why"
        before=$(cksum < disk/arm.checkpoint)
        sleep 1
        [ "$before" = "$(cksum < disk/arm.checkpoint)" ] && echo "previous checkpoint kept"
        echo "files: $(ls disk | tr '\n' ' ')"
        echo "said $(grep -c "the previous checkpoint stays" identifier.log) times"
        "$thetabus" ctl save "$@" 2>save.log; echo "save: $? $(grep -c "No space left" save.log)"
        "$thetabus" ctl describe "$@" >/dev/null && echo "answers"
        rm disk/stranger
        until grep -q "checkpoints can be written again" identifier.log; do sleep 0.05; done
        [ "$before" = "$(cksum < disk/arm.checkpoint)" ] || echo "renewed"
        kill $identifier_pid; wait $identifier_pid; echo "ended: $?"
        "$identifier" --warm "$@" 2>warm.log & identifier_pid=$!
        until grep -q "warm start from" warm.log; do kill -0 $identifier_pid || break; sleep 0.05; done
        kill $identifier_pid; wait $identifier_pid; echo "warm: $?"
        kill $plant_pid; wait $plant_pid
    "#;
    // `ctl` takes no --set, so all keys stand in a file.
    let config = site.dir.path().join("config.toml");
    let text = std::fs::read_to_string(PAPER).expect("a configuration");
    let keys = format!(
        "{text}\n[checkpoint]\ndir = \"{}/disk\"\nperiod_s = 0.1\n",
        site.dir.path().display()
    );
    std::fs::write(&config, keys).expect("write");
    let script = format!("{mount} && {{ {script} }}");
    let mut command = Command::new("unshare");
    command
        .current_dir(site.dir.path())
        .args(["--mount", "--propagation", "private", "sh", "-c", &script])
        .args([env!("CARGO_BIN_EXE_plant_simulator"), IDENTIFIER, THETABUS, "--"])
        .arg("--config")
        .arg(&config)
        .args(["--domain", site.domain.name()]);
    let mut all = Process::start(command);
    all.expect_code(0);
    let said = all.stdout();
    for line in [
        "said why",
        "previous checkpoint kept",
        "files: arm.checkpoint stranger ",
        "said 1 times",
        "save: 1 1",
        "answers",
        "renewed",
        "ended: 0",
        "warm: 0",
    ] {
        assert!(
            said.lines().any(|found| found == line),
            "{line:?} is not in\n{}",
            all.said()
        );
    }
}

#[test]
fn fault_a_recording_that_asks_for_gigabytes_is_refused_in_a_gigabyte() {
    let site = Site::new();
    let file = site.dir.path().join("long.mcap");
    let file = file.to_str().expect("UTF-8");
    let long = ["--config", PAPER, "--set", "estimator.block_len=10000000"];
    // A recorder makes no blocks, so that it can record what no reader should believe.
    let mut monitor = site.start(Program::Monitor, &[&long[..], &["--record", file]].concat());
    monitor.wait_for_log(" monitor");
    let plant = ["--config", PAPER, "--speed", "4", "--duration", "4"];
    site.start(Program::Plant, &plant).expect_code(0);
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(0);

    let identify = |own: &[&str]| {
        let mut command = Command::new("prlimit");
        command
            .current_dir(site.dir.path())
            .args(["--as=1073741824", "--", THETABUS, "identify", file])
            .args(own);
        Process::start(command)
    };
    let mut refused = identify(&[]);
    refused.expect_code(2);
    refused.expect_stderr(&[
        file,
        "estimator.block_len: expected blocks whose rows take at most 512 MiB",
        "got 10000000 samples per block",
        "--set estimator.block_len=",
    ]);
    identify(&QUICK).expect_code(0);
}

#[test]
fn fault_a_named_pipe_in_the_place_of_a_file_is_refused_and_not_waited_for() {
    let site = Site::new();
    let pipe = |name: &str| {
        let path = site.dir.path().join(name);
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).expect("a pipe");
        path.to_str().expect("UTF-8").to_owned()
    };
    let (config, log, recording) = (pipe("p.toml"), pipe("p.csv"), pipe("p.mcap"));
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robots/six_axis.toml");
    std::fs::create_dir(site.dir.path().join("result")).expect("a directory");
    let _results = ["result/summary.json", "result/covariance.csv"].map(pipe);
    let commands: [&[&str]; 12] = [
        &["config", "check", &config],
        &["run", &config],
        &["identify", &log, "--config", PAPER],
        &["identify", &recording],
        &["report", &recording],
        &["replay", &recording],
        &["export", &recording],
        &["identify", &log, "--config", robot],
        &["config", "check", robot, "--motion", &log],
        &["calibrate", &log, &log, "--config", robot, "--mass", "1"],
        &["excite", robot, "--residuals", &log],
        &["urdf", "result", "--config", robot, "--out", "new.urdf"],
    ];
    for words in commands {
        let start = Instant::now();
        let mut command = Command::new(THETABUS);
        command.current_dir(site.dir.path()).args(words);
        let mut program = Process::start(command);
        let status = program.wait();
        assert!(
            !status.success() && start.elapsed() < Duration::from_secs(20),
            "{words:?}"
        );
        program.expect_stderr(&["named pipe"]);
    }
    // What a shell passes as `<(…)` has its writer.
    let mut command = Command::new("bash");
    let script = r#""$0" config check <(cat "$1")"#;
    command.args(["-c", script, THETABUS, PAPER]);
    Process::start(command).expect_code(0);
}

/// A user of this test alone, whose processes and threads are counted.
const LONELY: User = User(65_531);

#[test]
fn fault_a_join_without_a_thread_to_watch_over_it_is_refused_in_words() {
    if !LONELY.is_possible() || !permitted("prlimit", &["--nproc=100", "--", "true"]) {
        return;
    }
    let place = Place::new(LONELY);
    // The program and its handler of signals.
    let mut identifier = Process::start(place.command(&["prlimit", "--nproc=2", "--"], IDENTIFIER, &[]));
    identifier.expect_code(1);
    identifier.expect_stderr(&["needs a thread of its own", "ulimit -u"]);
}
