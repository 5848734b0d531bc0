//! Started in any order, restarted, killed: the three programs find each other.

use crate::support::{Process, Program, QUICK, Site, eventually};
use nix::sys::signal::Signal;
use std::time::Duration;

/// Five simulated seconds at full speed: 5000 samples, 25 blocks.
const SHORT: [&str; 2] = ["--duration", "5"];

fn identifier(site: &Site) -> Process {
    site.start(Program::Identifier, &QUICK)
}

fn plant(site: &Site, args: &[&str]) -> Process {
    site.start(Program::Plant, &[args, &QUICK[..]].concat())
}

#[test]
fn e2e_identifier_first_then_monitor_then_plant() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut identifier = identifier(&site);
    identifier.wait_for_log("waiting for its samples");
    let out = site.out();
    let mut monitor = site.start(
        Program::Monitor,
        &[&["--out", out.to_str().expect("UTF-8")], &QUICK[..]].concat(),
    );
    monitor.wait_for_log("monitor");
    plant(&site, &SHORT).expect_code(0);
    let status = observer.end();
    assert_eq!(
        (status.accepted, status.missing, status.rejected, status.estimates),
        (5_000, 0, 0, 25)
    );
    monitor.wait_for_log("block   25");
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(0);
    assert!(
        monitor.stdout().contains("25 blocks, 5000 samples accepted, 0 missing"),
        "{}",
        monitor.said()
    );
    assert_eq!(site.summary().blocks, 25);
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
}

/// 60 samples in a quarter of a second: fewer than the plant keeps for who connects late.
#[test]
fn e2e_started_by_hand_in_real_time_the_first_block_is_never_lost() {
    let site = Site::new();
    let mut observer = site.observer();
    let keys = ["--set", "estimator.block_len=50"];
    let identifier = site.start(Program::Identifier, &keys);
    identifier.wait_for_log("waiting for its samples");
    std::thread::sleep(Duration::from_millis(50));
    for start in 1..=20 {
        let short = ["--speed", "0.25", "--duration", "0.06"];
        site.start(Program::Plant, &[&short[..], &keys].concat()).expect_code(0);
        let status = observer.status("the end of this stream", |status| {
            status.streams == start && status.state == thetabus::messages::State::Ended as u32
        });
        assert_eq!(
            (status.accepted, status.missing, status.estimates, status.last_block),
            (60, 0, 1, 1),
            "start {start}"
        );
    }
}

#[test]
fn e2e_identifier_last() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut plant = plant(&site, &SHORT);
    plant.wait_for_log("waiting for consumers");
    let _identifier = identifier(&site);
    plant.expect_code(0);
    let status = observer.end();
    assert_eq!((status.accepted, status.missing, status.estimates), (5_000, 0, 25));
}

#[test]
fn fault_an_identifier_killed_and_restarted_goes_on_with_the_next_whole_block() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut plant = plant(&site, &["--speed", "2"]);
    let mut first = identifier(&site);
    let before = observer.estimate("a second block", |estimate| estimate.block >= 2);
    first.signal(Signal::SIGKILL);
    first.wait();
    let second = identifier(&site);
    let pid = second.pid();
    observer.status("the second one's heartbeat", |status| {
        status.pid == pid && status.estimates > 0
    });
    let after = observer.estimate("a later block", |estimate| estimate.block > before.block);
    assert_eq!(after.stream_id, before.stream_id, "the plant is the same");
    // Blocks are cut by seq, so the restart has not moved their borders: block m ends with sample
    // 200 m − 1.
    assert_eq!(after.t_last_ns, (200 * after.block - 1) * 1_000_000);
    // What was sent before it listened is not missing.
    assert_eq!(after.missing, 0);
    assert!(plant.is_running(), "{}", plant.said());
}

#[test]
fn fault_in_lockstep_the_plant_waits_for_a_restarted_identifier() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut plant = plant(
        &site,
        &["--set", "bus.delivery=lockstep", "--speed", "20", "--duration", "60"],
    );
    let mut first = identifier(&site);
    observer.estimate("a second block", |estimate| estimate.block >= 2);
    first.signal(Signal::SIGKILL);
    first.wait();
    let _second = identifier(&site);
    plant.expect_code(0);
    let status = observer.end();
    assert_eq!((status.missing, status.last_seq), (0, 59_999), "{status:?}");
}

