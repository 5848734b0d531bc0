//! The identifier as a value: sample → validate → rows → block of N → estimate.
//!
//! Blocks are cut by `seq`: block = seq div N + 1 (the paper's α(m)), also after a late join, so that a lost sample does not shift the
//! borders. A block that was joined half-way is skipped, a partial last block gives no estimate, a block with lost or refused
//! samples is estimated from the rest of it, a block that was lost as a whole gives none. After construction a step neither
//! allocates nor locks, and the same input gives the same bits.
//!
//! # What is refused
//! Each sample passes, in this order: its place in the stream (`stream.rs`), number of joints, signals, finite numbers, its time, the limit of the
//! input's measurement, and the watch for frozen signals (`freeze.rs`). What fails is counted in [`StreamFaults`] and reaches no row.
//! A block in which a signal was frozen is left out as a whole, because what came before the fault was noticed is spoilt, too.
//!
//! # Commands
//! An [`Order`] takes effect at the next border between two blocks and as a whole; where no block is open, at once. Another N begins a
//! new grid there: with s the first sample behind the border and b the number of the block that would have begun there, block = b + (seq − s) div N,
//! so that numbers go on rising by one. A new stream begins with the plain grid again. An order for a sample of a stream goes with
//! that stream; `bound.rs` has those whose effects go, too.

use super::bound::{BoundEffects, KEPT, exchange_tunables};
use super::command::{Border, Change, Fate, MAX_ORDERS, NodeState, Order, RESERVED_ORDERS};
use super::freeze::FreezeWatch;
use super::misfit;
use super::stream::{SampleCursor, SamplePlace, StreamClock, Tick};
use crate::estimator::{BlockEstimator, ChangeKind, Held, Phase, Report, StateError, StateMachine, Verdict};
use crate::messages::{
    ErrorCode, Estimate, LastError, MAX_DERIVED, Sample, State, Status, StreamFaults, estimate_flags, signals,
    status_flags, stream_tag,
};
use crate::model::{DerivedValues, MAX_JOINTS};
use crate::rows::SampleBlock;
use std::any::Any;
use std::collections::VecDeque;

/// Positions, velocities, setpoints and inputs beyond this are no machine's \[SI units\].
const LARGEST: f64 = 1e9;
/// The same for accelerations and jerks.
const LARGEST_DERIVATIVE: f64 = 1e12;

/// What the identifier node needs to know beside its rows and its estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// Time between two samples \[ns\]; 0 where it is not known, and then a clock that was set forward is not noticed.
    pub sample_period_ns: u64,
    /// Magnitude from which on a measured input is saturated, per joint; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// Patience of the watch for frozen signals \[samples\]; 0 for no watch.
    pub frozen_after: u64,
}

impl IdentifierOptions {
    /// For blocks of `block_len` samples of `joints` joints that carry `signals`; everything else unknown or off.
    pub fn new(block_len: u64, joints: usize, signals: u32) -> Self {
        Self {
            block_len,
            joints,
            signals,
            model_hash: 0,
            config_hash: 0,
            sample_period_ns: 0,
            input_limit: [f64::INFINITY; MAX_JOINTS],
            frozen_after: 0,
        }
    }
}

/// The block being filled.
#[derive(Debug, Clone, Copy)]
struct OpenBlock {
    block: u64,
    t_first_ns: u64,
    /// Samples taken in; rows may be fewer.
    samples: u64,
    /// A signal was frozen.
    spoilt: bool,
}

/// How `seq` is cut into blocks.
#[derive(Debug, Clone, Copy)]
struct Grid {
    seq: u64,
    block: u64,
    len: u64,
}

impl Grid {
    fn new(len: u64) -> Self {
        Self { seq: 0, block: 1, len }
    }

    /// Block of a sample and its first sample; `None` before the grid begins.
    fn block(&self, seq: u64) -> Option<(u64, u64)> {
        let index = seq.checked_sub(self.seq)? / self.len;
        Some((self.block.saturating_add(index), self.seq + index * self.len))
    }

    fn ends_with(&self, seq: u64) -> bool {
        seq.checked_sub(self.seq)
            .is_some_and(|behind| behind % self.len == self.len - 1)
    }

