//! The identifier as a value: sample → validate → rows → block of N → estimate.
//!
//! Blocks are cut by `seq`: block = seq div N + 1 (the paper's α(m)), also after a late join, so that a lost sample does not shift the
//! borders. A block that was joined half-way is skipped, a partial last block gives no estimate, a block with lost or refused
//! samples is estimated from the rest of it, a block that was lost as a whole gives none. After construction a step neither
//! allocates nor locks, and the same input gives the same bits.

use super::stream::{Place, StreamCursor};
use crate::estimator::{BlockEstimator, ChangeKind, Phase, Report, StateMachine, Verdict};
use crate::messages::{Estimate, MAX_DERIVED, Sample, State, Status, estimate_flags, signals};
use crate::model::{DerivedValues, MAX_JOINTS, MAX_PARAMS};
use crate::rows::SampleBlock;

/// What the identifier node needs to know beside its rows and its estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdentifierOptions {
    /// N, samples per block; at least 1.
    pub block_len: u64,
    /// Number of joints that every sample must have.
    pub joints: usize,
    /// [`crate::messages::signals`] that every sample must carry.
    pub signals: u32,
    /// Identifies the model in every estimate.
    pub model_hash: u64,
    /// Identifies the configuration in every estimate.
    pub config_hash: u64,
}

/// The block being filled.
#[derive(Debug, Clone, Copy)]
struct OpenBlock {
    block: u64,
    t_first_ns: u64,
    /// Samples taken in; rows may be fewer.
    samples: u64,
}

/// An identifier node of whatever plant and rows.
pub trait Identifier {
    /// See [`IdentifierNode::on_sample`].
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate));
    /// See [`IdentifierNode::status`].
    fn status(&self) -> Status;
}

impl<B: SampleBlock> Identifier for IdentifierNode<B> {
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        IdentifierNode::on_sample(self, sample, emit);
    }

    fn status(&self) -> Status {
        IdentifierNode::status(self)
    }
}

/// Consumes samples, gives an estimate per block.
pub struct IdentifierNode<B> {
    options: IdentifierOptions,
    rows: B,
    estimator: BlockEstimator,
    machine: StateMachine,
    /// Time of the last change found \[ns of stream time\].
    t_change_ns: u64,
    derived: Option<Box<dyn DerivedValues>>,
    cursor: StreamCursor,
    /// `seq` of the first sample of the stream that this process received.
    first_seq: u64,
    open: Option<OpenBlock>,
    status: Status,
}

impl<B: SampleBlock> IdentifierNode<B> {
    /// A node that has seen nothing; `pid` goes into its status, `derived` into its estimates.
    ///
    /// # Panics
    /// Where `block_len` is 0.
    pub fn new(
        options: IdentifierOptions,
        rows: B,
        estimator: BlockEstimator,
        derived: Option<Box<dyn DerivedValues>>,
        pid: u32,
    ) -> Self {
        assert!(options.block_len > 0, "a block needs at least one sample");
        Self {
            options,
            rows,
            machine: StateMachine::new(estimator.theta()),
            estimator,
            t_change_ns: 0,
            derived,
            cursor: StreamCursor::new(),
            first_seq: 0,
            open: None,
            status: Status {
                pid,
                ..Status::default()
            },
        }
    }

