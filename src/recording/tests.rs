//! Recordings: written, read, truncated and damaged.

use super::info::tests::arm;
use super::names::RUN_METADATA;
use super::series::{existing_files, numbered};
use super::*;
use crate::messages::{ErrorCode, Estimate, LastError, ParameterSet, Sample, Status, signals};
use std::fs;
use std::path::{Path, PathBuf};

/// A sample with different values that do not compress well.
fn sample(seq: u64) -> Sample {
    let mut s = Sample::EMPTY;
    (s.stream_id, s.seq, s.t_ns) = (77, seq, seq * 1_000_000);
    (s.joints, s.signals, s.flags) = (2, 0b111111, 0);
    for (k, array) in [
        &mut s.q,
        &mut s.dq,
        &mut s.ddq,
        &mut s.dddq,
        &mut s.setpoint,
        &mut s.input,
    ]
    .into_iter()
    .enumerate()
    {
        for (j, value) in array[..2].iter_mut().enumerate() {
            *value = ((seq * 12 + k as u64 * 2 + j as u64) as f64 * 0.7123).sin();
        }
    }
    s
}

fn estimate(block: u64) -> Estimate {
    let mut e = Estimate::EMPTY;
    (e.stream_id, e.block, e.t_last_ns) = (77, block, block * 1_900_000_000);
    (e.params, e.equations, e.derived_len, e.state, e.flags) = (9, 2, 1, 1, 0b101);
    (e.excited, e.usable) = (ParameterSet::from_bits(0b1_0101_0101), ParameterSet::from_bits(0b11));
    (e.fixed, e.condition) = (ParameterSet::from_bits(1 << 2 | 1 << 8), f64::INFINITY);
    for i in 0..9 {
        (e.theta[i], e.theta_std[i]) = (0.1 * i as f64 + block as f64, f64::NAN);
    }
    (e.derived[0], e.derived_std[0]) = (170.1, 0.25);
    (e.innovation_rms[1], e.residual_rms[0]) = (1e-9, f64::MIN_POSITIVE);
    (e.fit[0], e.fit[1], e.explained[1], e.fit_probability) = (1.02, 40.5, 0.999, 1e-12);
    e
}

/// Messages as bits, so that NaN compares equal.
fn bits(e: &Estimate) -> Vec<u64> {
    let scalars = [
        e.stream_id,
        e.block,
        e.t_first_ns,
        e.t_last_ns,
        e.model_hash,
        e.config_hash,
        e.accepted,
        e.missing,
    ];
    let more = [
        e.rejected,
        e.excited.bits() as u64,
        e.usable.bits() as u64,
        e.fixed.bits() as u64,
        (e.fixed.bits() >> 64) as u64,
        e.t_change_ns,
        e.condition.to_bits(),
    ];
    let small = [
        e.state,
        e.use_ok,
        e.flags,
        e.params,
        e.equations,
        e.derived_len,
        e.iterations,
        e.outliers,
    ];
    let arrays = e
        .innovation_rms
        .iter()
        .chain(&e.residual_rms)
        .chain(&e.fit)
        .chain(&e.explained)
        .chain([&e.fit_probability])
        .chain(&e.theta)
        .chain(&e.theta_std);
    let arrays = arrays.chain(&e.derived).chain(&e.derived_std).map(|v| v.to_bits());
    scalars
        .into_iter()
        .chain(more)
        .chain(small.map(u64::from))
        .chain(arrays)
        .collect()
}

/// Writes `samples` samples, an estimate every hundred, flushed every `flush`.
fn write(path: &Path, samples: u64, flush: u64, limits: RecordingLimits, finish: bool) -> Vec<PathBuf> {
    let mut recorder = Recorder::create(path, arm(), limits).unwrap();
    let mut paths = vec![path.to_path_buf()];
    for seq in 0..samples {
        recorder.sample(&sample(seq), seq + 5).unwrap();
        if seq % 100 == 99 {
            recorder.estimate(&estimate(seq / 100 + 1), seq + 6).unwrap();
            recorder
                .status(
                    &Status {
                        last_seq: seq,
                        pid: 9,
                        error: LastError::new(ErrorCode::Gap, seq),
                        ..Status::default()
                    },
                    7,
                )
                .unwrap();
        }
        if seq % flush == flush - 1 {
            recorder.flush().unwrap();
        }
        if paths.last().unwrap() != recorder.path() {
            paths.push(recorder.path().to_path_buf());
        }
    }
    if finish {
        assert_eq!(recorder.finish().unwrap().samples, samples);
    } else {
        // Like a kill: nothing more is written, not even buffered data.
        std::mem::forget(recorder);
    }
    paths
}