    /// First border at or behind `seq`, and the block that begins there.
    fn border(&self, seq: u64) -> (u64, u64) {
        match self.block(seq) {
            None => (self.seq, self.block),
            Some((block, first)) if first == seq => (seq, block),
            Some((block, first)) => (first.saturating_add(self.len), block.saturating_add(1)),
        }
    }
}

/// An identifier node of whatever plant and rows.
pub trait Identifier: Send {
    /// See [`IdentifierNode::on_sample`].
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate));
    /// See [`IdentifierNode::status`].
    fn status(&self) -> Status;
    /// See [`IdentifierNode::offer`].
    ///
    /// # Errors
    /// The order, where there is no room for it or it is for other rows.
    fn offer(&mut self, order: Order) -> Result<Border, Order>;
    /// See [`IdentifierNode::take_done`].
    fn take_done(&mut self) -> Option<Order>;
    /// The rows of a node that has no other use, for a [`Change::Tune`] of another.
    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send>;
    /// See [`IdentifierNode::save`].
    fn save(&mut self, into: &mut NodeState);
    /// See [`IdentifierNode::load`].
    ///
    /// # Errors
    /// A state that does not belong here.
    fn load(&mut self, state: &NodeState) -> Result<(), StateError>;
}

impl<B: SampleBlock + Send + 'static> Identifier for IdentifierNode<B> {
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        IdentifierNode::on_sample(self, sample, emit);
    }

    fn status(&self) -> Status {
        IdentifierNode::status(self)
    }

    fn offer(&mut self, order: Order) -> Result<Border, Order> {
        IdentifierNode::offer(self, order)
    }

    fn take_done(&mut self) -> Option<Order> {
        IdentifierNode::take_done(self)
    }

    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send> {
        Box::new(self.rows)
    }

    fn save(&mut self, into: &mut NodeState) {
        IdentifierNode::save(self, into);
    }

    fn load(&mut self, state: &NodeState) -> Result<(), StateError> {
        IdentifierNode::load(self, state)
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
    derived: Option<Box<dyn DerivedValues + Send>>,
    cursor: SampleCursor,
    clock: StreamClock,
    freeze: FreezeWatch,
    grid: Grid,
    /// `seq` of the first sample of the stream that this process received, or from which on time goes on after a clock was set back.
    first_seq: u64,
    open: Option<OpenBlock>,
    paused: bool,
    /// Flags of the next estimate.
    news: u32,
    orders: VecDeque<Order>,
    done: VecDeque<Order>,
    bound: BoundEffects,
    status: Status,
}

