//! What the way from a sample to an estimate consists of, a stage each: for the times of `stages`
//! and the counts of `instructions`.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use thetabus::estimator::{BlockEstimator, EquationNoise, EstimatorOptions, ParameterPrior};
use thetabus::messages::{Sample, signals};
use thetabus::model::{DriveInput, JointSample, Manipulator, Motion, Plant, ServoAxis};
use thetabus::node::monitor::Label;
use thetabus::recording::{Entry, Recorder, RecordingLimits, RecordingReader, RunInfo, Span};
use thetabus::robot::{
    EnergyRegressors, IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, Selection,
};
use thetabus::rows::{
    InputSource, InputTiming, PointwiseBlock, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, structure,
};
use thetabus::sim::{
    ArmSimulator, Interpolation, Machine, MachineSimulator, MassSchedule, SensorOptions, ServoAxisOptions, SimOptions,
};

/// N of the shipped configurations.
const BLOCK: usize = 1900;

/// Name of a stage's recording.
const FILE: &str = "stage.mcap";

/// A piece of work, done once. What it works on stays alive, so that freeing memory does not count.
pub type Work = Box<dyn FnMut()>;

/// One stage.
pub struct Stage {
    /// Its path.
    pub name: &'static str,
    /// Pieces of work in one go: samples, blocks.
    pub pieces: u64,
    /// Everything up to the work, which can be made ready as often as needed.
    pub ready: Box<dyn Fn() -> Work>,
}

fn stage(name: &'static str, pieces: usize, ready: impl Fn() -> Work + 'static) -> Stage {
    Stage {
        name,
        pieces: pieces as u64,
        ready: Box::new(ready),
    }
}

/// A group of stages that are made ready together, with their names.
type Group = (&'static [&'static str], fn() -> Vec<Stage>);

const GROUPS: [Group; 6] = [
    (
        &[
            "rows/pointwise/sample",
            "rows/projected/sample",
            "rows/projected/whitening",
            "rows/projected/block",
        ],
        rows,
    ),
    (
        &[
            "block/p9/n475/iterations3",
            "block/p9/n1900/iterations1",
            "block/p9/n1900/iterations3",
            "block/p9/n1900/iterations10",
            "block/p9/n7600/iterations3",
        ],
        blocks,
    ),
    (&["alarm/quiet", "alarm/jump", "alarm/worst"], alarms),
    (&["axis/projected/sample", "axis/projected/block"], axis),
    (
        &["robot/regressors", "robot/sample", "robot/block", "robot/payload/block"],
        robot,
    ),
    (&["recording/write", "recording/read", "recording/identify"], recording),
];

/// The stages with `only` in their names, all of them if it is empty. A group of which no stage is
/// wanted is not made ready.
pub fn stages(only: &str) -> Vec<Stage> {
    let mut all = Vec::new();
    for (names, make) in GROUPS {
        if names.iter().any(|name| name.contains(only)) {
            let stages = make();
            assert!(stages.iter().map(|stage| &stage.name).eq(names), "expected {names:?}");
            all.extend(stages.into_iter().filter(|stage| stage.name.contains(only)));
        }
    }
    all
}

/// The paper's arm, both joints in motion from the first sample on.
fn exact_samples(count: usize, mass_2: MassSchedule) -> Vec<JointSample> {
    let sim = SimOptions {
        mass_2,
        sensors: SensorOptions {
            input_noise_v: 0.05,
            ..SensorOptions::exact()
        },
        ..SimOptions::cedro2022()
    };
    ArmSimulator::new(&sim)
        .expect("valid options")
        .skip(BLOCK)
        .take(count)
        .collect()
}

fn seen_samples(count: usize) -> Vec<JointSample> {
    let sim = SimOptions {
        sensors: SensorOptions::encoder(16, 0.05),
        ..SimOptions::cedro2022()
    };
    ArmSimulator::new(&sim).expect("valid options").take(count).collect()
}

fn pointwise(samples: &[JointSample]) -> PointwiseBlock<Manipulator> {
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, samples.len());
    for (k, sample) in samples.iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
    }
    block
}

fn arm_options() -> EstimatorOptions {
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let starts = truth.iter().zip([2.5, 0.4].into_iter().cycle());
    EstimatorOptions::recommended(starts.map(|(t, factor)| ParameterPrior::positive(t * factor)), 2)
}

fn estimator(options: EstimatorOptions) -> BlockEstimator {
    BlockEstimator::new(structure(&Manipulator::default()), options).expect("valid options")
}

fn arm_rows() -> ProjectedOptions {
    ProjectedOptions {
        timing: InputTiming::Continuous,
        noise: SensorNoise::encoder(16, 0.05),
        ..ProjectedOptions::recommended()
    }
}

