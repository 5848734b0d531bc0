//! The identifier as a value: sample → validate → rows → block of N → estimate.
//!
//! Blocks are cut by `seq`: block = seq div N + 1 (the paper's α(m)), also after a late join, so
//! that a lost sample does not shift the borders. A block joined part-way is skipped, a partial
//! last block gives no estimate, a block with lost or refused samples is estimated from the rest,
//! and a completely lost block gives none. After construction a step neither allocates nor locks,
//! and the same input gives the same bits.
//!
//! # What is refused
//! Each sample passes, in this order: its place in the stream (`stream.rs`), number of joints,
//! signals, finite numbers, its time, the limit of the input's measurement, and the watch for
//! frozen signals (`freeze.rs`). A sample that fails is counted in
//! [`StreamFaults`](crate::messages::StreamFaults) and enters no row. A block with a frozen signal
//! is left out as a whole, because samples before the detection are also invalid.
//!
//! # Commands
//! An [`Order`] takes effect as a whole at the next border between two blocks, or at once if no
//! block is open. Another N begins a new grid there: with s the first sample after the border and b
//! the number of the block that would have begun there, block = b + (seq − s) div N, so numbers
//! still increase by one. A new stream begins with the plain grid again. An order for a sample of a
//! stream ends with that stream; `bound.rs` has those whose effects end too.

use super::block_grid::{BlockGrid, OpenBlock};
use super::bound::BoundEffects;
use super::command::{Border, Change, Fate, NodeState, Order};
use super::command_queue::CommandQueue;
use super::estimate_message::message;
use super::lacking;
use super::learner::{BlockEnd, Learner};
use super::replayed::{BeforeReplay, copy_out};
use super::sample_gate::{SampleGate, largest};
use super::status_tracker::StatusTracker;
use super::stream::{SampleCursor, SamplePlace};
use crate::estimator::{StateError, Verdict};
use crate::messages::{
    ErrorCode, Estimate, LastError, ParameterSet, Sample, State, Status, estimate_flags, sample_flags, stream_tag,
};

pub use super::identifier_object::Identifier;
pub use super::identifier_options::IdentifierOptions;

/// Consumes samples and gives one estimate per block; its learner does the estimation.
pub struct IdentifierNode<L: ?Sized> {
    options: IdentifierOptions,
    learner: Box<L>,
    /// Time of the last change found \[ns of stream time\].
    t_change_ns: u64,
    cursor: SampleCursor,
    gate: SampleGate,
    grid: BlockGrid,
    /// `seq` of the first sample of the stream that this process received, or of the first one
    /// after a clock was set back.
    first_seq: u64,
    open: Option<OpenBlock>,
    commands: CommandQueue,
    bound: BoundEffects,
    before_replay: BeforeReplay,
    tracker: StatusTracker,
}

impl<L: Learner> IdentifierNode<L> {
    /// A node without data; `pid` is shown in its status.
    ///
    /// # Panics
    /// If `block_len` is 0.
    pub fn new(options: IdentifierOptions, learner: L, pid: u32) -> Self {
        Self::boxed(options, Box::new(learner), pid)
    }
}

impl<L: Learner + ?Sized> IdentifierNode<L> {
    /// The same for a boxed learner, which may be a `dyn Learner`: all nodes of that type share
    /// their code.
    ///
    /// # Panics
    /// If `block_len` is 0.
    pub fn boxed(options: IdentifierOptions, mut learner: Box<L>, pid: u32) -> Self {
        assert!(options.block_len > 0, "a block needs at least one sample");
        let mut node = Self {
            before_replay: BeforeReplay::new(&mut *learner),
            learner,
            t_change_ns: 0,
            cursor: SampleCursor::new(),
            gate: SampleGate::new(&options),
            grid: BlockGrid::new(options.block_len),
            first_seq: 0,
            open: None,
            commands: CommandQueue::new(),
            bound: BoundEffects::new(),
            tracker: StatusTracker::new(pid),
            options,
        };
        node.learner.describe(&mut node.tracker.status);
        node
    }

