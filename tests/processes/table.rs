//! The fault table: what fails, and what becomes of values, counters and exit code. Real processes,
//! real topics.

use crate::support::{Program, QUICK, Site, column, eventually, text};
use iceoryx2::prelude::{
    Config as BusConfig, FileName, NodeBuilder, Path as BusPath, SemanticString, ServiceName, SignalHandlingMode,
    ZeroCopySend, ipc,
};
use nix::sys::signal::Signal;
use std::ops::RangeInclusive;
use thetabus::messages::{Header, SCHEMA_VERSION, Sample};
use thetabus::model::JointSample;

/// A fault of the plant's signals between 2 s and 3 s of a run of 6 s: 1000 of 6000 samples.
struct Row {
    fault: &'static str,
    /// Samples that never came.
    missing: RangeInclusive<u64>,
    /// Samples that were refused.
    rejected: RangeInclusive<u64>,
    /// 3 where samples are missing in a run in which nothing may be lost.
    code: i32,
}

const TABLE: &[Row] = &[
    Row {
        fault: r#"kind="off", signal="sample""#,
        missing: 1_000..=1_000,
        rejected: 0..=0,
        code: 3,
    },
    Row {
        fault: r#"kind="off", signal="input""#,
        missing: 0..=0,
        rejected: 1_000..=1_000,
        code: 0,
    },
    Row {
        fault: r#"kind="off", signal="q", joint=2"#,
        missing: 0..=0,
        rejected: 1_000..=1_000,
        code: 0,
    },
    // One of ten periods of 10 ms: 900 are missing.
    Row {
        fault: r#"kind="slow", signal="sample", period_s=0.01"#,
        missing: 900..=900,
        rejected: 0..=0,
        code: 3,
    },
    // Ten periods of 100 ms, each lost or not by the seed.
    Row {
        fault: r#"kind="intermittent", signal="sample", share=0.5, period_s=0.1"#,
        missing: 100..=900,
        rejected: 0..=0,
        code: 3,
    },
    // A joint count or a mask drawn at random is right once in 256 at best.
    Row {
        fault: r#"kind="garbage", signal="sample""#,
        missing: 0..=0,
        rejected: 990..=1_000,
        code: 0,
    },
    // The first sample with the clock's last time is right, the others repeat it.
    Row {
        fault: r#"kind="stuck", signal="time""#,
        missing: 0..=0,
        rejected: 999..=1_000,
        code: 0,
    },
];

#[test]
fn fault_a_run_without_a_sample_that_can_be_used_does_not_end_as_if_all_were_well() {
    let site = Site::new();
    let fault = r#"plant.faults=[{kind="off", signal="q", joint=1, from_s=0}]"#;
    let mut run = site.start_run(&[&["--duration", "6", "--set", fault], &QUICK[..]].concat());
    run.expect_code(3);
    run.expect_stderr(&["6000 of 6000 samples were rejected"]);
    let out = site.out();
    let mut identify = site.start(Program::Thetabus, &["identify", text(&out)]);
    identify.expect_code(3);
    identify.expect_stderr(&["6000 of 6000 samples were rejected", "q of joint 1"]);
}

#[test]
fn fault_table_of_signals_that_fail_in_a_run() {
    for row in TABLE {
        let site = Site::new();
        let fault = format!("plant.faults=[{{{}, from_s=2, to_s=3}}]", row.fault);
        let mut run = site.start_run(&[&["--no-record", "--duration", "6", "--set", &fault], &QUICK[..]].concat());
        run.expect_code(row.code);
        let summary = site.summary();
        let samples = summary.samples;
        assert!(row.missing.contains(&samples.missing), "{}: {samples:?}", row.fault);
        assert!(row.rejected.contains(&samples.rejected), "{}: {samples:?}", row.fault);
        assert_eq!(
            samples.accepted + samples.missing + samples.rejected,
            6_000,
            "{}",
            row.fault
        );
        // What was refused or never came has not spoilt what was left: exact signals, so θ̂ is
        // right to far less than 0.1 %.
        for parameter in &summary.parameters {
            let error = parameter.relative_error.expect("the truth is known");
            assert!(
                error.abs() < 1e-3,
                "{}: {} is off by {error}",
                row.fault,
                parameter.name
            );
        }
        // And says where: nothing is converged on data that are not there.
        let csv = site.out().join("estimates.csv");
        let blocks: Vec<(f64, f64)> = column(&csv, "block").into_iter().zip(column(&csv, "t_s")).collect();
        assert!(
            blocks.windows(2).all(|pair| pair[0].0 < pair[1].0),
            "{}: {blocks:?}",
            row.fault
        );
        assert_eq!(site.shared_memory(), Vec::<String>::new());
    }
}

