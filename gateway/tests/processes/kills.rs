//! Gateways that are killed, and started again.

use crate::support::*;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, SampleSubscriber, Subscriber};
use thetabus::messages::Estimate;

/// Sends samples at 1 kHz and an estimate every 50 of them until `is_done`; what came on the far
/// side is in `come`.
struct Flow {
    machine: Machine,
    samples: SampleSubscriber,
    estimates: Subscriber<Estimate>,
    start: Instant,
    seq: u64,
    come: Vec<u64>,
    blocks: Vec<u64>,
}

impl Flow {
    fn new(site: &Site) -> Self {
        let machine = Machine::new(&site.near).with_samples();
        let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
        Self {
            machine,
            samples: SampleSubscriber::new(&bus).expect("subscribed"),
            estimates: Subscriber::new(&bus).expect("subscribed"),
            start: Instant::now(),
            seq: 0,
            come: Vec::new(),
            blocks: Vec::new(),
        }
    }

    fn until(&mut self, what: &str, mut is_done: impl FnMut(&Self) -> bool) {
        let began = Instant::now();
        while !is_done(self) {
            let limit = WATCHDOG + Duration::from_secs(seconds().unwrap_or(0));
            assert!(began.elapsed() < limit, "not within {limit:?}: {what}");
            self.machine.sample(self.seq);
            self.seq += 1;
            if self.seq.is_multiple_of(50) {
                self.machine.tick();
                self.machine.estimates.send(&estimate(self.seq / 50)).expect("sent");
                self.samples.refresh().expect("connected");
            }
            self.receive();
            std::thread::sleep(Duration::from_millis(self.seq).saturating_sub(self.start.elapsed()));
        }
    }

    fn receive(&mut self) {
        let (come, blocks) = (&mut self.come, &mut self.blocks);
        self.samples
            .drain(usize::MAX, |sample| come.push(sample.seq))
            .expect("received");
        self.estimates
            .drain(|estimate| blocks.push(estimate.block))
            .expect("received");
    }

    /// Waits until the last sample that was sent has come.
    fn settle(&mut self) {
        eventually("the last sample", || {
            self.receive();
            (self.come.last() == Some(&(self.seq - 1))).then_some(())
        });
    }

    /// Waits until the log of `inward` has told that so many samples and estimates are missing.
    fn told(inward: &Process, samples: u64, estimates: u64) {
        let sum = |log: &str, topic: &str| -> u64 {
            let lines = log.lines().filter_map(|line| line.split_once("messages are missing: "));
            let words = lines.flat_map(|(_, missing)| missing.split([' ', ',']));
            let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
            let counts = words.windows(2).filter(|pair| pair[0] == topic);
            counts.map(|pair| pair[1].parse::<u64>().expect("a number")).sum()
        };
        eventually("word of what is missing", || {
            let log = inward.stderr();
            ((sum(&log, "sample"), sum(&log, "estimate")) == (samples, estimates)).then_some(())
        });
    }

    /// Estimates missing between the first and the last that came.
    fn missing_blocks(&self) -> u64 {
        let first_to_last = self.blocks[self.blocks.len() - 1] - self.blocks[0] + 1;
        let different: BTreeSet<u64> = self.blocks.iter().copied().collect();
        first_to_last - different.len() as u64
    }

    /// Samples missing between the first and the last that came.
    fn missing(&self) -> u64 {
        let (first, last) = (self.come[0], self.come[self.come.len() - 1]);
        let different: BTreeSet<u64> = self.come.iter().copied().collect();
        assert_eq!(different.len(), self.come.len(), "none comes twice");
        assert!(self.come.is_sorted());
        last - first + 1 - self.come.len() as u64
    }
}

#[test]
fn fault_an_out_gateway_killed_in_the_middle_resumes_and_its_losses_are_counted() {
    let site = Site::new();
    let mut flow = Flow::new(&site);
    let [a, b] = [endpoint(), endpoint()];
    let router_a = gateway(&["route", "--listen", &a]);
    let router_b = gateway(&["route", "--listen", &b, "--connect", &a]);
    let args = ["--connect", a.as_str(), "--samples"];
    // Half of the time before, half of it after.
    let half = (500 * seconds().unwrap_or(1)) as usize;
    let out = site.out(&args);
    let inward = site.inward(&["--connect", &b, "--samples"]);
    flow.until("samples come", |flow| flow.come.len() > half);
    out.kill();
    inward.says("its gateway has gone");
    let before = flow.come.len();
    let killed = flow.seq;
    flow.until("time without a gateway", |flow| flow.seq > killed + 1000);
    let out = site.out(&args);
    flow.until("samples come again", |flow| flow.come.len() > before + half.max(1000));
    flow.settle();
    let missing = flow.missing();
    // Nobody carried what was sent while there was none, more than a tenth of a second.
    assert!(missing > 100, "{missing}");
    Flow::told(&inward, missing, flow.missing_blocks());
    let (code, table, log) = inward.end();
    eprintln!("{table}");
    assert!(code.success(), "{log}");
    let [carried, lost, gaps, left_out, runs] = figures(&table, "thetabus/cell/arm/sample");
    assert_eq!((gaps, left_out, runs), (missing, 0, 2), "{table}");
    assert_eq!(
        lost, 0,
        "what the dead gateway had numbered last is not known to be lost: {table}"
    );
    // On a crowded machine the reader connects when more have come than the topic keeps.
    assert!(carried >= flow.come.len() as u64, "{table}");
    // Estimates, too: each block that did not come is counted.
    let [_, _, gaps, _, runs] = figures(&table, "thetabus/cell/arm/estimate");
    assert!(flow.missing_blocks() > 2, "{:?}", flow.blocks);
    assert_eq!((gaps, runs), (flow.missing_blocks(), 2), "{table}");
    drop((out, router_a, router_b));
}