#[test]
fn fault_a_plant_killed_and_restarted_starts_a_new_stream() {
    let site = Site::new();
    let mut observer = site.observer();
    let _identifier = identifier(&site);
    let mut first = plant(&site, &["--speed", "2"]);
    let before = observer.estimate("a first block", |_| true);
    first.signal(Signal::SIGKILL);
    first.wait();
    // The other delivery mode, too: the identifier has let go of the topic.
    plant(&site, &SHORT).expect_code(0);
    let status = observer.end();
    assert_ne!(status.stream_id, before.stream_id);
    assert_eq!((status.streams, status.accepted, status.missing), (2, 5_000, 0));
}

#[test]
fn fault_a_plant_restarted_after_everybody_was_killed_needs_no_cleaning_up() {
    let site = Site::new();
    for _ in 0..3 {
        let mut observer = site.observer();
        let mut processes = [
            plant(&site, &["--speed", "2"]),
            identifier(&site),
            site.start(Program::Monitor, &QUICK),
        ];
        observer.estimate("a block", |estimate| estimate.block >= 2);
        for process in &mut processes {
            process.signal(Signal::SIGKILL);
            process.wait();
        }
    }
    let mut observer = site.observer();
    let _identifier = identifier(&site);
    plant(&site, &SHORT).expect_code(0);
    assert_eq!(observer.end().accepted, 5_000);
}

#[test]
fn fault_processes_stopped_and_continued_go_on() {
    let site = Site::new();
    let mut observer = site.observer();
    let plant = plant(&site, &["--speed", "2"]);
    let identifier = identifier(&site);
    for process in [&identifier, &plant] {
        let block = observer.estimate("a block", |_| true).block;
        process.signal(Signal::SIGSTOP);
        std::thread::sleep(Duration::from_millis(700));
        process.signal(Signal::SIGCONT);
        let after = observer.estimate("later blocks", |estimate| estimate.block > block + 2);
        // 700 ms at twice the speed are 1400 samples, and the queue holds 4096.
        assert_eq!(after.missing, 0);
    }
    let pid = identifier.pid();
    eventually("the heartbeat goes on", || {
        observer.look();
        observer.last_status.filter(|status| status.pid == pid)
    });
}

#[test]
fn fault_damaged_leftovers_of_a_crash_are_swept_away_by_the_next_start() {
    let site = Site::new();
    for damage in [
        "",
        "cut",
        "not what iceoryx2 writes, \u{1}\u{2}\u{3}, and longer than what it expects",
    ] {
        let mut observer = site.observer();
        let mut processes = [plant(&site, &["--speed", "2"]), identifier(&site)];
        observer.estimate("a block", |estimate| estimate.block >= 2);
        for process in &mut processes {
            process.signal(Signal::SIGKILL);
            process.wait();
        }
        // Left by a process that cannot be asked, as the observer could be: it goes as well, but
        // its services stay.
        let (root, prefix) = (site.domain.root(), site.domain.prefix());
        let services: Vec<_> = std::fs::read_dir(root.join("services"))
            .expect("services")
            .flatten()
            .collect();
        assert!(!services.is_empty());
        let kept: Vec<_> = services
            .iter()
            .map(|entry| (entry.path(), std::fs::read(entry.path()).expect("read")))
            .collect();
        drop(observer);
        for (path, content) in kept {
            let text = match damage {
                "" => Vec::new(),
                "cut" => content[..content.len() / 2].to_vec(),
                text => text.as_bytes().to_vec(),
            };
            let _ = std::fs::remove_file(&path);
            std::fs::write(&path, text).expect("write");
        }
        let name = format!("/dev/shm/{prefix}{}_1.data", "0a".repeat(20));
        std::fs::write(&name, "rubbish").expect("write");

        let next = site.observer();
        assert!(
            !std::fs::exists(&name).expect("known"),
            "rubbish in shared memory is removed"
        );
        drop(next);
        site.start_run(&[&["--duration", "2"], &QUICK[..]].concat())
            .expect_code(0);
        assert_eq!(site.summary().samples.accepted, 2_000);
        std::fs::remove_dir_all(site.out()).expect("results");
    }
}
