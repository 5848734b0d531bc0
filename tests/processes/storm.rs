//! A storm of kills beside a plant in real time: the plant does not stall, estimates are right
//! again, recordings can be read.

use crate::support::{PAPER, Process, Program, QUICK, Site};
use nix::sys::signal::Signal;
use std::path::Path;
use std::time::{Duration, Instant};
use thetabus::recording::{Entry, RecordingReader, Span};
use thetabus::sim::SimOptions;

/// Longest time between two samples that the storm may cause \[ns\].
const STALL: u64 = 50_000_000;
/// How long the plant runs before the storm, for its own pauses on this machine.
const CALM: Duration = Duration::from_secs(4);
/// How long an identifier has after the storm.
const RECOVERY: Duration = Duration::from_secs(10);

const CONSTANT: [&str; 4] = [
    "--set",
    "plant.mass_2.t_s=[0.0]",
    "--set",
    "plant.mass_2.mass_kg=[150.0]",
];

/// When the samples of a recording were sent, by CLOCK_MONOTONIC \[ns\].
fn times_of_sending(recording: &Path) -> Vec<u64> {
    let mut reader = RecordingReader::open(recording, Span::default()).expect("a recording");
    let mut times = Vec::new();
    while let Some(entry) = reader.next_entry().expect("it can be read") {
        if let Entry::Sample { sent_ns, .. } = entry {
            times.push(sent_ns);
        }
    }
    times
}

fn longest(times: impl Iterator<Item = u64> + Clone) -> u64 {
    let later = times.clone().skip(1);
    times.zip(later).map(|(a, b)| b - a).max().expect("samples")
}

fn storm(kills: u64) {
    let site = Site::new();
    let path = |name: &str| site.dir.path().join(name);
    let paper = ["--config", PAPER];
    let plant = [&paper[..], &["--speed", "1", "--duration", "100000"], &CONSTANT].concat();
    let mut plant = site.start(Program::Plant, &plant);
    let witness = path("witness.mcap");
    let args = [&paper[..], &["--record", witness.to_str().expect("UTF-8")]].concat();
    let mut witness_process = site.start(Program::Monitor, &args);
    witness_process.wait_for_log(" monitor");
    std::thread::sleep(CALM);

    let storm_begins = thetabus::bus::monotonic_ns();
    for n in 0..kills {
        let recording = format!("{n}.mcap");
        let mut victim = match n % 4 {
            0 | 1 => site.start(Program::Identifier, &[&paper[..], &QUICK].concat()),
            2 => site.start(Program::Monitor, &[&paper[..], &["--record", &recording]].concat()),
            _ => site.start(Program::Thetabus, &["doctor", "--clean"]),
        };
        // The golden ratio spreads them evenly over half a second.
        let fraction = (n as f64 * 0.618_033_988_749_895).fract();
        std::thread::sleep(Duration::from_secs_f64(0.5 * fraction));
        if victim.is_running() {
            victim.signal(Signal::SIGKILL);
        }
        victim.wait();
    }
    let storm_ends = thetabus::bus::monotonic_ns();
    let mut observer = site.observer();
    let _identifier: Process = site.start(Program::Identifier, &[&paper[..], &QUICK].concat());
    let start = Instant::now();
    let last = observer.estimate("an estimate after the recovery", |_| start.elapsed() > RECOVERY);
    let truth = SimOptions::cedro2022().true_theta(0.0);
    for i in 3..9 {
        let error = (last.theta[i] / truth[i] - 1.0).abs();
        assert!(error < 3e-4, "theta_{}: {error:e}", i + 1);
    }
    for process in [&mut plant, &mut witness_process] {
        assert!(process.is_running(), "{}", process.said());
        process.signal(Signal::SIGTERM);
        process.expect_code(0);
    }

    let times = times_of_sending(&witness);
    let before = longest(times.iter().copied().filter(|&t| t < storm_begins));
    let during = longest(
        times
            .iter()
            .copied()
            .filter(|&t| (storm_begins..storm_ends).contains(&t)),
    );
    eprintln!(
        "{kills} kills: longest time between two samples {:.1} ms, before the storm {:.1} ms",
        during as f64 * 1e-6,
        before as f64 * 1e-6
    );
    // A machine that others use stalls a process without real-time priority by itself.
    assert!(
        during < STALL.max(4 * before),
        "{during} ns, before the storm {before} ns"
    );
    let mut read = 0;
    for n in 0..kills {
        // One that was killed before its definitions were in it has no name yet.
        let recording = path(&format!("{n}.mcap"));
        if recording.exists() {
            times_of_sending(&recording);
            read += 1;
        }
    }
    assert!(read > kills / 10, "{read} recordings of {kills} kills");
}

#[test]
fn fault_a_storm_of_kills_neither_stalls_the_plant_nor_spoils_estimates_or_recordings() {
    storm(24);
}

#[test]
#[ignore = "some three minutes"]
fn fault_a_storm_of_four_hundred_kills() {
    storm(400);
}
