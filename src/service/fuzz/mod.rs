//! Hostile files and messages by the thousand: no panic, no abort, no hang, in a gigabyte of
//! memory.
//!
//! Each target runs in a separate process (this test program, started again), so that the memory
//! limit (`RLIMIT_AS`) holds and an abort is detected. A case is determined by its target and
//! number: `THETABUS_FUZZ=mcap:1234:1 cargo test --release --lib service::fuzz::worker -- --ignored
//! --exact` runs number 1234 again.

mod corpora;
mod hostile;
mod mutate;
mod robots;
mod targets;

use corpora::Corpora;
use mutate::Random;
use nix::sys::resource::{Resource, setrlimit};
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use targets::TARGETS;

/// A worker's task: target, first case, number of cases.
const TASK: &str = "THETABUS_FUZZ";
/// Directory for its files.
const DIRECTORY: &str = "THETABUS_FUZZ_DIR";
/// File with the case that it has begun.
const PROGRESS: &str = "progress";
/// Memory that a worker may map.
const MEMORY: u64 = 1 << 30;
/// A case takes milliseconds; this is a hang even on a busy machine.
const LONGEST: Duration = Duration::from_secs(20);
/// Number of cases in the suite, and in the separate long test.
const FEW: u64 = 500;
const MANY: u64 = 10_000;

#[test]
fn fault_500_hostile_inputs_of_each_kind_end_in_no_panic_abort_or_hang() {
    for (target, _) in TARGETS {
        fuzz(target, FEW);
    }
}

#[test]
#[ignore = "takes minutes"]
fn fault_10_000_hostile_inputs_of_each_kind_end_in_no_panic_abort_or_hang() {
    for (target, _) in TARGETS {
        fuzz(target, MANY);
    }
}

#[test]
#[ignore = "a part of the tests above, which start it"]
fn worker() {
    let Ok(task) = std::env::var(TASK) else { return };
    let parts: Vec<&str> = task.split(':').collect();
    let [target, first, cases] = parts[..] else {
        panic!("expected TARGET:FIRST:CASES, got {task}")
    };
    let [first, cases] = [first, cases].map(|text| text.parse::<u64>().expect("a number"));
    let (name, run) = TARGETS
        .into_iter()
        .find(|(name, _)| *name == target)
        .unwrap_or_else(|| panic!("no target {target}"));
    let own = tempfile::tempdir().expect("a directory");
    let dir = std::env::var_os(DIRECTORY).map_or(own.path().to_path_buf(), Into::into);
    setrlimit(Resource::RLIMIT_AS, MEMORY, MEMORY).expect("a limit on memory");
    let corpora = Corpora::new(&dir);
    for case in first..first + cases {
        fs::write(dir.join(PROGRESS), case.to_string()).expect("progress");
        let start = Instant::now();
        run(&mut Random::of(name, case), &corpora);
        assert!(start.elapsed() < LONGEST, "case {case} took {:?}", start.elapsed());
    }
}

/// Runs the cases 0 up to `cases` of a target.
fn fuzz(target: &str, cases: u64) {
    let dir = tempfile::tempdir().expect("a directory");
    let errors = dir.path().join("stderr");
    let start = Instant::now();
    let mut worker = Command::new(std::env::current_exe().expect("this program"))
        .args([
            "service::fuzz::worker",
            "--exact",
            "--ignored",
            "--nocapture",
            "--test-threads=1",
        ])
        .env(TASK, format!("{target}:0:{cases}"))
        .env(DIRECTORY, dir.path())
        .env("RUST_LOG", "off")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&errors).expect("a file"))
        .spawn()
        .expect("it starts");
    let mut last = (progress(dir.path()), Instant::now());
    let status = loop {
        if let Some(status) = worker.try_wait().expect("a child") {
            break status;
        }
        let now = progress(dir.path());
        if now != last.0 {
            last = (now, Instant::now());
        }
        if last.1.elapsed() > 2 * LONGEST {
            let _ = worker.kill();
            let _ = worker.wait();
            panic!("{target}, case {:?} hangs", last.0);
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let reached = progress(dir.path());
    let said = fs::read(&errors).unwrap_or_default();
    let said = String::from_utf8_lossy(&said[said.len().saturating_sub(4000)..]).into_owned();
    assert!(status.success(), "{target}, case {reached:?}: {status}\n{said}");
    // A worker that found no test to run would also succeed.
    assert_eq!(reached, Some(cases - 1), "{target}: not all cases were run");
    eprintln!("{target}: {cases} cases in {:.1} s", start.elapsed().as_secs_f64());
}

fn progress(dir: &Path) -> Option<u64> {
    fs::read_to_string(dir.join(PROGRESS)).ok()?.parse().ok()
}
