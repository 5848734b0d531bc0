//! Cost of many browsers: jitter of the plant, times of the identifier and the page's own processor
//! time, with and without them in one run.

use crate::live::{BEST, Events, page_of};
use crate::support::{Process, Program, QUICK, Site};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, SampleSubscriber};
use thetabus::messages::Timing;

const BROWSERS: usize = 20;
/// Phases without and with browsers, by turns, so that whatever else the machine does meets both.
const PHASES: usize = 8;
const PHASE: Duration = Duration::from_secs(10);
/// Time from one sample to the next [ns].
const PERIOD_NS: f64 = 1e6;

/// Processor time of the thread that serves the page.
fn server_time(monitor: &Process) -> Duration {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", monitor.pid())).expect("it lives");
    let stats = tasks
        .flatten()
        .filter_map(|task| std::fs::read_to_string(task.path().join("stat")).ok());
    let server = stats
        .into_iter()
        .find(|stat| stat.contains("(web)"))
        .expect("the thread `web`");
    let (_, fields) = server.rsplit_once(')').expect("a name");
    // Fields 14 and 15 of proc(5), user and system, in ticks of 10 ms.
    let ticks = fields
        .split_whitespace()
        .skip(11)
        .take(2)
        .map(|field| field.parse::<u64>().expect("a number"));
    Duration::from_millis(10 * ticks.sum::<u64>())
}

/// Mean over what came between two messages, from means since the start [µs].
fn mean_us(before: &Timing, after: &Timing) -> f64 {
    let sum = |t: &Timing| t.mean_ns as f64 * t.count as f64;
    (sum(after) - sum(before)) / (after.count - before.count).max(1) as f64 / 1e3
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

/// Results of one kind of phase.
#[derive(Default)]
struct Seen {
    /// Distance of the time between two samples from the period [µs].
    jitter_us: Vec<f64>,
    step_us: Vec<f64>,
    block_us: Vec<f64>,
    server: Duration,
    wall: Duration,
}

/// By hand, in a build with optimization on a quiet machine:
/// `cargo test --release --test processes -- --ignored --nocapture rt_twenty_browsers`.
#[test]
#[ignore = "takes a minute and a half and a quiet machine"]
fn rt_twenty_browsers_leave_plant_and_identifier_as_they_were() {
    let site = Site::new();
    let mut observer = site.observer();
    let bus = Bus::join(&site.domain, "arm", "observer").expect("join");
    let mut samples = SampleSubscriber::polled(&bus).expect("subscribe");
    let best = [&QUICK[..], &["--config", BEST]].concat();
    let _identifier = site.start(Program::Identifier, &best);
    let monitor = site.start(Program::Monitor, &[&best[..], &["--web", "127.0.0.1:0"]].concat());
    let (address, _) = page_of(&monitor);
    let _plant = site.start(Program::Plant, &["--config", BEST, "--speed", "1", "--duration", "170"]);
    observer.status("blocks come", |status| status.estimates > 5);

    let mut seen = [Seen::default(), Seen::default()];
    let events = Arc::new(AtomicU64::new(0));
    for phase in 0..PHASES {
        let with = phase % 2;
        let over = Arc::new(AtomicBool::new(false));
        let browsers: Vec<_> = (0..with * BROWSERS)
            .map(|_| {
                let (address, over, events) = (address.clone(), over.clone(), events.clone());
                std::thread::spawn(move || {
                    let mut browser = Events::open(&address);
                    while !over.load(Ordering::Relaxed) {
                        browser.skip();
                        events.fetch_add(1, Ordering::Relaxed);
                    }
                })
            })
            .collect();
        // Whoever comes gets the whole state first, which is not what stays.
        std::thread::sleep(Duration::from_secs(1));
        samples.refresh().expect("refresh");
        samples.drain_timed(usize::MAX, |_, _| ()).expect("drain");
        observer.look();
        let before = observer.last_status.expect("a heartbeat");
        let (server, start) = (server_time(&monitor), Instant::now());
        let mut last_sent = None;
        while start.elapsed() < PHASE {
            std::thread::sleep(Duration::from_millis(50));
            samples
                .drain_timed(usize::MAX, |_, sent_ns| {
                    if let Some(last) = last_sent.replace(sent_ns) {
                        seen[with]
                            .jitter_us
                            .push(((sent_ns - last) as f64 - PERIOD_NS).abs() / 1e3);
                    }
                })
                .expect("drain");
        }
        observer.look();
        let after = observer.last_status.expect("a heartbeat");
        assert_eq!(after.missing, 0, "the identifier keeps up");
        let seen = &mut seen[with];
        seen.server += server_time(&monitor) - server;
        seen.wall += start.elapsed();
        seen.step_us.push(mean_us(&before.step, &after.step));
        seen.block_us.push(mean_us(&before.block, &after.block));
        over.store(true, Ordering::Relaxed);
        for browser in browsers {
            browser.join().expect("a browser");
        }
    }
    let mut rows = Vec::new();
    for seen in &mut seen {
        seen.jitter_us.sort_by(f64::total_cmp);
        let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
        rows.push([
            quantile(&seen.jitter_us, 0.5),
            quantile(&seen.jitter_us, 0.99),
            mean(&seen.step_us),
            mean(&seen.block_us),
            100.0 * seen.server.as_secs_f64() / seen.wall.as_secs_f64(),
        ]);
    }
    let names = [
        "jitter of the plant, median [us]",
        "jitter of the plant, 99th percentile [us]",
        "identifier, a sample, mean [us]",
        "identifier, a block, mean [us]",
        "the page's server [% of a core]",
    ];
    println!("{:<44}{:>10}{:>14}{:>8}", "", "none", "20 browsers", "ratio");
    for (index, name) in names.iter().enumerate() {
        let [without, with] = [rows[0][index], rows[1][index]];
        let ratio = match without > 0.0 {
            true => format!("{:.2}", with / without),
            false => "–".to_owned(),
        };
        println!("{name:<44}{without:>10.2}{with:>14.2}{ratio:>8}");
    }
    // Five updates a second each, over half of the phases; a part may come late on a busy machine.
    let expected = BROWSERS as u64 * 5 * PHASE.as_secs() * PHASES as u64 / 2;
    let got = events.load(Ordering::Relaxed);
    assert!(got > expected * 8 / 10, "{got} events of {expected}");
    assert!(rows[1][4] < 5.0, "the page's server took {:.1} % of a core", rows[1][4]);
}
