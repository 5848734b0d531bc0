//! Faults of a stream and their effect on the estimates: expected value, flag and counter per row
//! of a table.

use crate::support::TestRng;
use thetabus::estimator::{BlockEstimator, EstimatorOptions, StateMachine};
use thetabus::messages::{Estimate, Sample, State, Status, estimate_flags, signals};
use thetabus::model::{Manipulator, Plant};
use thetabus::node::block_learner::BlockLearner;
use thetabus::node::command::{Change, NodeState, Order};
use thetabus::node::identifier::{IdentifierNode, IdentifierOptions};
use thetabus::rows::{InputSource, PointwiseBlock, structure};
use thetabus::sim::{ArmSimulator, Interpolation, MassSchedule, SimOptions};

const N: u64 = 400;
const PAPER_START: [f64; 9] = [0.01, 0.01, 0.1, 0.1, 10.0, 0.01, 0.1, 10.0, 0.5];

type Node = IdentifierNode<BlockLearner<PointwiseBlock<Manipulator>>>;

fn node() -> Node {
    node_of(EstimatorOptions::recommended(PAPER_START.to_vec(), 2), N)
}

fn node_of(options: EstimatorOptions, block_len: u64) -> Node {
    let plant = Manipulator::default();
    let mut limit = [f64::INFINITY; 8];
    limit[0] = 1e3;
    let node = IdentifierOptions {
        sample_period_ns: 1_000_000,
        frozen_after: 100,
        input_limit: limit,
        ..IdentifierOptions::new(block_len, plant.joints(), signals::ALL & !signals::SETPOINT)
    };
    let rows = PointwiseBlock::new(plant, InputSource::Measured, block_len as usize);
    let estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    IdentifierNode::new(node, BlockLearner::new(rows, estimator, None), 1)
}

/// The paper's arm, `blocks` blocks long.
fn stream(blocks: u64) -> Vec<Sample> {
    let arm = arm();
    ArmSimulator::new(&arm)
        .unwrap()
        .take((blocks * N) as usize)
        .enumerate()
        .map(|(seq, joints)| Sample::new(1, seq as u64, seq as u64 * 1_000_000, 2, signals::ALL, &joints))
        .collect()
}

fn arm() -> SimOptions {
    SimOptions {
        mass_2: MassSchedule::constant(150.0),
        ..SimOptions::cedro2022()
    }
}

struct Outcome {
    estimates: Vec<Estimate>,
    status: Status,
}

impl Outcome {
    fn worst_error(&self) -> f64 {
        let truth = arm().true_theta(0.0);
        let last = self.estimates.last().expect("an estimate");
        truth
            .iter()
            .zip(&last.theta)
            .map(|(truth, theta)| (theta / truth - 1.0).abs())
            .fold(0.0, f64::max)
    }

    fn flagged(&self, flag: u32) -> Vec<u64> {
        self.estimates
            .iter()
            .filter(|e| e.flags & flag != 0)
            .map(|e| e.block)
            .collect()
    }
}

fn run_with(node: &mut Node, samples: &[Sample]) -> Outcome {
    let mut estimates = Vec::new();
    for sample in samples {
        node.on_sample(sample, &mut |e: &Estimate| {
            assert!(e.theta.iter().all(|v| v.is_finite()), "block {}", e.block);
            estimates.push(*e);
        });
    }
    Outcome {
        estimates,
        status: node.status(),
    }
}

/// A row: a change of a stream of 20 blocks, the counters that must show it, the state and `use_ok`
/// in the faulty block (0 for none).
struct Row {
    name: &'static str,
    spoil: fn(&mut Vec<Sample>),
    counters: fn(&Status) -> Vec<u64>,
    expected: &'static [u64],
    block: u64,
    state: State,
    use_ok: bool,
}