impl<B: SampleBlock + 'static> IdentifierNode<B> {
    /// A node that has seen nothing; `pid` goes into its status, `derived` into its estimates.
    ///
    /// # Panics
    /// Where `block_len` is 0.
    pub fn new(
        options: IdentifierOptions,
        rows: B,
        estimator: BlockEstimator,
        derived: Option<Box<dyn DerivedValues + Send>>,
        pid: u32,
    ) -> Self {
        assert!(options.block_len > 0, "a block needs at least one sample");
        let mut node = Self {
            rows,
            machine: StateMachine::new(estimator.theta()),
            estimator,
            t_change_ns: 0,
            derived,
            cursor: SampleCursor::new(),
            clock: StreamClock::new(options.sample_period_ns),
            freeze: FreezeWatch::new(options.frozen_after, options.sample_period_ns as f64 * 1e-9),
            grid: Grid::new(options.block_len),
            first_seq: 0,
            open: None,
            paused: false,
            news: 0,
            orders: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS),
            done: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS + KEPT),
            bound: BoundEffects::new(),
            status: Status {
                pid,
                fit_probability: 1.0,
                ..Status::default()
            },
            options,
        };
        node.note_information();
        node
    }

    /// Takes a sample in; calls `emit` for each estimate that this completes: none, one, or two where the end of the previous
    /// block was lost and this sample ends the next.
    pub fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        match self.cursor.advance(sample.boot_id, sample.seq) {
            SamplePlace::First => self.start_stream(sample),
            SamplePlace::Next => {}
            SamplePlace::Gap { missing } => {
                self.status.missing = self.status.missing.saturating_add(missing);
                self.status.faults.gaps += 1;
                self.status.error = LastError::new(ErrorCode::Gap, sample.seq);
            }
            SamplePlace::Duplicate => {
                self.refuse(sample.seq, ErrorCode::Duplicate);
                return;
            }
            SamplePlace::Late => {
                // it was counted as missing, and rows are made in the order of time
                self.status.missing = self.status.missing.saturating_sub(1);
                self.refuse(sample.seq, ErrorCode::Reordered);
                return;
            }
        }
        self.status.last_seq = sample.seq;
        let place = self.grid.block(sample.seq);
        if self
            .open
            .is_some_and(|open| place.is_none_or(|(block, _)| block != open.block))
        {
            self.close(emit);
        }
        if self.open.is_none() && !self.orders.is_empty() {
            let begin = place.map_or(sample.seq, |(_, first)| first.max(self.first_seq));
            self.at_border(begin, sample.seq);
        }
        self.take(sample);
        if self.grid.ends_with(sample.seq) {
            self.close(emit);
            if !self.orders.is_empty() {
                let next = sample.seq.saturating_add(1);
                self.at_border(next, next);
            }
        }
        if sample.is_end() {
            self.discard();
            self.status.state = State::Ended as u32;
            self.leave_stream();
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

    /// Takes an order for the next border, and carries it out at once where no block is open. Returns the border as far as it is known now: lost
    /// samples may move it by blocks.
    ///
    /// # Errors
    /// The order, if [`MAX_ORDERS`] are waiting, or [`RESERVED_ORDERS`] more for one that needs nothing but the next border; or if it brings rows of
    /// another type than the node's.
    pub fn offer(&mut self, mut order: Order) -> Result<Border, Order> {
        let foreign = match &order.change {
            Change::Tune { rows: Some(rows), .. } => !rows.is::<B>(),
            // N as it is, or as an order that waits will have made it
            Change::Tune {
                block_len, rows: None, ..
            } => {
                let resizes = |order: &Order| match order.change {
                    Change::Tune {
                        block_len: len,
                        rows: Some(_),
                        ..
                    } => len == *block_len,
                    _ => false,
                };
                *block_len != self.grid.len && !self.orders.iter().any(resizes)
            }
            Change::Fix { index, .. } | Change::Free { index } => *index >= self.estimator.structure().params,
            _ => false,
        };
        let waits = order.from_seq != 0 || order.tag != 0;
        let room = if waits {
            MAX_ORDERS
        } else {
            MAX_ORDERS + RESERVED_ORDERS
        };
        if foreign || self.orders.len() + self.done.len() >= room {
            return Err(order);
        }
        let (between, tag) = (self.is_between_streams(), order.tag);
        order.stream = self.cursor.streams() + u64::from(between);
        let from_seq = order.from_seq;
        self.orders.push_back(order);
        let next = match between {
            true => 0,
            false => self.status.last_seq.saturating_add(1),
        };
        if tag != 0 && tag != self.open_tag() {
            let (seq, block) = Grid::new(self.grid.len).border(from_seq);
            return Ok(Border {
                boot_id: 0,
                from_seq: seq,
                block,
            });
        }
        if self.open.is_none() {
            self.at_border(next, next);
        }
        let (seq, block) = if self.open.is_none() && from_seq <= next {
            (next, self.grid.border(next).1)
        } else {
            self.grid.border(from_seq.max(next))
        };
        Ok(Border {
            boot_id: if between { 0 } else { self.status.boot_id },
            from_seq: seq,
            block,
        })
    }

    /// Gives an order back that took effect, with the place where it did and with what was exchanged.
    pub fn take_done(&mut self) -> Option<Order> {
        self.done.pop_front()
    }

    /// Copies out what another process needs to go on; allocates only where `into` has no room. Between two calls of
    /// [`on_sample`](Self::on_sample) the state is always whole.
    pub fn save(&mut self, into: &mut NodeState) {
        self.estimator.save(&mut self.machine, &mut into.estimator);
        into.boot_id = self.status.boot_id;
        into.block = self.status.last_block;
        into.t_ns = self.status.last_t_ns;
        into.blocks = self.estimator.report().blocks;
    }

    /// Goes on from a state that was [saved](Self::save); to be called before the first sample.
    ///
    /// # Errors
    /// A state of another model, or one that no estimator can be in. The node is as if nothing had been tried then.
    pub fn load(&mut self, state: &NodeState) -> Result<(), StateError> {
        self.estimator.load(&mut self.machine, &state.estimator)?;
        self.news |= estimate_flags::WARM;
        self.status.flags |= status_flags::WARM;
        self.note_information();
        Ok(())
    }

    /// A new stream: counters start over. θ̂ and its information stay, for the machine is the same; only its publisher was
    /// started again.
    fn start_stream(&mut self, sample: &Sample) {
        self.enter_stream(stream_tag(sample.boot_id));
        self.rows.reset();
        self.clock.reset();
        self.freeze.reset();
        self.grid = Grid::new(self.grid.len);
        self.open = None;
        self.first_seq = sample.seq;
        self.t_change_ns = 0;
        self.status = Status {
            boot_id: sample.boot_id,
            streams: self.cursor.streams(),
            state: if self.paused { State::Paused } else { State::Collecting } as u32,
            accepted: 0,
            missing: 0,
            rejected: 0,
            last_seq: 0,
            last_t_ns: 0,
            estimates: 0,
            last_block: 0,
            fit: 0.0,
            fit_probability: 1.0,
            faults: StreamFaults::default(),
            ..self.status
        };
    }

    /// Counts a sample and, where its block is wanted, makes rows of it.
    fn take(&mut self, sample: &Sample) {
        let verdict = self.judge(sample);
        // A block that was joined half-way stays closed.
        let wanted = self
            .grid
            .block(sample.seq)
            .filter(|&(_, first)| first >= self.first_seq);
        if let (Some((block, _)), None) = (wanted, self.open) {
            self.open = Some(OpenBlock {
                block,
                t_first_ns: match verdict {
                    Ok(()) => sample.t_ns,
                    Err(_) => self.status.last_t_ns,
                },
                samples: 0,
                spoilt: false,
            });
        }
        match verdict {
            Ok(()) => {
                let used = wanted.is_some() && !self.paused;
                if used && !self.rows.push(sample.t_ns, &sample.joint_sample()) {
                    // rows have room for N samples, and a block has no more
                    self.refuse(sample.seq, ErrorCode::NotEvaluable);
                    return;
                }
                self.status.accepted += 1;
                self.status.last_t_ns = sample.t_ns;
                if let Some(open) = &mut self.open {
                    open.samples += 1;
                }
            }
            Err(code) => {
                self.refuse(sample.seq, code);
                if let Some(open) = &mut self.open {
                    open.spoilt |= code == ErrorCode::Frozen;
                }
            }
        }
    }

    fn refuse(&mut self, seq: u64, code: ErrorCode) {
        self.status.rejected += 1;
        let faults = &mut self.status.faults;
        let count = match code {
            ErrorCode::Duplicate => Some(&mut faults.duplicates),
            ErrorCode::Reordered => Some(&mut faults.reordered),
            ErrorCode::ClockJump => Some(&mut faults.clock_jumps),
            ErrorCode::WrongJoints => Some(&mut faults.wrong_joints),
            ErrorCode::WrongSignals => Some(&mut faults.wrong_signals),
            ErrorCode::NotFinite => Some(&mut faults.not_finite),
            ErrorCode::Saturated => Some(&mut faults.saturated),
            ErrorCode::Frozen => Some(&mut faults.frozen),
            _ => None,
        };
        count.into_iter().for_each(|count| *count += 1);
        self.status.error = LastError::new(code, seq);
    }

    /// What a sample that is in its place is good for.
    fn judge(&mut self, sample: &Sample) -> Result<(), ErrorCode> {
        let options = self.options;
        if sample.joints as usize != options.joints {
            return Err(ErrorCode::WrongJoints);
        }
        if sample.signals & options.signals != options.signals {
            return Err(ErrorCode::WrongSignals);
        }
        if !options.are_numbers(sample) {
            return Err(ErrorCode::NotFinite);
        }
        match self.clock.check(sample.seq, sample.t_ns) {
            Tick::Good | Tick::Set { back: false } => {}
            Tick::Jump => return Err(ErrorCode::ClockJump),
            // rows are ordered in time: what is there belongs to another time
            Tick::Set { back: true } => {
                self.discard();
                self.rows.reset();
                self.first_seq = sample.seq;
            }
        }
        let joints = options.joints.min(MAX_JOINTS);
        let driven = options.signals & signals::INPUT != 0;
        let inputs = sample.input.iter().zip(&options.input_limit).take(joints);
        if driven && inputs.into_iter().any(|(input, limit)| input.abs() >= *limit) {
            return Err(ErrorCode::Saturated);
        }
        let measured = options.signals & signals::DQ != 0;
        if self.freeze.look(&sample.joint_sample(), joints, measured, driven) {
            return Err(ErrorCode::Frozen);
        }
        Ok(())
    }

    /// Ends the open block with an estimate.
    fn close(&mut self, emit: &mut dyn FnMut(&Estimate)) {
        let Some(open) = self.open else { return };
        let incomplete = open.samples < self.grid.len;
        let mut estimate = if self.paused {
            let mut estimate = message(self.estimator.report(), Verdict::default());
            estimate.state = State::Paused as u32;
            estimate.flags |= estimate_flags::HELD;
            (estimate.excited, estimate.iterations, estimate.outliers) = (0, 0, 0);
            estimate
        } else {
            if open.spoilt {
                self.rows.reset();
                self.status.faults.blocks_held += 1;
            }
            self.rows.prepare(self.estimator.theta());
            let report = self.estimator.update(&self.rows);
            let lost = match open.spoilt {
                true => 1.0,
                false => 1.0 - open.samples as f64 / self.grid.len as f64,
            };
            let replaced = self.rows.replaced();
            let spiky = f64::from(replaced) / (2 * self.options.joints.max(1)) as f64 / self.grid.len as f64;
            let mut estimate = message(report, self.machine.step(report, lost.max(spiky)));
            estimate.outliers = estimate.outliers.saturating_add(replaced);
            if let Some(change) = report.change.filter(|change| change.kind != ChangeKind::Drift) {
                self.t_change_ns = change.time;
                estimate.flags |= estimate_flags::CHANGED;
            }
            if report.held == Some(Held::NotFinite) {
                self.status.error = LastError::new(ErrorCode::NotEvaluable, self.status.last_seq);
            } else if let Some(suspicion) = report.suspicion
                && let Some(suspect) = self.rows.suspect(suspicion.suspect)
            {
                self.status.error = misfit::error(&suspect, &suspicion, self.status.last_seq);
            }
            estimate
        };
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
        estimate.flags |= std::mem::take(&mut self.news);
        if incomplete {
            estimate.flags |= estimate_flags::INCOMPLETE;
        }
        if open.spoilt {
            estimate.flags |= estimate_flags::SENSOR;
        }
        if let Some(derived) = &self.derived {
            let covariance = |i: usize, j: usize| self.estimator.covariance(i, j);
            let count = derived.quantities().len().min(MAX_DERIVED);
            estimate.derived_len = count as u32;
            for index in 0..count {
                (estimate.derived[index], estimate.derived_std[index]) =
                    derived.value_and_std(index, &self.estimator.report().theta, &covariance);
            }
        }
        self.status.estimates += 1;
        self.status.last_block = open.block;
        self.status.state = estimate.state;
        self.status.fit = estimate.fit.iter().copied().fold(0.0, f64::max);
        self.status.fit_probability = estimate.fit_probability;
        self.note_information();
        self.discard();
        emit(&estimate);
    }

    /// Drops the open block.
    fn discard(&mut self) {
        self.rows.clear();
        self.open = None;
    }

    fn note_information(&mut self) {
        self.status.condition = self.estimator.report().condition;
        (self.status.information_ln, self.status.asymmetry) = self.estimator.information_figures();
    }

    /// Carries out what is due between two blocks; `begin` is the first sample behind the border, `next` the next one to be taken in.
    fn at_border(&mut self, begin: u64, next: u64) {
        let mut waiting = 0;
        while let Some(order) = self.orders.get(waiting) {
            let here = order.tag == 0 || order.tag == self.open_tag();
            let in_time = match order.tag {
                0 => order.stream == self.cursor.streams(),
                _ => true,
            } && next >= order.from_seq;
            if !(here && (order.from_seq == 0 || in_time)) {
                waiting += 1;
                continue;
            }
            if let Some(mut order) = self.orders.remove(waiting) {
                self.bound.note(&order, self.paused, self.status.flags, &self.estimator);
                self.carry_out(&mut order.change, begin);
                order.border = Border {
                    boot_id: self.status.boot_id,
                    from_seq: begin,
                    block: self.grid.border(begin).1,
                };
                let superfluous = self.bound.keep(&mut order).into_iter().flatten();
                self.done.extend(superfluous.map(|order| order.with_fate(Fate::Undone)));
                self.status.process.commands += 1;
                self.news |= estimate_flags::COMMANDED;
                self.done.push_back(order.with_fate(Fate::Done));
            }
        }
    }

    fn is_between_streams(&self) -> bool {
        self.status.boot_id == 0 || self.status.state == State::Ended as u32
    }

    /// Of the stream that is open; 0 between two.
    fn open_tag(&self) -> u32 {
        if self.is_between_streams() {
            0
        } else {
            stream_tag(self.status.boot_id)
        }
    }

    /// At the END of a stream: what was for it alone goes with it.
    fn leave_stream(&mut self) {
        let over = stream_tag(self.status.boot_id);
        self.drop_orders(self.cursor.streams() + 1, |order| order.tag == over);
        self.undo_for(0);
    }

    /// At the first sample of a stream, which may have come without the END of another.
    fn enter_stream(&mut self, tag: u32) {
        self.drop_orders(self.cursor.streams(), |order| order.tag != 0 && order.tag != tag);
        self.undo_for(tag);
    }

    /// Gives back the orders that `gone` picks, and those for a sample of a stream before the one with this number.
    fn drop_orders(&mut self, stream: u64, gone: impl Fn(&Order) -> bool) {
        let mut at = 0;
        while let Some(order) = self.orders.get(at) {
            if !(gone(order) || order.tag == 0 && order.from_seq != 0 && order.stream < stream) {
                at += 1;
            } else if let Some(order) = self.orders.remove(at) {
                self.done.push_back(order.with_fate(Fate::Dropped));
            }
        }
    }

    /// Puts back what orders have changed for streams other than this one.
    fn undo_for(&mut self, tag: u32) {
        if !self.bound.are_foreign_to(tag) {
            return;
        }
        let before = self.bound.take();
        before.hold(&mut self.estimator);
        if let Some(paused) = before.paused {
            self.paused = paused;
            self.status.flags &= !status_flags::PAUSED;
            self.status.flags |= if paused { status_flags::PAUSED } else { 0 };
        }
        // the older change last: its tunables are those of before
        for mut order in [before.resized, before.tuned].into_iter().flatten() {
            self.carry_out(&mut order.change, 0);
            self.done.push_back(order.with_fate(Fate::Undone));
        }
        self.rows.reset();
        self.status.flags &= !status_flags::COMMANDED;
        self.status.flags |= before.commanded;
        // nothing that this stream would have to be told of
        self.news &= !estimate_flags::COMMANDED;
    }

    fn carry_out(&mut self, change: &mut Change, begin: u64) {
        match change {
            Change::Pause => {
                self.paused = true;
                self.status.flags |= status_flags::PAUSED;
                if self.status.state != State::Ended as u32 {
                    self.status.state = State::Paused as u32;
                }
            }
            Change::Resume => {
                if std::mem::take(&mut self.paused) && self.status.state != State::Ended as u32 {
                    self.status.state = State::Collecting as u32;
                }
                self.status.flags &= !status_flags::PAUSED;
                // windows must not reach back over the pause
                self.rows.reset();
            }
            Change::Replace { estimator, judge, warm } => {
                std::mem::swap(&mut self.estimator, estimator);
                std::mem::swap(&mut self.machine, judge);
                self.rows.reset();
                self.t_change_ns = 0;
                self.news &= !estimate_flags::WARM;
                self.status.flags &= !status_flags::WARM;
                if *warm {
                    self.news |= estimate_flags::WARM;
                    self.status.flags |= status_flags::WARM;
                }
                self.note_information();
            }
            Change::Tune {
                options,
                config_hash,
                block_len,
                rows,
            } => {
                self.status.flags |= status_flags::COMMANDED;
                exchange_tunables(&mut self.estimator, options);
                std::mem::swap(&mut self.options.config_hash, config_hash);
                if let Some(rows) = rows.as_mut().and_then(|rows| rows.downcast_mut::<B>()) {
                    std::mem::swap(&mut self.rows, rows);
                    let (seq, block) = self.grid.border(begin);
                    let len = std::mem::replace(block_len, self.grid.len);
                    self.grid = Grid { seq, block, len };
                }
            }
            Change::Kept => {}
            Change::Fix { index, value } => {
                self.status.flags |= status_flags::COMMANDED;
                let value = value.unwrap_or(self.estimator.report().theta[*index]);
                self.estimator.fix(*index, Some(value));
            }
            Change::Free { index } => {
                self.status.flags |= status_flags::COMMANDED;
                // what is known of a parameter that is free already must not be forgotten
                if self.estimator.options().fixed[*index] {
                    self.estimator.fix(*index, None);
                }
            }
        }
    }
}

