//! External inputs: configuration, CSV, MCAP, checkpoint, samples, control; each followed by the
//! processing in the programs.

use super::corpora::{Corpora, LENGTH, QUICK, info, record};
use super::hostile::{hostile_estimate, hostile_info, hostile_request, hostile_sample};
use super::mutate::Random;
use super::robots::{cell, robot};
use crate::checkpoint;
use crate::config::{Catalog, Config, Source, keys};
use crate::messages::{Estimate, Journal, Request, Sample, Status};
use crate::node::command::{NodeState, Order};
use crate::node::identifier::Identifier;
use crate::offline::LogReader;
use crate::recording::{Entry, EstimatesCsv, RecordingReader, SamplesCsv, Span, read_journal};
use crate::report::{RunData, figures, page};
use crate::runner::Shutdown;
use crate::service::advice::Advisor;
use crate::service::commands::{Commands, Wanted};
use crate::service::wiring::{identifier_node, identity, monitor_node};
use crate::service::{CommonArgs, IdentifyArgs, SpanArgs, TableFormat, identify, report};
use std::fs;
use std::path::Path;

/// Name and function of one case.
pub(super) const TARGETS: [(&str, fn(&mut Random, &Corpora)); 8] = [
    ("configuration", configuration),
    ("robot", robot),
    ("cell", cell),
    ("csv", csv),
    ("mcap", mcap),
    ("checkpoint", checkpoints),
    ("samples", samples),
    ("control", control),
];

fn configuration(random: &mut Random, corpora: &Corpora) {
    let names = [
        "default",
        "cedro2022",
        "encoder_only",
        "servo_axis",
        "cedro2022_best",
        "own_plant",
    ];
    let Some(Source::Embedded { text, .. }) = Config::embedded(random.pick(&names)) else {
        unreachable!("built in")
    };
    let mut bytes = text.into_bytes();
    random.mutate(&mut bytes);
    let name = "fuzz".to_owned();
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let source = match random.below(3) {
        0 => {
            let path = corpora.dir.join("fuzz.toml");
            fs::write(&path, &bytes).expect("a disk");
            Source::File(path)
        }
        1 => Source::Recorded { name, text },
        _ => Source::Embedded { name, text },
    };
    let known: Vec<String> = keys().map(crate::config::Key::path).collect();
    let sets: Vec<String> = (0..random.below(4))
        .map(|_| format!("{}={}", known[random.below(known.len())], random.number()))
        .collect();
    let loaded = Config::load(&[source], &sets);
    match loaded {
        Err(error) => {
            let error = error.to_string();
            assert!(
                !error.is_empty() && error.len() < 100_000,
                "{} bytes of error",
                error.len()
            );
        }
        Ok(config) => {
            let again = Config::parse("again", &config.to_toml()).expect("what is written out loads");
            assert_eq!(again.to_toml(), config.to_toml());
            let key = &known[random.below(known.len())];
            let _ = config.with_number(key, random.real());
        }
    }
}

fn csv(random: &mut Random, corpora: &Corpora) {
    let which = random.below(corpora.logs.len());
    let mut bytes = corpora.logs[which].clone();
    random.mutate(&mut bytes);
    if random.once_in(20) {
        setpoints(random, corpora);
    }
    let config = if which == 2 { "encoder_only" } else { "servo_axis" };
    let mut log = LogReader::new(bytes.as_slice(), &corpora.configs[2].log, 1, 1e-3);
    if let Ok(log) = &mut log {
        let mut ended = false;
        while let Ok(Some(sample)) = log.next_sample() {
            assert!(!ended && sample.q[0].is_finite() && sample.input[0].is_finite());
            ended = sample.is_end();
        }
    }
    let path = corpora.dir.join("fuzz.csv");
    fs::write(&path, &bytes).expect("a disk");
    identified(&path, Some(config), random);
}

/// A table of setpoints.
fn setpoints(random: &mut Random, corpora: &Corpora) {
    let rows: String = (0..200).map(|k| format!("{k},0.{k},-0.{k}\n")).collect();
    let mut bytes = format!("t_s,q1_rad,q2_rad\n{rows}").into_bytes();
    random.mutate(&mut bytes);
    let path = corpora.dir.join("setpoints.csv");
    fs::write(&path, &bytes).expect("a disk");
    let sets = [
        "plant.setpoint.kind=csv".to_owned(),
        format!("plant.setpoint.csv.path={}", path.display()),
    ];
    if let Ok(config) = Config::load(&[], &sets) {
        let again = Config::parse("again", &config.to_toml()).expect("what is written out loads");
        assert_eq!(again.plant, config.plant);
    }
}