#[test]
fn fault_every_fault_of_a_stream_is_counted_flagged_and_leaves_the_estimate_right() {
    let rows = [
        Row {
            name: "nothing",
            spoil: |_| (),
            counters: |s| vec![s.accepted, s.rejected, s.missing, s.faults.blocks_held],
            expected: &[20 * N, 0, 0, 0],
            block: 20,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a gap of 100 samples",
            spoil: |s| _ = s.drain(4100..4200),
            counters: |s| vec![s.missing, s.faults.gaps],
            expected: &[100, 1],
            block: 11,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "a gap of three seconds",
            spoil: |s| _ = s.drain(4100..7100),
            counters: |s| vec![s.missing, s.faults.gaps],
            expected: &[3000, 1],
            block: 18,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "every tenth sample lost",
            spoil: |s| s.retain(|s| s.seq % 10 != 5),
            counters: |s| vec![s.missing, s.faults.gaps],
            expected: &[800, 800],
            block: 20,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "duplicates",
            spoil: |s| {
                for at in (100..4000).step_by(100) {
                    s.insert(at, s[at - 1]);
                }
            },
            counters: |s| vec![s.faults.duplicates, s.rejected, s.missing],
            expected: &[39, 39, 0],
            block: 11,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "reordered",
            spoil: |s| {
                for at in (4010..4030).step_by(10) {
                    s.swap(at, at + 2);
                }
            },
            // of 0 1 2 arriving as 2 1 0, two come late
            counters: |s| vec![s.faults.reordered, s.rejected, s.missing],
            expected: &[4, 4, 0],
            block: 11,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a publisher that starts again",
            spoil: |s| {
                s.iter_mut()
                    .skip(4000)
                    .for_each(|s| (s.stream_id, s.seq) = (2, s.seq - 4000))
            },
            counters: |s| vec![s.streams, s.accepted, s.missing],
            expected: &[2, 4000, 0],
            block: 10,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a clock that stands still for a sample and goes back for one",
            spoil: |s| {
                s[4005].t_ns = s[4004].t_ns;
                s[4010].t_ns = 7;
            },
            counters: |s| vec![s.faults.clock_jumps, s.rejected],
            expected: &[2, 2],
            block: 11,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a plant that pauses for five minutes",
            spoil: |s| s.iter_mut().skip(4100).for_each(|s| s.t_ns += 300_000_000_000),
            counters: |s| vec![s.faults.clock_jumps, s.rejected, s.accepted],
            expected: &[1, 1, 20 * N - 1],
            block: 11,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a clock that is set back by an hour",
            spoil: |s| {
                s.iter_mut().for_each(|s| s.t_ns += 4_000_000_000_000);
                s.iter_mut().skip(4100).for_each(|s| s.t_ns -= 3_600_000_000_000);
            },
            counters: |s| vec![s.faults.clock_jumps, s.rejected, s.estimates],
            // the block that holds it is left out
            expected: &[1, 1, 19],
            block: 0,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "another number of joints",
            spoil: |s| s[4100..4200].iter_mut().for_each(|s| s.joints = 3),
            counters: |s| vec![s.faults.wrong_joints, s.rejected],
            expected: &[100, 100],
            block: 11,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "a signal that is not there",
            spoil: |s| s[4100..4200].iter_mut().for_each(|s| s.signals = signals::Q),
            counters: |s| vec![s.faults.wrong_signals, s.rejected],
            expected: &[100, 100],
            block: 11,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "NaN, infinities and numbers that no machine has",
            spoil: |s| {
                s[4100].q[0] = f64::NAN;
                s[4101].dddq[1] = f64::INFINITY;
                s[4102].input[1] = f64::NEG_INFINITY;
                s[4103].q[1] = 1e300;
                s[4104].dq[0] = -1e10;
            },
            counters: |s| vec![s.faults.not_finite, s.rejected],
            expected: &[5, 5],
            block: 11,
            state: State::Converged,
            use_ok: true,
        },
        Row {
            name: "a saturated input",
            spoil: |s| s[4100..4150].iter_mut().for_each(|s| s.input[0] = -1e3),
            counters: |s| vec![s.faults.saturated, s.rejected, s.faults.blocks_held],
            expected: &[50, 50, 0],
            block: 11,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "a position that freezes in the middle of a block",
            spoil: |s| {
                let frozen = s[4010].q[1];
                s[4010..4390].iter_mut().for_each(|s| s.q[1] = frozen);
            },
            counters: |s| vec![u64::from(s.faults.frozen > 0), s.faults.blocks_held],
            expected: &[1, 1],
            block: 11,
            state: State::Degraded,
            use_ok: false,
        },
        Row {
            name: "a whole sample that is sent again and again",
            spoil: |s| {
                let frozen = s[4010].joint_sample();
                for s in &mut s[4010..6000] {
                    *s = Sample::new(1, s.seq, s.t_ns, 2, signals::ALL, &frozen);
                }
            },
            counters: |s| vec![u64::from(s.faults.frozen > 1000)],
            expected: &[1],
            block: 14,
            state: State::Degraded,
            use_ok: false,
        },
    ];
    for row in rows {
        let mut samples = stream(20);
        (row.spoil)(&mut samples);
        let outcome = run_with(&mut node(), &samples);
        let name = row.name;
        assert_eq!((row.counters)(&outcome.status), row.expected, "{name}: counters");
        assert_eq!(
            outcome.flagged(estimate_flags::CHANGED),
            [0u64; 0],
            "{name}: a change where none was"
        );
        if let Some(faulty) = outcome.estimates.iter().find(|e| e.block == row.block) {
            let state = State::from_wire(faulty.state).expect("a state");
            assert_eq!(
                (state, faulty.use_ok == 1),
                (row.state, row.use_ok),
                "{name}: block {}",
                row.block
            );
        }
        // exact data: what is left of them gives the parameters to 1e-6, however little it is
        assert!(
            outcome.worst_error() < 1e-6,
            "{name}: off by {:e}",
            outcome.worst_error()
        );
    }
}

