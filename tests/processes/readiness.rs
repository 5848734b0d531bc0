//! What a service manager hears.

use crate::support::{PAPER, Process, Site};
use nix::sys::signal::Signal;
use std::collections::BTreeMap;
use std::os::unix::net::UnixDatagram;
use std::process::Command;
use std::time::{Duration, Instant};

#[test]
fn e2e_a_service_manager_is_told_when_programs_are_ready_and_that_the_identifier_lives() {
    let site = Site::new();
    let path = site.dir.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    socket
        .set_read_timeout(Some(Duration::from_millis(100)))
        .expect("a timeout");
    let heard = |limit: Duration| {
        let mut heard: BTreeMap<String, u32> = BTreeMap::new();
        let start = Instant::now();
        let mut text = [0; 256];
        while start.elapsed() < limit {
            let Ok(len) = socket.recv(&mut text) else { continue };
            let words = String::from_utf8_lossy(&text[..len]).trim().to_owned();
            *heard.entry(words).or_default() += 1;
            if limit > Duration::from_secs(5) && heard.contains_key("READY=1") {
                break;
            }
        }
        heard
    };
    let start = |program: &str, args: &[&str]| {
        let mut command = Command::new(program);
        command
            .current_dir(site.dir.path())
            .args(args)
            .args(["--config", PAPER, "--domain", site.domain.name()])
            .env("NOTIFY_SOCKET", &path);
        command
    };
    let mut identifier = start(env!("CARGO_BIN_EXE_identifier"), &[]);
    identifier.env("WATCHDOG_USEC", "800000");
    let identifier = Process::start(identifier);
    assert_eq!(heard(Duration::from_secs(30)).get("READY=1"), Some(&1));
    // Fed every 200 ms; a machine that is busy may leave most of them out, but not all.
    let fed = heard(Duration::from_secs(2));
    assert!(fed.get("WATCHDOG=1").is_some_and(|times| *times >= 2), "{fed:?}");
    // Whoever does not turn does not feed.
    identifier.signal(Signal::SIGSTOP);
    heard(Duration::from_millis(100));
    assert_eq!(heard(Duration::from_secs(1)), BTreeMap::new());
    identifier.signal(Signal::SIGCONT);
    for (program, args) in [
        (env!("CARGO_BIN_EXE_monitor"), &["--out", "out"][..]),
        (
            env!("CARGO_BIN_EXE_plant_simulator"),
            &["--duration", "1", "--speed", "1"],
        ),
    ] {
        let _program = Process::start(start(program, args));
        assert_eq!(heard(Duration::from_secs(30)).get("READY=1"), Some(&1), "{program}");
    }
}