/// Reads a whole recording: seq of the samples, blocks of the estimates, number of statuses, loss.
/// Also checks values.
fn read(path: &Path, span: Span) -> (Vec<u64>, Vec<u64>, u64, Loss) {
    let mut reader = RecordingReader::open(path, span).unwrap();
    // Each file states its own number.
    let file_number = reader.info().file_number;
    assert_eq!(reader.info(), &RunInfo { file_number, ..arm() });
    let (mut seqs, mut blocks, mut statuses) = (Vec::new(), Vec::new(), 0);
    while let Some(entry) = reader.next_entry().unwrap() {
        match entry {
            Entry::Sample { sample: s, sent_ns } => {
                assert_eq!((*s, sent_ns), (sample(s.seq), s.seq + 5));
                seqs.push(s.seq);
            }
            Entry::Estimate { estimate: e, .. } => {
                assert_eq!(bits(e), bits(&estimate(e.block)));
                blocks.push(e.block);
            }
            Entry::Status { status, .. } => {
                assert_eq!((status.pid, status.error.words()), (9, "samples are missing"));
                statuses += 1;
            }
            Entry::Recorder(_) => {}
        }
    }
    (seqs, blocks, statuses, reader.loss())
}

const NO_LIMITS: RecordingLimits = RecordingLimits {
    file_bytes: 0,
    files: 0,
};

#[test]
fn prop_messages_come_back_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 5_000, 1_000, NO_LIMITS, true);
    let (seqs, blocks, statuses, loss) = read(&path, Span::default());
    assert_eq!(seqs, (0..5_000).collect::<Vec<_>>());
    assert_eq!(blocks, (1..=50).collect::<Vec<_>>());
    assert_eq!(statuses, 50);
    assert!(loss.is_none(), "{loss}");
}

#[test]
fn prop_a_span_of_stream_time_is_read_without_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 5_000, 500, NO_LIMITS, true);
    let span = Span {
        from_ns: 1_250_000_000,
        to_ns: 1_999_000_000,
    };
    let (seqs, _, _, loss) = read(&path, span);
    assert_eq!(seqs, (1_250..=1_999).collect::<Vec<_>>());
    assert!(loss.is_none(), "{loss}");
}

#[test]
fn fault_an_existing_file_is_not_written_over() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    fs::write(&path, "mine").unwrap();
    let error = Recorder::create(&path, arm(), NO_LIMITS).err().unwrap();
    assert!(matches!(error, RecordError::Io { .. }), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"mine");
}

#[test]
fn fault_of_a_killed_recorder_everything_flushed_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 2_750, 500, NO_LIMITS, false);
    let (seqs, _, _, loss) = read(&path, Span::default());
    assert_eq!(seqs, (0..2_500).collect::<Vec<_>>());
    assert_eq!(loss.unfinished_files, 1);
}

/// A small random generator, so that the places vary but are the same in every run.
fn places(count: usize, below: u64) -> impl Iterator<Item = u64> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    (0..count).map(move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % below
    })
}