impl IdentifierOptions {
    /// True for a sample whose needed signals hold numbers that a machine can have.
    fn are_numbers(&self, sample: &Sample) -> bool {
        let joints = self.joints.min(MAX_JOINTS);
        // false for NaN, too
        let within = |signal: u32, values: &[f64; MAX_JOINTS], largest: f64| {
            self.signals & signal == 0 || values[..joints].iter().all(|value| value.abs() <= largest)
        };
        within(signals::Q, &sample.q, LARGEST)
            && within(signals::DQ, &sample.dq, LARGEST)
            && within(signals::DDQ, &sample.ddq, LARGEST_DERIVATIVE)
            && within(signals::DDDQ, &sample.dddq, LARGEST_DERIVATIVE)
            && within(signals::SETPOINT, &sample.setpoint, LARGEST)
            && within(signals::INPUT, &sample.input, LARGEST)
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
        Phase::Misfit => State::Misfit,
    };
    let mut estimate = Estimate {
        excited: report.excited,
        usable: report.usable,
        fixed: report.fixed,
        state: state as u32,
        use_ok: u32::from(verdict.use_ok),
        flags: if report.held.is_some() { estimate_flags::HELD } else { 0 },
        params: report.theta.len() as u32,
        equations: report.residual_rms.len() as u32,
        iterations: report.iterations,
        outliers: report.outliers,
        condition: report.condition,
        fit_probability: report.fit_probability,
        ..Estimate::EMPTY
    };
    fill(&mut estimate.innovation_rms, &report.innovation_rms);
    fill(&mut estimate.residual_rms, &report.residual_rms);
    fill(&mut estimate.fit, &report.fit);
    fill(&mut estimate.explained, &report.explained);
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
pub(super) mod tests {
    use super::*;
    use crate::estimator::{EstimatorOptions, Residuals, Structure};
    use crate::messages::sample_flags;
    use crate::model::JointSample;

    /// u = θ q: one equation, one parameter.
    #[derive(Default)]
    pub(in crate::node) struct Spring(Vec<(f64, f64)>);

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

    pub(in crate::node) fn node(block_len: u64) -> IdentifierNode<Spring> {
        let structure = Structure {
            params: 1,
            equations: vec![0..1],
        };
        let estimator = BlockEstimator::new(structure, EstimatorOptions::paper(vec![1.0], 1)).unwrap();
        let options = IdentifierOptions {
            sample_period_ns: 1_000_000,
            ..IdentifierOptions::new(block_len, 1, signals::Q | signals::INPUT)
        };
        IdentifierNode::new(options, Spring::default(), estimator, None, 77)
    }

    pub(in crate::node) fn sample(boot_id: u64, seq: u64) -> Sample {
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
    fn fault_with_n_larger_than_the_run_there_is_no_estimate() {
        let mut node = node(100);
        let theta = node.estimator().theta()[0];
        assert_eq!(run(&mut node, &stream(1, 0..99)), []);
        assert_eq!(
            (node.estimator().theta()[0], node.estimator().report().blocks),
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
