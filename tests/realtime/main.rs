//! The step sample → estimate, after construction: what it may not do.
//!
//! A test binary of its own, because the counting allocator is global.

#![cfg(feature = "sim")]

#[cfg(feature = "robot")]
mod robot;

use std::f64::consts::TAU;
use thetabus::estimator::{BlockEstimator, EstimatorOptions, StateMachine};
use thetabus::messages::{Estimate, Sample, signals};
use thetabus::model::{AutoDiff, Delayed, JointSample, KnownConstants, Manipulator, ManipulatorDerived, Plant};
use thetabus::node::block_learner::BlockLearner;
use thetabus::node::command::{Change, NodeState, Order};
use thetabus::node::identifier::{IdentifierNode, IdentifierOptions};
use thetabus::rows::{
    AutoWindowBlock, InputSource, PointwiseBlock, ProjectedBlock, ProjectedOptions, SampleBlock, SmoothedBlock,
    SmoothedOptions, priors, structure,
};
use thetabus::sim::{ArmParameters, ArmSimulator, SimOptions};

const BLOCK_LEN: u64 = 400;

fn identifier(options: EstimatorOptions) -> IdentifierNode<BlockLearner<PointwiseBlock<Manipulator>>> {
    let plant = Manipulator::default();
    let arm = ArmParameters::cedro2022();
    let known = KnownConstants {
        length_1_m: arm.length_1_m,
        winding_resistance_ohm: arm.winding_resistance_ohm,
        torque_constant_n_m_per_a: arm.torque_constant_n_m_per_a,
    };
    let node = IdentifierOptions {
        sample_period_ns: 1_000_000,
        frozen_after: 200,
        ..IdentifierOptions::new(BLOCK_LEN, plant.joints(), signals::ALL)
    };
    let rows = PointwiseBlock::new(plant, InputSource::Measured, BLOCK_LEN as usize);
    let estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    let derived = ManipulatorDerived::new(known).unwrap();
    IdentifierNode::new(node, BlockLearner::new(rows, estimator, Some(Box::new(derived))), 1)
}

/// Ten blocks: lost, refused and repeated samples, a jump of the payload inside block 6, a
/// restarted publisher.
fn eventful_stream() -> Vec<Sample> {
    let mut arm = SimOptions::cedro2022();
    arm.mass_2 = thetabus::sim::MassSchedule::jump(150.0, 2.15, 170.0);
    let mut samples: Vec<Sample> = ArmSimulator::new(&arm)
        .unwrap()
        .take(10 * BLOCK_LEN as usize)
        .enumerate()
        .map(|(seq, joints)| Sample::new(1, seq as u64, seq as u64 * 1_000_000, 2, signals::ALL, &joints))
        .collect();
    samples[700].input[1] = f64::NAN;
    samples[800].q[0] = f64::INFINITY;
    samples[901] = samples[900];
    // what is made good on its way to projected rows: spikes, single losses, stamps off the grid
    samples[720].q[0] += 0.5;
    samples[760].input[1] += 300.0;
    samples[850..860].iter_mut().for_each(|s| s.t_ns += s.seq % 3 * 50_000);
    samples.remove(1900);
    samples.drain(1850..1853);
    samples.drain(1000..1010);
    samples.drain(1180..1620);
    let restarted: Vec<Sample> = samples[..900].iter().map(|s| Sample { stream_id: 2, ..*s }).collect();
    samples.extend(restarted);
    samples
}

/// One of each kind.
fn orders(options: &EstimatorOptions) -> Vec<Order> {
    let plant = Manipulator::default();
    let estimator = BlockEstimator::new(structure(&plant), options.clone()).unwrap();
    let rows = PointwiseBlock::new(plant, InputSource::Measured, 200);
    let changes = [
        Change::Replace {
            judge: Box::new(StateMachine::new(estimator.theta())),
            estimator: Box::new(estimator),
            warm: false,
        },
        Change::Tune {
            options: Box::new(options.clone()),
            config_hash: 1,
            block_len: 200,
            rows: Some(Box::new(rows)),
        },
        Change::Free { index: 4 },
        Change::Fix { index: 4, value: None },
        Change::Resume,
    ];
    changes.into_iter().map(|change| Order::new(0, 0, change)).collect()
}

#[test]
fn rt_the_step_from_sample_to_estimate_allocates_nothing() {
    let stream = eventful_stream();
    let start = vec![0.01, 0.01, 0.1, 0.1, 10.0, 0.01, 0.1, 10.0, 0.5];
    for options in [
        EstimatorOptions::paper(start.clone(), 2),
        EstimatorOptions::recommended(start.clone(), 2),
    ] {
        let mut node = identifier(options.clone());
        let mut estimates = 0;
        // prepared beforehand, as the service does it
        let mut orders = orders(&options);
        let mut done = Vec::with_capacity(orders.len());
        let mut state = NodeState::default();
        node.save(&mut state);
        let counted = allocation_counter::measure(|| {
            for (index, sample) in stream.iter().enumerate() {
                if index % 500 == 250
                    && let Some(order) = orders.pop()
                {
                    assert!(node.offer(order).is_ok());
                }
                while let Some(order) = node.take_done() {
                    done.push(order);
                }
                node.save(&mut state);
                node.on_sample(sample, &mut |_: &Estimate| estimates += 1);
            }
        });
        assert_eq!(done.len(), 5, "every order took effect");
        assert!(estimates >= 8, "the stream gave only {estimates} estimates");
        assert_eq!(
            counted.count_total, 0,
            "allocations in the step from sample to estimate"
        );
    }
}