#[test]
fn fault_a_file_cut_at_20_random_places_is_read_up_to_the_cut() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("run.mcap");
    write(&whole, 5_000, 500, NO_LIMITS, true);
    let bytes = fs::read(&whole).unwrap();
    // Where each flush ended: the chunk with samples up to here is whole in a file of this length.
    let chunk_ends: Vec<u64> = chunks(&bytes).into_iter().skip(1).map(|(_, end)| end as u64).collect();
    assert_eq!(chunk_ends.len(), 11, "one chunk per flush, the last one of `finish`");
    let cut = dir.path().join("cut.mcap");
    let first_chunk = chunks(&bytes)[0].1 as u64;
    for at in places(20, bytes.len() as u64 - first_chunk).map(|p| p + first_chunk) {
        fs::write(&cut, &bytes[..at as usize]).unwrap();
        let (seqs, _, _, loss) = read(&cut, Span::default());
        let flushed = 500 * chunk_ends[..10].iter().filter(|&&end| end <= at).count() as u64;
        assert!(seqs.len() as u64 >= flushed, "cut at {at}: {} of {flushed}", seqs.len());
        // Samples read from the truncated chunk are in order and without a gap.
        assert_eq!(seqs, (0..seqs.len() as u64).collect::<Vec<_>>(), "cut at {at}");
        assert_eq!(loss.unfinished_files, 1, "cut at {at}: {loss}");
    }
    // If the file is cut inside the metadata, it cannot be read.
    fs::write(&cut, &bytes[..100]).unwrap();
    let error = RecordingReader::open(&cut, Span::default()).err().unwrap().to_string();
    assert!(error.contains("no metadata"), "{error}");
}

/// Start and end of each chunk record.
fn chunks(bytes: &[u8]) -> Vec<(usize, usize)> {
    let mut at = 8;
    let mut found = Vec::new();
    while at + 9 <= bytes.len() - 8 {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == 0x06 {
            found.push((at, at + 9 + length));
        }
        at += 9 + length;
    }
    found
}

#[test]
fn fault_a_damaged_chunk_is_left_out_and_its_messages_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 5_000, 500, NO_LIMITS, true);
    let bytes = fs::read(&path).unwrap();
    let whole: Vec<u64> = (0..500).chain(1_000..5_000).collect();
    let (start, end) = chunks(&bytes)[2];
    // Each byte represents a kind of damage: opcode, length, checksum, name and size, data.
    for at in [
        start,
        start + 3,
        start + 34,
        start + 42,
        start + 45,
        start + 400,
        end - 5,
    ] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x5a;
        fs::write(&path, damaged).unwrap();
        let (seqs, _, statuses, loss) = read(&path, Span::default());
        assert_eq!(seqs, whole, "byte {} of the chunk", at - start);
        assert_eq!(statuses, 45);
        assert!(!loss.is_none());
        if at > start + 45 {
            // 500 samples, 5 estimates, 5 status, 1 of the recorder
            assert_eq!((loss.damaged_chunks, loss.messages), (1, 511), "{loss}");
        }
    }
}

#[test]
fn fault_random_bytes_never_end_in_a_panic_or_a_wrong_sample() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 2_000, 200, NO_LIMITS, true);
    let bytes = fs::read(&path).unwrap();
    let first_chunk = chunks(&bytes)[1].0;
    let mut places = places(600, (bytes.len() - first_chunk) as u64);
    for _ in 0..200 {
        let mut damaged = bytes.clone();
        for at in places.by_ref().take(3) {
            damaged[first_chunk + at as usize] ^= 0xff;
        }
        fs::write(&path, damaged).unwrap();
        // `read` compares each sample with what was written.
        read(&path, Span::default());
    }
}

#[test]
fn prop_a_rotated_recording_is_read_as_one_and_keeps_to_its_limits() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let limits = RecordingLimits {
        file_bytes: 60_000,
        files: 0,
    };
    let paths = write(&path, 5_000, 100, limits, true);
    assert!(paths.len() > 3, "{paths:?}");
    for path in &paths {
        // At most one flush beyond the limit, plus the index of the file.
        assert!(fs::metadata(path).unwrap().len() < 120_000);
    }
    let (seqs, _, _, loss) = read(&path, Span::default());
    assert_eq!(seqs, (0..5_000).collect::<Vec<_>>());
    assert!(loss.is_none(), "{loss}");
    // From a later file on.
    let (seqs, ..) = read(&paths[2], Span::default());
    assert!(seqs[0] > 0 && *seqs.last().unwrap() == 4_999);

    let kept = dir.path().join("kept.mcap");
    let paths = write(&kept, 5_000, 100, RecordingLimits { files: 2, ..limits }, true);
    let existing: Vec<_> = paths.iter().filter(|p| p.exists()).collect();
    assert_eq!(existing, paths[paths.len() - 2..].iter().collect::<Vec<_>>());
    assert_eq!(numbered(&kept, 12).file_name().unwrap(), "kept_0012.mcap");
}

