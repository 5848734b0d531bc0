use super::*;
use crate::messages::{Description, Estimate, Journal, Sample, State, Status};
use crate::model::JointSample;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Instant;

/// A separate domain, removed on drop.
pub(super) struct TestDomain(pub Domain);

impl TestDomain {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        Self(Domain::new(&format!("u{}-{n}", std::process::id())).expect("valid name"))
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.0.root());
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(self.0.prefix()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

fn sample(seq: u64) -> Sample {
    Sample::new(7, seq, seq * 1_000_000, 2, 0, &JointSample::default())
}

fn lockstep(consumers: usize, limit_ms: u64) -> Delivery {
    Delivery::Lockstep {
        consumers,
        limit: Duration::from_millis(limit_ms),
    }
}

fn never() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}

fn status(estimates: u64) -> Status {
    Status {
        estimates,
        state: State::Collecting as u32,
        ..Status::default()
    }
}

/// Receives until `count` samples have arrived or the watchdog fires; returns their numbers.
fn receive(subscriber: &mut SampleSubscriber, count: usize) -> Vec<u64> {
    let start = Instant::now();
    let mut seqs = Vec::new();
    while seqs.len() < count && start.elapsed() < Duration::from_secs(20) {
        subscriber.refresh().expect("refresh");
        if subscriber.drain(usize::MAX, |s| seqs.push(s.seq)).expect("drain") == 0 {
            subscriber.wait(Duration::from_millis(10)).expect("wait");
        }
    }
    seqs
}

#[test]
fn prop_lockstep_loses_nothing_with_a_consumer_slower_than_its_publisher() {
    let domain = TestDomain::new();
    const COUNT: u64 = 20_000;
    thread::scope(|scope| {
        let consumer = scope.spawn(|| {
            let bus = Bus::join(&domain.0, "arm", "consumer").expect("join");
            let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
            receive(&mut subscriber, COUNT as usize)
        });
        let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
        let mut publisher = SamplePublisher::new(&bus, lockstep(1, 20_000), never()).expect("publish");
        assert_eq!(publisher.wait_for_consumers().expect("a consumer"), Attached::Yes);
        for seq in 0..COUNT {
            publisher.send(&sample(seq)).expect("send");
        }
        publisher.wake();
        assert_eq!(consumer.join().expect("consumer"), (0..COUNT).collect::<Vec<_>>());
        assert!(publisher.loss().is_none());
    });
}

#[test]
fn prop_lockstep_fills_the_startup_hole_of_a_consumer_that_was_there_before_the_publisher() {
    let domain = TestDomain::new();
    const COUNT: u64 = 5_000;
    let bus = Bus::join(&domain.0, "arm", "test").expect("join");
    // Two consumers outlive their first publisher; only one of them listens immediately when the
    // second publisher starts.
    let first = SamplePublisher::new(&bus, lockstep(2, 20_000), never()).expect("publish");
    let (attached, is_attached) = std::sync::mpsc::channel();
    let (go, may_go) = std::sync::mpsc::channel::<()>();
    thread::scope(|scope| {
        let domain = &domain.0;
        let prompt = {
            let attached = attached.clone();
            scope.spawn(move || {
                let bus = Bus::join(domain, "arm", "prompt").expect("join");
                let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
                attached.send(()).expect("main waits");
                may_go.recv().expect("main sends");
                receive(&mut subscriber, COUNT as usize)
            })
        };
        let sleepy = scope.spawn(move || {
            let bus = Bus::join(domain, "arm", "sleepy").expect("join");
            let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
            attached.send(()).expect("main waits");
            // Without back pressure, more samples than the buffer holds would be sent in this time.
            thread::sleep(Duration::from_millis(1_500));
            receive(&mut subscriber, COUNT as usize)
        });
        is_attached.recv().expect("prompt");
        is_attached.recv().expect("sleepy");
        drop(first);
        let mut second = SamplePublisher::new(&bus, lockstep(2, 20_000), never()).expect("publish");
        go.send(()).expect("prompt waits");
        for seq in 0..COUNT {
            second.send(&sample(seq)).expect("send");
        }
        second.wake();
        let expected: Vec<u64> = (0..COUNT).collect();
        assert!(prompt.join().expect("prompt") == expected, "each sample once, in order");
        assert!(sleepy.join().expect("sleepy") == expected, "each sample once, in order");
        assert!(second.loss().is_none());
    });
}

#[test]
fn fault_lockstep_cuts_off_a_stuck_consumer_once_and_counts_it() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    let mut publisher = SamplePublisher::new(&bus, lockstep(1, 200), never()).expect("publish");
    let stuck = SampleSubscriber::new(&bus).expect("subscribe");
    let start = Instant::now();
    for seq in 0..4_000 {
        publisher.send(&sample(seq)).expect("send");
    }
    assert_eq!(publisher.loss().cut_off, 1);
    // Once cut off, the consumer costs nothing: waiting the limit for each of the 3 000 samples
    // would take ten minutes.
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    assert!(stuck.is_connected());
}

