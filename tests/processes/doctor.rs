//! `thetabus doctor`: shows all objects, and removes only those of dead processes.

use crate::support::{Process, Program, QUICK, Site, eventually};
use nix::sys::signal::Signal;
use serde_json::Value;

fn doctor(site: &Site, args: &[&str]) -> Value {
    let mut doctor = site.start(Program::Thetabus, &[&["doctor", "--format", "json"], args].concat());
    doctor.expect_code(0);
    serde_json::from_str(&doctor.stdout()).unwrap_or_else(|e| panic!("{e}: {}", doctor.said()))
}

/// The one domain that was asked for.
fn domain(report: &Value) -> &Value {
    &report["domains"][0]
}

fn programs(report: &Value, alive: bool) -> Vec<String> {
    domain(report)["programs"]
        .as_array()
        .expect("a list")
        .iter()
        .filter(|program| program["alive"] == alive)
        .map(|program| program["name"].as_str().expect("a name").to_owned())
        // The identifier's thread for commands is a program of its own on the bus.
        .filter(|name| name != "identifier_desk")
        .collect()
}

fn at_work(site: &Site) -> [Process; 3] {
    let mut observer = site.observer();
    let processes = [
        site.start(Program::Plant, &[&["--speed", "2"], &QUICK[..]].concat()),
        site.start(Program::Identifier, &QUICK),
        site.start(Program::Monitor, &QUICK),
    ];
    observer.estimate("a block", |estimate| estimate.block >= 2);
    processes
}

#[test]
fn e2e_doctor_shows_programs_services_locks_and_memory() {
    let site = Site::new();
    let [plant, identifier, _monitor] = at_work(&site);
    let report = doctor(&site, &[]);
    assert_eq!(domain(&report)["name"], site.domain.name());
    assert_eq!(programs(&report, true), ["identifier", "monitor", "plant_simulator"]);
    assert_eq!(programs(&report, false), Vec::<String>::new());
    assert_eq!(
        (&domain(&report)["abandoned"], &domain(&report)["has_dead"]),
        (&Value::Bool(false), &Value::Bool(false))
    );
    let services = domain(&report)["services"].as_array().expect("a list");
    let sample = services
        .iter()
        .find(|service| service["name"] == "thetabus/arm/sample" && service["pattern"] == "publish-subscribe")
        .expect("the topic");
    assert_eq!(sample["type"], "ThetabusSampleV3");
    assert_eq!(sample["message_bytes"], size_of::<thetabus::messages::Sample>());
    assert_eq!(sample["programs"], 2, "{sample}");
    for (role, pid) in [("plant", plant.pid()), ("identifier", identifier.pid())] {
        let locks = domain(&report)["locks"].as_array().expect("a list");
        let lock = locks.iter().find(|lock| lock["role"] == role).expect("the lock");
        assert_eq!(
            (&lock["robot"], &lock["holder"]),
            (&Value::from("arm"), &Value::from(pid.to_string()))
        );
    }
    // The plant's buffer of 4096 samples for 16 consumers alone takes 27 MB.
    assert!(domain(&report)["memory"]["bytes"].as_u64().expect("a number") > 27_000_000);
    assert_eq!(domain(&report)["memory"]["unused_objects"], 0);
    assert!(report["shared_memory"]["free_bytes"].as_u64().expect("a number") > 0);
    // The same as text.
    let mut text = site.start(Program::Thetabus, &["doctor"]);
    text.expect_code(0);
    for part in [
        "in use",
        "plant_simulator",
        "thetabus/arm/estimate",
        "free of",
        "held by process",
    ] {
        assert!(text.stdout().contains(part), "{part:?} is not in {}", text.said());
    }
}

#[test]
fn fault_doctor_clean_frees_the_dead_among_the_living_who_notice_nothing() {
    let site = Site::new();
    let mut observer = site.observer();
    let [mut plant, mut identifier, mut monitor] = at_work(&site);
    let before = observer.estimate("a block", |_| true);
    monitor.signal(Signal::SIGKILL);
    monitor.wait();
    let report = doctor(&site, &[]);
    assert_eq!(programs(&report, false), ["monitor"]);
    assert_eq!(domain(&report)["has_dead"], true);
    let report = doctor(&site, &["--clean"]);
    assert_eq!(report["removed"][0]["programs"], 1);
    assert_eq!(report["removed"][0]["whole_domain"], false);
    assert_eq!(programs(&report, false), Vec::<String>::new());
    assert_eq!(domain(&report)["memory"]["unused_objects"], 0);
    // Again there is nothing to do, and the living go on.
    assert_eq!(doctor(&site, &["--clean"])["removed"], Value::Array(Vec::new()));
    let after = observer.estimate("later blocks", |estimate| estimate.block > before.block + 3);
    assert_eq!((after.stream_id, after.missing), (before.stream_id, 0));
    assert!(plant.is_running() && identifier.is_running());
}

