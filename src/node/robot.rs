//! The identifier of a robot as a value: sample → validate → torque, velocity → rows → block of N → estimate.
//!
//! Streams, blocks, states and commands are those of [`IdentifierNode`](super::identifier::IdentifierNode): blocks are cut by `seq`, a block that was joined half-way is
//! skipped, a replay teaches nothing that lasts, orders take effect between two blocks. Rows reach over the border of a block, for their windows are not
//! cut by it; what is within half a window of the end is learnt with the next block. Tunables and another N are declined.

use super::block_grid::{BlockGrid, OpenBlock};
use super::command::{Border, Change, Fate, NodeState, Order};
use super::command_queue::CommandQueue;
use super::estimate_message::message;
use super::identifier::Identifier;
use super::identifier_options::IdentifierOptions;
use super::lacking;
use super::robot_evidence::{self, LEAST_EXPLAINED};
use super::sample_gate::{SampleGate, largest};
use super::stream::{SampleCursor, SamplePlace};
use crate::estimator::{Report, StateError, StateMachine, Verdict};
use crate::messages::{
    ErrorCode, Estimate, LastError, MAX_DERIVED, Sample, State, Status, StreamFaults, estimate_flags, sample_flags,
    status_flags, stream_tag,
};
use crate::robot::{ChangeCause, Drives, PAYLOAD_VALUES, RobotIdentifier, RobotSample, Velocities};
use std::any::Any;

/// What was in force before the orders of one stream.
struct Before {
    tag: u32,
    paused: bool,
    commanded: u32,
    fixed: Vec<bool>,
    theta: Vec<f64>,
}

/// Consumes a robot's samples, gives an estimate per block.
pub struct RobotNode {
    options: IdentifierOptions,
    drives: Drives,
    robot: RobotIdentifier,
    velocities: Option<Velocities>,
    machine: StateMachine,
    report: Report,
    changed_before: bool,
    t_change_ns: u64,
    cursor: SampleCursor,
    gate: SampleGate,
    grid: BlockGrid,
    first_seq: u64,
    open: Option<OpenBlock>,
    paused: bool,
    news: u32,
    commands: CommandQueue,
    before: Before,
    /// What is known of the machine while a replay teaches something else.
    kept: NodeState,
    is_kept: bool,
    status: Status,
}

impl RobotNode {
    /// A node that has seen nothing. `velocities` is for samples without velocities; `pid` goes into its status.
    ///
    /// # Panics
    /// If `block_len` is 0.
    pub fn new(
        options: IdentifierOptions,
        drives: Drives,
        robot: RobotIdentifier,
        velocities: Option<Velocities>,
        pid: u32,
    ) -> Self {
        assert!(options.block_len > 0, "a block needs at least one sample");
        let (parameters, joints) = (robot.theta().len(), robot.model().robot().len());
        let mut node = Self {
            machine: StateMachine::new(robot.theta()).explaining(LEAST_EXPLAINED),
            report: robot_evidence::empty(parameters, joints),
            changed_before: false,
            t_change_ns: 0,
            cursor: SampleCursor::new(),
            gate: SampleGate::new(
                options.joints,
                options.signals,
                options.input_limit,
                options.sample_period_ns,
                options.frozen_after,
            ),
            grid: BlockGrid::new(options.block_len),
            first_seq: 0,
            open: None,
            paused: false,
            news: 0,
            commands: CommandQueue::new(),
            before: Before {
                tag: 0,
                paused: false,
                commanded: 0,
                fixed: vec![false; parameters],
                theta: vec![0.0; parameters],
            },
            kept: NodeState::default(),
            is_kept: false,
            status: Status {
                pid,
                fit_probability: 1.0,
                ..Status::default()
            },
            options,
            drives,
            robot,
            velocities,
        };
        // Room for what a replay puts aside: a step allocates nothing.
        let mut kept = NodeState::default();
        node.copy_out(&mut kept);
        node.kept = kept;
        robot_evidence::fill(&mut node.report, &node.robot, false, false);
        node
    }

    /// What was learnt, for its evidence beyond the message.
    pub fn robot(&self) -> &RobotIdentifier {
        &self.robot
    }

