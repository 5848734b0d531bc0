//! Strangers on the network, who publish what they like.

use crate::support::*;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Role, RoleLock, Subscriber};
use thetabus::messages::{Description, Estimate, SCHEMA_VERSION};
use thetabus::recording::{Dimensions, OnWire, to_cdr};
use zenoh::Wait;
use zenoh::qos::CongestionControl;

/// Messages that nobody can read, each with its envelope.
fn garbage(round: u8) -> [(Vec<u8>, Vec<u8>); 5] {
    let of_an_arm = Dimensions {
        joints: 2,
        equations: 2,
        parameters: 9,
        derived: 1,
    };
    let ours = envelope(SCHEMA_VERSION, round.into(), of_an_arm);
    [
        (vec![], vec![]),
        (vec![round; 100], ours.clone()),
        (vec![0, 1, 0, 0, 255, 255, 255, 255], ours),
        (vec![0; 100_000], envelope(SCHEMA_VERSION + 96, 0, of_an_arm)),
        (vec![0, 1, 0, 0], vec![255; 41]),
    ]
}

fn throw(session: &zenoh::Session, key: &str, (payload, envelope): (Vec<u8>, Vec<u8>)) {
    let put = session.put(key, payload).attachment(envelope);
    put.congestion_control(CongestionControl::Block).wait().expect("put");
}

#[test]
fn fault_garbage_on_the_network_is_left_out_and_told() {
    let site = Site::new();
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let inward = site.inward(&["--connect", &at, "--samples", "--max-robots", "1"]);
    inward.says("carries in");
    let session = stranger(&at);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    put(&session, "thetabus/cell/arm/estimate", 0, &estimate(1));
    next(&mut estimates, "the only estimate that there is", |_| true);
    for round in 0..20_u8 {
        for message in garbage(round) {
            for topic in ["estimate", "sample", "description", "journal", "status", "nonsense"] {
                throw(&session, &format!("thetabus/cell/arm/{topic}"), message.clone());
            }
        }
        put(&session, &format!("thetabus/cell/robot-{round}/status"), 0, &status(1));
        session
            .put("thetabus/CELL/arm/estimate", "no host")
            .wait()
            .expect("put");
    }
    inward.says("a message was left out: what came as its estimate");
    inward.says("robot not admitted: there are 1 robots already");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(estimates.drain(|_| {}).expect("looked"), 0);
    session.close().wait().expect("closed");
    let (code, table, log) = inward.end();
    assert_eq!(code.code(), Some(0), "{log}");
    let [carried, _, _, left_out, _] = figures(&table, "thetabus/cell/arm/estimate");
    assert_eq!((carried, left_out), (1, 100), "{table}");
}

#[test]
fn fault_names_of_garbage_take_no_place_and_an_honest_robot_comes_in_behind_them() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let inward = site.inward(&["--connect", &at, "--max-robots", "2"]);
    inward.says("carries in");
    let session = stranger(&at);
    let names = 30_u64;
    let begun = Instant::now();
    for round in 0..2 {
        for name in 0..names {
            for message in garbage(round) {
                throw(&session, &format!("thetabus/cell/made-up-{name}/estimate"), message);
            }
        }
    }
    // A role that a name has taken would be taken here.
    inward.says("robot not admitted: what came as its estimate");
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    let out = site.out(&["--connect", &at]);
    out.says("carries out");
    machine.estimates.send(&estimate(7)).expect("sent");
    machine.until(&mut estimates, "the honest robot's estimate", |estimate| {
        estimate.block == 7
    });
    drop(RoleLock::acquire(&site.far, "made-up-0", Role::Identifier).expect("nobody has this role"));

    let (code, table, log) = inward.end();
    assert_eq!(code.code(), Some(0), "{log}");
    assert!(!table.contains("made-up"), "{table}");
    let count = format!("not readable from robots without a place: {}", 2 * 5 * names);
    assert!(table.contains(&count), "{count} in {table}");
    // Each name once, and no more than ten lines a second.
    let lines: Vec<&str> = log.lines().filter(|line| line.contains("made-up")).collect();
    let told = lines.len() as u64;
    let seconds = begun.elapsed().as_secs() + 1;
    assert!(told <= names && told <= 10 * seconds, "{lines:?}");
    for name in 0..names {
        let of_it = lines
            .iter()
            .filter(|line| line.contains(&format!("\"made-up-{name}\"")))
            .count();
        assert!(of_it <= 1, "{lines:?}");
    }
}

#[test]
fn fault_a_full_inbox_is_told_while_it_lasts_and_what_comes_once_comes_after_it() {
    let site = Site::new();
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let inward = site.inward(&["--connect", &at]);
    inward.says("carries in");
    let session = stranger(&at);
    let bytes = (
        to_cdr(&description()),
        envelope(SCHEMA_VERSION, 0, description().dimensions()),
    );
    let begun = Instant::now();
    let mut count = 0;
    while !inward.stderr().contains("inbox full: ") {
        assert!(begun.elapsed() < WATCHDOG, "{count} in {WATCHDOG:?}");
        throw(&session, "thetabus/cell/flood/description", bytes.clone());
        count += 1;
    }
    // A robot that appears in the middle is asked for what it has sent.
    let mut machine = Machine::new(&site.near);
    let out = site.out(&["--connect", &at]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    eventually("the description, through the flood", || {
        throw(&session, "thetabus/cell/flood/description", bytes.clone());
        machine.tick();
        let mut found = 0;
        descriptions.drain(|_| found += 1).expect("received");
        (found > 0).then_some(())
    });
    inward.says("inbox has room again");
    let (code, table, log) = inward.end();
    assert!(code.success(), "{log}");
    let told = log.lines().filter_map(|line| {
        line.split_once("inbox full: ")?
            .1
            .split(' ')
            .next()?
            .parse::<u64>()
            .ok()
    });
    let count = format!("inbox full: {} messages", told.sum::<u64>());
    assert!(table.contains(&count), "{count} in {table}{log}");
    drop(out);
}
