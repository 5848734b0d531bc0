//! In real time the plant never waits for anybody.

use crate::support::{Program, QUICK, Site};
use nix::sys::signal::Signal;
use std::time::{Duration, Instant};

#[test]
fn rt_a_stopped_monitor_never_slows_the_plant() {
    let site = Site::new();
    let mut observer = site.observer();
    let _identifier = site.start(Program::Identifier, &QUICK);
    let monitor = site.start(Program::Monitor, &QUICK);
    monitor.wait_for_log("monitor");
    let start = Instant::now();
    // 100 blocks: more than the monitor's queue of 64 holds.
    let mut plant = site.start(
        Program::Plant,
        &[&["--speed", "4", "--duration", "20"], &QUICK[..]].concat(),
    );
    monitor.wait_for_log(" usable");
    monitor.signal(Signal::SIGSTOP);
    plant.expect_code(0);
    let wall = start.elapsed();
    let status = observer.end();
    assert_eq!((status.missing, status.last_seq), (0, 19_999));
    // In real time an identifier may come too late for the first sample, and then skips what it
    // joined half-way.
    assert!(status.estimates > 64, "{status:?}");
    // 20 s at four times the speed take 5 s; waiting for a monitor that is never continued would
    // take for ever.
    assert!(wall >= Duration::from_secs(5), "{wall:?}");
    assert!(
        !plant.stderr().contains("WARN"),
        "it kept its pace:\n{}",
        plant.stderr()
    );
    monitor.signal(Signal::SIGCONT);
    monitor.wait_for_log("block  100");
}

#[test]
fn rt_a_stopped_identifier_never_slows_the_plant_and_its_loss_is_counted() {
    let site = Site::new();
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    // 20 000 samples: more than its queue of 4096 holds.
    let mut plant = site.start(
        Program::Plant,
        &[&["--speed", "10", "--duration", "20"], &QUICK[..]].concat(),
    );
    let before = observer.status("samples", |status| status.accepted > 0);
    identifier.signal(Signal::SIGSTOP);
    plant.expect_code(0);
    identifier.signal(Signal::SIGCONT);
    let status = observer.end();
    assert_eq!(status.last_seq, 19_999);
    assert_eq!(status.stream_id, before.stream_id);
    assert!(status.missing > 5_000, "{status:?}");
    // Whatever was not taken in was counted, but for what was sent before it listened.
    assert!(
        status.accepted + status.missing + status.rejected > 19_000,
        "{status:?}"
    );
}