    /// Takes a sample and calls `emit` for each estimate that it completes: none, one, or two if
    /// the end of the previous block was lost and this sample ends the next.
    pub fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        match self.cursor.advance(sample.stream_id, sample.seq) {
            SamplePlace::First => self.start_stream(sample),
            SamplePlace::Next => {}
            SamplePlace::Gap { missing } => self.tracker.miss(sample.seq, missing),
            SamplePlace::Duplicate => {
                self.tracker.refuse(sample.seq, ErrorCode::Duplicate);
                return;
            }
            SamplePlace::Late => {
                // it was counted as missing; rows need samples in order of time, so it is not used
                self.tracker.status.missing = self.tracker.status.missing.saturating_sub(1);
                self.tracker.refuse(sample.seq, ErrorCode::Reordered);
                return;
            }
        }
        self.tracker.status.last_seq = sample.seq;
        let place = self.grid.block(sample.seq);
        if self
            .open
            .is_some_and(|open| place.is_none_or(|(block, _)| block != open.block))
        {
            self.close(emit);
        }
        if self.open.is_none() && !self.commands.is_empty() {
            let begin = place.map_or(sample.seq, |(_, first)| first.max(self.first_seq));
            self.at_border(begin, sample.seq);
        }
        self.take(sample);
        if self.grid.ends_with(sample.seq) {
            self.close(emit);
            if !self.commands.is_empty() {
                let next = sample.seq.saturating_add(1);
                self.at_border(next, next);
            }
        }
        if sample.is_end() {
            self.discard();
            self.tracker.status.state = State::Ended as u32;
            self.leave_stream();
        }
    }

    /// The status message.
    pub fn status(&self) -> Status {
        self.tracker.status
    }

    /// The learner, for evidence beyond the message.
    pub fn learner(&self) -> &L {
        &self.learner
    }

    /// The learner of a node that is no longer needed.
    pub(super) fn into_learner(self) -> Box<L> {
        self.learner
    }

    /// Accepts an order for the next border, and carries it out at once if no block is open.
    /// Returns the border as known now: lost samples may move it by blocks.
    ///
    /// # Errors
    /// The order, if [`MAX_ORDERS`](super::command::MAX_ORDERS) are waiting, or
    /// [`RESERVED_ORDERS`](super::command::RESERVED_ORDERS) more for one that needs nothing but the
    /// next border; or if it brings rows of another type than the node's.
    pub fn offer(&mut self, mut order: Order) -> Result<Border, Order> {
        let fits = match &order.change {
            Change::Pause | Change::Resume => true,
            Change::Fix { index, .. } | Change::Free { index } => *index < self.learner.report().theta.len(),
            // N as it is, or as a waiting order will make it
            Change::Tune {
                block_len, rows: None, ..
            } if *block_len != self.grid.len && !self.commands.will_resize_to(*block_len) => false,
            Change::Kept => false,
            change => self.learner.accepts(change),
        };
        if !fits || !self.commands.has_room_for(&order) {
            return Err(order);
        }
        let (between, tag) = (self.tracker.is_between_streams(), order.tag);
        order.stream = self.cursor.streams() + u64::from(between);
        let from_seq = order.from_seq;
        self.commands.push(order);
        let next = match between {
            true => 0,
            false => self.tracker.status.last_seq.saturating_add(1),
        };
        if tag != 0 && tag != self.tracker.open_tag() {
            let (seq, block) = BlockGrid::new(self.grid.len).border(from_seq);
            return Ok(Border {
                stream_id: 0,
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
            stream_id: if between { 0 } else { self.tracker.status.stream_id },
            from_seq: seq,
            block,
        })
    }

    /// Returns an order that took effect, with its border and the exchanged parts.
    pub fn take_done(&mut self) -> Option<Order> {
        self.commands.take_done()
    }

    /// Saves the state that another process needs to continue; allocates only if `into` is too
    /// small. Between two calls of [`on_sample`](Self::on_sample) the state is always consistent.
    /// During a replay, and after it up to the next stream, this is the state from before it.
    pub fn save(&mut self, into: &mut NodeState) {
        match self.before_replay.kept() {
            None => copy_out(&mut *self.learner, &self.tracker.status, into),
            Some(kept) => into.copy_from(kept),
        }
    }

    /// Continues from a [saved](Self::save) state; call it before the first sample.
    ///
    /// # Errors
    /// If the state is of another model or is invalid. The node is then unchanged.
    pub fn load(&mut self, state: &NodeState) -> Result<(), StateError> {
        self.learner.load(&state.estimator)?;
        self.tracker.set_warm(true);
        self.learner.describe(&mut self.tracker.status);
        Ok(())
    }

    /// A new stream: counters start over. θ̂ and its information stay, because the machine is
    /// likely to be the same, but nothing is usable until the new stream confirms it. What was
    /// learnt from a replay is dropped.
    fn start_stream(&mut self, sample: &Sample) {
        self.enter_stream(stream_tag(sample.stream_id));
        self.change_teacher(sample);
        self.learner.enter_stream(sample.stream_id);
        self.learner.restart_rows();
        self.gate.reset();
        self.grid = BlockGrid::new(self.grid.len);
        self.open = None;
        self.first_seq = sample.seq;
        self.t_change_ns = 0;
        self.tracker.begin_stream(sample.stream_id, self.cursor.streams());
    }

    /// Restores the state before a finished replay, and keeps it while another one is open.
    fn change_teacher(&mut self, sample: &Sample) {
        let given_back = self.before_replay.give_back(&mut *self.learner);
        if given_back != Ok(false) {
            self.learner.describe(&mut self.tracker.status);
        }
        if given_back.is_err() {
            self.tracker.status.error = LastError::new(ErrorCode::NotEvaluable, sample.seq);
        }
        let replay = sample.flags & sample_flags::REPLAY != 0;
        self.tracker.set_replay(replay);
        if replay {
            match given_back {
                Ok(true) => self.before_replay.keep_on(),
                _ => self.before_replay.keep(&mut *self.learner, &self.tracker.status),
            }
        }
    }

    /// Counts a sample and, if its block is used, adds it to the rows.
    fn take(&mut self, sample: &Sample) {
        let judgement = self.gate.judge(sample);
        if judgement.set_back {
            // rows are ordered in time: the present ones belong to another time
            self.open = None;
            self.learner.restart_rows();
            self.first_seq = sample.seq;
        }
        let verdict = judgement.result;
        // A block joined part-way stays closed.
        let wanted = self
            .grid
            .block(sample.seq)
            .filter(|&(_, first)| first >= self.first_seq);
        if let (Some((block, _)), None) = (wanted, self.open) {
            self.open = Some(OpenBlock {
                block,
                t_first_ns: match verdict {
                    Ok(()) => sample.t_ns,
                    Err(_) => self.tracker.status.last_t_ns,
                },
                samples: 0,
                spoilt: false,
            });
        }
        match verdict {
            Ok(()) => {
                let used = wanted.is_some() && !self.tracker.paused;
                if used && !self.learner.take(sample) {
                    self.tracker.refuse(sample.seq, ErrorCode::NotEvaluable);
                    return;
                }
                self.tracker.status.accepted += 1;
                self.tracker.status.last_t_ns = sample.t_ns;
                if let Some(open) = &mut self.open {
                    open.samples += 1;
                }
            }
            Err(code) => {
                self.tracker.refuse(sample.seq, code);
                self.tracker.status.error = match code {
                    ErrorCode::WrongSignals => lacking::signal(sample.seq, self.options.signals, sample.signals),
                    ErrorCode::NotFinite => lacking::number(sample, self.options.signals, self.options.joints, largest),
                    _ => self.tracker.status.error,
                };
                if let Some(open) = &mut self.open {
                    open.spoilt |= code == ErrorCode::Frozen;
                }
            }
        }
    }

    /// Ends the open block with an estimate.
    fn close(&mut self, emit: &mut dyn FnMut(&Estimate)) {
        let Some(open) = self.open.take() else { return };
        let incomplete = open.samples < self.grid.len;
        let mut estimate = if self.tracker.paused {
            let mut estimate = message(self.learner.report(), Verdict::default());
            estimate.state = State::Paused as u32;
            estimate.flags |= estimate_flags::HELD;
            (estimate.excited, estimate.iterations, estimate.outliers) = (ParameterSet::EMPTY, 0, 0);
            estimate
        } else {
            self.learn(open)
        };
        estimate.t_change_ns = self.t_change_ns;
        estimate.stream_id = self.tracker.status.stream_id;
        estimate.block = open.block;
        estimate.t_first_ns = open.t_first_ns;
        estimate.t_last_ns = self.tracker.status.last_t_ns;
        estimate.model_hash = self.options.model_hash;
        estimate.config_hash = self.options.config_hash;
        estimate.accepted = self.tracker.status.accepted;
        estimate.missing = self.tracker.status.missing;
        estimate.rejected = self.tracker.status.rejected;
        if incomplete {
            estimate.flags |= estimate_flags::INCOMPLETE;
        }
        if open.spoilt {
            estimate.flags |= estimate_flags::SENSOR;
        }
        self.learner.derive(&mut estimate);
        self.tracker.publish(&mut estimate);
        self.learner.describe(&mut self.tracker.status);
        emit(&estimate);
    }

    fn learn(&mut self, open: OpenBlock) -> Estimate {
        if open.spoilt {
            self.learner.restart_rows();
            self.tracker.status.faults.blocks_held += 1;
        }
        let learnt = self.learner.learn(&BlockEnd {
            lost: match open.spoilt {
                true => 1.0,
                false => 1.0 - open.samples as f64 / self.grid.len as f64,
            },
            len: self.grid.len,
            joints: self.options.joints,
            last_seq: self.tracker.status.last_seq,
        });
        self.t_change_ns = learnt.change_ns.unwrap_or(self.t_change_ns);
        self.tracker.status.error = learnt.error.unwrap_or(self.tracker.status.error);
        learnt.estimate
    }

    /// Drops the open block.
    fn discard(&mut self) {
        if self.open.take().is_some() {
            self.learner.drop_block();
        }
    }

    /// Carries out the orders due between two blocks; `begin` is the first sample after the border,
    /// `next` the next one to be taken.
    fn at_border(&mut self, begin: u64, next: u64) {
        let (streams, open_tag) = (self.cursor.streams(), self.tracker.open_tag());
        let is_due = |order: &Order| {
            let here = order.tag == 0 || order.tag == open_tag;
            let in_time = (order.tag != 0 || order.stream == streams) && next >= order.from_seq;
            here && (order.from_seq == 0 || in_time)
        };
        while let Some(mut order) = self.commands.take_due(is_due) {
            self.bound
                .note(&order, self.tracker.paused, self.tracker.status.flags, &*self.learner);
            self.carry_out(&mut order.change, begin);
            self.before_replay
                .follow(&order, &mut *self.learner, &self.tracker.status);
            order.border = Border {
                stream_id: self.tracker.status.stream_id,
                from_seq: begin,
                block: self.grid.border(begin).1,
            };
            for superfluous in self.bound.keep(&mut order).into_iter().flatten() {
                self.commands.give_back(superfluous, Fate::Undone);
            }
            self.tracker.count_command();
            self.commands.give_back(order, Fate::Done);
        }
    }

    /// At the END of a stream: drops and undoes the orders for this stream only.
    fn leave_stream(&mut self) {
        let over = stream_tag(self.tracker.status.stream_id);
        self.drop_orders(self.cursor.streams() + 1, |order| order.tag == over);
        self.undo_for(0);
    }

    /// At the first sample of a stream, which may arrive without the END of the previous one.
    fn enter_stream(&mut self, tag: u32) {
        self.drop_orders(self.cursor.streams(), |order| order.tag != 0 && order.tag != tag);
        self.undo_for(tag);
    }

    /// Returns the orders for which `gone` is true, and those for a sample of a stream before the
    /// one with this number.
    fn drop_orders(&mut self, stream: u64, gone: impl Fn(&Order) -> bool) {
        self.commands
            .drop_all(|order| gone(order) || order.tag == 0 && order.from_seq != 0 && order.stream < stream);
    }

    /// Undoes the effects of orders for streams other than this one.
    fn undo_for(&mut self, tag: u32) {
        if !self.bound.are_foreign_to(tag) {
            return;
        }
        let before = self.bound.take();
        before.hold(&mut *self.learner);
        // the older change last: it holds the original tunables
        for mut order in [before.resized, before.tuned].into_iter().flatten() {
            self.carry_out(&mut order.change, 0);
            self.commands.give_back(order, Fate::Undone);
        }
        self.learner.restart_rows();
        self.tracker.undo_commands(before.paused, before.commanded);
    }

    fn carry_out(&mut self, change: &mut Change, begin: u64) {
        match change {
            Change::Pause => self.tracker.pause(),
            Change::Resume => {
                self.tracker.resume();
                // windows must not extend back over the pause
                self.learner.restart_rows();
            }
            Change::Replace { .. } | Change::Restart { .. } => {
                self.t_change_ns = 0;
                let begun = self.learner.begin_anew(change);
                self.tracker.set_warm(begun == Ok(true));
                if !self.tracker.is_between_streams() {
                    self.learner.enter_stream(self.tracker.status.stream_id);
                }
                if begun.is_err() {
                    self.tracker.status.error =
                        LastError::new(ErrorCode::CheckpointUnused, self.tracker.status.last_seq);
                }
                self.learner.describe(&mut self.tracker.status);
            }
            Change::Tune {
                options,
                config_hash,
                block_len,
                rows,
            } => {
                self.tracker.set_commanded();
                std::mem::swap(&mut self.options.config_hash, config_hash);
                if self.learner.tune(options, rows.as_mut()) {
                    let (seq, block) = self.grid.border(begin);
                    let len = std::mem::replace(block_len, self.grid.len);
                    self.grid = BlockGrid { seq, block, len };
                }
            }
            Change::Payload { body } => {
                self.tracker.set_commanded();
                self.learner.declare_payload(body.as_deref());
            }
            Change::Kept => {}
            Change::Fix { index, value } => {
                self.tracker.set_commanded();
                self.learner.fix(*index, *value);
            }
            Change::Free { index } => {
                self.tracker.set_commanded();
                self.learner.free(*index);
            }
        }
    }
}