#[test]
fn fault_ten_thousand_seeded_corrupt_samples_give_no_panic_and_no_nan() {
    let mut random = TestRng(7);
    let mut samples = stream(40);
    let mut corrupt = 0;
    while corrupt < 10_000 {
        let at = (random.bits() % samples.len() as u64) as usize;
        let word = random.bits();
        let sample = &mut samples[at];
        let index = (random.bits() % 8) as usize;
        match random.bits() % 12 {
            0 => sample.stream_id = word % 3,
            1 => sample.seq = word,
            2 => sample.seq = sample.seq.wrapping_add(word % 7).wrapping_sub(3),
            3 => sample.t_ns = word,
            4 => sample.flags = word as u32,
            5 => sample.joints = word as u32,
            6 => sample.signals = word as u32,
            7 => sample.q[index] = f64::from_bits(word),
            8 => sample.dq[index] = f64::from_bits(word),
            9 => sample.ddq[index] = f64::from_bits(word),
            10 => sample.dddq[index] = f64::from_bits(word),
            _ => sample.input[index] = f64::from_bits(word),
        }
        corrupt += 1;
    }
    let mut node = node();
    for sample in &samples {
        node.on_sample(sample, &mut |e: &Estimate| {
            let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
            assert!(finite(&e.theta) && finite(&e.theta_std), "block {}", e.block);
        });
    }
    let status = node.status();
    assert!(status.streams > 100 && status.error.code != 0, "{status:?}");
}

/// Everything of an estimate except the origin of the stream.
fn bits(estimates: &[Estimate]) -> Vec<u64> {
    let of = |e: &Estimate| {
        let head = [
            e.block,
            u64::from(e.state),
            u64::from(e.use_ok),
            u64::from(e.flags),
            e.config_hash,
            e.fixed.bits() as u64,
        ];
        head.into_iter()
            .chain(e.theta.iter().chain(&e.theta_std).map(|v| v.to_bits()))
            .collect::<Vec<_>>()
    };
    estimates.iter().flat_map(of).collect()
}