    /// Takes a sample in; calls `emit` for each estimate that this completes: none, one, or two where the end of the previous
    /// block was lost and this sample ends the next.
    pub fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        match self.cursor.advance(sample.boot_id, sample.seq) {
            Place::First => self.start_stream(sample),
            Place::Next => {}
            Place::Gap { missing } => self.status.missing += missing,
            Place::Duplicate => {
                self.status.rejected += 1;
                return;
            }
        }
        self.status.last_seq = sample.seq;
        let block = sample.seq / self.options.block_len + 1;
        if self.open.is_some_and(|open| open.block != block) {
            self.close(emit);
        }
        self.take(sample, block);
        if sample.seq % self.options.block_len == self.options.block_len - 1 {
            self.close(emit);
        }
        if sample.is_end() {
            self.discard();
            self.status.state = State::Ended as u32;
        }
    }

    /// The heartbeat.
    pub fn status(&self) -> Status {
        self.status
    }

    /// The estimator, for its evidence beyond the message.
    pub fn estimator(&self) -> &BlockEstimator {
        &self.estimator
    }

    /// A new stream: counters start over. θ̂ and its information stay, for the machine is the same; only its publisher was
    /// started again.
    fn start_stream(&mut self, sample: &Sample) {
        self.rows.reset();
        self.open = None;
        self.first_seq = sample.seq;
        self.t_change_ns = 0;
        self.status = Status {
            boot_id: sample.boot_id,
            pid: self.status.pid,
            streams: self.cursor.streams(),
            state: State::Collecting as u32,
            ..Status::default()
        };
    }

    /// Counts a sample and, where its block is wanted, makes rows of it.
    fn take(&mut self, sample: &Sample, block: u64) {
        // A block that was joined half-way stays closed.
        let wanted = (block - 1) * self.options.block_len >= self.first_seq;
        let valid = self.options.accepts(sample) && (self.status.accepted == 0 || sample.t_ns > self.status.last_t_ns);
        if wanted && self.open.is_none() {
            self.open = Some(OpenBlock {
                block,
                t_first_ns: if valid { sample.t_ns } else { self.status.last_t_ns },
                samples: 0,
            });
        }
        let taken = valid && (!wanted || self.rows.push(sample.t_ns, &sample.joint_sample()));
        if taken {
            self.status.accepted += 1;
            self.status.last_t_ns = sample.t_ns;
            if let Some(open) = &mut self.open {
                open.samples += 1;
            }
        } else {
            self.status.rejected += 1;
        }
    }

    /// Ends the open block with an estimate.
    fn close(&mut self, emit: &mut dyn FnMut(&Estimate)) {
        let Some(open) = self.open else { return };
        let incomplete = open.samples < self.options.block_len;
        self.rows.prepare(self.estimator.theta());
        let report = self.estimator.update(&self.rows);
        let lost = 1.0 - open.samples as f64 / self.options.block_len as f64;
        let mut estimate = message(report, self.machine.step(report, lost));
        if let Some(change) = report.change.filter(|change| change.kind != ChangeKind::Drift) {
            self.t_change_ns = change.time;
            estimate.flags |= estimate_flags::CHANGED;
        }
        estimate.t_change_ns = self.t_change_ns;
        estimate.boot_id = self.status.boot_id;
        estimate.block = open.block;
        estimate.t_first_ns = open.t_first_ns;
        estimate.t_last_ns = self.status.last_t_ns;
        estimate.model_hash = self.options.model_hash;
        estimate.config_hash = self.options.config_hash;
        estimate.accepted = self.status.accepted;
        estimate.missing = self.status.missing;
        estimate.rejected = self.status.rejected;
        if incomplete {
            estimate.flags |= estimate_flags::INCOMPLETE;
        }
        if let Some(derived) = &self.derived {
            let covariance = |i: usize, j: usize| self.estimator.covariance(i, j);
            let count = derived.quantities().len().min(MAX_DERIVED);
            estimate.derived_len = count as u32;
            for index in 0..count {
                (estimate.derived[index], estimate.derived_std[index]) =
                    derived.value_and_std(index, self.estimator.theta(), &covariance);
            }
        }
        self.status.estimates += 1;
        self.status.last_block = open.block;
        self.status.state = estimate.state;
        self.discard();
        emit(&estimate);
    }

    /// Drops the open block.
    fn discard(&mut self) {
        self.rows.clear();
        self.open = None;
    }
}

impl IdentifierOptions {
    /// True for a sample that carries what the rows need, in finite numbers.
    fn accepts(&self, sample: &Sample) -> bool {
        let joints = self.joints.min(MAX_JOINTS);
        let finite = |signal: u32, values: &[f64; MAX_JOINTS]| {
            self.signals & signal == 0 || values[..joints].iter().all(|value| value.is_finite())
        };
        sample.joints as usize == self.joints
            && sample.signals & self.signals == self.signals
            && finite(signals::Q, &sample.q)
            && finite(signals::DQ, &sample.dq)
            && finite(signals::DDQ, &sample.ddq)
            && finite(signals::DDDQ, &sample.dddq)
            && finite(signals::SETPOINT, &sample.setpoint)
            && finite(signals::INPUT, &sample.input)
    }
}

/// The estimator's answer as a message; what only the stream knows is zero.
fn message(report: &Report, verdict: Verdict) -> Estimate {
    let state = match verdict.phase {
        Phase::Collecting => State::Collecting,
        Phase::Converging => State::Converging,
        Phase::Converged => State::Converged,
        Phase::PoorlyExcited => State::PoorlyExcited,
        Phase::Changing => State::Changing,
        Phase::Degraded => State::Degraded,
        Phase::Invalid => State::Invalid,
    };
    let mut estimate = Estimate {
        boot_id: 0,
        block: 0,
        t_first_ns: 0,
        t_last_ns: 0,
        model_hash: 0,
        config_hash: 0,
        accepted: 0,
        missing: 0,
        rejected: 0,
        excited: report.excited,
        usable: report.usable,
        fixed: report.fixed,
        t_change_ns: 0,
        state: state as u32,
        use_ok: u32::from(verdict.use_ok),
        flags: if report.held.is_some() { estimate_flags::HELD } else { 0 },
        params: report.theta.len() as u32,
        equations: report.residual_rms.len() as u32,
        derived_len: 0,
        iterations: report.iterations,
        outliers: report.outliers,
        condition: report.condition,
        innovation_rms: [0.0; MAX_JOINTS],
        residual_rms: [0.0; MAX_JOINTS],
        theta: [0.0; MAX_PARAMS],
        theta_std: [0.0; MAX_PARAMS],
        derived: [0.0; MAX_DERIVED],
        derived_std: [0.0; MAX_DERIVED],
    };
    fill(&mut estimate.innovation_rms, &report.innovation_rms);
    fill(&mut estimate.residual_rms, &report.residual_rms);
    fill(&mut estimate.theta, &report.theta);
    fill(&mut estimate.theta_std, &report.theta_std);
    estimate
}