/// `thetabus identify`: it must return, with any result.
fn identified(path: &Path, config: Option<&str>, random: &mut Random) {
    let mut common = CommonArgs {
        set: QUICK.map(str::to_owned).into(),
        ..CommonArgs::default()
    };
    if let Some(Source::Embedded { text, .. }) = config.and_then(Config::embedded) {
        let file = path.with_extension("toml");
        fs::write(&file, text).expect("a disk");
        common.config.push(file);
    }
    let args = IdentifyArgs {
        input: path.to_path_buf(),
        out: None,
        validate: None,
        span: SpanArgs {
            from: random.once_in(10).then_some(0.1),
            to: random.once_in(10).then(|| random.real().abs()),
        },
        format: TableFormat::default(),
        warm: false,
        common,
    };
    if let Err(failure) = identify(&args, &Shutdown::new()) {
        let said = failure.to_string();
        assert!(
            !said.is_empty() && said.len() < 100_000,
            "{} bytes of error",
            said.len()
        );
    }
}

fn mcap(random: &mut Random, corpora: &Corpora) {
    let path = corpora.dir.join("fuzz.mcap");
    let _ = fs::remove_file(&path);
    if random.once_in(2) {
        let mut bytes = corpora.recordings[random.below(corpora.recordings.len())].clone();
        random.mutate(&mut bytes);
        fs::write(&path, &bytes).expect("a disk");
    } else {
        // A valid file with hostile content.
        let which = random.below(corpora.configs.len());
        let mut info = info(&corpora.configs[which]);
        hostile_info(random, &mut info);
        let mut samples = corpora.samples[which].clone();
        for _ in 0..random.below(20) {
            let at = random.below(samples.len());
            hostile_sample(random, &mut samples[at]);
        }
        let estimates: Vec<Estimate> = (0..random.below(5))
            .map(|k| hostile_estimate(random, k as u64))
            .collect();
        record(&path, info, &samples, &estimates, &[]);
    }
    let Ok(mut reader) = RecordingReader::open(&path, Span::default()) else {
        identified(&path, None, random);
        return;
    };
    let mut advisor = Advisor::new(&corpora.configs[1], reader.info().joints);
    let mut csv = SamplesCsv::new(std::io::sink(), reader.info()).expect("a sink");
    while let Ok(Some(entry)) = reader.next_entry() {
        if let Entry::Sample { sample, .. } = entry {
            advisor.take(sample);
            csv.write(sample).expect("a sink");
        }
    }
    let _ = advisor.line(None);
    let _ = read_journal(&path);
    if let Ok(run) = report::read(&path, Span::default(), &Catalog::default(), |_| ()) {
        show(&run, random);
    }
    identified(&path, None, random);
}

/// Table, tables as files, figures and page of a run.
fn show(run: &RunData, random: &mut Random) {
    let summary = run.summary();
    let table = summary.to_string();
    assert!(!table.contains('\u{1b}'), "a control character reaches the terminal");
    serde_json::to_string(&summary).expect("plain data");
    let (parameters, derived) = (run.monitor.parameters(), run.monitor.derived());
    let mut csv = EstimatesCsv::new(std::io::sink(), parameters, run.info.equations.len(), derived).expect("a sink");
    run.estimates.iter().for_each(|e| csv.write(e).expect("a sink"));
    if random.once_in(5) {
        let figures = figures(run);
        figures.iter().for_each(|figure| _ = figure.svg());
        let _ = page(run, &summary, &figures, &[]);
    }
}

