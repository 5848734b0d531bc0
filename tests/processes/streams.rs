//! Commands belong to their stream, requests cannot fill anything for good, and a second publisher
//! is told apart.

use crate::support::{PAPER, Process, Program, QUICK, Site, eventually};
use nix::sys::signal::Signal;
use std::path::PathBuf;
use std::time::Duration;
use thetabus::bus::{Bus, ControlClient, Publisher, Subscriber};
use thetabus::messages::{Command, Estimate, Request, State, estimate_flags, response_code, status_flags};

const PATIENCE: Duration = Duration::from_secs(20);

fn client(site: &Site) -> ControlClient {
    let bus = Bus::join(&site.domain, "arm", "test").expect("join");
    eventually("an identifier", || ControlClient::new(&bus).ok())
}

/// A recording in whose middle parameters are held, tunables are set, N is another one and the
/// estimation rests.
fn recorded() -> (Site, PathBuf) {
    let site = Site::new();
    let mut run = site.start_run(&[&["--speed", "2", "--duration", "12"], &QUICK[..]].concat());
    let mut observer = site.observer();
    observer.estimate("a block", |_| true);
    let client = client(&site);
    let tell = |request: Request, from_seq: u64| {
        let answer = client
            .ask(&Request { from_seq, ..request }, PATIENCE)
            .expect("an answer");
        assert_eq!(answer.code, response_code::DONE, "{}", answer.text());
    };
    tell(Request::new(Command::Fix).named("theta_5").with_value(40.0), 1_000);
    tell(
        Request::new(Command::Set).named("forgetting_factor").with_value(0.7),
        1_200,
    );
    tell(Request::new(Command::Set).named("block_len").with_value(100.0), 2_000);
    tell(Request::new(Command::Pause), 4_000);
    tell(Request::new(Command::Resume), 11_000);
    run.expect_code(0);
    drop(observer);
    let recording = site.out().join("recording.mcap");
    (site, recording)
}

#[test]
fn replay_broken_off_leaves_no_command_to_the_next_stream() {
    let (_recorded, recording) = recorded();
    let recording = recording.to_str().expect("UTF-8");
    let site = Site::new();
    let config = ["--config", PAPER];
    let identifier = site.start(Program::Identifier, &[&config[..], &QUICK].concat());
    identifier.wait_for_log("no plant yet");
    let mut observer = site.observer();
    let machine = |observer: &mut crate::support::Observer| {
        let start = [&config[..], &["--speed", "4", "--duration", "1000"], &QUICK].concat();
        let plant = site.start(Program::Plant, &start);
        let boot = observer.last_estimate.map_or(0, |e| e.stream_id);
        let first = observer.estimate("the machine's first estimate", |e| e.stream_id != boot);
        let later = observer.estimate("its third block", |e| e.stream_id == first.stream_id && e.block >= 3);
        (plant, first, later)
    };
    let (mut plant, _, before) = machine(&mut observer);
    plant.signal(Signal::SIGTERM);
    plant.expect_code(0);

    let broken_at: [(&str, fn(&Estimate) -> bool); 3] = [
        // the pause still waits
        ("held", |e| !e.fixed.is_empty()),
        ("blocks of 100", |e| e.t_last_ns - e.t_first_ns == 99_000_000),
        ("paused", |e| e.state == State::Paused as u32),
    ];
    for (what, there) in broken_at {
        for signal in [Signal::SIGKILL, Signal::SIGTERM] {
            let replay = ["replay", recording, "--speed", "8"];
            let mut replay = site.start(Program::Thetabus, &replay);
            let last = observer.last_estimate.expect("estimates").stream_id;
            let replayed = observer.estimate(what, |e| e.stream_id != last && there(e));
            observer.status("the mark of a replay", |s| s.flags & status_flags::REPLAY != 0);
            replay.signal(signal);
            replay.wait();
            let (mut plant, first, later) = machine(&mut observer);
            for estimate in [&first, &later] {
                let told = format!("{what}, {signal}: {estimate:?}");
                assert_ne!(estimate.stream_id, replayed.stream_id, "{told}");
                assert_eq!(
                    (estimate.fixed.bits(), estimate.config_hash),
                    (0, before.config_hash),
                    "{told}"
                );
                assert_ne!(estimate.state, State::Paused as u32, "{told}");
                assert_eq!(
                    estimate.flags & (estimate_flags::COMMANDED | estimate_flags::HELD),
                    0,
                    "{told}"
                );
                assert_eq!(estimate.t_last_ns - estimate.t_first_ns, 199_000_000, "{told}");
            }
            let status = observer.status("a heartbeat", |s| s.stream_id == first.stream_id);
            assert_eq!(
                status.flags & (status_flags::COMMANDED | status_flags::PAUSED | status_flags::REPLAY),
                0,
                "{what}"
            );
            identifier.wait_for_log("replay ended");
            plant.signal(Signal::SIGTERM);
            plant.expect_code(0);
        }
    }
    // The desk's view is the loop's: what is set now is set beside the tunables of the start.
    let described = client(&site)
        .ask(&Request::new(Command::Describe), PATIENCE)
        .expect("an answer");
    let value = |name: &str| {
        let item = described
            .items()
            .iter()
            .find(|i| thetabus::messages::text_of(&i.name) == name);
        item.expect(name).value
    };
    assert_eq!(value("block_len"), 200.0);
    assert_ne!(value("forgetting_factor"), 0.7);
    assert!(identifier.stderr().contains("it was dropped"), "{}", identifier.said());
}