    fn start_stream(&mut self, sample: &Sample) {
        self.enter_stream(stream_tag(sample.stream_id));
        self.change_teacher(sample);
        self.robot.discard_block();
        self.restart_rows();
        self.gate.reset();
        self.grid = BlockGrid::new(self.grid.len);
        self.open = None;
        self.first_seq = sample.seq;
        self.t_change_ns = 0;
        self.status = Status {
            stream_id: sample.stream_id,
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

    /// Rows begin anew: time has been lost.
    fn restart_rows(&mut self) {
        self.robot.restart_windows();
        if let Some(velocities) = &mut self.velocities {
            velocities.restart();
        }
    }

    /// Goes back to what was known before a replay that is over, and keeps it while another one is open.
    fn change_teacher(&mut self, sample: &Sample) {
        let is_replay = sample.flags & sample_flags::REPLAY != 0;
        if self.is_kept {
            let kept = std::mem::take(&mut self.kept);
            if self.copy_in(&kept).is_err() {
                self.status.error = LastError::new(ErrorCode::NotEvaluable, sample.seq);
            }
            self.kept = kept;
            self.is_kept = is_replay;
        } else if is_replay {
            let mut kept = std::mem::take(&mut self.kept);
            self.copy_out(&mut kept);
            self.kept = kept;
            self.is_kept = true;
        }
        self.status.flags &= !status_flags::REPLAY;
        self.status.flags |= if is_replay { status_flags::REPLAY } else { 0 };
    }

    /// Counts a sample and, if its block is wanted, makes rows of it.
    fn take(&mut self, sample: &Sample) {
        let judgement = self.gate.judge(sample);
        if judgement.set_back {
            self.discard();
            self.restart_rows();
            self.first_seq = sample.seq;
        }
        let verdict = judgement.result;
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
                if wanted.is_some() && !self.paused && !self.learn(sample) {
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
                self.status.error = match code {
                    ErrorCode::WrongSignals => lacking::signal(sample.seq, self.options.signals, sample.signals),
                    ErrorCode::NotFinite => lacking::number(sample, self.options.signals, self.options.joints, largest),
                    _ => self.status.error,
                };
                if let Some(open) = &mut self.open {
                    open.spoilt |= code == ErrorCode::Frozen;
                }
            }
        }
    }

    fn learn(&mut self, sample: &Sample) -> bool {
        let sample = RobotSample {
            t_s: sample.t_ns as f64 * 1e-9,
            q: sample.q,
            dq: sample.dq,
            tau: self.drives.torques(&sample.input),
        };
        match &mut self.velocities {
            None => self.robot.take(&sample).is_ok(),
            Some(velocities) => velocities
                .push(&sample)
                .is_none_or(|middle| self.robot.take(&middle).is_ok()),
        }
    }

    fn refuse(&mut self, seq: u64, code: ErrorCode) {
        self.status.rejected += 1;
        self.status.faults.count(code);
        self.status.error = LastError::new(code, seq);
    }

    /// Ends the open block with an estimate.
    fn close(&mut self, emit: &mut dyn FnMut(&Estimate)) {
        let Some(open) = self.open.take() else { return };
        let incomplete = open.samples < self.grid.len;
        let mut estimate = if self.paused {
            let mut estimate = message(&self.report, Verdict::default());
            estimate.state = State::Paused as u32;
            estimate.flags |= estimate_flags::HELD;
            estimate.excited = Default::default();
            (estimate.iterations, estimate.outliers) = (0, 0);
            estimate
        } else {
            if open.spoilt {
                self.robot.discard_block();
                self.restart_rows();
                self.status.faults.blocks_held += 1;
            }
            let learnt = self.robot.close_block();
            robot_evidence::fill(&mut self.report, &self.robot, learnt, self.changed_before);
            let lost = match open.spoilt {
                true => 1.0,
                false => 1.0 - open.samples as f64 / self.grid.len as f64,
            };
            let change = self.robot.change().filter(|_| learnt);
            self.changed_before = change.is_some();
            let mut estimate = message(&self.report, self.machine.step(&self.report, lost));
            if let Some(change) = change {
                if let Some(words) = robot_evidence::words(&change, self.status.last_seq) {
                    self.status.error = words;
                }
                if change.cause != ChangeCause::Unexplained {
                    self.t_change_ns = (change.t_s.max(0.0) * 1e9) as u64;
                    estimate.flags |= estimate_flags::CHANGED;
                }
            }
            estimate
        };
        estimate.t_change_ns = self.t_change_ns;
        estimate.stream_id = self.status.stream_id;
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
        self.derive(&mut estimate);
        self.status.estimates += 1;
        self.status.last_block = open.block;
        self.status.state = estimate.state;
        self.status.fit = estimate.fit.iter().copied().fold(0.0, f64::max);
        self.status.fit_probability = estimate.fit_probability;
        emit(&estimate);
    }

    /// The payload as robot controllers take it: zeros if nothing is carried, `NaN` while it cannot be told.
    fn derive(&self, estimate: &mut Estimate) {
        if !self.robot.estimates_payload() {
            return;
        }
        let count = PAYLOAD_VALUES.len().min(MAX_DERIVED);
        estimate.derived_len = count as u32;
        let unknown = if self.robot.is_loaded() { f64::NAN } else { 0.0 };
        estimate.derived[..count].fill(unknown);
        estimate.derived_std[..count].fill(f64::NAN);
        if let Some(carried) = self.robot.carried() {
            estimate.derived[..count].copy_from_slice(&carried.values[..count]);
            estimate.derived_std[..count].copy_from_slice(&carried.std[..count]);
        }
    }

    fn discard(&mut self) {
        if self.open.take().is_some() {
            self.robot.discard_block();
        }
    }

    /// Carries out what is due between two blocks; `begin` is the first sample behind the border, `next` the next one to be taken in.
    fn at_border(&mut self, begin: u64, next: u64) {
        let (streams, open_tag) = (self.cursor.streams(), self.open_tag());
        let is_due = |order: &Order| {
            let here = order.tag == 0 || order.tag == open_tag;
            let in_time = (order.tag != 0 || order.stream == streams) && next >= order.from_seq;
            here && (order.from_seq == 0 || in_time)
        };
        while let Some(mut order) = self.commands.take_due(is_due) {
            self.note(&order);
            self.carry_out(&order.change, order.tag);
            order.border = Border {
                stream_id: self.status.stream_id,
                from_seq: begin,
                block: self.grid.border(begin).1,
            };
            self.status.process.commands += 1;
            self.news |= estimate_flags::COMMANDED;
            self.commands.give_back(order, Fate::Done);
        }
    }

    /// Remembers what was in force before the first order of a stream.
    fn note(&mut self, order: &Order) {
        if order.tag == 0 || self.before.tag != 0 {
            return;
        }
        self.before.tag = order.tag;
        self.before.paused = self.paused;
        self.before.commanded = self.status.flags & status_flags::COMMANDED;
        for i in 0..self.before.fixed.len() {
            self.before.fixed[i] = self.robot.is_fixed(i);
            self.before.theta[i] = self.robot.theta()[i];
        }
    }

    fn carry_out(&mut self, change: &Change, tag: u32) {
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
                self.restart_rows();
            }
            Change::Restart { state } => {
                self.news &= !estimate_flags::WARM;
                self.status.flags &= !status_flags::WARM;
                self.t_change_ns = 0;
                match state {
                    Some(state) if self.load(state).is_err() => {
                        self.status.error = LastError::new(ErrorCode::CheckpointUnused, self.status.last_seq);
                    }
                    Some(_) => {}
                    None => {
                        self.robot.reset();
                        self.machine.reset(self.robot.theta());
                    }
                }
                if self.is_kept && tag == 0 {
                    let mut kept = std::mem::take(&mut self.kept);
                    self.copy_out(&mut kept);
                    self.kept = kept;
                }
            }
            Change::Fix { index, value } => {
                self.status.flags |= status_flags::COMMANDED;
                self.robot.fix(*index, *value);
            }
            Change::Free { index } => {
                self.status.flags |= status_flags::COMMANDED;
                self.robot.free(*index);
            }
            Change::Replace { .. } | Change::Tune { .. } | Change::Kept => {}
        }
        robot_evidence::fill(&mut self.report, &self.robot, false, false);
    }

    fn is_between_streams(&self) -> bool {
        self.status.stream_id == 0 || self.status.state == State::Ended as u32
    }

    /// Of the stream that is open; 0 between two.
    fn open_tag(&self) -> u32 {
        match self.is_between_streams() {
            true => 0,
            false => stream_tag(self.status.stream_id),
        }
    }

    /// At the END of a stream: what was for it alone goes with it.
    fn leave_stream(&mut self) {
        let over = stream_tag(self.status.stream_id);
        let next = self.cursor.streams() + 1;
        self.drop_orders(next, |order| order.tag == over);
        self.undo_for(0);
    }

    /// At the first sample of a stream, which may have come without the END of another.
    fn enter_stream(&mut self, tag: u32) {
        let stream = self.cursor.streams();
        self.drop_orders(stream, |order| order.tag != 0 && order.tag != tag);
        self.undo_for(tag);
    }

    fn drop_orders(&mut self, stream: u64, gone: impl Fn(&Order) -> bool) {
        self.commands
            .drop_all(|order| gone(order) || order.tag == 0 && order.from_seq != 0 && order.stream < stream);
    }

    /// Puts back what orders have changed for streams other than this one.
    fn undo_for(&mut self, tag: u32) {
        if self.before.tag == 0 || self.before.tag == tag {
            return;
        }
        self.before.tag = 0;
        for i in 0..self.before.fixed.len() {
            match (self.before.fixed[i], self.robot.is_fixed(i)) {
                (true, _) => self.robot.fix(i, Some(self.before.theta[i])),
                (false, true) => self.robot.free(i),
                (false, false) => {}
            }
        }
        self.paused = self.before.paused;
        self.status.flags &= !(status_flags::PAUSED | status_flags::COMMANDED);
        self.status.flags |= self.before.commanded | if self.paused { status_flags::PAUSED } else { 0 };
        self.news &= !estimate_flags::COMMANDED;
        self.restart_rows();
    }

    fn copy_out(&mut self, into: &mut NodeState) {
        self.robot.save(&mut into.estimator);
        into.stream_id = self.status.stream_id;
        into.block = self.status.last_block;
        into.t_ns = self.status.last_t_ns;
        into.blocks = self.robot.blocks() as u64;
    }

    fn copy_in(&mut self, state: &NodeState) -> Result<(), StateError> {
        let loaded = self.robot.load_state(&state.estimator);
        self.machine.reset(self.robot.theta());
        robot_evidence::fill(&mut self.report, &self.robot, false, false);
        loaded
    }
}

