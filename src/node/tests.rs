//! The identifier node with streams of every kind and a plant of one parameter.

use super::block_learner::BlockLearner;
use super::identifier::{IdentifierNode, IdentifierOptions};
use crate::estimator::{BlockEstimator, EstimatorOptions, Residuals, Structure};
use crate::messages::{Estimate, Sample, State, estimate_flags, sample_flags, signals};
use crate::model::JointSample;
use crate::rows::SampleBlock;

/// u = θ q: one equation, one parameter.
#[derive(Default)]
pub(super) struct Spring(Vec<(f64, f64)>);

impl Residuals for Spring {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn row(&self, _: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let (q, u) = self.0[index];
        regressor[0] = q;
        u - theta[0] * q
    }
}

impl SampleBlock for Spring {
    fn push(&mut self, _: u64, sample: &JointSample) -> bool {
        self.0.push((sample.q[0], sample.input[0]));
        true
    }
    fn clear(&mut self) {
        self.0.clear();
    }
}

pub(super) fn node(block_len: u64) -> IdentifierNode<BlockLearner<Spring>> {
    let structure = Structure {
        params: 1,
        equations: vec![0..1],
    };
    let estimator = BlockEstimator::new(structure, EstimatorOptions::paper(vec![1.0], 1)).unwrap();
    let options = IdentifierOptions {
        sample_period_ns: 1_000_000,
        ..IdentifierOptions::new(block_len, 1, signals::Q | signals::INPUT)
    };
    IdentifierNode::new(options, BlockLearner::new(Spring::default(), estimator, None), 77)
}

pub(super) fn sample(stream_id: u64, seq: u64) -> Sample {
    let mut joints = JointSample::default();
    joints.q[0] = 1.0 + (seq % 3) as f64;
    joints.input[0] = 5.0 * joints.q[0];
    Sample::new(stream_id, seq, seq * 1_000_000, 1, signals::Q | signals::INPUT, &joints)
}

/// Feeds samples and returns (block, accepted, missing, rejected, flags) of every estimate.
fn run(node: &mut IdentifierNode<BlockLearner<Spring>>, samples: &[Sample]) -> Vec<(u64, u64, u64, u64, u32)> {
    let mut estimates = Vec::new();
    for sample in samples {
        node.on_sample(sample, &mut |e: &Estimate| {
            assert!(e.theta[..e.params as usize].iter().all(|v| v.is_finite()));
            estimates.push((e.block, e.accepted, e.missing, e.rejected, e.flags));
        });
    }
    estimates
}

fn stream(stream_id: u64, seqs: impl IntoIterator<Item = u64>) -> Vec<Sample> {
    seqs.into_iter().map(|seq| sample(stream_id, seq)).collect()
}

#[test]
fn ident_a_whole_stream_gives_one_estimate_per_full_block_and_ends() {
    let mut node = node(10);
    let mut samples = stream(1, 0..35);
    samples[34].flags = sample_flags::END;
    let estimates = run(&mut node, &samples);
    assert_eq!(estimates, [(1, 10, 0, 0, 0), (2, 20, 0, 0, 0), (3, 30, 0, 0, 0)]);
    // Two unknowns only in rounding: the data are exact, so θ̂ is off by no more than what ε = 1e-3
    // pulls.
    assert!((node.learner().estimator().theta()[0] - 5.0).abs() < 1e-3);
    let status = node.status();
    assert_eq!(status.state, State::Ended as u32);
    assert_eq!(
        (status.accepted, status.last_seq, status.last_block, status.pid),
        (35, 34, 3, 77)
    );
}

#[test]
fn fault_blocks_are_cut_by_seq_whatever_is_lost() {
    const INCOMPLETE: u32 = estimate_flags::INCOMPLETE;
    let cases: [(&str, Vec<u64>, Vec<(u64, u64, u64, u64, u32)>); 6] = [
        (
            "a gap inside",
            [0..4, 6..20].into_iter().flatten().collect(),
            vec![(1, 8, 2, 0, INCOMPLETE), (2, 18, 2, 0, 0)],
        ),
        // The first sample after the gap closes the block that lost its end, and is itself not yet
        // counted there.
        (
            "a gap over a border",
            [0..8, 13..20].into_iter().flatten().collect(),
            vec![(1, 8, 5, 0, INCOMPLETE), (2, 15, 5, 0, INCOMPLETE)],
        ),
        (
            "a whole block lost",
            [0..10, 20..30].into_iter().flatten().collect(),
            vec![(1, 10, 0, 0, 0), (3, 20, 10, 0, 0)],
        ),
        ("joined late, half-way", (14..30).collect(), vec![(3, 16, 0, 0, 0)]),
        ("joined late, at a border", (20..30).collect(), vec![(3, 10, 0, 0, 0)]),
        (
            "joined half-way, then a gap within the same block",
            [14..15, 17..30].into_iter().flatten().collect(),
            vec![(3, 14, 2, 0, 0)],
        ),
    ];
    for (name, seqs, expected) in cases {
        assert_eq!(run(&mut node(10), &stream(1, seqs)), expected, "{name}");
    }
}

