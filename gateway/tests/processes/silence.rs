//! Robots that fall silent: their roles in the domain are given back, and taken again.

use crate::support::*;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, BusError, ControlServer, Role, RoleLock, SampleSubscriber, Subscriber};
use thetabus::messages::{Description, Estimate};

/// How long a robot may be silent in these tests, and a time that is longer.
const LIMIT: [&str; 2] = ["--give-back-after", "2"];
const LONGER: Duration = Duration::from_secs(4);

/// Gateways of both ends, with these arguments, connected to each other.
fn both_ends(site: &Site, more: &[&str]) -> (Process, Process) {
    let at = endpoint();
    let out = site.out(&[&["--listen", &at], more].concat());
    let inward = site.inward(&[&["--connect", &at], more, &LIMIT[..]].concat());
    out.says("carries out");
    (out, inward)
}

fn role(site: &Site, role: Role) -> Result<RoleLock, BusError> {
    RoleLock::acquire(&site.far, "arm", role)
}

#[test]
fn fault_a_robot_whose_host_is_gone_gives_its_roles_back_and_takes_them_again() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near).with_samples();
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let out = site.out(&["--connect", &at, "--samples"]);
    let inward = site.inward(&[&["--connect", &at, "--samples"], &LIMIT[..]].concat());
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    machine.estimates.send(&estimate(1)).expect("sent");
    machine.until(&mut estimates, "an estimate", |_| true);
    let mut seq = 0;
    eventually("the plant's role is taken, by the first sample", || {
        machine.tick();
        machine.sample(seq);
        seq += 1;
        role(&site, Role::Plant).is_err().then_some(())
    });
    out.kill();
    inward.says("its gateway has gone");
    assert!(role(&site, Role::Identifier).is_err(), "not at once: it may come back");

    // A machine and an identifier of this domain can be started, with all that they need.
    eventually("the roles are free", || {
        let free = [Role::Identifier, Role::Plant].map(|of| role(&site, of).is_ok());
        free.into_iter().all(|is_free| is_free).then_some(())
    });
    assert!(
        inward.stderr().contains("nothing has come for 2 s"),
        "{}",
        inward.stderr()
    );
    let local = Machine::new(&site.far).with_samples();
    let server = ControlServer::new(&local.bus).expect("served");
    // What the robot sends is not taken in, as long as they are there.
    let out = site.out(&["--connect", &at, "--samples"]);
    eventually("word that another program has the role", || {
        machine.statuses.send(&status(1)).expect("sent");
        machine.tick();
        inward.stderr().contains("robot not admitted").then_some(())
    });
    let holder = format!("process {}", std::process::id());
    assert!(inward.stderr().contains(&holder), "{}", inward.stderr());
    for block in 2..9 {
        machine.estimates.send(&estimate(block)).expect("sent");
    }
    drop((server, local));

    // The last messages come, too, although they were sent while there was no place for them.
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    eventually("the description, again", || {
        machine.statuses.send(&status(2)).expect("sent");
        machine.tick();
        let mut count = 0;
        descriptions.drain(|_| count += 1).expect("received");
        (count > 0).then_some(())
    });
    next(&mut estimates, "the last estimate", |estimate| estimate.block == 8);
    inward.says("robot is back");
    assert!(role(&site, Role::Identifier).is_err());
    let (code, table, log) = inward.end();
    assert!(code.success(), "{log}");
    // One line, and what was sent meanwhile is missing in it.
    let lines = table.lines().filter(|line| line.contains("thetabus/cell/arm/estimate"));
    assert_eq!(lines.count(), 1, "{table}");
    let [carried, _, gaps, _, runs] = figures(&table, "thetabus/cell/arm/estimate");
    assert_eq!((carried, gaps, runs), (2, 6, 2), "{table}");
    drop(out);
}

#[test]
fn fault_a_route_that_returns_with_the_same_gateway_brings_everything_once_more() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let (_out, inward) = both_ends(&site, &[]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    machine.estimates.send(&estimate(1)).expect("sent");
    machine.until(&mut estimates, "an estimate", |_| true);
    // The identifier says nothing for a while, and its gateway goes on.
    inward.says("nothing has come for 2 s");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.statuses.send(&status(1)).expect("sent");
    assert_eq!(next(&mut descriptions, "the description", |_| true), description());
    // Once more to the bus, where nobody has it, and once in the table.
    next(&mut estimates, "the estimate, again", |estimate| estimate.block == 1);
    let (_, table, log) = inward.end();
    assert_eq!(
        figures(&table, "thetabus/cell/arm/estimate"),
        [1, 0, 0, 0, 1],
        "{table}{log}"
    );
}

#[test]
fn fault_a_plant_whose_samples_stop_gives_its_role_back_and_the_identifier_stays() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near).with_samples();
    let (_out, inward) = both_ends(&site, &["--samples"]);
    let mut seq = 0;
    let mut samples_until = |machine: &mut Machine, what: &str, is_done: &mut dyn FnMut() -> bool| {
        eventually(what, || {
            machine.tick();
            machine.statuses.send(&status(seq)).expect("sent");
            machine.sample(seq);
            seq += 1;
            is_done().then_some(())
        });
    };
    samples_until(&mut machine, "the plant's role is taken", &mut || {
        role(&site, Role::Plant).is_err()
    });
    let start = Instant::now();
    while start.elapsed() < LONGER {
        machine.statuses.send(&status(1)).expect("sent");
        std::thread::sleep(Duration::from_millis(100));
    }
    assert!(inward.stderr().contains("no samples for 2 s"), "{}", inward.stderr());
    drop(role(&site, Role::Plant).expect("free"));
    assert!(role(&site, Role::Identifier).is_err(), "it is not silent");
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut samples = SampleSubscriber::new(&bus).expect("subscribed");
    samples_until(&mut machine, "samples come again", &mut || {
        samples.refresh().expect("looked");
        samples.drain(usize::MAX, |_| {}).expect("received") > 0
    });
    assert!(!inward.stderr().contains("nothing has come"), "{}", inward.stderr());
}

#[test]
fn fault_a_gateway_that_stood_still_itself_keeps_the_roles() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let (_out, inward) = both_ends(&site, &[]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);
    inward.stop();
    let start = Instant::now();
    while start.elapsed() < 2 * LONGER {
        if start.elapsed() > LONGER {
            inward.go_on();
        }
        machine.statuses.send(&status(1)).expect("sent");
        std::thread::sleep(Duration::from_millis(100));
    }
    assert!(!inward.stderr().contains("nothing has come"), "{}", inward.stderr());
    assert!(role(&site, Role::Identifier).is_err());
}
