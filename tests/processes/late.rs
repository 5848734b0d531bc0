//! Late joiners.

use crate::support::{Program, QUICK, Site};
use std::thread;
use std::time::{Duration, Instant};

#[test]
fn e2e_a_monitor_attached_after_the_end_gets_the_last_estimate_at_once() {
    let site = Site::new();
    let mut early = site.observer();
    let _identifier = site.start(Program::Identifier, &QUICK);
    site.start(Program::Plant, &[&["--duration", "5"], &QUICK[..]].concat())
        .expect_code(0);
    early.end();
    // Long silent: whatever comes now comes from the history.
    thread::sleep(Duration::from_millis(300));

    let start = Instant::now();
    let mut late = site.observer();
    let estimate = late.estimate("the last estimate", |_| true);
    let waited = start.elapsed();
    assert_eq!(estimate.block, 25);
    assert_eq!(late.end().accepted, 5_000);
    // Publishers look for late joiners every 100 ms; the rest is the scheduler's.
    assert!(waited < Duration::from_secs(2), "{waited:?}");

    let monitor = site.start(Program::Monitor, &QUICK);
    monitor.wait_for_log("block   25");
}

#[test]
fn e2e_an_identifier_without_a_plant_has_a_heartbeat() {
    let site = Site::new();
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    let pid = identifier.pid();
    let mut beats = 0;
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(2_500) {
        observer.look();
        beats += usize::from(observer.last_status.take().is_some_and(|status| status.pid == pid));
        thread::sleep(Duration::from_millis(20));
    }
    assert!(beats >= 2, "{beats} in 2.5 s");
}
