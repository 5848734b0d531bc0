//! Long runs: memory does not grow, nothing is lost, Γ does not drift.
//!
//! The short one belongs to the suite; the long ones are run by hand, see docs/deployment.md.

use crate::support::{ENCODERS, PAPER, Site, column};
use nix::unistd::Pid;
use std::time::Duration;

/// Memory of a process's own \[KiB\], without what it shares; `None` once it has ended.
fn own_memory_kib(pid: Pid) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    line.trim().trim_end_matches(" kB").parse().ok()
}

/// Slope and standard deviation of the line's points around it, over an even grid of `n` points
/// from 0 to 1.
fn line(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let x = |i: usize| i as f64 / (n - 1.0).max(1.0);
    let mean = values.iter().sum::<f64>() / n;
    let (mut xx, mut xy) = (0.0, 0.0);
    for (i, value) in values.iter().enumerate() {
        xx += (x(i) - 0.5).powi(2);
        xy += (x(i) - 0.5) * (value - mean);
    }
    let slope = xy / xx;
    let rest = values
        .iter()
        .enumerate()
        .map(|(i, value)| (value - mean - slope * (x(i) - 0.5)).powi(2))
        .sum::<f64>();
    (slope, (rest / n).sqrt())
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// A run of `samples` samples, looked at once per `look`; every claim of the file's head is checked
/// at the end.
fn soak(config: &str, samples: u64, look: Duration, args: &[&str]) {
    let site = Site::new();
    let mut observer = site.observer();
    let duration = (samples as f64 / 1e3).to_string();
    // What σ allows for a drift follows what the last hundred blocks say of one, by some 20 %, and
    // what it allows for viscous friction falls with all of them; here Γ alone is judged.
    let fixed = [
        config,
        "--duration",
        &duration,
        "--set",
        "estimator.max_iterations=10",
        "--set",
        "identifier.considered.drift_per_s=0.0",
        "--set",
        "identifier.considered.viscous=0.0",
    ];
    let mut run = site.start_run(&[&fixed[..], args].concat());
    let roles = ["plant", "identifier", "monitor"];
    let pids = roles.map(|role| site.child(&run, role));
    let mut memory: [Vec<f64>; 3] = Default::default();
    let mut asymmetry = 0.0f64;
    while run.is_running() {
        observer.look();
        if let Some(status) = observer.last_status.filter(|status| status.estimates > 0) {
            asymmetry = asymmetry.max(status.asymmetry);
            for (list, pid) in memory.iter_mut().zip(pids) {
                list.extend(own_memory_kib(pid));
            }
        }
        std::thread::sleep(look);
    }
    run.expect_code(0);
    let summary = site.summary();
    assert_eq!(
        (
            summary.samples.accepted,
            summary.samples.missing,
            summary.samples.rejected
        ),
        (samples, 0, 0)
    );
    // What it said between two looks still lies in the queue.
    observer.look();
    assert_eq!(observer.last_status.expect("a heartbeat").missing, 0);
    // The monitor remembers its last 16 384 blocks, 48 bytes each and some for the list: a run that
    // fills it is judged from its middle on.
    let blocks = samples as usize / 1900;
    let (settling, remembered_kib) = match blocks / 2 > 16_384 {
        true => (2, 0.0),
        false => (4, blocks as f64 * 0.064),
    };
    for (role, memory) in roles.iter().zip(&memory) {
        // What is still filling up at first has been filled by then.
        let settled = &memory[memory.len() / settling..];
        let (growth, scatter) = line(settled);
        println!(
            "{role}: {} looks, {:.0} KiB, growth {growth:+.1} KiB, scatter {scatter:.1} KiB",
            settled.len(),
            median(settled)
        );
        // An allocator gives and takes pages of 4 KiB by the dozen; a leak of a byte per sample
        // would be thousands.
        assert!(
            growth < 128.0 + remembered_kib,
            "{role} grew by {growth:.1} KiB, from {} to {}",
            settled[0],
            settled[settled.len() - 1]
        );
    }
    // Γ is what deviations are made of: with as much forgotten as is learnt it stays where it is,
    // block after block.
    let csv = site.out().join("estimates.csv");
    for i in 1..=9 {
        let std = column(&csv, &format!("theta_{i}_std"));
        let ln: Vec<f64> = std[std.len() / 4..].iter().map(|value| value.ln()).collect();
        let (drift, scatter) = line(&ln);
        // Blocks see different parts of the motion; a drift would carry all of them along.
        let error = scatter * (12.0 / ln.len() as f64).sqrt();
        println!("ln std theta_{i}: drift {drift:+.4}, scatter {scatter:.3}, error {error:.4}");
        assert!(
            drift.abs() < 0.2 + 5.0 * error,
            "theta_{i}: Γ drifts by a factor of {:.3}",
            drift.exp()
        );
    }
    assert!(asymmetry < 1e-9, "{asymmetry}");
    println!(
        "{samples} samples in {:.1} s, asymmetry {asymmetry:.1e}",
        summary.wall_s.expect("measured")
    );
    drop(observer);
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn rt_four_million_samples_in_lockstep_neither_grow_lose_nor_drift() {
    soak(PAPER, 4_000_000, Duration::from_millis(50), &["--no-record"]);
}

#[test]
fn rt_two_million_samples_of_encoders_in_lockstep_neither_grow_lose_nor_drift() {
    soak(ENCODERS, 2_000_000, Duration::from_millis(50), &["--no-record"]);
}

#[test]
#[ignore = "half an hour"]
fn rt_half_an_hour_at_1_khz() {
    // A recording ends with an index that grows until then, 0.4 KiB a second; with small files it
    // begins anew every two minutes.
    let recorded = [
        "--speed",
        "1",
        "--set",
        "monitor.record_file_mib=8",
        "--set",
        "monitor.record_files=0",
    ];
    soak(ENCODERS, 1_800_000, Duration::from_secs(1), &recorded);
}

#[test]
#[ignore = "some five minutes"]
fn rt_a_hundred_million_samples_in_lockstep() {
    soak(PAPER, 100_000_000, Duration::from_millis(500), &["--no-record"]);
}