#[test]
fn fault_a_flood_of_requests_fills_neither_queue_nor_memory_nor_log() {
    const REFUSALS: u64 = 3_000;
    let site = Site::new();
    let mut identifier = site.start(Program::Identifier, &QUICK);
    let _plant = site.start(
        Program::Plant,
        &[&["--speed", "1", "--duration", "600"], &QUICK[..]].concat(),
    );
    let mut observer = site.observer();
    observer.estimate("a block", |_| true);
    let client = client(&site);
    let ask = |request: &Request| client.ask(request, PATIENCE).expect("an answer");

    // For samples that never come: in the end refused, and an operator is heard all the same.
    let far = Request {
        from_seq: u64::MAX,
        ..Request::new(Command::Resume)
    };
    let answers: Vec<u32> = (0..80).map(|_| ask(&far).code).collect();
    assert_eq!(answers[0], response_code::DONE);
    assert_eq!(answers[79], response_code::FAILED);
    assert_eq!(ask(&Request::new(Command::Pause)).code, response_code::DONE);
    observer.estimate("a pause", |e| e.state == State::Paused as u32);
    assert_eq!(ask(&Request::new(Command::Resume)).code, response_code::DONE);
    observer.estimate("it goes on", |e| e.state != State::Paused as u32);

    // First parts of states that nobody finishes: 3 MB of them, of which one kilobyte may stay.
    let part = Request::restore(&[0; 3_000]).expect("fits")[0];
    let before = observer.status("a heartbeat", |_| true);
    for _ in 0..REFUSALS {
        assert_eq!(ask(&part).code, response_code::DONE);
    }
    // Blocks that would take gigabytes.
    let long = ask(&Request::new(Command::Set).named("block_len").with_value(1e7));
    assert_eq!(long.code, response_code::REFUSED);
    assert!(
        long.text().contains("[samples] while the identifier runs"),
        "{}",
        long.text()
    );
    // A hundred that fit one by one: together they take no more than half a million samples.
    let lengths: Vec<u32> = (0..100u32)
        .map(|i| {
            let set = Request::new(Command::Set).named("block_len");
            ask(&Request {
                from_seq: u64::MAX - 1,
                ..set.with_value(f64::from(50_000 + i))
            })
            .code
        })
        .collect();
    assert!(
        lengths.iter().filter(|code| **code == response_code::DONE).count() < 10,
        "{lengths:?}"
    );
    let refused = observer
        .status("the refusals", |s| s.process.refused > before.process.refused)
        .process
        .refused;
    for _ in 0..REFUSALS {
        assert_eq!(
            ask(&Request::new(Command::Free).named("colour")).code,
            response_code::REFUSED
        );
    }
    let after = observer.status("all are counted", |s| s.process.refused >= refused + REFUSALS);
    let grown = after
        .process
        .resident_bytes
        .saturating_sub(before.process.resident_bytes);
    // Room for 500 000 samples of 200 bytes may have been taken.
    assert!(grown < 150 << 20, "{grown} bytes more");
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    let log = identifier.stderr();
    let (lines, told) = log
        .lines()
        .filter(|line| line.contains("refused"))
        .fold((0, 0), |(lines, told), line| {
            let count = |key: &str| {
                let number = line.split(key).nth(1).and_then(|rest| rest.split(' ').next());
                number.and_then(|number| number.parse::<u64>().ok())
            };
            // "… WARN 17 more requests refused"
            let rest = line.split_once(" more requests refused").map(|(before, _)| before);
            let rest = rest.and_then(|before| before.rsplit(' ').next()?.parse().ok());
            let more = count("before=").map(|before| before + 1).or(rest);
            (lines + 1, told + more.unwrap_or(1))
        });
    // One a second and one for the rest; every refusal is in a line or in a count.
    assert!(lines < 100, "{lines} lines\n{log}");
    assert!(told >= REFUSALS, "{told} told\n{log}");
}

