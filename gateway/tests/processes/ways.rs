//! A robot goes one way, out of a domain or into it, so that nothing goes round.

use crate::support::*;
use std::time::Duration;
use thetabus::bus::{Bus, Role, RoleLock, Subscriber};
use thetabus::messages::Estimate;

/// Longer than an `in` waits before it tries again to admit a robot.
const RETRIED: Duration = Duration::from_millis(2500);

#[test]
fn fault_gateways_both_ways_in_one_domain_send_nothing_round_and_leave_the_identifier_its_role() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let at = endpoint();
    let out = site.out(&["--listen", &at]);
    out.says("carries out");
    let stranger = stranger(&at);
    machine.estimates.send(&estimate(1)).expect("sent");
    eventually("an estimate at the gateway", || {
        machine.tick();
        let answers = replies(&stranger, "thetabus/cell/arm/estimate");
        (!answers.is_empty()).then_some(())
    });
    // The identifier's role is free, and the gateway has its last messages.
    drop(machine);
    let both = gateway(&["in", "--domain", site.near.name(), "--connect", &at]);
    both.says("robot not admitted");
    assert!(
        both.stderr().contains(&format!("process {}", out.pid())),
        "{}",
        both.stderr()
    );
    std::thread::sleep(RETRIED);
    let mut machine = Machine::new(&site.near);
    machine.estimates.send(&estimate(2)).expect("sent");
    std::thread::sleep(RETRIED);
    let (code, table, log) = both.end();
    assert_eq!(code.code(), Some(0), "{log}");
    assert!(!table.contains("thetabus/"), "nothing was brought in: {table}");
    let (_, table, _) = out.end();
    let [carried, ..] = figures(&table, "thetabus/cell/arm/estimate");
    assert_eq!(carried, 2, "each once: {table}");
}

#[test]
fn fault_a_chain_of_hosts_that_send_and_bring_robots_of_one_name_has_no_ring() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let on = ["--connect", at.as_str()];
    let out = site.out(&on);
    out.says("carries out");
    let inward = site.inward(&on);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    machine.estimates.send(&estimate(1)).expect("sent");
    machine.until(&mut estimates, "the estimate", |estimate| estimate.block == 1);

    // What was brought in is not sent out again, under whatever name.
    let args = ["out", "--host", "other", "--domain", site.far.name(), "--connect", &at];
    let (code, _, log) = gateway(&args).wait();
    assert_eq!(code.code(), Some(1), "{log}");
    let holder = format!("process {}", inward.pid());
    assert!(log.contains("has a gateway already") && log.contains(&holder), "{log}");

    // The other way about: the far domain sends a robot of its own of that name, whose identifier is
    // not there yet, and both domains bring in whatever there is.
    inward.kill();
    let back = gateway(&args);
    back.says("carries out");
    let inward = site.inward(&on);
    let near_in = gateway(&["in", "--domain", site.near.name(), "--connect", &at]);
    inward.says("robot not admitted");
    drop(machine);
    std::thread::sleep(RETRIED);
    let mut machine = Machine::new(&site.near);
    let role = RoleLock::acquire(&site.far, "arm", Role::Identifier).expect("free for the far machine");
    machine.estimates.send(&estimate(2)).expect("sent");
    std::thread::sleep(RETRIED);
    for process in [inward, near_in] {
        let (_, table, log) = process.end();
        assert!(!table.contains("thetabus/"), "nothing was brought in: {table}{log}");
    }
    let (_, table, _) = back.end();
    let [carried, ..] = figures(&table, "thetabus/other/arm/estimate");
    assert_eq!(carried, 0, "the far domain has none of its own: {table}");
    let (_, table, _) = out.end();
    let [carried, ..] = figures(&table, "thetabus/cell/arm/estimate");
    assert_eq!(carried, 2, "each once: {table}");
    drop(role);
}

#[test]
fn fault_a_second_gateway_of_a_robot_is_refused_and_a_killed_one_is_not_in_the_way() {
    let site = Site::new();
    let first = site.out(&["--listen", &endpoint(), "--robot", "arm", "--robot", "arm"]);
    first.says("carries out");
    let (code, _, log) = site.out(&["--listen", &endpoint()]).wait();
    assert_eq!(code.code(), Some(1), "{log}");
    assert!(log.contains(&format!("process {}", first.pid())), "{log}");
    first.kill();
    let next = site.out(&["--listen", &endpoint()]);
    next.says("carries out");
}

#[test]
fn fault_two_hosts_of_one_name_that_send_a_robot_of_one_name_are_told() {
    let (site, twin) = (Site::new(), Site::new());
    let mut machines = [Machine::new(&site.near), Machine::new(&twin.near)];
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    router.says("routes");
    let inward = site.inward(&["--connect", &at]);
    let outs = [site.out(&["--connect", &at]), twin.out(&["--connect", &at])];
    outs.iter().for_each(|out| out.says("carries out"));
    eventually("word of both", || {
        for machine in &mut machines {
            machine.tick();
            machine.statuses.send(&status(1)).expect("sent");
        }
        inward.stderr().contains("two gateways send").then_some(())
    });
}
