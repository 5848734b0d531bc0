//! Late joiners.

use crate::support::{Program, QUICK, Site, eventually};
use std::collections::BTreeSet;
use std::thread;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Subscriber};
use thetabus::messages::Status;

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
    // Publishers look for late joiners every 100 ms; the rest is a busy machine's.
    assert!(waited < Duration::from_secs(10), "{waited:?}");

    let monitor = site.start(Program::Monitor, &QUICK);
    monitor.wait_for_log("block   25");
}

#[test]
fn e2e_an_identifier_without_a_plant_has_a_heartbeat() {
    let site = Site::new();
    let bus = Bus::join(&site.domain, "arm", "observer").expect("join");
    let mut statuses: Subscriber<Status> = Subscriber::new(&bus).expect("subscribe");
    let identifier = site.start(Program::Identifier, &QUICK);
    let pid = identifier.pid();
    // What is sent again for late joiners has the time at which it was first sent.
    let mut beats = BTreeSet::new();
    eventually("three heartbeats", || {
        let beat = |status: &Status, sent_ns| {
            if status.pid == pid {
                beats.insert(sent_ns);
            }
        };
        statuses.drain_timed(beat).expect("drain");
        (beats.len() >= 3).then_some(())
    });
}
