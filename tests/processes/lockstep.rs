//! Lockstep: nothing is lost, and no consumer can block the plant for ever.

use crate::support::{Program, QUICK, Site};
use nix::sys::signal::Signal;

#[test]
fn fault_a_consumer_stuck_past_the_limit_is_cut_off_and_the_plant_says_so() {
    let site = Site::new();
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    let pid = identifier.pid();
    observer.status("a heartbeat", |status| status.pid == pid);
    let args = [
        "--duration",
        "60",
        "--speed",
        "20",
        "--set",
        "bus.delivery=lockstep",
        "--set",
        "bus.lockstep_limit_s=1",
    ];
    let mut plant = site.start(Program::Plant, &args);
    observer.status("samples", |status| status.accepted > 0);
    identifier.signal(Signal::SIGSTOP);
    plant.expect_code(3);
    plant.expect_stderr(&["is stuck", &pid.to_string()]);
    identifier.signal(Signal::SIGCONT);
    // It still gets what was in its queue, and goes on.
    let stuck_at = observer.last_status.expect("seen").accepted;
    observer.status("the rest of its queue", |status| status.accepted > stuck_at);
}

#[test]
fn fault_a_consumer_stopped_for_less_than_the_limit_loses_nothing() {
    let site = Site::new();
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    let mut plant = site.start(
        Program::Plant,
        &[
            &["--duration", "60", "--speed", "20", "--set", "bus.delivery=lockstep"],
            &QUICK[..],
        ]
        .concat(),
    );
    observer.status("samples", |status| status.accepted > 0);
    identifier.signal(Signal::SIGSTOP);
    // A second at twenty times the speed is twenty queues.
    std::thread::sleep(std::time::Duration::from_secs(1));
    assert!(plant.is_running(), "{}", plant.said());
    identifier.signal(Signal::SIGCONT);
    plant.expect_code(0);
    let status = observer.end();
    assert_eq!((status.accepted, status.missing, status.rejected), (60_000, 0, 0));
}

#[test]
fn fault_a_plant_that_nobody_listens_to_gives_up_with_advice() {
    let site = Site::new();
    let mut plant = site.start(Program::Plant, &["--set", "bus.lockstep_limit_s=0.3"]);
    plant.expect_code(1);
    plant.expect_stderr(&["0 of 1 consumers", site.domain.name(), "realtime"]);
}

#[test]
fn e2e_a_run_with_a_stuck_identifier_ends_with_code_3() {
    let site = Site::new();
    let mut observer = site.observer();
    let args = [
        "--duration",
        "200",
        "--speed",
        "20",
        "--set",
        "bus.delivery=lockstep",
        "--set",
        // Longer than a busy machine takes to start an identifier, for which the plant waits as long.
        "bus.lockstep_limit_s=3",
    ];
    let mut run = site.start_run(&[&args[..], &QUICK].concat());
    observer.status("samples", |status| status.accepted > 0);
    let identifier = site.child(&run, "identifier");
    nix::sys::signal::kill(identifier, Signal::SIGSTOP).expect("it lives");
    run.wait_for_log("is stuck");
    nix::sys::signal::kill(identifier, Signal::SIGCONT).expect("it lives");
    run.expect_code(3);
}