/// A projected block in the midst of a run, empty, with an estimator that has seen what came
/// before.
fn in_run(
    plant: &(impl Plant + Clone + Send + Sync + 'static),
    rows: ProjectedOptions,
    options: &EstimatorOptions,
    samples: &[JointSample],
) -> (ProjectedBlock, BlockEstimator) {
    let mut block = ProjectedBlock::new(plant.clone(), rows, BLOCK)
        .and_then(|block| block.starting_at(&options.theta_start()))
        .expect("valid options");
    let mut settled = BlockEstimator::new(structure(plant), options.clone()).expect("valid options");
    for (k, sample) in samples.iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
        if (k + 1) % BLOCK == 0 {
            block.prepare(settled.theta());
            settled.update(&block);
            block.clear();
        }
    }
    (block, settled)
}

/// A projected block in the midst of a run, with an estimator that has seen what came before.
struct LastBlock {
    samples: Vec<JointSample>,
    empty: ProjectedBlock,
    full: ProjectedBlock,
    settled: BlockEstimator,
}

/// Blocks that come before it: so many that none is fitted for its weights any more, as the first
/// ones are.
const BEFORE: usize = 11;

impl LastBlock {
    /// The last of the blocks of these samples.
    fn of(
        plant: &(impl Plant + Clone + Send + Sync + 'static),
        rows: ProjectedOptions,
        options: &EstimatorOptions,
        samples: &[JointSample],
    ) -> Self {
        let (before, last) = samples.split_at(BEFORE * BLOCK);
        let (empty, settled) = in_run(plant, rows, options, before);
        let mut full = empty.clone();
        push_last(&mut full, last);
        Self {
            samples: last.to_vec(),
            empty,
            full,
            settled,
        }
    }

    /// A sample into the block.
    fn sample(&self, name: &'static str) -> Stage {
        let (empty, samples) = (self.empty.clone(), self.samples.clone());
        stage(name, samples.len(), move || {
            let (mut block, samples) = (empty.clone(), samples.clone());
            Box::new(move || push_last(&mut block, &samples))
        })
    }

    /// The weights of its rows.
    fn whitening(&self, name: &'static str) -> Stage {
        let (full, theta) = (self.full.clone(), self.settled.theta().to_vec());
        stage(name, 1, move || {
            let (mut block, theta) = (full.clone(), theta.clone());
            Box::new(move || block.prepare(black_box(&theta)))
        })
    }

    /// The end of the block: its weights, and the update with them.
    fn end(&self, name: &'static str) -> Stage {
        let (settled, full) = (self.settled.clone(), self.full.clone());
        stage(name, 1, move || {
            let (mut settled, mut block) = (settled.clone(), full.clone());
            Box::new(move || {
                block.prepare(settled.theta());
                black_box(settled.update(black_box(&block)).iterations);
            })
        })
    }
}

fn push_last(block: &mut ProjectedBlock, samples: &[JointSample]) {
    for (k, sample) in samples.iter().enumerate() {
        assert!(black_box(
            block.push((BEFORE * BLOCK + k) as u64 * 1_000_000, black_box(sample))
        ));
    }
}

/// Samples to rows.
fn rows() -> Vec<Stage> {
    let exact = exact_samples(BLOCK, MassSchedule::constant(150.0));
    let seen = seen_samples((BEFORE + 1) * BLOCK);
    let options = EstimatorOptions {
        equations: vec![EquationNoise::WHITENED; 2],
        ..arm_options()
    };
    let projected = LastBlock::of(&Manipulator::default(), arm_rows(), &options, &seen);
    vec![
        stage("rows/pointwise/sample", BLOCK, move || {
            let samples = exact.clone();
            let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, BLOCK);
            Box::new(move || {
                for (k, sample) in samples.iter().enumerate() {
                    black_box(block.push(k as u64 * 1_000_000, black_box(sample)));
                }
            })
        }),
        projected.sample("rows/projected/sample"),
        projected.whitening("rows/projected/whitening"),
        projected.end("rows/projected/block"),
    ]
}

/// The update by the length of the block and by its iterations.
fn blocks() -> Vec<Stage> {
    let by = |name, len: usize, iterations: usize| {
        let options = EstimatorOptions {
            max_iterations: iterations,
            ..arm_options()
        };
        let fresh = estimator(options);
        let block = pointwise(&exact_samples(len, MassSchedule::constant(150.0)));
        stage(name, 1, move || {
            let (mut fresh, block) = (fresh.clone(), block.clone());
            Box::new(move || {
                black_box(fresh.update(black_box(&block)).iterations);
            })
        })
    };
    vec![
        by("block/p9/n475/iterations3", 475, 3),
        by("block/p9/n1900/iterations1", BLOCK, 1),
        by("block/p9/n1900/iterations3", BLOCK, 3),
        by("block/p9/n1900/iterations10", BLOCK, 10),
        by("block/p9/n7600/iterations3", 4 * BLOCK, 3),
    ]
}