#[test]
fn fault_with_n_1_each_sample_is_a_block() {
    assert_eq!(
        run(&mut node(1), &stream(1, [5, 6, 9])),
        [(6, 1, 0, 0, 0), (7, 2, 0, 0, 0), (10, 3, 2, 0, 0)]
    );
}

#[test]
fn fault_with_n_larger_than_the_run_there_is_no_estimate() {
    let mut node = node(100);
    let theta = node.learner().estimator().theta()[0];
    assert_eq!(run(&mut node, &stream(1, 0..99)), []);
    assert_eq!(
        (
            node.learner().estimator().theta()[0],
            node.learner().estimator().report().blocks
        ),
        (theta, 0)
    );
}

#[test]
fn fault_refused_samples_are_counted_and_never_reach_an_estimate() {
    let spoil: [(&str, fn(&mut Sample)); 6] = [
        ("NaN position", |s| s.q[0] = f64::NAN),
        ("infinite input", |s| s.input[0] = f64::INFINITY),
        ("wrong joint count", |s| s.joints = 2),
        ("signal not carried", |s| s.signals = signals::Q),
        ("time stands still", |s| s.t_ns -= 1_000_000),
        ("time goes back", |s| s.t_ns = 0),
    ];
    for (name, spoil) in spoil {
        let mut samples = stream(1, 0..20);
        spoil(&mut samples[9]);
        assert_eq!(
            run(&mut node(10), &samples),
            [(1, 9, 0, 1, estimate_flags::INCOMPLETE), (2, 19, 0, 1, 0)],
            "{name}"
        );
    }
    // NaN in a joint or signal that is not needed has no effect.
    let mut samples = stream(1, 0..10);
    samples[3].q[5] = f64::NAN;
    samples[3].dddq[0] = f64::NAN;
    assert_eq!(run(&mut node(10), &samples), [(1, 10, 0, 0, 0)]);
}

#[test]
fn fault_a_block_of_refused_samples_keeps_the_estimate_and_says_so() {
    let mut node = node(10);
    run(&mut node, &stream(1, 0..10));
    let theta = node.learner().estimator().theta()[0];
    let mut samples = stream(1, 10..20);
    samples.iter_mut().for_each(|s| s.input[0] = f64::NAN);
    let estimates = run(&mut node, &samples);
    assert_eq!(
        estimates,
        [(2, 10, 0, 10, estimate_flags::INCOMPLETE | estimate_flags::HELD)]
    );
    assert_eq!(node.learner().estimator().theta()[0].to_bits(), theta.to_bits());
}

#[test]
fn fault_a_restarted_publisher_is_a_new_stream_that_keeps_what_was_learnt() {
    let mut node = node(10);
    run(&mut node, &stream(1, 0..15));
    let estimates = run(&mut node, &stream(2, 0..10));
    assert_eq!(
        estimates,
        [(1, 10, 0, 0, 0)],
        "the open block of the old stream gives nothing, its counters are gone"
    );
    assert_eq!((node.status().stream_id, node.status().streams), (2, 2));
    // seq goes back under the same stream_id: also a new stream
    assert_eq!(run(&mut node, &stream(2, 0..10)), [(1, 10, 0, 0, 0)]);
    assert_eq!(node.status().streams, 3);
}

#[test]
fn fault_a_duplicate_is_refused_and_changes_nothing() {
    let mut samples = stream(1, 0..10);
    samples.insert(5, samples[4]);
    let mut with = node(10);
    assert_eq!(run(&mut with, &samples), [(1, 10, 0, 1, 0)]);
    let mut without = node(10);
    run(&mut without, &stream(1, 0..10));
    assert_eq!(
        with.learner().estimator().theta()[0].to_bits(),
        without.learner().estimator().theta()[0].to_bits()
    );
}