#[test]
fn replay_an_identifier_stopped_at_any_block_and_continued_from_its_state_gives_the_same_bits() {
    let mut arm = arm();
    // a jump, then a drift that comes to rest
    arm.mass_2 = MassSchedule {
        points: vec![(0.0, 150.0), (1.299, 150.0), (1.3, 170.0), (2.8, 170.0), (5.4, 172.0)],
        interpolation: Interpolation::Linear,
    };
    let mut noise = TestRng(3);
    let samples: Vec<Sample> = ArmSimulator::new(&arm)
        .unwrap()
        .take(20 * N as usize)
        .enumerate()
        .map(|(seq, mut joints)| {
            joints.input.iter_mut().for_each(|u| *u += noise.between(-1.0, 1.0));
            Sample::new(1, seq as u64, seq as u64 * 1_000_000, 2, signals::ALL, &joints)
        })
        .collect();
    let paper = EstimatorOptions::paper(PAPER_START.to_vec(), 2);
    for options in [EstimatorOptions::recommended(PAPER_START.to_vec(), 2), paper] {
        let whole = run_with(&mut node_of(options.clone(), N), &samples).estimates;
        for stop in 1..20u64 {
            let (before, after) = samples.split_at((stop * N) as usize);
            let mut first = node_of(options.clone(), N);
            let mut estimates = run_with(&mut first, before).estimates;
            let mut state = NodeState::default();
            first.save(&mut state);
            let mut second = node_of(options.clone(), N);
            second.load(&state).expect("its own state");
            let mut continued = run_with(&mut second, after).estimates;
            assert_eq!(continued[0].flags & estimate_flags::WARM, estimate_flags::WARM);
            continued[0].flags &= !estimate_flags::WARM;
            // counts and the time of the last change belong to a process
            estimates.extend(continued);
            assert!(bits(&estimates) == bits(&whole), "stopped after block {stop}");
        }
    }
}

#[test]
fn fault_a_state_of_another_model_or_out_of_range_is_refused_and_leaves_a_fresh_node() {
    let mut node_a = node();
    run_with(&mut node_a, &stream(3));
    let mut good = NodeState::default();
    node_a.save(&mut good);
    type Spoil = fn(&mut NodeState);
    let cases: [(&str, Spoil); 5] = [
        ("too short", |s| _ = s.estimator.reals.pop()),
        ("too long", |s| s.estimator.counts.push(1)),
        ("NaN", |s| s.estimator.reals[3] = f64::NAN),
        // the first matrix behind the nine estimates is the information of joint 1
        ("information not positive", |s| s.estimator.reals[9] = -1.0),
        ("information not symmetric", |s| {
            s.estimator.reals[10] += 1e3 * (1.0 + s.estimator.reals[9])
        }),
    ];
    for (name, spoil) in cases {
        let mut state = good.clone();
        spoil(&mut state);
        let mut tried = node();
        assert!(tried.load(&state).is_err(), "{name}");
        let mut fresh = node();
        let samples = stream(3);
        let (tried, fresh) = (run_with(&mut tried, &samples), run_with(&mut fresh, &samples));
        assert!(bits(&tried.estimates) == bits(&fresh.estimates), "{name}: half-used");
    }
}

/// Runs with orders, each given before a sample; the estimates and the borders.
fn run_ordered(
    node: &mut Node,
    samples: &[Sample],
    mut orders: Vec<(usize, Order)>,
) -> (Vec<Estimate>, Vec<(u64, u64)>) {
    let mut estimates = Vec::new();
    for (at, sample) in samples.iter().enumerate() {
        while orders.first().is_some_and(|order| order.0 == at) {
            node.offer(orders.remove(0).1).expect("room");
        }
        node.on_sample(sample, &mut |e: &Estimate| estimates.push(*e));
    }
    let borders = std::iter::from_fn(|| node.take_done());
    let borders = borders
        .map(|order| (order.border.from_seq, order.border.block))
        .collect();
    (estimates, borders)
}

fn tune(options: &EstimatorOptions, block_len: u64) -> Change {
    let rows = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, block_len as usize);
    Change::Tune {
        options: Box::new(options.clone()),
        config_hash: 99,
        block_len,
        rows: (block_len != N).then(|| Box::new(rows) as Box<dyn std::any::Any + Send>),
    }
}