#[test]
fn regress_a_recording_whose_own_name_ends_in_digits_is_read_and_resumed_as_one() {
    let dir = tempfile::tempdir().unwrap();
    let limits = RecordingLimits {
        file_bytes: 60_000,
        files: 0,
    };
    let at = |name: &str| dir.path().join(name);
    // The second name is one that a later file of `run.mcap` could have.
    for name in ["run.mcap", "run_20260801.mcap", "run_4294967295.mcap"] {
        let paths = write(&at(name), 5_000, 100, limits, true);
        assert!(paths.len() > 3, "{paths:?}");
        let (seqs, _, _, loss) = read(&at(name), Span::default());
        assert_eq!(seqs.len(), 5_000, "{name}");
        assert!(loss.is_none(), "{loss}");
        let (seqs, ..) = read(&paths[2], Span::default());
        assert_eq!(*seqs.last().unwrap(), 4_999, "{name}");
        // A recorder that continues takes the next number, and ignores files of other recordings.
        let existing: Vec<_> = existing_files(&at(name)).into_iter().map(|(_, path)| path).collect();
        assert_eq!(existing, paths);
        let resumed = Recorder::resume(&at(name), arm(), limits).unwrap();
        assert_eq!(resumed.path(), numbered(&at(name), paths.len() as u32));
    }
    // Also next to the others.
    let own = existing_files(&at("run.mcap"));
    assert!(own.iter().all(|(number, _)| *number < 1_000), "{own:?}");
    fs::remove_file(at("run_20260801.mcap")).unwrap();
    let oldest = oldest_file(&at("run_20260801.mcap"));
    assert_eq!(oldest, Some(at("run_20260801_0001.mcap")));
}

#[test]
fn fault_samples_that_never_reached_the_recorder_are_stated_in_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = Recorder::create(&path, arm(), NO_LIMITS).unwrap();
    for seq in (0..1_000).chain(1_300..2_000) {
        recorder.sample(&sample(seq), seq + 5).unwrap();
    }
    assert_eq!(recorder.finish().unwrap().samples_missing, 300);
    let (seqs, _, _, loss) = read(&path, Span::default());
    assert_eq!((seqs.len(), loss.samples_not_recorded), (1_700, 300));
    assert!(!loss.is_none());
}

#[test]
fn val_the_mcap_crate_reads_every_message_with_its_checksums() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 3_000, 500, NO_LIMITS, true);
    let bytes = fs::read(&path).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap();
    let samples = messages
        .map(Result::unwrap)
        .filter(|m| m.channel.topic == "/thetabus/arm/sample");
    assert_eq!(samples.count(), 3_000);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    // Samples twice: as samples and as joint states.
    assert_eq!(summary.stats.unwrap().message_count, 2 * 3_000 + 30 + 30 + 7);
    let index = summary
        .metadata_indexes
        .iter()
        .find(|m| m.name == RUN_METADATA)
        .unwrap();
    let metadata = mcap::read::metadata(&bytes, index).unwrap().metadata;
    assert_eq!(metadata["config_toml"], arm().config_toml);
}

