//! What is read from outside: configuration, CSV, MCAP, checkpoint, samples, control. Each with what the programs do with it afterwards.

use super::mutate::Random;
use crate::checkpoint;
use crate::config::{Catalog, Config, Source, keys};
use crate::messages::{Command, Estimate, Journal, ParameterSet, Request, Sample, Status, sample_flags};
use crate::node::command::{NodeState, Order};
use crate::node::identifier::Identifier;
use crate::offline::LogReader;
use crate::recording::{
    Entry, EstimatesCsv, Recorder, RecordingLimits, RecordingReader, RunInfo, SamplesCsv, Span, read_journal,
};
use crate::report::{RunData, figures, page};
use crate::runner::Shutdown;
use crate::service::advice::Advisor;
use crate::service::commands::{Commands, Wanted};
use crate::service::run_info::run_info;
use crate::service::wiring::{identifier_node, identity, monitor_node};
use crate::service::{CommonArgs, IdentifyArgs, SpanArgs, TableFormat, identify, report};
use crate::sim::MachineSimulator;
use std::fs;
use std::path::{Path, PathBuf};

/// Name and what one case does.
pub(super) const TARGETS: [(&str, fn(&mut Random, &Corpora)); 6] = [
    ("configuration", configuration),
    ("csv", csv),
    ("mcap", mcap),
    ("checkpoint", checkpoints),
    ("samples", samples),
    ("control", control),
];

/// A block that is soon full.
const QUICK: [&str; 2] = ["estimator.block_len=100", "estimator.max_iterations=3"];
/// Samples of a recording or log.
const LENGTH: usize = 450;

/// Good inputs, which the cases change.
pub(super) struct Corpora {
    dir: PathBuf,
    /// Of the paper's arm, of an arm with encoders, of a servo axis.
    configs: Vec<Config>,
    samples: Vec<Vec<Sample>>,
    recordings: Vec<Vec<u8>>,
    logs: Vec<Vec<u8>>,
    states: Vec<NodeState>,
}

impl Corpora {
    pub(super) fn new(dir: &Path) -> Self {
        let sets = QUICK.map(str::to_owned);
        let load = |name: &str| {
            let source = Config::embedded(name).expect("built in");
            Config::load(&[source], &sets).expect("valid")
        };
        let configs: Vec<Config> = ["cedro2022", "encoder_only", "servo_axis"].map(load).into();
        let samples: Vec<Vec<Sample>> = configs.iter().map(simulated).collect();
        let recordings = configs.iter().zip(&samples).map(|(config, samples)| {
            let path = dir.join("good.mcap");
            record(&path, info(config), samples, &[], &[]);
            let bytes = fs::read(&path).expect("a recording");
            fs::remove_file(&path).expect("removed");
            bytes
        });
        let states = configs.iter().zip(&samples).map(|(config, samples)| {
            let mut node = identifier_node(config).expect("a node");
            samples.iter().for_each(|sample| node.on_sample(sample, &mut |_| {}));
            let mut state = NodeState::default();
            node.save(&mut state);
            state
        });
        Self {
            dir: dir.to_path_buf(),
            recordings: recordings.collect(),
            logs: vec![
                log(&samples[2]),
                exported(&configs[2], &samples[2]),
                exported(&configs[1], &samples[1]),
            ],
            states: states.collect(),
            samples,
            configs,
        }
    }
}

fn simulated(config: &Config) -> Vec<Sample> {
    let sim = &config.plant.sim;
    let simulator = MachineSimulator::new(sim).expect("valid");
    let joints = config.model.definition().joints;
    let numbered = simulator.take(LENGTH).enumerate();
    let samples = numbered.map(|(k, s)| Sample::new(7, k as u64, k as u64 * 1_000_000, joints, sim.signals(), &s));
    samples.collect()
}

fn info(config: &Config) -> RunInfo {
    run_info(config, &monitor_node(config, None), true)
}

/// Columns as in `config/servo_axis.toml`.
fn log(samples: &[Sample]) -> Vec<u8> {
    let mut text = "t_s,q_m,q_ref_m,voltage_v\n".to_owned();
    for s in samples {
        text.push_str(&format!(
            "{},{},{},{}\n",
            s.t_ns as f64 * 1e-9,
            s.q[0],
            s.setpoint[0],
            s.input[0]
        ));
    }
    text.into_bytes()
}

fn exported(config: &Config, samples: &[Sample]) -> Vec<u8> {
    let mut sink = Vec::new();
    let mut csv = SamplesCsv::new(&mut sink, &info(config)).expect("memory");
    samples.iter().for_each(|sample| csv.write(sample).expect("memory"));
    csv.finish().expect("memory");
    sink
}

fn record(path: &Path, info: RunInfo, samples: &[Sample], estimates: &[Estimate], told: &[Journal]) {
    // What a recording cannot hold is refused.
    let Ok(mut recorder) = Recorder::create(path, info, RecordingLimits::default()) else {
        return;
    };
    told.iter().for_each(|entry| recorder.journal(entry).expect("a disk"));
    for (k, sample) in samples.iter().enumerate() {
        recorder.sample(sample, k as u64).expect("a disk");
        if k % 100 == 99 {
            recorder.flush().expect("a disk");
        }
    }
    estimates.iter().for_each(|e| recorder.estimate(e, 1).expect("a disk"));
    recorder.status(&Status::default(), 1).expect("a disk");
    recorder.finish().expect("a disk");
}

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