/// A settled estimator's block without a change of the payload, with one, and with four: one more
/// than the search looks for in a block.
fn alarms() -> Vec<Stage> {
    // After this part of the block.
    let at_s = |part: f64| BLOCK as f64 * (6.0 + part) * 1e-3;
    let wild = MassSchedule {
        points: vec![
            (0.0, 150.0),
            (at_s(0.2), 250.0),
            (at_s(0.45), 90.0),
            (at_s(0.7), 200.0),
            (at_s(0.85), 120.0),
        ],
        interpolation: Interpolation::Step,
    };
    let settled = |mass_2: MassSchedule| {
        let samples = exact_samples(6 * BLOCK, mass_2);
        let mut settled = estimator(arm_options());
        for chunk in samples[..5 * BLOCK].chunks_exact(BLOCK) {
            settled.update(&pointwise(chunk));
        }
        (settled, pointwise(&samples[5 * BLOCK..]))
    };
    let case = |name, mass_2, changes: bool| {
        let (settled, block) = settled(mass_2);
        assert_eq!(settled.clone().update(&block).change.is_some(), changes, "{name}");
        stage(name, 1, move || {
            let (mut settled, block) = (settled.clone(), block.clone());
            Box::new(move || {
                black_box(settled.update(black_box(&block)).iterations);
            })
        })
    };
    vec![
        case("alarm/quiet", MassSchedule::constant(150.0), false),
        case("alarm/jump", MassSchedule::jump(150.0, at_s(0.4), 170.0), true),
        case("alarm/worst", wild, true),
    ]
}

/// The servo axis: four parameters.
fn axis() -> Vec<Stage> {
    let machine = ServoAxisOptions::emps();
    let plant = ServoAxis::new(Motion::Linear, DriveInput::Voltage, machine.gain).expect("a gain");
    let sim = SimOptions {
        machine: Machine::ServoAxis(machine),
        sensors: SensorOptions {
            input_noise_v: 0.05,
            ..SensorOptions::exact()
        },
        ..SimOptions::cedro2022()
    };
    let samples: Vec<JointSample> = MachineSimulator::new(&sim)
        .expect("valid options")
        .take((BEFORE + 1) * BLOCK)
        .collect();
    let start = plant.parameters().iter().map(|p| p.start);
    let options = EstimatorOptions::recommended(start, 1);
    let rows = ProjectedOptions {
        timing: InputTiming::Continuous,
        ..ProjectedOptions::recommended()
    };
    let projected = LastBlock::of(&plant, rows, &options, &samples);
    vec![
        projected.sample("axis/projected/sample"),
        projected.end("axis/projected/block"),
    ]
}

fn robot_sample(k: u32) -> RobotSample {
    let t_s = 0.001 * f64::from(k);
    let mut sample = RobotSample {
        t_s,
        ..RobotSample::default()
    };
    for i in 0..6 {
        let w = 1.0 + 0.3 * i as f64;
        (sample.q[i], sample.dq[i], sample.tau[i]) = ((w * t_s).sin(), w * (w * t_s).cos(), 10.0 * (w * t_s).cos());
    }
    sample
}

/// The six-axis robot at 1 kHz: 70 parameters, blocks of a second. The targets are those of 68, so
/// one of the six terms of friction is left out.
fn robot() -> Vec<Stage> {
    let urdf = include_str!("../../config/robots/six_axis.urdf");
    let robot = Robot::from_urdf(urdf, &Selection::default()).expect("a sound URDF");
    let mut friction = JointFriction::default();
    friction.terms.pop();
    let model = RobotModel::new(robot.clone(), true, vec![friction; 6]).expect("sound friction");
    let (mut ready, mut next) = before_a_blocks_end(model.clone(), IdentifyOptions::default());
    let before_end = ready.clone();
    let watch = IdentifyOptions {
        payload: true,
        ..IdentifyOptions::default()
    };
    let (watching, _) = before_a_blocks_end(model, watch);
    // The first sample of a block ends the one before.
    let _ = ready.push(&robot_sample(next));
    next += 1;
    let samples: Vec<RobotSample> = (next..next + 900).map(robot_sample).collect();
    let states = samples.clone();
    vec![
        stage("robot/regressors", states.len(), move || {
            let (robot, states) = (robot.clone(), states.clone());
            let mut regressors = EnergyRegressors::new(robot.len());
            Box::new(move || {
                for state in &states {
                    let (q, dq) = (&state.q[..robot.len()], &state.dq[..robot.len()]);
                    regressors.evaluate(&robot, black_box(q), black_box(dq));
                    black_box(&regressors);
                }
            })
        }),
        stage("robot/sample", samples.len(), move || {
            let (mut ready, samples) = (ready.clone(), samples.clone());
            Box::new(move || {
                for sample in &samples {
                    let _ = black_box(ready.push(black_box(sample)));
                }
            })
        }),
        end_of_block("robot/block", before_end),
        end_of_block("robot/payload/block", watching),
    ]
}

