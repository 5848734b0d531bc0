//! Is what is published as usable right? Machines, motions and faults that used to be confidently
//! wrong.
//!
//! A *dangerous* block publishes `use_ok` = 1 and a usable parameter that is more than 5 of its
//! standard deviations, and more than 0.5 %, off.

mod changes;
mod estimator;
mod garbage;
mod machines;

use crate::support::{EMPS_GAIN, TestRng};
use std::path::Path;
use thetabus::config::{Config, Source};
use thetabus::estimator::BlockEstimator;
use thetabus::messages::{Estimate, Sample, State, signals};
use thetabus::model::{JointSample, Manipulator, Plant, ServoAxis};
use thetabus::node::block_learner::BlockLearner;
use thetabus::node::identifier::{Identifier, IdentifierNode, IdentifierOptions};
use thetabus::rows::{InputSource, PointwiseBlock, ProjectedBlock, RowForm, SampleBlock, structure};
use thetabus::sim::{Interpolation, MachineSimulator, MassSchedule, Setpoint};

const N: usize = 1900;

fn config(name: &str, sets: &[&str]) -> Config {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("config/{name}.toml"));
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    Config::load(&[Source::File(path)], &sets).unwrap()
}

fn node<B: SampleBlock + Send + 'static>(
    config: &Config,
    plant: &impl Plant,
    signals: u32,
    rows: B,
) -> Box<dyn Identifier> {
    let period_s = config.plant.sim.sample_period_s;
    let options = IdentifierOptions {
        sample_period_ns: (period_s * 1e9).round() as u64,
        input_limit: config.identifier.input_limit,
        frozen_after: (config.identifier.frozen_after_s / period_s).round() as u64,
        ..IdentifierOptions::new(config.estimator.block_len as u64, plant.joints(), signals)
    };
    let estimator = BlockEstimator::new(structure(plant), config.estimator.options.clone()).unwrap();
    Box::new(IdentifierNode::new(
        options,
        BlockLearner::new(rows, estimator, None),
        1,
    ))
}

/// The identifier of a configuration, as the service makes it.
fn identifier(config: &Config) -> Box<dyn Identifier> {
    let start = &config.estimator.options.theta_start();
    let len = config.estimator.block_len;
    match (config.model.name(), &config.identifier.rows) {
        ("manipulator", RowForm::Pointwise) => {
            let plant = &Manipulator::default();
            let rows = PointwiseBlock::new(*plant, InputSource::Measured, len);
            node(config, plant, signals::ALL & !signals::SETPOINT, rows)
        }
        ("manipulator", RowForm::Projected(options)) => {
            let plant = Manipulator::default();
            let rows = ProjectedBlock::new(plant, *options, len)
                .unwrap()
                .starting_at(start)
                .unwrap();
            node(config, &plant, signals::Q | signals::INPUT, rows)
        }
        ("servo_axis", RowForm::Projected(options)) => {
            let plant = axis();
            let rows = ProjectedBlock::new(plant.clone(), *options, len)
                .unwrap()
                .starting_at(start)
                .unwrap();
            node(config, &plant, signals::Q | signals::INPUT, rows)
        }
        _ => panic!("no such case here"),
    }
}

fn axis() -> ServoAxis {
    use thetabus::model::{DriveInput, Motion};
    ServoAxis::new(Motion::Linear, DriveInput::Voltage, EMPS_GAIN).unwrap()
}

/// Result of a run.
#[derive(Default)]
struct Outcome {
    name: String,
    blocks: Vec<(Estimate, Vec<f64>)>,
}

impl Outcome {
    fn dangerous(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (e, truth) in &self.blocks {
            for (i, truth) in truth.iter().enumerate().filter(|&(i, _)| e.is_usable(i)) {
                let off = (e.theta[i] - truth).abs();
                if off > 5.0 * e.theta_std[i] && off > 0.005 * truth.abs() {
                    let sigmas = off / e.theta_std[i];
                    let percent = 100.0 * off / truth.abs();
                    found.push(format!(
                        "block {} theta_{} off by {percent:.2} %, {sigmas:.0} sigma",
                        e.block,
                        i + 1
                    ));
                }
            }
        }
        found
    }

    fn dangerous_blocks(&self) -> usize {
        let mut blocks: Vec<String> = self
            .dangerous()
            .iter()
            .map(|words| words.split(" theta").next().unwrap_or_default().to_owned())
            .collect();
        blocks.dedup();
        blocks.len()
    }

    fn use_ok(&self) -> usize {
        self.blocks.iter().filter(|(e, _)| e.use_ok == 1).count()
    }

    fn first_use_ok(&self) -> Option<u64> {
        self.blocks.iter().find(|(e, _)| e.use_ok == 1).map(|(e, _)| e.block)
    }

    fn misfits(&self) -> usize {
        self.blocks
            .iter()
            .filter(|(e, _)| e.state == State::Misfit as u32)
            .count()
    }

    /// Share of the excited (block, parameter) pairs from block `from` on that may be used.
    fn usable_share(&self, from: u64) -> f64 {
        let (mut excited, mut usable) = (0, 0);
        for (e, truth) in self.blocks.iter().filter(|(e, _)| e.block >= from) {
            for i in (0..truth.len()).filter(|&i| e.excited.contains(i)) {
                excited += 1;
                usable += usize::from(e.is_usable(i));
            }
        }
        f64::from(usable as u32) / f64::from((excited as u32).max(1))
    }