#[test]
fn fault_samples_that_come_late_all_come() {
    let site = Site::new();
    let fault = r#"plant.faults=[{kind="delayed", delay_s=0.7, from_s=1, to_s=2}]"#;
    let mut run = site.start_run(&[&["--speed", "2", "--duration", "4", "--set", fault], &QUICK[..]].concat());
    run.expect_code(0);
    let samples = site.summary().samples;
    assert_eq!((samples.accepted, samples.missing, samples.rejected), (4_000, 0, 0));
}

/// A message of a later schema, larger than ours.
#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("ThetabusSampleV3")]
struct LaterSample {
    sample: [u64; 53],
    more: u64,
}

/// A program of another make in the domain of a test.
fn stranger(site: &Site) -> iceoryx2::node::Node<ipc::Service> {
    let mut config = BusConfig::default();
    let root = site.domain.root().as_os_str().as_encoded_bytes();
    config.global.set_root_path(&BusPath::new(root).expect("a path"));
    config.global.prefix = FileName::new(site.domain.prefix().as_bytes()).expect("a name");
    NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .expect("a node")
}

fn topic() -> ServiceName {
    ServiceName::new("thetabus/arm/sample").expect("a name")
}

#[test]
fn fault_a_topic_of_another_schema_version_is_refused_naming_both() {
    let site = Site::new();
    let _observer = site.observer();
    let node = stranger(&site);
    let service = node
        .service_builder(&topic())
        .publish_subscribe::<LaterSample>()
        .user_header::<Header>()
        .create()
        .expect("a service");
    let _publisher = service.publisher_builder().create().expect("a publisher");
    for program in [Program::Plant, Program::Identifier] {
        let mut process = site.start(program, &QUICK);
        process.expect_code(1);
        process.expect_stderr(&[
            &format!("ThetabusSampleV3 of {} bytes", size_of::<Sample>()),
            &format!("ThetabusSampleV3 of {} bytes", size_of::<LaterSample>()),
            "same version of thetabus",
        ]);
    }
}

#[test]
fn fault_a_message_of_another_schema_version_is_left_out_and_told_naming_both() {
    let site = Site::new();
    let _observer = site.observer();
    let node = stranger(&site);
    let service = node
        .service_builder(&topic())
        .publish_subscribe::<Sample>()
        .user_header::<Header>()
        .subscriber_max_borrowed_samples(2)
        .max_subscribers(4)
        .create()
        .expect("a service");
    let publisher = service.publisher_builder().create().expect("a publisher");
    let mut identifier = site.start(Program::Identifier, &QUICK);
    let mut seq = 0;
    eventually("the identifier has seen it", || {
        let mut loan = publisher.loan_uninit().expect("a loan");
        *loan.user_header_mut() = Header {
            schema: SCHEMA_VERSION + 1,
            flags: 0,
            sent_ns: 0,
        };
        let sample = Sample::new(1, seq, seq * 1_000_000, 2, 0, &JointSample::default());
        loan.write_payload(sample).send().expect("sent");
        seq += 1;
        identifier.stderr().contains("left out").then_some(())
    });
    // one foreign program must not end a service that others rely on
    assert!(identifier.is_running());
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    let said = identifier.stderr();
    assert!(
        said.contains(&format!("{}", SCHEMA_VERSION + 1)) && said.contains(&format!("{SCHEMA_VERSION}")),
        "{said}"
    );
    assert_eq!(
        said.matches("such messages are left out").count(),
        1,
        "told once:\n{said}"
    );
}

#[test]
fn fault_a_service_that_nobody_has_and_nobody_can_read_is_removed_beside_the_living() {
    let site = Site::new();
    // A member of the domain, so that what is there may not be swept away by the one who comes.
    let mut observer = site.observer();
    let services = site.domain.root().join("services");
    let files = || -> Vec<_> {
        let entries = std::fs::read_dir(&services).expect("services").flatten();
        entries.map(|entry| entry.path()).collect()
    };
    let before = files();
    let mut plant = site.start(Program::Plant, &["--speed", "1"]);
    plant.wait_for_log("plant simulator");
    let made: Vec<_> = files().into_iter().filter(|path| !before.contains(path)).collect();
    assert!(!made.is_empty());
    plant.signal(Signal::SIGTERM);
    plant.expect_code(0);
    for path in &made {
        std::fs::write(path, "iceoryx2 0.9.3 had another form").expect("write");
    }
    eventually("it is gone", || made.iter().all(|path| !path.exists()).then_some(()));
    let mut plant = site.start(Program::Plant, &["--speed", "1"]);
    plant.wait_for_log("plant simulator");
    plant.signal(Signal::SIGTERM);
    plant.expect_code(0);
    // Nobody else is concerned.
    observer.look();
    site.start(Program::Thetabus, &["doctor"]).expect_code(0);
}
