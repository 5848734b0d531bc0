//! SIGINT and SIGTERM end each program cleanly.

use crate::support::{Process, Program, QUICK, Site};
use nix::sys::signal::Signal;
use std::time::Duration;

/// A plant, an identifier and a monitor at work.
fn at_work(site: &Site) -> [Process; 3] {
    let mut observer = site.observer();
    let identifier = site.start(Program::Identifier, &QUICK);
    let monitor = site.start(Program::Monitor, &QUICK);
    let plant = site.start(Program::Plant, &[&["--speed", "2"], &QUICK[..]].concat());
    monitor.wait_for_log("theta_1=");
    observer.estimate("a second block", |estimate| estimate.block >= 2);
    [plant, identifier, monitor]
}

#[test]
fn e2e_sigint_and_sigterm_end_each_program_with_exit_code_0_and_nothing_left_over() {
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let site = Site::new();
        let mut processes = at_work(&site);
        for process in &mut processes {
            process.signal(signal);
            process.expect_code(0);
        }
        let [plant, identifier, monitor] = &processes;
        assert!(plant.stdout().contains("samples sent"), "{}", plant.said());
        assert!(
            identifier.stdout().contains("samples accepted, 0 missing"),
            "{}",
            identifier.said()
        );
        assert!(monitor.stdout().contains("theta_1"), "{}", monitor.said());
        assert_eq!(site.shared_memory(), Vec::<String>::new());
    }
}

#[test]
fn e2e_an_interrupted_plant_ends_its_stream_so_that_everybody_knows() {
    let site = Site::new();
    let [mut plant, _identifier, _monitor] = at_work(&site);
    plant.signal(Signal::SIGINT);
    plant.expect_code(0);
    let status = site.observer().end();
    assert_eq!(status.missing, 0);
}

#[test]
fn e2e_services_without_anybody_to_talk_to_end_as_cleanly() {
    let site = Site::new();
    for (program, log) in [
        (Program::Identifier, "waiting for its samples"),
        (Program::Monitor, "monitor"),
        (Program::Plant, "plant simulator"),
    ] {
        let mut process = site.start(program, &["--set", "bus.lockstep_limit_s=60"]);
        process.wait_for_log(log);
        process.signal(Signal::SIGTERM);
        process.expect_code(0);
    }
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn e2e_a_second_signal_ends_a_program_at_once_with_130() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut identifier = site.start(Program::Identifier, &QUICK);
    observer.status("a heartbeat", |_| true);
    // The first one leaves it two ticks for late readers.
    identifier.signal(Signal::SIGINT);
    std::thread::sleep(Duration::from_millis(30));
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(130);
}