fn checkpoints(random: &mut Random, corpora: &Corpora) {
    let which = random.below(corpora.configs.len());
    let (config, samples) = (&corpora.configs[which], &corpora.samples[which]);
    let identity = identity(config);
    let mut state = corpora.states[which].clone();
    let whole = random.once_in(3);
    if !whole {
        // A state with a valid checksum and invalid content.
        for _ in 0..=random.below(5) {
            let (real, count) = (random.real(), random.whole());
            let (reals, counts) = (&mut state.estimator.reals, &mut state.estimator.counts);
            match random.below(6) {
                0 => reals.truncate(random.below(reals.len() + 1)),
                1 => counts.truncate(random.below(counts.len() + 1)),
                2 => reals.extend(vec![real; random.below(1000)]),
                3 if !counts.is_empty() => {
                    let at = random.below(counts.len());
                    counts[at] = count;
                }
                4 => {
                    (state.block, state.t_ns, state.blocks, state.stream_id) =
                        (count, random.whole(), random.whole(), 7)
                }
                _ if !reals.is_empty() => {
                    let at = random.below(reals.len());
                    reals[at] = real;
                }
                _ => {}
            }
        }
    }
    let mut bytes = checkpoint::encode(&identity, &state).expect("small");
    if whole {
        random.mutate(&mut bytes);
    }
    let path = corpora.dir.join("fuzz.checkpoint");
    fs::write(&path, &bytes).expect("a disk");
    let read = checkpoint::read(&path).expect("a file").expect("a file");
    let Ok(state) = checkpoint::decode(&read, &identity) else {
        return;
    };
    let mut node = identifier_node(config).expect("a node");
    if node.load(&state).is_err() {
        return;
    }
    follow(&mut *node, samples);
    node.save(&mut NodeState::default());
}

/// Feeds a node and checks that usable estimates are numbers.
fn follow(node: &mut dyn Identifier, samples: &[Sample]) {
    for sample in samples {
        node.on_sample(sample, &mut |e| {
            let theta = &e.theta[..e.params as usize];
            assert!(e.use_ok == 0 || theta.iter().all(|v| v.is_finite()), "{theta:?}");
        });
        while node.take_done().is_some() {}
    }
    let _ = node.status();
}

fn samples(random: &mut Random, corpora: &Corpora) {
    let which = random.below(corpora.configs.len());
    let config = &corpora.configs[which];
    let mut samples = corpora.samples[which].clone();
    for _ in 0..=random.below(100) {
        let at = random.below(samples.len());
        match random.below(10) {
            0 => samples.swap(at, random.below(LENGTH)),
            1 => samples[at] = samples[random.below(LENGTH)],
            _ => hostile_sample(random, &mut samples[at]),
        }
    }
    follow(&mut *identifier_node(config).expect("a node"), &samples);
    // hostile estimates may claim any model; accept all, so that they reach the figures
    let monitor = monitor_node(config, Some(&config.plant.sim)).of_model(0);
    let mut run = RunData::new(info(config), monitor);
    for (k, sample) in samples.iter().enumerate() {
        run.sample(sample, random.whole());
        if k % 40 == 0 {
            let estimate = hostile_estimate(random, k as u64 / 40);
            let _ = run.monitor.line(&estimate);
            run.estimate(&estimate, random.whole());
            run.status(&Status {
                stream_id: 7,
                state: random.whole() as u32,
                accepted: random.whole(),
                missing: random.whole(),
                rejected: random.whole(),
                condition: random.real(),
                ..Status::default()
            });
        }
    }
    let _ = run.block_s();
    show(&run, random);
}

fn control(random: &mut Random, corpora: &Corpora) {
    let which = random.below(corpora.configs.len());
    let (config, samples) = (&corpora.configs[which], &corpora.samples[which]);
    let requests: Vec<Request> = (0..random.below(60)).map(|_| hostile_request(random, config)).collect();
    let mut node = identifier_node(config).expect("a node");
    let mut commands = Commands::new(config);
    for (k, request) in requests.iter().enumerate() {
        if let Ok(Wanted::Order(change, what)) = commands.prepare(request) {
            assert!(!what.is_empty());
            if node.offer(Order::new(k as u64, request.from_seq, change)).is_err() {
                commands.undo();
            }
        }
        let at = (k * 8).min(LENGTH - 8);
        follow(&mut *node, &samples[at..at + 8]);
    }
    follow(&mut *node, samples);
    if random.once_in(4) {
        let journal = |request| Journal {
            stream_id: if random.once_in(2) { 7 } else { random.whole() },
            block: random.whole(),
            request,
        };
        let told: Vec<Journal> = requests.into_iter().map(journal).collect();
        let path = corpora.dir.join("told.mcap");
        let _ = fs::remove_file(&path);
        record(&path, info(config), samples, &[], &told);
        identified(&path, None, random);
    }
}