/// `thetabus identify`: whatever comes of it, it comes back.
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
        // Whole as a file, hostile in what it says.
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

fn hostile_info(random: &mut Random, info: &mut RunInfo) {
    for _ in 0..random.below(4) {
        match random.below(9) {
            0 => info.joints = random.below(9),
            1 => info.simulated = !info.simulated,
            2 => info.parameters.truncate(random.below(10)),
            3 => info.derived = info.parameters.iter().take(random.below(9)).cloned().collect(),
            4 => info.equations = vec!["e".repeat(random.below(200)); random.below(9)],
            5 => info.input_unit = random.number(),
            6 => info.model = "m\u{1b}[2J".repeat(random.below(30)),
            7 => info.robot = random.pick(&["", "../..", "arm", "a b", "θ"]).to_owned(),
            _ => {
                let mut bytes = std::mem::take(&mut info.config_toml).into_bytes();
                random.mutate(&mut bytes);
                info.config_toml = String::from_utf8_lossy(&bytes).into_owned();
            }
        }
    }
}

fn hostile_sample(random: &mut Random, sample: &mut Sample) {
    for _ in 0..=random.below(3) {
        let (whole, real, joint) = (random.whole(), random.real(), random.below(8));
        match random.below(12) {
            0 => sample.stream_id = whole,
            1 => sample.seq = whole,
            2 => sample.t_ns = whole,
            3 => sample.flags = whole as u32,
            4 => sample.flags |= sample_flags::END,
            5 => sample.joints = whole as u32,
            6 => sample.signals = whole as u32,
            7 => sample.q[joint] = real,
            8 => sample.dq[joint] = real,
            9 => sample.setpoint[joint] = real,
            10 => sample.input[joint] = real,
            _ => (sample.ddq[joint], sample.dddq[joint]) = (real, real),
        }
    }
}

fn hostile_estimate(random: &mut Random, block: u64) -> Estimate {
    let reals: [f64; crate::model::MAX_PARAMS] = std::array::from_fn(|_| random.real());
    let mut wholes = || random.whole();
    Estimate {
        stream_id: 7,
        block: if wholes() % 2 == 0 { block } else { wholes() },
        t_first_ns: wholes(),
        t_last_ns: wholes(),
        model_hash: wholes(),
        config_hash: wholes(),
        accepted: wholes(),
        missing: wholes(),
        rejected: wholes(),
        excited: ParameterSet::from_bits(u128::from(wholes()) << 31),
        usable: ParameterSet::from_bits(u128::from(wholes())),
        fixed: ParameterSet::from_bits(u128::from(wholes()) << 64),
        t_change_ns: wholes(),
        state: wholes() as u32,
        use_ok: wholes() as u32,
        flags: wholes() as u32,
        params: wholes() as u32,
        equations: wholes() as u32,
        derived_len: wholes() as u32,
        iterations: wholes() as u32,
        outliers: wholes() as u32,
        condition: reals[0],
        theta: reals,
        theta_std: reals,
        ..crate::node::monitor::tests::estimate(block, reals[1])
    }
}

fn checkpoints(random: &mut Random, corpora: &Corpora) {
    let which = random.below(corpora.configs.len());
    let (config, samples) = (&corpora.configs[which], &corpora.samples[which]);
    let identity = identity(config);
    let mut state = corpora.states[which].clone();
    let whole = random.once_in(3);
    if !whole {
        // A state that is one by its checksum, and none by what it says.
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

/// Feeds a node; estimates that may be used are numbers.
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
    // hostile estimates claim any model: taken as they come, so that they reach the figures
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

fn hostile_request(random: &mut Random, config: &Config) -> Request {
    let mut request = Request::new(Command::Pause);
    request.command = match random.below(8) {
        0 => random.whole() as u32,
        _ => 1 + random.below(10) as u32,
    };
    let parameter = config.model.parameters()[random.below(config.model.parameters().len())]
        .name
        .as_ref();
    let names = [
        parameter,
        "forgetting_factor",
        "max_iterations",
        "change_margin_s",
        "gate_limit",
        "noise_floor_relative",
    ];
    request = request.named(random.pick(&names));
    if random.once_in(10) {
        request.name = std::array::from_fn(|_| random.next() as u8);
    }
    if random.once_in(2) {
        request = request.with_value(random.real());
    }
    request.flags = if random.once_in(10) {
        random.whole() as u32
    } else {
        request.flags
    };
    request.from_seq = if random.once_in(2) { 0 } else { random.whole() };
    if random.once_in(3) {
        (request.part, request.parts) = (random.below(3) as u32, random.below(4) as u32);
        request.data_len = random.whole() as u32;
        request.data.fill_with(|| random.next() as u8);
    }
    request
}