    /// Prints one line.
    fn tell(&self) -> &Self {
        let dangerous = self.dangerous();
        let least =
            |of: &dyn Fn(&Estimate) -> f64| self.blocks.iter().map(|(e, _)| of(e)).fold(f64::INFINITY, f64::min);
        let late: Vec<&Estimate> = self.blocks.iter().map(|(e, _)| e).filter(|e| e.block > 2).collect();
        let explained = |e: &Estimate| e.explained[..e.equations as usize].iter().copied().fold(1.0, f64::min);
        let most_fit = late
            .iter()
            .map(|e| e.fit[..e.equations as usize].iter().copied().fold(0.0, f64::max))
            .fold(0.0, f64::max);
        println!(
            "{:44} blocks {:3} use_ok {:3} first {:?} misfit {} dangerous {} usable {:.3} p {:.1e} fit {:.2} explained {:.5} last {:.5}",
            self.name,
            self.blocks.len(),
            self.use_ok(),
            self.first_use_ok(),
            self.misfits(),
            self.dangerous_blocks(),
            self.usable_share(6),
            least(&|e| e.fit_probability),
            most_fit,
            late.iter().map(|e| explained(e)).fold(1.0, f64::min),
            late.last().map_or(0.0, |e| explained(e)),
        );
        for words in dangerous.iter().take(3) {
            println!("        {words}");
        }
        self
    }
}

/// Runs samples through the identifier; `truth` is asked at the last sample of each block.
fn identify(
    name: &str,
    config: &Config,
    samples: impl Iterator<Item = JointSample>,
    carried: u32,
    truth: impl Fn(f64) -> Vec<f64>,
) -> Outcome {
    let mut node = identifier(config);
    let period_ns = (config.plant.sim.sample_period_s * 1e9).round() as u64;
    let joints = config.model.definition().joints;
    let mut outcome = Outcome {
        name: name.to_owned(),
        ..Outcome::default()
    };
    for (seq, sample) in (0u64..).zip(samples) {
        let sample = Sample::new(1, seq, seq * period_ns, joints, carried, &sample);
        node.on_sample(&sample, &mut |e: &Estimate| {
            assert!(e.theta.iter().all(|v| v.is_finite()), "{name}, block {}", e.block);
            outcome.blocks.push((*e, truth(e.t_last_ns as f64 * 1e-9)));
        });
    }
    outcome.tell();
    outcome
}

/// A simulated run; `spoil` changes each sample.
fn simulate(name: &str, config: &Config, mut spoil: impl FnMut(u64, &mut JointSample)) -> Outcome {
    let sim = &config.plant.sim;
    let samples = MachineSimulator::new(sim).unwrap().take(sim.sample_count() as usize);
    let carried = sim.signals();
    let spoilt = (0u64..).zip(samples).map(|(k, mut sample)| {
        spoil(k, &mut sample);
        sample
    });
    identify(name, config, spoilt, carried, |t_s| sim.true_parameters(t_s))
}

/// Random levels for 1 to 3 s each, except for a rest from `rest.0` to `rest.1` \[s\].
fn steps_with_rest(random: &mut TestRng, reach: f64, duration_s: f64, rest: (f64, f64)) -> Setpoint {
    let (mut t_s, mut values_rad, mut t) = (Vec::new(), Vec::new(), 0.0);
    while t < duration_s {
        if !(t > rest.0 && t < rest.1) {
            t_s.push(t);
            values_rad.push(random.between(-reach, reach));
        }
        t += random.between(1.0, 3.0);
    }
    Setpoint::Table {
        t_s,
        values_rad,
        interpolation: Interpolation::Step,
    }
}

fn sines(random: &mut TestRng, reach: f64) -> Setpoint {
    Setpoint::Sines {
        offset_rad: 0.0,
        tones: [0.23, 0.43, 0.81, 1.51, 2.83, 5.3f64]
            .map(|frequency_hz| thetabus::sim::Tone {
                frequency_hz: frequency_hz * random.between(0.95, 1.05),
                amplitude_rad: reach / 6.0,
                phase_rad: random.between(0.0, std::f64::consts::TAU),
            })
            .to_vec(),
    }
}

/// The arm through encoders with a motion.
fn arm(seed: u64, blocks: f64, mass_2: MassSchedule, motion: &str) -> Config {
    arm_with(&[], seed, blocks, mass_2, motion)
}

fn arm_with(sets: &[&str], seed: u64, blocks: f64, mass_2: MassSchedule, motion: &str) -> Config {
    let mut config = config("encoder_only", sets);
    let sim = &mut config.plant.sim;
    (sim.seed, sim.duration_s, sim.mass_2) = (seed, blocks * N as f64 * 1e-3, mass_2);
    let mut random = TestRng(seed * 7919 + 13);
    sim.setpoint = [1.0, 0.8].map(|reach| match motion {
        "steps" => steps_with_rest(&mut random, reach, sim.duration_s, (f64::MAX, f64::MAX)),
        "sines" => sines(&mut random, reach),
        "rest" => Setpoint::constant(0.3),
        _ => panic!("no such motion"),
    });
    config
}

/// The servo axis with its own sines, or square moves.
fn servo(seed: u64, blocks: f64) -> Config {
    let mut config = config("servo_axis", &[]);
    let sim = &mut config.plant.sim;
    (sim.seed, sim.duration_s) = (seed, blocks * N as f64 * 1e-3);
    config
}

fn still(_: u64, _: &mut JointSample) {}

fn nothing_dangerous(outcome: &Outcome) {
    assert!(
        outcome.dangerous().is_empty(),
        "{}: {:?}",
        outcome.name,
        outcome.dangerous()
    );
}