#[test]
fn fault_an_in_gateway_killed_in_the_middle_resumes_and_readers_see_what_is_missing() {
    let site = Site::new();
    let mut flow = Flow::new(&site);
    let at = endpoint();
    let out = site.out(&["--listen", &at, "--samples"]);
    let inward = site.inward(&["--connect", &at, "--samples"]);
    flow.until("samples come", |flow| flow.come.len() > 500);
    inward.kill();
    let before = flow.come.len();
    let seq = flow.seq;
    flow.until("time without a gateway", |flow| flow.seq > seq + 500);
    let inward = site.inward(&["--connect", &at, "--samples"]);
    flow.until("samples come again", |flow| flow.come.len() > before + 1000);
    flow.settle();
    // At least those sent while nobody took them in, but for what the dead one had left on the bus.
    assert!(flow.missing() > 100, "{}", flow.missing());
    let (_, table, log) = inward.end();
    let [_, lost, gaps, ..] = figures(&table, "thetabus/cell/arm/sample");
    assert_eq!((lost, gaps), (0, 0), "the new one has lost nothing: {table}{log}");
    let (code, table, log) = out.end();
    assert!(code.success(), "{log}");
    let [carried, _, gaps, ..] = figures(&table, "thetabus/cell/arm/sample");
    assert!(carried >= flow.come.len() as u64 && gaps == 0, "{table}");
}

#[test]
fn fault_a_router_killed_in_the_middle_is_found_again() {
    let site = Site::new();
    let mut flow = Flow::new(&site);
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    let _out = site.out(&["--connect", &at, "--samples"]);
    let inward = site.inward(&["--connect", &at, "--samples"]);
    flow.until("samples come", |flow| flow.come.len() > 500);
    router.kill();
    let (before, seq) = (flow.come.len(), flow.seq);
    flow.until("time without a router", |flow| flow.seq > seq + 500);
    let _router = gateway(&["route", "--listen", &at]);
    flow.until("samples come again", |flow| flow.come.len() > before + 500);
    flow.settle();
    let (samples, estimates) = (flow.missing(), flow.missing_blocks());
    assert!(samples > 100 && estimates > 2, "{samples}, {estimates}");
    Flow::told(&inward, samples, estimates);
    let (_, table, log) = inward.end();
    // The gateways have lived on, so both counts tell the same.
    let [_, lost, gaps, _, runs] = figures(&table, "thetabus/cell/arm/sample");
    assert_eq!((lost, gaps, runs), (samples, samples, 1), "{table}{log}");
    let [_, lost, gaps, _, runs] = figures(&table, "thetabus/cell/arm/estimate");
    assert_eq!((lost, gaps, runs), (estimates, estimates, 1), "{table}{log}");
}

#[test]
fn fault_a_signal_ends_a_gateway_and_nothing_stays_behind() {
    let site = Site::new();
    let mut flow = Flow::new(&site);
    let at = endpoint();
    let out = site.out(&["--listen", &at, "--samples"]);
    let inward = site.inward(&["--connect", &at, "--samples"]);
    flow.until("samples come", |flow| flow.come.len() > 100);
    for process in [inward, out] {
        let (code, table, log) = process.end();
        assert_eq!(code.code(), Some(0), "{log}");
        assert!(table.contains("thetabus/cell/arm/sample"), "{table}");
    }
    // The reader and the machine are here; no other program is.
    drop(flow);
    for domain in [&site.near, &site.far] {
        let report = thetabus::bus::inspect(domain).expect("inspected");
        assert!(report.nodes.is_empty(), "{:?}", report.nodes);
        assert!(
            report.locks.iter().all(|lock| lock.holder.is_none()),
            "{:?}",
            report.locks
        );
        assert_eq!(report.memory.unused, 0, "{:?}", report.memory);
    }
    // One that has found nobody ends as readily.
    let lonely = site.inward(&["--connect", &endpoint()]);
    lonely.says("not connected");
    assert_eq!(lonely.end().0.code(), Some(0));
}