#[test]
fn fault_lockstep_without_consumers_fails_with_robot_domain_and_advice() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    let mut publisher = SamplePublisher::new(&bus, lockstep(2, 50), never()).expect("publish");
    let error = publisher.wait_for_consumers().expect_err("nobody").to_string();
    assert!(
        error.contains("0 of 2") && error.contains("\"arm\"") && error.contains("realtime"),
        "{error}"
    );
}

#[test]
fn prop_realtime_never_waits_and_the_consumer_keeps_the_newest() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    let mut publisher = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish");
    let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
    for seq in 0..10_000 {
        publisher.send(&sample(seq)).expect("send");
    }
    let mut seqs = Vec::new();
    subscriber.drain(usize::MAX, |s| seqs.push(s.seq)).expect("drain");
    assert_eq!(seqs, (10_000 - 4_096..10_000).collect::<Vec<_>>());
}

#[test]
fn prop_the_next_publisher_may_choose_another_delivery_mode_while_a_consumer_stays() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    thread::scope(|scope| {
        let first = SamplePublisher::new(&bus, lockstep(1, 10_000), never()).expect("publish");
        let consumer = scope.spawn(|| {
            let bus = Bus::join(&domain.0, "arm", "consumer").expect("join");
            let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
            receive(&mut subscriber, 1)
        });
        while first.attached() == 0 {
            thread::sleep(Duration::from_millis(5));
        }
        drop(first);
        let mut second = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish in the other mode");
        while second.attached() == 0 {
            thread::sleep(Duration::from_millis(5));
        }
        second.send(&sample(42)).expect("send");
        second.wake();
        assert_eq!(consumer.join().expect("consumer"), [42]);
    });
}

#[test]
fn prop_samples_in_the_queue_of_a_publisher_that_has_gone_still_arrive() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    let mut publisher = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish");
    let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
    for seq in 0..500 {
        publisher.send(&sample(seq)).expect("send");
    }
    drop(publisher);
    // Refreshing before reading must not drop the queue.
    subscriber.refresh().expect("refresh");
    assert_eq!(receive(&mut subscriber, 500), (0..500).collect::<Vec<_>>());
    subscriber.refresh().expect("refresh");
    assert!(!subscriber.is_connected(), "lets go of a topic without a publisher");
}

#[test]
fn prop_a_late_joiner_gets_the_last_status_and_no_earlier_one() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "identifier").expect("join");
    let mut publisher = Publisher::<Status>::new(&bus).expect("publish");
    publisher.send(&status(1)).expect("send");
    publisher.send(&status(2)).expect("send");
    let mut late = Subscriber::<Status>::new(&bus).expect("subscribe");
    publisher.serve_late_joiners().expect("serve");
    let mut seen = Vec::new();
    late.drain(|status| seen.push(status.estimates)).expect("drain");
    assert_eq!(seen, [2]);
}

#[test]
fn prop_domains_and_robots_never_meet() {
    let (left, right) = (TestDomain::new(), TestDomain::new());
    let speaker = Bus::join(&left.0, "arm", "speaker").expect("join");
    let mut publisher = Publisher::<Status>::new(&speaker).expect("publish");
    for (domain, robot) in [(&right.0, "arm"), (&left.0, "leg")] {
        let other = Bus::join(domain, robot, "listener").expect("join");
        let mut subscriber = Subscriber::<Status>::new(&other).expect("subscribe");
        publisher.send(&status(1)).expect("send");
        assert_eq!(subscriber.drain(|_| ()).expect("drain"), 0, "{domain:?} {robot}");
    }
}

#[test]
fn fault_a_topic_with_other_messages_is_refused_with_expected_and_found() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "intruder").expect("join");
    let _intruder = bus.occupy(Topic::Sample).expect("occupy");
    let refused = SamplePublisher::new(&bus, Delivery::Realtime, never())
        .expect_err("another type")
        .to_string();
    for part in [
        "topic sample",
        "\"arm\"",
        bus.domain().name(),
        "ThetabusSampleV3",
        "ThetabusStatusV3",
    ] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    let error = SampleSubscriber::new(&bus).expect_err("another type").to_string();
    assert!(error.contains("expected messages ThetabusSampleV3"), "{error}");
}