/// A robot's identifier after six blocks but for the sample that ends the last of them, and that
/// sample's number.
fn before_a_blocks_end(model: RobotModel, options: IdentifyOptions) -> (RobotIdentifier, u32) {
    let mut ready = RobotIdentifier::new(model, options).expect("sound options");
    let mut next = 0;
    while ready.blocks() < 5 || next % 1000 != 0 {
        let _ = ready.push(&robot_sample(next));
        next += 1;
    }
    (ready, next)
}

fn end_of_block(name: &'static str, ready: RobotIdentifier) -> Stage {
    stage(name, 1, move || {
        let mut ready = ready.clone();
        Box::new(move || {
            let _ = black_box(ready.end_of_recording());
        })
    })
}

/// A name for a file that nobody else has; the file goes with its last user.
fn temporary() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join(FILE);
    (folder, path)
}

fn info() -> RunInfo {
    let plant = Manipulator::default();
    let label = |name: &str, unit: &str| Label {
        name: name.to_owned(),
        unit: unit.to_owned(),
    };
    RunInfo {
        recording_id: "stages".to_owned(),
        robot: "default".to_owned(),
        model: plant.name().to_owned(),
        joints: 2,
        position_unit: "rad".to_owned(),
        input_unit: "V".to_owned(),
        equations: plant.equations().iter().map(|e| e.name.to_string()).collect(),
        parameters: plant.parameters().iter().map(|p| label(&p.name, &p.unit)).collect(),
        ..RunInfo::default()
    }
}

/// A recording in the midst of a run: written, read, and read and identified as `thetabus identify`
/// does it.
fn recording() -> Vec<Stage> {
    const SETTLED: usize = BEFORE * BLOCK;
    let seen = seen_samples(SETTLED + 10 * BLOCK);
    let messages: Vec<Sample> = (SETTLED as u64..)
        .zip(&seen[SETTLED..])
        .map(|(k, sample)| {
            let mut message = Sample::EMPTY;
            (message.stream_id, message.seq, message.t_ns) = (1, k, k * 1_000_000);
            (message.joints, message.signals) = (2, signals::Q | signals::SETPOINT | signals::INPUT);
            (message.q, message.setpoint, message.input) = (sample.q, sample.setpoint, sample.input);
            message
        })
        .collect();
    let count = messages.len();
    let (folder, path) = temporary();
    // Lives as long as any stage that reads from it.
    let read_from = Rc::new(folder);
    let identified_from = Rc::clone(&read_from);
    let mut recorder = Recorder::create(&path, info(), RecordingLimits::default()).expect("a recording");
    for message in &messages {
        recorder.sample(message, message.t_ns).expect("room on the disk");
    }
    recorder.finish().expect("room on the disk");
    let options = EstimatorOptions {
        equations: vec![EquationNoise::WHITENED; 2],
        ..arm_options()
    };
    let (empty, settled) = in_run(&Manipulator::default(), arm_rows(), &options, &seen[..SETTLED]);
    vec![
        stage("recording/write", count, move || {
            let messages = messages.clone();
            let (folder, path) = temporary();
            let recorder = Recorder::create(&path, info(), RecordingLimits::default()).expect("a recording");
            let mut recorder = Some(recorder);
            Box::new(move || {
                let mut recorder = recorder.take().expect("written once");
                for message in &messages {
                    recorder
                        .sample(black_box(message), message.t_ns)
                        .expect("room on the disk");
                }
                recorder.finish().expect("room on the disk");
                black_box(&folder);
            })
        }),
        stage("recording/read", count, move || {
            let path = read_from.path().join(FILE);
            Box::new(move || each_sample(&path, |sample, t_ns| _ = black_box((sample, t_ns))))
        }),
        stage("recording/identify", count, move || {
            let path = identified_from.path().join(FILE);
            let (mut block, mut estimator) = (empty.clone(), settled.clone());
            Box::new(move || {
                let mut taken = 0;
                each_sample(&path, |sample, t_ns| {
                    assert!(block.push(t_ns, &sample.joint_sample()));
                    taken += 1;
                    if taken % BLOCK == 0 {
                        block.prepare(estimator.theta());
                        black_box(estimator.update(&block).iterations);
                        block.clear();
                    }
                });
            })
        }),
    ]
}

fn each_sample(path: &Path, mut take: impl FnMut(&Sample, u64)) {
    let mut reader = RecordingReader::open(path, Span::default()).expect("a recording");
    while let Some(entry) = reader.next_entry().expect("readable") {
        if let Entry::Sample { sample, .. } = entry {
            take(sample, sample.t_ns);
        }
    }
}