fn lines_of(process: &Process, part: &str) -> usize {
    process.stderr().lines().filter(|line| line.contains(part)).count()
}

#[test]
fn fault_a_second_publisher_of_estimates_is_told_apart_by_readers() {
    let site = Site::new();
    let bus = Bus::join(&site.domain, "arm", "stranger").expect("join");
    // It is there before the identifier, and nobody contradicts it yet.
    let mut stranger = Publisher::<Estimate>::new(&bus).expect("publish");
    let out = site.out();
    let monitor = site.start(
        Program::Monitor,
        &["--config", PAPER, "--out", out.to_str().expect("UTF-8")],
    );
    let identifier = site.start(
        Program::Identifier,
        &["--config", PAPER, "--set", "estimator.block_len=200"],
    );
    let _plant = site.start(
        Program::Plant,
        &[
            "--config",
            PAPER,
            "--speed",
            "2",
            "--duration",
            "600",
            "--set",
            "estimator.block_len=200",
        ],
    );
    let mut reader = Subscriber::<Estimate>::new(&bus).expect("subscribe");
    let mut genuine = None;
    eventually("an estimate", || {
        reader.drain(|e| genuine = Some(*e)).expect("drain");
        stranger.serve_late_joiners().expect("serve");
        genuine
    });
    let mut forged = genuine.expect("an estimate");
    forged.config_hash = 0xbad;
    forged.stream_id ^= 1;
    let mut seen = 0;
    for i in 0..300 {
        forged.block += i % 2;
        stranger.send(&forged).expect("send");
        reader
            .drain(|e| {
                assert_ne!(e.config_hash, 0xbad);
                seen += 1;
            })
            .expect("drain");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(
        seen > 5 && reader.left_out() >= 200,
        "{seen} and {} left out",
        reader.left_out()
    );
    let told = format!(
        "process {} publishes beside the identifier, process {}",
        std::process::id(),
        identifier.pid()
    );
    monitor.wait_for_log(&told);
    assert_eq!(lines_of(&monitor, "publishes beside"), 1, "{}", monitor.said());
    let csv = std::fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    let blocks: Vec<u64> = csv
        .lines()
        .skip(1)
        .map(|l| l.split(',').next().unwrap().parse().unwrap())
        .collect();
    assert!(blocks.windows(2).all(|pair| pair[1] > pair[0]), "{blocks:?}");
}