#[test]
fn prop_a_publisher_of_status_never_waits_for_a_subscriber_that_does_not_listen() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "identifier").expect("join");
    let mut publisher = Publisher::<Status>::new(&bus).expect("publish");
    let mut silent = Subscriber::<Status>::new(&bus).expect("subscribe");
    for count in 1..=1_000 {
        publisher.send(&status(count)).expect("send");
    }
    let mut last = 0;
    silent.drain(|status| last = status.estimates).expect("drain");
    assert_eq!(last, 1_000);
}

#[test]
fn prop_with_receipts_no_message_is_lost_to_a_reader_slower_than_its_publisher() {
    let domain = TestDomain::new();
    const COUNT: u64 = 1_000;
    let bus = Bus::join(&domain.0, "arm", "identifier").expect("join");
    let mut publisher = Publisher::<Status>::new(&bus).expect("publish");
    publisher
        .await_receipts(&bus, Duration::from_secs(20), never())
        .expect("receipts");
    thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let bus = Bus::join(&domain.0, "arm", "monitor").expect("join");
            let mut subscriber = Subscriber::<Status>::new(&bus).expect("subscribe");
            subscriber.give_receipts(&bus).expect("receipts");
            let (mut seen, start) = (Vec::new(), Instant::now());
            while seen.len() < COUNT as usize && start.elapsed() < Duration::from_secs(20) {
                // In this time, many times as many messages as the queue holds could be sent.
                thread::sleep(Duration::from_millis(5));
                subscriber.drain(|status| seen.push(status.estimates)).expect("drain");
            }
            seen
        });
        while publisher.subscribers() == 0 {
            thread::sleep(Duration::from_millis(1));
        }
        for count in 0..COUNT {
            publisher.send(&status(count)).expect("send");
        }
        assert_eq!(reader.join().expect("reader"), (0..COUNT).collect::<Vec<_>>());
    });
}

#[test]
fn fault_a_reader_that_gives_no_receipts_is_waited_for_once() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "identifier").expect("join");
    let mut publisher = Publisher::<Status>::new(&bus).expect("publish");
    let limit = Duration::from_millis(200);
    publisher.await_receipts(&bus, limit, never()).expect("receipts");
    let start = Instant::now();
    for count in 0..1_000 {
        publisher.send(&status(count)).expect("send");
    }
    // Waiting the limit for each of the 950 messages beyond the window would take three minutes.
    assert!(start.elapsed() >= limit && start.elapsed() < Duration::from_secs(20));
}

#[test]
fn fault_too_little_shared_memory_is_refused_with_the_numbers() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "plant").expect("join");
    let error = super::memory::check(&bus, Topic::Sample, u64::MAX)
        .expect_err("nobody has that much")
        .to_string();
    assert!(
        error.contains("/dev/shm") && error.contains(&u64::MAX.to_string()),
        "{error}"
    );
    super::memory::check(&bus, Topic::Sample, 0).expect("nothing is needed");
}

/// Messages with another schema in their headers, mixed with others.
#[test]
fn fault_messages_of_another_schema_are_left_out_and_counted() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "both").expect("join");
    let mut subscriber = SampleSubscriber::new(&bus).expect("subscribe");
    let mut statuses = Subscriber::<Status>::new(&bus).expect("subscribe");
    let header = |schema| crate::messages::Header {
        schema,
        flags: 0,
        sent_ns: 0,
    };
    let schemas = [
        7,
        crate::messages::SCHEMA_VERSION,
        0,
        u32::MAX,
        crate::messages::SCHEMA_VERSION,
    ];

    let service = bus.create_sample(true, 64).expect("the topic");
    let port = service.publisher_builder().create().expect("publish");
    subscriber.refresh().expect("refresh");
    let service = bus.latched::<Status>().expect("the topic");
    let own = service.publisher_builder().create().expect("publish");
    for (seq, schema) in schemas.into_iter().enumerate() {
        let mut loan = port.loan_uninit().expect("a loan");
        *loan.user_header_mut() = header(schema);
        loan.write_payload(sample(seq as u64)).send().expect("sent");
        let mut loan = own.loan_uninit().expect("a loan");
        *loan.user_header_mut() = header(schema);
        let status = Status {
            last_seq: seq as u64,
            ..Status::default()
        };
        loan.write_payload(status).send().expect("sent");
    }
    let (mut seqs, mut last) = (Vec::new(), Vec::new());
    subscriber.drain(100, |s| seqs.push(s.seq)).expect("no error");
    statuses.drain(|s| last.push(s.last_seq)).expect("no error");
    assert_eq!((seqs, last), (vec![1, 4], vec![1, 4]));
    assert_eq!((subscriber.left_out(), statuses.left_out()), (3, 3));
}