#[test]
fn fault_doctor_clean_removes_an_abandoned_domain_altogether_and_no_other() {
    let (site, neighbour) = (Site::new(), Site::new());
    let mut watched = neighbour.observer();
    let mut living = at_work(&neighbour);
    let before = watched.estimate("a block", |_| true);
    for process in &mut at_work(&site) {
        process.signal(Signal::SIGKILL);
        process.wait();
    }
    let report = doctor(&site, &[]);
    assert_eq!(
        (&domain(&report)["abandoned"], programs(&report, false).len()),
        (&Value::Bool(true), 3)
    );
    let report = doctor(&site, &["--clean"]);
    assert_eq!(report["removed"][0]["whole_domain"], true);
    assert_eq!(report["domains"], Value::Array(Vec::new()));
    assert!(!site.domain.root().exists());
    let left: Vec<_> = std::fs::read_dir("/dev/shm")
        .expect("/dev/shm")
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(site.domain.prefix()))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    let after = watched.estimate("later blocks", |estimate| estimate.block > before.block + 3);
    assert_eq!((after.stream_id, after.missing), (before.stream_id, 0));
    assert!(living.iter_mut().all(Process::is_running));
    // The next run starts without leftovers and leaves none.
    site.start_run(&[&["--duration", "2"], &QUICK[..]].concat())
        .expect_code(0);
    let report = doctor(&site, &[]);
    assert_eq!(
        (&domain(&report)["abandoned"], &domain(&report)["has_dead"]),
        (&Value::Bool(true), &Value::Bool(false))
    );
}

#[test]
fn fault_leftovers_of_another_iceoryx2_version_are_told_by_programs_and_removed_by_doctor() {
    let site = Site::new();
    for process in &mut at_work(&site) {
        process.signal(Signal::SIGKILL);
        process.wait();
    }
    // Another version has other files under the same names and beside them.
    let services: Vec<_> = std::fs::read_dir(site.domain.root().join("services"))
        .expect("services")
        .flatten()
        .map(|entry| entry.path())
        .collect();
    assert!(!services.is_empty());
    for path in &services {
        let text = std::fs::read(path).expect("read");
        let _ = std::fs::remove_file(path);
        // The version stands in the file's head.
        std::fs::write(path, [b"iceoryx2 0.9.3 ".as_slice(), &text].concat()).expect("write");
    }
    let memory = format!("/dev/shm/{}{}_9.dynamic", site.domain.prefix(), "0b".repeat(20));
    std::fs::write(&memory, "of 0.9.3").expect("write");
    let management = format!(
        "/dev/shm/{}{}_node.0_9_3.global_mgmt",
        site.domain.prefix(),
        "0c".repeat(20)
    );
    std::fs::write(&management, "of 0.9.3").expect("write");
    let report = doctor(&site, &[]);
    assert_eq!(domain(&report)["unreadable_services"], services.len());
    let report = doctor(&site, &["--clean"]);
    assert_eq!(report["removed"][0]["whole_domain"], true);
    for path in [&memory, &management] {
        assert!(!std::fs::exists(path).expect("known"), "{path}");
    }
    assert!(!site.domain.root().exists());
}

#[test]
fn e2e_doctor_lists_every_domain_of_the_user_and_does_not_mind_a_domain_that_is_not() {
    let site = Site::new();
    let _identifier = site.start(Program::Identifier, &QUICK);
    let binary = env!("CARGO_BIN_EXE_thetabus");
    eventually("the domain is listed", || {
        let mut command = std::process::Command::new(binary);
        command.args(["doctor", "--format", "json"]);
        let mut all = Process::start(command);
        all.expect_code(0);
        let report: Value = serde_json::from_str(&all.stdout()).expect("JSON");
        let domains = report["domains"].as_array().expect("a list");
        domains
            .iter()
            .any(|domain| domain["name"] == site.domain.name())
            .then_some(())
    });
    let other = Site::new();
    let report = doctor(&other, &[]);
    assert_eq!(programs(&report, true), Vec::<String>::new());
    let mut wrong = Process::start({
        let mut command = std::process::Command::new(binary);
        command.args(["doctor", "--domain", "No Such"]);
        command
    });
    wrong.expect_code(2);
}
