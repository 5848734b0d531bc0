//! What is carried arrives as it was sent.

use crate::support::*;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, SampleSubscriber, Subscriber};
use thetabus::messages::{Description, Estimate, Journal, Status};
use thetabus::recording::to_cdr;

#[test]
fn e2e_topics_come_to_the_bit_and_late_joiners_get_the_last() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    machine.estimates.send(&estimate(1)).expect("sent");
    machine.estimates.send(&estimate(2)).expect("sent");
    machine.statuses.send(&status(5)).expect("sent");
    machine.journal.send(&journal(1)).expect("sent");
    machine.journal.send(&journal(2)).expect("sent");
    let at = endpoint();
    let out = site.out(&["--listen", &at]);
    out.says("carries out");
    // The first gateway has it all long before the second one is there, and tells whoever asks.
    let stranger = stranger(&at);
    let answers = eventually("what was sent before the gateway was there", || {
        machine.tick();
        let answers = replies(&stranger, "thetabus/cell/arm/*");
        (answers.len() == 5).then_some(answers)
    });
    assert!(answers.contains(&("thetabus/cell/arm/estimate".into(), to_cdr(&estimate(2)))));
    let schemas = replies(&stranger, "thetabus/*/*/estimate/schema");
    let text = String::from_utf8(schemas[0].1.clone()).expect("UTF-8");
    assert!(text.contains("float64 theta_9  # Estimate [V s/rad]"), "{text}");
    let inward = site.inward(&["--connect", &at]);
    inward.says("carries in");

    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    let mut statuses = Subscriber::<Status>::new(&bus).expect("subscribed");
    let mut journals = Subscriber::<Journal>::new(&bus).expect("subscribed");
    assert_eq!(next(&mut descriptions, "the description", |_| true), description());
    let last = next(&mut estimates, "the last estimate", |_| true);
    assert_eq!(bits(&last), bits(&estimate(2)), "and not the one before");
    assert_eq!(next(&mut statuses, "the status", |_| true), status(5));
    let mut entries = Vec::new();
    eventually("both entries of the journal", || {
        journals.drain(|entry| entries.push(*entry)).expect("received");
        (entries.len() == 2).then_some(())
    });
    assert_eq!(entries, [journal(1), journal(2)]);

    for block in 3..20 {
        machine.estimates.send(&estimate(block)).expect("sent");
        let come = next(&mut estimates, "the next estimate", |_| true);
        assert_eq!(bits(&come), bits(&estimate(block)));
    }
    let (code, table, log) = inward.end();
    assert!(code.success(), "{log}");
    assert_eq!(
        figures(&table, "thetabus/cell/arm/estimate"),
        [18, 0, 0, 0, 1],
        "{table}"
    );
    assert_eq!(figures(&table, "thetabus/cell/arm/journal"), [2, 0, 0, 0, 1], "{table}");
    let (code, table, log) = out.end();
    assert!(code.success(), "{log}");
    assert_eq!(
        figures(&table, "thetabus/cell/arm/estimate")[..3],
        [18, 0, 0],
        "{table}"
    );
}

#[test]
fn e2e_samples_at_1_khz_pass_two_routers_and_none_is_lost() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near).with_samples();
    let [a, b] = [endpoint(), endpoint()];
    let router_a = gateway(&["route", "--listen", &a]);
    let router_b = gateway(&["route", "--listen", &b, "--connect", &a]);
    let out = site.out(&["--connect", &a, "--samples"]);
    let inward = site.inward(&["--connect", &b, "--samples"]);
    out.says("carries out");
    inward.says("carries in");
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut samples = SampleSubscriber::new(&bus).expect("subscribed");
    // The way is open as soon as one sample has come; the count begins behind it.
    let mut seq = 0;
    let mut come = Vec::new();
    eventually("the first sample", || {
        machine.tick();
        machine.sample(seq);
        seq += 1;
        samples.refresh().expect("connected");
        samples
            .drain(usize::MAX, |sample| come.push(sample.seq))
            .expect("received");
        (!come.is_empty()).then_some(())
    });
    let total = seq + 1000 * seconds().unwrap_or(5);
    let (start, first) = (Instant::now(), seq);
    while seq < total {
        machine.sample(seq);
        seq += 1;
        if seq.is_multiple_of(100) {
            machine.tick();
            let block = seq / 100;
            machine.estimates.send(&estimate(block)).expect("sent");
        }
        samples
            .drain(usize::MAX, |sample| come.push(sample.seq))
            .expect("received");
        let due = Duration::from_millis(seq - first);
        std::thread::sleep(due.saturating_sub(start.elapsed()));
    }
    eventually("the last sample", || {
        samples
            .drain(usize::MAX, |sample| come.push(sample.seq))
            .expect("received");
        (come.last() == Some(&(total - 1))).then_some(())
    });
    let whole: Vec<u64> = (come[0]..total).collect();
    assert_eq!(come, whole, "each once and in order");
    let (_, table, log) = inward.end();
    let [carried, lost, gaps, left_out, runs] = figures(&table, "thetabus/cell/arm/sample");
    assert_eq!((lost, gaps, left_out, runs), (0, 0, 0, 1), "{table}{log}");
    // On a crowded machine the reader connects when more have come than the topic keeps.
    assert!(carried >= come.len() as u64, "{table}");
    eprintln!("{table}");
    drop((out, router_a, router_b));
}

#[test]
fn e2e_samples_stay_at_home_unless_both_ends_ask_for_them() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near).with_samples();
    let at = endpoint();
    let out = site.out(&["--listen", &at]);
    let inward = site.inward(&["--connect", &at, "--samples"]);
    out.says("carries out");
    inward.says("carries in");
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut samples = SampleSubscriber::new(&bus).expect("subscribed");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    (0..50).for_each(|seq| machine.sample(seq));
    machine.estimates.send(&estimate(1)).expect("sent");
    // Estimates come behind the samples, by the same way.
    next(&mut estimates, "the estimate", |_| true);
    samples.refresh().expect("looked");
    assert_eq!(samples.drain(usize::MAX, |_| {}).expect("received"), 0);
    assert!(!samples.is_connected(), "there is no such topic");
}