impl Identifier for RobotNode {
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        match self.cursor.advance(sample.stream_id, sample.seq) {
            SamplePlace::First => self.start_stream(sample),
            SamplePlace::Next => {}
            SamplePlace::Gap { missing } => {
                self.status.missing = self.status.missing.saturating_add(missing);
                self.status.faults.gaps += 1;
                self.status.error = LastError::new(ErrorCode::Gap, sample.seq);
            }
            SamplePlace::Duplicate => return self.refuse(sample.seq, ErrorCode::Duplicate),
            SamplePlace::Late => {
                // It was counted as missing, and rows are made in the order of time.
                self.status.missing = self.status.missing.saturating_sub(1);
                return self.refuse(sample.seq, ErrorCode::Reordered);
            }
        }
        self.status.last_seq = sample.seq;
        let place = self.grid.block(sample.seq);
        let other = |open: OpenBlock| place.is_none_or(|(block, _)| block != open.block);
        if self.open.is_some_and(other) {
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
            self.status.state = State::Ended as u32;
            self.leave_stream();
        }
    }

    fn status(&self) -> Status {
        self.status
    }

    fn window_s(&self) -> Option<f64> {
        Some(self.robot.window_s())
    }

    fn offer(&mut self, mut order: Order) -> Result<Border, Order> {
        let foreign = match &order.change {
            Change::Replace { .. } | Change::Tune { .. } | Change::Kept => true,
            Change::Fix { index, .. } | Change::Free { index } => *index >= self.robot.theta().len(),
            _ => false,
        };
        if foreign || !self.commands.has_room_for(&order) {
            return Err(order);
        }
        let (between, tag) = (self.is_between_streams(), order.tag);
        order.stream = self.cursor.streams() + u64::from(between);
        let from_seq = order.from_seq;
        self.commands.push(order);
        let next = match between {
            true => 0,
            false => self.status.last_seq.saturating_add(1),
        };
        if tag != 0 && tag != self.open_tag() {
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
            stream_id: if between { 0 } else { self.status.stream_id },
            from_seq: seq,
            block,
        })
    }

    fn take_done(&mut self) -> Option<Order> {
        self.commands.take_done()
    }

    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send> {
        Box::new(())
    }

    fn save(&mut self, into: &mut NodeState) {
        match self.is_kept {
            false => self.copy_out(into),
            true => into.copy_from(&self.kept),
        }
    }

    fn load(&mut self, state: &NodeState) -> Result<(), StateError> {
        self.copy_in(state)?;
        self.news |= estimate_flags::WARM;
        self.status.flags |= status_flags::WARM;
        Ok(())
    }
}