/// A Python with the packages to read recordings; `None`, with a message, if there is none and none
/// is required.
fn peer_python() -> Option<String> {
    let named = std::env::var("THETABUS_PEERS_PYTHON").ok();
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/ci-venv/bin/python");
    let candidates = [named, Some(ours.to_string_lossy().into_owned()), Some("python3".into())];
    let found = candidates.into_iter().flatten().find(|python| {
        let imports = std::process::Command::new(python)
            .args(["-c", "import mcap, mcap_ros2, rosbags"])
            .output();
        imports.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        let why = "no Python with the packages mcap, mcap-ros2-support and rosbags (set THETABUS_PEERS_PYTHON)";
        assert!(std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"), "{why}");
        eprintln!("skipped: {why}");
    }
    found
}

/// The result of a script of `tests/peers` for a recording.
fn peer(python: &str, script: &str, path: &Path) -> serde_json::Value {
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers");
    let output = std::process::Command::new(python)
        .arg(scripts.join(script))
        .arg(path)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn val_the_python_packages_decode_every_message() {
    let Some(python) = peer_python() else { return };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    write(&path, 1_000, 300, NO_LIMITS, true);
    let found = peer(&python, "read_recording.py", &path);
    for (topic, count) in [("sample", 1_000), ("estimate", 10), ("status", 10), ("recorder", 4)] {
        assert_eq!(found["counts"][format!("/thetabus/arm/{topic}")], count, "{topic}");
    }
    for encoding in found["encodings"].as_array().unwrap() {
        assert_eq!(
            (&encoding[2], &encoding[3]),
            (&"ros2msg".into(), &"cdr".into()),
            "{encoding}"
        );
    }
    let last = &found["last"]["/thetabus/arm/sample"];
    assert_eq!((&last["seq"], &last["signals"]), (&999.into(), &0b111111.into()));
    let float = |value: &serde_json::Value| value.as_str().unwrap().parse::<f64>().unwrap();
    assert_eq!(float(&last["q_2"]), sample(999).q[1]);
    assert_eq!(float(&last["input_1"]), sample(999).input[0]);
    // Python adds in the same order, so the sums agree to the bit.
    let sum = (0..1_000).map(|seq| sample(seq).dddq[0]).fold(0.0, |sum, v| sum + v);
    assert_eq!(float(&found["sums"]["/thetabus/arm/sample"]["dddq_1"]), sum);
    let last = &found["last"]["/thetabus/arm/status"];
    assert_eq!(
        (&last["error_text"], &last["error_seq"]),
        (&"samples are missing".into(), &999.into())
    );
    let last = &found["last"]["/thetabus/arm/estimate"];
    assert_eq!(float(&last["theta_9"]), estimate(10).theta[8]);
    assert!(float(&last["theta_9_std"]).is_nan());
    assert_eq!(float(&last["condition"]), f64::INFINITY);
    assert_eq!(float(&last["mass_2"]), 170.1);
    assert_eq!(found["metadata"][RUN_METADATA]["config_toml"], arm().config_toml);
    assert_eq!(found["metadata"]["thetabus_end"]["samples"], "1000");
}

#[test]
fn val_rosbags_reads_every_topic_by_its_own_definition_at_the_time_of_day() {
    let Some(python) = peer_python() else { return };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let mut recorder = Recorder::create(&path, arm(), NO_LIMITS).unwrap();
    // A machine without measured velocities, whose clock has run for an hour.
    let begin_ns = 3_600_000_000_000;
    let machine = |seq: u64| Sample {
        t_ns: begin_ns + seq * 1_000_000,
        signals: signals::Q | signals::INPUT,
        ..sample(seq)
    };
    for seq in 0..500 {
        recorder
            .sample(&machine(seq), begin_ns + seq * 1_000_000 + 70_000)
            .unwrap();
    }
    let last_ns = begin_ns + 499_000_000;
    let learnt = Estimate {
        t_last_ns: last_ns,
        ..estimate(1)
    };
    recorder.estimate(&learnt, last_ns + 90_000).unwrap();
    let status = Status {
        last_t_ns: last_ns,
        state: 4,
        ..Status::default()
    };
    recorder.status(&status, last_ns + 95_000).unwrap();
    recorder.finish().unwrap();

    let found = peer(&python, "read_rosbag.py", &path);
    let topics = [
        ("/thetabus/arm/sample", "thetabus/msg/Sample", 500),
        ("/thetabus/arm/estimate", "thetabus/msg/Estimate", 1),
        ("/thetabus/arm/status", "thetabus/msg/Status", 1),
        ("/thetabus/arm/recorder", "thetabus/msg/Recorder", 1),
        ("/arm/joint_states", "sensor_msgs/msg/JointState", 500),
    ];
    assert_eq!(found["types"].as_object().unwrap().len(), topics.len());
    let wall_ns = arm().clock_epoch_ns + last_ns;
    for (topic, kind, count) in topics {
        assert_eq!(
            (&found["types"][topic], &found["counts"][topic]),
            (&kind.into(), &count.into())
        );
        assert_eq!(found["times"][topic][1], wall_ns, "{topic}");
    }
    assert_eq!(found["times"]["/arm/joint_states"][0], wall_ns - 499_000_000);

    let text = |value: f64| serde_json::Value::from(format!("{value:?}"));
    let joints = &found["last"]["/arm/joint_states"];
    let s = machine(499);
    assert_eq!(joints["name"], serde_json::json!(["joint_1", "joint_2"]));
    assert_eq!(joints["position"], serde_json::json!([text(s.q[0]), text(s.q[1])]));
    assert_eq!(joints["velocity"], serde_json::json!([]));
    assert_eq!(
        joints["effort"],
        serde_json::json!([text(s.input[0]), text(s.input[1])])
    );
    let stamp = &joints["header"]["stamp"];
    assert_eq!(
        stamp["sec"].as_u64().unwrap() * 1_000_000_000 + stamp["nanosec"].as_u64().unwrap(),
        wall_ns
    );

    // Unmeasured signals are NaN; sets are one bool per parameter; states have names.
    let last = &found["last"]["/thetabus/arm/sample"];
    assert_eq!(
        (&last["q_1"], &last["dq_1"], &last["setpoint_2"]),
        (&text(s.q[0]), &"nan".into(), &"nan".into())
    );
    let last = &found["last"]["/thetabus/arm/estimate"];
    assert_eq!(
        (&last["theta_1_usable"], &last["theta_3_usable"]),
        (&true.into(), &false.into())
    );
    assert_eq!(
        (&last["theta_3_fixed"], &last["theta_9_excited"]),
        (&true.into(), &true.into())
    );
    let constants = &found["constants"]["/thetabus/arm/status"];
    assert_eq!(
        (&constants["STATE_POORLY_EXCITED"], &constants["STATE_MISFIT"]),
        (&4.into(), &9.into())
    );
    assert_eq!(found["constants"]["/thetabus/arm/sample"]["SIGNAL_INPUT"], 32);

    // None of this prevents reading it again.
    let mut reader = RecordingReader::open(&path, Span::default()).unwrap();
    let mut read = 0;
    while let Some(entry) = reader.next_entry().unwrap() {
        if let Entry::Sample { sample: s, sent_ns } = entry {
            let cleared = Sample {
                dq: [0.0; 8],
                ddq: [0.0; 8],
                dddq: [0.0; 8],
                setpoint: [0.0; 8],
                ..machine(s.seq)
            };
            assert_eq!((*s, sent_ns), (cleared, s.t_ns + 70_000));
            read += 1;
        }
    }
    assert_eq!((read, reader.loss().is_none()), (500, true));
    let states = read_joint_states(&path, &["joint_2", "joint_1"]).unwrap();
    assert_eq!((states.len(), states[499].t_ns), (500, wall_ns));
    assert_eq!(states[499].position, [s.q[1], s.q[0]]);
}

#[test]
fn prop_spans_hold_for_streams_that_begin_again_and_for_recordings_without_joint_states() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let info = RunInfo {
        joint_states: false,
        ..arm()
    };
    let mut recorder = Recorder::create(&path, info, NO_LIMITS).unwrap();
    // Two simulations, an hour apart, whose times begin at 0.
    for (stream_id, sent_ns) in [(1, 5_000_000_000), (2, 3_605_000_000_000)] {
        for seq in 0..2_000 {
            let s = Sample {
                stream_id,
                ..sample(seq)
            };
            recorder.sample(&s, sent_ns + seq).unwrap();
        }
    }
    recorder.finish().unwrap();
    let span = Span {
        from_ns: 500_000_000,
        to_ns: 599_000_000,
    };
    let mut reader = RecordingReader::open(&path, span).unwrap();
    let mut found = Vec::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let Entry::Sample { sample, .. } = entry {
            found.push((sample.stream_id, sample.seq));
        }
    }
    let expected: Vec<(u64, u64)> = [1, 2]
        .into_iter()
        .flat_map(|id| (500..600).map(move |seq| (id, seq)))
        .collect();
    assert_eq!(found, expected);
    let bytes = fs::read(&path).unwrap();
    let mut messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    assert!(messages.all(|m| m.channel.topic.starts_with("/thetabus/arm/")));
}