#[test]
fn rt_the_same_samples_give_the_same_bits() {
    let stream = eventful_stream();
    let start = vec![0.01, 0.01, 0.1, 0.1, 10.0, 0.01, 0.1, 10.0, 0.5];
    let run = || {
        let mut node = identifier(EstimatorOptions::recommended(start.clone(), 2));
        let mut bits: Vec<u64> = Vec::new();
        for sample in &stream {
            node.on_sample(sample, &mut |e: &Estimate| {
                bits.extend(
                    e.theta
                        .iter()
                        .chain(&e.theta_std)
                        .chain(&e.derived)
                        .map(|v| v.to_bits()),
                );
            });
        }
        bits
    };
    assert_eq!(run(), run());
}

/// A node with rows from positions and inputs.
fn from_positions<B: SampleBlock + Send + 'static>(plant: &impl Plant, rows: B) -> IdentifierNode<BlockLearner<B>> {
    let mut options = EstimatorOptions::recommended(priors(plant), plant.equations().len());
    options.relations = plant.relations().to_vec();
    let node = IdentifierOptions::new(BLOCK_LEN, plant.joints(), signals::Q | signals::INPUT);
    let estimator = BlockEstimator::new(structure(plant), options).unwrap();
    IdentifierNode::new(node, BlockLearner::new(rows, estimator, None), 1)
}

fn allocations<B: SampleBlock + Send + 'static>(mut node: IdentifierNode<BlockLearner<B>>) -> u64 {
    let stream = eventful_stream();
    let mut estimates = 0;
    let counted = allocation_counter::measure(|| {
        for sample in &stream {
            node.on_sample(sample, &mut |_: &Estimate| estimates += 1);
        }
    });
    assert!(estimates >= 8, "the stream gave only {estimates} estimates");
    counted.count_total
}

#[test]
fn rt_projected_and_smoothed_rows_allocate_nothing_either() {
    let plant = Manipulator::default();
    let len = BLOCK_LEN as usize;
    for learn_noise in [false, true] {
        let options = ProjectedOptions {
            learn_noise,
            ..ProjectedOptions::recommended()
        };
        let rows = ProjectedBlock::new(plant, options, len).unwrap();
        assert_eq!(allocations(from_positions(&plant, rows)), 0, "projected");
        let delayed = Delayed::new(plant, 0.0, 5e-3);
        let rows = ProjectedBlock::new(delayed.clone(), options, len).unwrap();
        assert_eq!(
            allocations(from_positions(&delayed, rows)),
            0,
            "with a delay to be found"
        );
    }
    let rows = SmoothedBlock::new(AutoDiff(plant), 2, SmoothedOptions::recommended(), len).unwrap();
    assert_eq!(allocations(from_positions(&plant, rows)), 0, "smoothed");
}

/// The window at the end of each block of samples whose joints swing at these frequencies \[Hz\],
/// and the allocations on the way.
fn windows_of(swings: &[(u64, f64)]) -> (Vec<f64>, u64) {
    let theta: Vec<f64> = Manipulator::default().parameters().iter().map(|p| p.start).collect();
    let options = ProjectedOptions::recommended();
    let mut rows = AutoWindowBlock::chosen(Manipulator::default(), options, 1000).unwrap();
    let blocks: u64 = swings.iter().map(|(blocks, _)| blocks).sum();
    let mut windows = Vec::with_capacity(blocks as usize);
    let counted = allocation_counter::measure(|| {
        let (mut k, mut phase) = (0, 0.0_f64);
        for &(blocks, frequency) in swings {
            for _ in 0..blocks {
                for _ in 0..1000 {
                    phase += TAU * frequency * 1e-3;
                    let mut sample = JointSample::default();
                    for joint in 0..2 {
                        // starts without a jump of the velocity
                        sample.q[joint] = (0.3 * (1.0 - phase.cos()) / 1e-4).round() * 1e-4;
                        sample.input[joint] = 40.0 * (phase + 0.4).sin();
                    }
                    assert!(rows.push(k * 1_000_000, &sample));
                    k += 1;
                }
                rows.prepare(&theta);
                windows.extend(rows.window_s());
                rows.clear();
            }
        }
    });
    (windows, counted.count_total)
}

#[test]
fn rt_windows_follow_the_motion_without_allocating() {
    let (windows, allocations) = windows_of(&[(2, 0.0), (20, 13.0), (20, 4.0)]);
    assert_eq!(allocations, 0);
    // 1.3 periods of 13 Hz are 100 ms, of 4 Hz 325 ms; at rest nothing is chosen
    assert_eq!(windows[..22], [0.1; 22]);
    assert_eq!(windows[41], 0.2, "{windows:?}");
    let changed = windows.iter().position(|&w| w == 0.2).unwrap();
    // two reviews of eight blocks each have to agree
    assert!((22 + 8..=22 + 25).contains(&changed), "{changed}");
    // the first motion decides at once
    let (windows, _) = windows_of(&[(1, 40.0)]);
    assert_eq!(windows, [0.025]);
    let (windows, _) = windows_of(&[(1, 2.0)]);
    assert_eq!(windows, [0.2]);
}