/// Copies values to the head of a message array.
fn fill(target: &mut [f64], values: &[f64]) {
    for (target, value) in target.iter_mut().zip(values) {
        *target = *value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::{EstimatorOptions, Residuals, Structure};
    use crate::messages::sample_flags;
    use crate::model::JointSample;

    /// u = θ q: one equation, one parameter.
    #[derive(Default)]
    struct Spring(Vec<(f64, f64)>);

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

    fn node(block_len: u64) -> IdentifierNode<Spring> {
        let structure = Structure {
            params: 1,
            equations: vec![0..1],
        };
        let estimator = BlockEstimator::new(structure, EstimatorOptions::paper(vec![1.0], 1)).unwrap();
        let options = IdentifierOptions {
            block_len,
            joints: 1,
            signals: signals::Q | signals::INPUT,
            model_hash: 3,
            config_hash: 4,
        };
        IdentifierNode::new(options, Spring::default(), estimator, None, 77)
    }

    fn sample(boot_id: u64, seq: u64) -> Sample {
        let mut joints = JointSample::default();
        joints.q[0] = 1.0 + (seq % 3) as f64;
        joints.input[0] = 5.0 * joints.q[0];
        Sample::new(boot_id, seq, seq * 1_000_000, 1, signals::Q | signals::INPUT, &joints)
    }

    /// Feeds samples and gives (block, accepted, missing, rejected, flags) of every estimate.
    fn run(node: &mut IdentifierNode<Spring>, samples: &[Sample]) -> Vec<(u64, u64, u64, u64, u32)> {
        let mut estimates = Vec::new();
        for sample in samples {
            node.on_sample(sample, &mut |e: &Estimate| {
                assert!(e.theta[..e.params as usize].iter().all(|v| v.is_finite()));
                estimates.push((e.block, e.accepted, e.missing, e.rejected, e.flags));
            });
        }
        estimates
    }

    fn stream(boot_id: u64, seqs: impl IntoIterator<Item = u64>) -> Vec<Sample> {
        seqs.into_iter().map(|seq| sample(boot_id, seq)).collect()
    }

    #[test]
    fn ident_a_whole_stream_gives_one_estimate_per_full_block_and_ends() {
        let mut node = node(10);
        let mut samples = stream(1, 0..35);
        samples[34].flags = sample_flags::END;
        let estimates = run(&mut node, &samples);
        assert_eq!(estimates, [(1, 10, 0, 0, 0), (2, 20, 0, 0, 0), (3, 30, 0, 0, 0)]);
        // Two unknowns only in rounding: the data are exact, so θ̂ is off by no more than what ε = 1e-3 pulls.
        assert!((node.estimator().theta()[0] - 5.0).abs() < 1e-3);
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
            // The first sample after the gap closes the block that lost its end, and is itself not yet counted there.
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
        // NaN in a joint or signal that nobody needs is nobody's business.
        let mut samples = stream(1, 0..10);
        samples[3].q[5] = f64::NAN;
        samples[3].dddq[0] = f64::NAN;
        assert_eq!(run(&mut node(10), &samples), [(1, 10, 0, 0, 0)]);
    }

    #[test]
    fn fault_a_block_of_refused_samples_keeps_the_estimate_and_says_so() {
        let mut node = node(10);
        run(&mut node, &stream(1, 0..10));
        let theta = node.estimator().theta()[0];
        let mut samples = stream(1, 10..20);
        samples.iter_mut().for_each(|s| s.input[0] = f64::NAN);
        let estimates = run(&mut node, &samples);
        assert_eq!(
            estimates,
            [(2, 10, 0, 10, estimate_flags::INCOMPLETE | estimate_flags::HELD)]
        );
        assert_eq!(node.estimator().theta()[0].to_bits(), theta.to_bits());
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
        assert_eq!((node.status().boot_id, node.status().streams), (2, 2));
        // seq goes back under the same boot_id: a new stream, too
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
            with.estimator().theta()[0].to_bits(),
            without.estimator().theta()[0].to_bits()
        );
    }
}