/// Bytes of the domain's objects whose names have this ending.
fn bytes(domain: &Domain, ending: &str) -> u64 {
    super::objects::of_domain(domain)
        .filter(|entry| entry.file_name().to_string_lossy().ends_with(ending))
        .map(|entry| entry.metadata().expect("there").len())
        .sum()
}

#[test]
fn prop_what_a_port_asks_for_is_what_it_takes_at_most_and_not_much_more() {
    use super::publisher::bytes_of;
    use super::topic::{control, sample};
    let domain = TestDomain::new();
    let limits = domain.0.limits();
    let bus = Bus::join(&domain.0, "arm", "all").expect("join");
    let mut before = 0;
    let mut took = |asked: u64| {
        let now = bytes(&domain.0, ".data");
        let taken = std::mem::replace(&mut before, now).abs_diff(now);
        // Per chunk 128 bytes are asked for its header and alignment; for the smallest message that
        // is a third of it.
        assert!(taken <= asked && asked < 2 * taken, "{taken} of {asked}");
    };
    let _sample = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish");
    took(sample::segment_bytes(limits.sample_subscribers, limits.sample_buffer));
    let _estimate = Publisher::<Estimate>::new(&bus).expect("publish");
    took(bytes_of::<Estimate>(limits.estimate_subscribers));
    let _status = Publisher::<Status>::new(&bus).expect("publish");
    took(bytes_of::<Status>(limits.estimate_subscribers));
    let _description = Publisher::<Description>::new(&bus).expect("publish");
    took(bytes_of::<Description>(limits.estimate_subscribers));
    let _journal = Publisher::<Journal>::new(&bus).expect("publish");
    took(bytes_of::<Journal>(limits.estimate_subscribers));
    let _server = ControlServer::new(&bus).expect("serve");
    took(control::server_bytes());
    let _client = ControlClient::new(&bus).expect("ask");
    took(control::client_bytes());
    let connections = bytes(&domain.0, ".connection");
    let _subscriber = SampleSubscriber::new(&bus).expect("subscribe");
    let connection = bytes(&domain.0, ".connection") - connections;
    let asked = sample::connection_bytes(limits.sample_subscribers, limits.sample_buffer);
    assert!(connection <= asked && asked < 2 * connection, "{connection} of {asked}");
    // The rest is small compared with the extra that every port requests.
    let small: u64 = [".dynamic", ".event_mgmt"]
        .map(|ending| bytes(&domain.0, ending))
        .iter()
        .sum();
    assert!(4 * small < super::memory::SPARE, "{small}");
    // No page remains to be reserved later.
    for entry in super::objects::of_domain(&domain.0) {
        use std::os::unix::fs::MetadataExt as _;
        let found = entry.metadata().expect("there");
        assert!(found.blocks() * 512 >= found.len(), "{}", entry.path().display());
    }
}

#[test]
fn prop_a_consumer_that_connects_late_gets_what_was_sent_in_real_time() {
    let domain = TestDomain::new();
    let bus = Bus::join(&domain.0, "arm", "all").expect("join");
    let kept = super::topic::sample::HISTORY as u64;
    let mut publisher = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish");
    for seq in 0..kept + 10 {
        publisher.send(&sample(seq)).expect("sent");
    }
    let mut late = SampleSubscriber::new(&bus).expect("subscribe");
    publisher.send(&sample(kept + 10)).expect("sent");
    let mut seqs = Vec::new();
    late.drain(1000, |s| seqs.push(s.seq)).expect("drained");
    assert!(
        seqs.iter().copied().eq(10..=kept + 10) || seqs.iter().copied().eq(11..=kept + 10),
        "{seqs:?}"
    );
}

#[test]
fn prop_a_topic_is_taken_as_it_is_by_who_comes_later_and_says_which_key_makes_room() {
    let domain = TestDomain::new();
    let small = Limits {
        estimate_subscribers: 2,
        sample_subscribers: 1,
        sample_buffer: 300,
        ..Limits::default()
    };
    let narrow = domain.0.clone().with_limits(small);
    let bus = Bus::join(&narrow, "arm", "first").expect("join");
    let _plant = SamplePublisher::new(&bus, Delivery::Realtime, never()).expect("publish");
    let _first = Subscriber::<Estimate>::new(&bus).expect("subscribe");
    let wide = Bus::join(&domain.0, "arm", "second").expect("join");
    let _second = Subscriber::<Estimate>::new(&wide).expect("subscribe");
    let error = Subscriber::<Estimate>::new(&wide).expect_err("no place").to_string();
    assert!(error.contains("bus.max_estimate_subscribers"), "{error}");
    let _sample = SampleSubscriber::new(&wide).expect("subscribe");
    let error = SampleSubscriber::new(&wide).expect_err("no place").to_string();
    assert!(error.contains("bus.max_sample_subscribers"), "{error}");
}
