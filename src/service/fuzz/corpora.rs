//! Valid inputs, which the cases mutate.

use crate::config::Config;
use crate::messages::{Estimate, Journal, Sample, Status};
use crate::node::command::NodeState;
use crate::recording::{Recorder, RecordingLimits, RunInfo, SamplesCsv};
use crate::service::run_info::run_info;
use crate::service::wiring::{identifier_node, monitor_node};
use crate::sim::MachineSimulator;
use std::fs;
use std::path::{Path, PathBuf};

/// Settings for short blocks.
pub(super) const QUICK: [&str; 2] = ["estimator.block_len=100", "estimator.max_iterations=3"];
/// Number of samples in a recording or log.
pub(super) const LENGTH: usize = 450;

/// Valid inputs, which the cases mutate.
pub(super) struct Corpora {
    pub(super) dir: PathBuf,
    /// Configurations of the paper's arm, an arm with encoders, and a servo axis.
    pub(super) configs: Vec<Config>,
    pub(super) samples: Vec<Vec<Sample>>,
    pub(super) recordings: Vec<Vec<u8>>,
    pub(super) logs: Vec<Vec<u8>>,
    pub(super) states: Vec<NodeState>,
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

pub(super) fn simulated(config: &Config) -> Vec<Sample> {
    let sim = &config.plant.sim;
    let simulator = MachineSimulator::new(sim).expect("valid");
    let joints = config.model.definition().joints;
    let numbered = simulator.take(LENGTH).enumerate();
    let samples = numbered.map(|(k, s)| Sample::new(7, k as u64, k as u64 * 1_000_000, joints, sim.signals(), &s));
    samples.collect()
}

pub(super) fn info(config: &Config) -> RunInfo {
    run_info(config, &monitor_node(config, None), true)
}

/// Columns as in `config/servo_axis.toml`.
pub(super) fn log(samples: &[Sample]) -> Vec<u8> {
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

pub(super) fn exported(config: &Config, samples: &[Sample]) -> Vec<u8> {
    let mut sink = Vec::new();
    let mut csv = SamplesCsv::new(&mut sink, &info(config)).expect("memory");
    samples.iter().for_each(|sample| csv.write(sample).expect("memory"));
    csv.finish().expect("memory");
    sink
}

pub(super) fn record(path: &Path, info: RunInfo, samples: &[Sample], estimates: &[Estimate], told: &[Journal]) {
    // A recording refuses what it cannot represent.
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