#[test]
fn prop_commands_take_effect_at_a_border_whole_and_the_estimate_says_so() {
    let samples = stream(20);
    let options = EstimatorOptions::recommended(PAPER_START.to_vec(), 2);
    let fresh = || {
        let estimator = BlockEstimator::new(structure(&Manipulator::default()), options.clone()).unwrap();
        Change::Replace {
            judge: Box::new(StateMachine::new(estimator.theta())),
            estimator: Box::new(estimator),
            warm: false,
        }
    };
    let mut tuned = options.clone();
    tuned.forgetting_factor = 0.7;
    let orders = || {
        vec![
            (1000, Order::new(1, 0, Change::Pause)),
            (2000, Order::new(2, 0, Change::Resume)),
            (
                2500,
                Order::new(
                    3,
                    0,
                    Change::Fix {
                        index: 2,
                        value: Some(4.0),
                    },
                ),
            ),
            (3300, Order::new(4, 0, Change::Free { index: 2 })),
            (4100, Order::new(5, 0, fresh())),
            (5000, Order::new(6, 0, tune(&tuned, 100))),
        ]
    };
    let (estimates, borders) = run_ordered(&mut node(), &samples, orders());
    assert_eq!(
        borders,
        [(1200, 4), (2000, 6), (2800, 8), (3600, 10), (4400, 12), (5200, 14)]
    );
    let at = |block: u64| estimates.iter().find(|e| e.block == block).expect("the block");
    let (paused, held) = (State::Paused as u32, estimate_flags::HELD);
    for block in [4, 5] {
        assert_eq!(
            (at(block).state, at(block).use_ok, at(block).flags & held),
            (paused, 0, held)
        );
        assert_eq!(at(block).theta, at(3).theta);
    }
    assert_ne!(at(6).state, paused);
    assert_eq!([7, 8, 9, 10].map(|block| at(block).fixed.bits()), [0, 4, 4, 0]);
    assert_eq!(at(8).theta[2], 4.0);
    assert_eq!((at(13).config_hash, at(14).config_hash), (0, 99));
    let commanded: Vec<u64> = estimates
        .iter()
        .filter(|e| e.flags & estimate_flags::COMMANDED != 0)
        .map(|e| e.block)
        .collect();
    assert_eq!(commanded, [4, 6, 8, 10, 12, 14]);
    // numbers go on, blocks are shorter: 13 of 400 and 28 of 100
    let blocks: Vec<u64> = estimates.iter().map(|e| e.block).collect();
    assert_eq!(blocks, (1..=13 + 28).collect::<Vec<u64>>());
    assert_eq!((at(14).t_first_ns, at(14).t_last_ns), (5_200_000_000, 5_299_000_000));

    // given in advance with their borders, as a replay does it, they give the same bits
    let in_advance = orders()
        .into_iter()
        .zip(&borders)
        .map(|((_, order), border)| (0, Order::new(order.id, border.0, order.change)))
        .collect();
    let (again, same) = run_ordered(&mut node(), &samples, in_advance);
    assert_eq!(same, borders);
    assert!(bits(&again) == bits(&estimates));
}

#[test]
fn prop_a_command_where_the_end_of_a_block_is_lost_holds_from_the_next_block_on() {
    let mut samples = stream(20);
    // the end of block 3 and the beginning of block 4
    samples.drain(1100..1300);
    let orders = vec![(
        1000,
        Order::new(1, 0, tune(&EstimatorOptions::recommended(PAPER_START.to_vec(), 2), 200)),
    )];
    let (estimates, borders) = run_ordered(&mut node(), &samples, orders);
    assert_eq!(borders, [(1200, 4)]);
    let first: Vec<(u64, u64)> = estimates
        .iter()
        .take(5)
        .map(|e| (e.block, e.t_last_ns / 1_000_000))
        .collect();
    assert_eq!(first, [(1, 399), (2, 799), (3, 1099), (4, 1399), (5, 1599)]);
}

#[test]
fn fault_more_orders_than_there_is_room_for_and_foreign_rows_are_given_back() {
    let mut node = node();
    run_with(&mut node, &stream(1)[..10]);
    let foreign = Change::Tune {
        options: Box::new(EstimatorOptions::recommended(PAPER_START.to_vec(), 2)),
        config_hash: 0,
        block_len: 100,
        rows: Some(Box::new(0u8)),
    };
    assert!(node.offer(Order::new(1, 0, foreign)).is_err());
    assert!(node.offer(Order::new(1, 0, Change::Free { index: 9 })).is_err());
    // 64 that wait, and 16 places for what is to take effect at the next border
    for id in 0..80 {
        assert!(node.offer(Order::new(id, 0, Change::Pause)).is_ok(), "{id}");
    }
    assert!(node.offer(Order::new(80, 0, Change::Pause)).is_err());
}
