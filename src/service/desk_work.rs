//! Work of the identifier's desk for one robot: answers, orders, journal, checkpoints.

use super::commands::{Commands, Wanted};
use super::sparse::Sparse;
use super::usage;
use crate::bus::{Bus, BusError, Publisher};
use crate::checkpoint;
use crate::config::Config;
use crate::messages::{
    Command, Description, ErrorCode, Item, Journal, LastError, Request, Response, item_kind, response_code,
};
use crate::node::command::{Border, Change, Fate, NodeState, Order};
use crate::runner::{Board, DeskEnd, FromLoop, TICK, ToLoop};
use std::collections::{HashMap, VecDeque};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// Polling period of the desk without requests.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// How long the loop may take to answer: it checks once per idle tick, and once per batch when it
/// is busy.
const LOOP_ANSWERS: Duration = Duration::from_secs(2);
/// Log lines per period about refusals, dropped commands, and commands, for all clients together.
/// The journal has every command that took effect.
const LINES: (u64, u64, u64) = (1, 1, 50);
const LINES_PERIOD: Duration = Duration::from_secs(1);
/// Entries of the journal sent per tick. Readers look once per tick and hold twice as many, so
/// none loses a part of a state, which takes a hundred.
const BURST: usize = 32;
/// Period of checking the memory in use.
const MEMORY_PERIOD: Duration = Duration::from_millis(500);

/// Everything of a desk except the server, which owns each request while it is answered.
pub(super) struct Work {
    journal: Publisher<Journal>,
    /// Entries not yet sent, how many may be sent before `journal_due`, and that time.
    unsent: VecDeque<Journal>,
    may_send: usize,
    journal_due: Instant,
    description: Publisher<Description>,
    description_due: Instant,
    commands: Commands,
    end: DeskEnd,
    /// Requests whose orders have not yet taken effect.
    waiting: HashMap<u64, Vec<Request>>,
    next_id: u64,
    /// Parts received of a state to restore.
    parts: Vec<Request>,
    /// Block lengths of waiting orders, by order \[samples\].
    lengths: HashMap<u64, u64>,
    refusals: Sparse,
    drops: Sparse,
    acceptances: Sparse,
    checkpoint: Option<PathBuf>,
    period: Duration,
    checkpoint_due: Instant,
    memory_due: Instant,
    /// Buffer for a state, while the loop does not have it.
    room: Option<Box<NodeState>>,
    failing: bool,
}

impl Work {
    pub(super) fn new(bus: &Bus, config: &Config, end: DeskEnd) -> Result<Self, BusError> {
        let robot = &config.bus.robot;
        let checkpoint = config.checkpoint.dir.as_ref().map(|dir| checkpoint::path(dir, robot));
        let period = Duration::from_secs_f64(config.checkpoint.period_s);
        let now = Instant::now();
        end.board
            .checkpointing
            .store(u64::from(checkpoint.is_some()), Ordering::Relaxed);
        Ok(Self {
            journal: Publisher::new(bus)?,
            unsent: VecDeque::new(),
            may_send: BURST,
            journal_due: now + TICK,
            description: Publisher::new(bus)?,
            description_due: now,
            commands: Commands::new(config),
            end,
            waiting: HashMap::new(),
            next_id: 1,
            parts: Vec::new(),
            lengths: HashMap::new(),
            refusals: Sparse::new(LINES.0, LINES_PERIOD),
            drops: Sparse::new(LINES.1, LINES_PERIOD),
            acceptances: Sparse::new(LINES.2, LINES_PERIOD),
            checkpoint,
            period,
            checkpoint_due: now + period,
            memory_due: now,
            room: Some(Box::default()),
            failing: false,
        })
    }

    /// Publishes the description of the robot's estimates.
    pub(super) fn describe(&mut self, description: &Description) -> Result<(), BusError> {
        self.description.send(description)
    }

    pub(super) fn answer(&mut self, request: &Request) -> Response {
        if request.command == Command::Restore as u32 && request.part == 0 {
            // Another state begins; the parts of the previous one are dropped.
            self.parts.clear();
        }
        let response = match self.commands.prepare(request) {
            Err(why) => Response::new(response_code::REFUSED, &why),
            Ok(Wanted::Answer(response)) => self.with_window(*response),
            Ok(Wanted::More) => {
                self.parts.push(*request);
                Response::new(response_code::DONE, "")
            }
            Ok(Wanted::RecorderMissing(missing)) => {
                self.end.board.recorder_missing.store(missing, Ordering::Relaxed);
                let error = LastError::with_text(
                    ErrorCode::Recorder,
                    0,
                    &format!("a recorder has lost {missing} samples"),
                );
                self.end.board.tell(error);
                Response::new(response_code::DONE, "")
            }
            Ok(Wanted::Save) => self.save_now(),
            Ok(Wanted::Order(change, what)) => self.order(request, change, &what),
        };
        if response.code != response_code::DONE {
            let command = Command::from_wire(request.command).map_or("request", Command::name);
            let words = format!("{command}: {}", response.text());
            if let Some(left_out) = self.refusals.line(Instant::now()) {
                match left_out {
                    0 => tracing::warn!("refused: {words}"),
                    _ => tracing::warn!(
                        before = left_out,
                        "refused, as others before that are not shown: {words}"
                    ),
                }
            }
            self.end.board.tell(LastError::with_text(ErrorCode::Refused, 0, &words));
            Board::count(&self.end.board.refused);
        }
        response
    }

    /// A description with the present window, which may have been chosen from the signals.
    fn with_window(&self, mut response: Response) -> Response {
        let window_s = f64::from_bits(self.end.board.window_s.load(Ordering::Relaxed));
        if window_s > 0.0
            && let Some(slot) = response.items.get_mut(response.items_len as usize)
        {
            let none = (f64::NEG_INFINITY, f64::INFINITY);
            *slot = Item::new(item_kind::FIGURE, "window_s", "s", window_s, none);
            response.items_len += 1;
        }
        response
    }

    /// Passes an order to the loop and waits until its border is known.
    fn order(&mut self, request: &Request, change: Change, what: &str) -> Response {
        let id = self.next_id;
        self.next_id += 1;
        let failed = |words: &str| Response::new(response_code::FAILED, words);
        if let Change::Tune {
            block_len,
            rows: Some(_),
            ..
        } = &change
        {
            let waiting: u64 = self.lengths.values().sum();
            if waiting > 0 && waiting + block_len > self.commands.room() {
                self.commands.undo();
                return failed(
                    "other block lengths are on their way and take all the room; try again after the next block",
                );
            }
            self.lengths.insert(id, *block_len);
        }
        let is_state = request.command == Command::Restore as u32;
        let mut requests = match is_state {
            false => Vec::new(),
            true => std::mem::take(&mut self.parts),
        };
        requests.push(*request);
        self.waiting.insert(id, requests);
        let start = Instant::now();
        let order = Order::new(id, request.from_seq, change).for_stream(request.stream);
        if self.end.to_loop.try_send(ToLoop::Offer(order)).is_err() {
            self.forget(id);
            self.commands.undo();
            return failed("the identifier is too busy for another command");
        }
        while start.elapsed() < LOOP_ANSWERS {
            match self.end.from_loop.recv_timeout(LOOK) {
                Ok(FromLoop::Offered { id: offered, border }) if offered == id => {
                    let mut response = Response::new(response_code::DONE, what);
                    (response.from_seq, response.block) = (border.from_seq, border.block);
                    let (from_seq, block) = (border.from_seq, border.block);
                    match self.acceptances.line(Instant::now()) {
                        None => {}
                        Some(0) => tracing::info!(from_seq, block, "command: {what}"),
                        Some(before) => tracing::info!(
                            from_seq,
                            block,
                            before,
                            "command, as others before that are not shown: {what}"
                        ),
                    }
                    return response;
                }
                Ok(FromLoop::Declined(order)) if order.id == id => {
                    self.forget(id);
                    self.commands.undo();
                    return failed("too many commands are waiting for the next block");
                }
                Ok(message) => self.take(message),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        failed("the identifier's loop does not answer; the command may still take effect")
    }

    pub(super) fn hear(&mut self) {
        while let Ok(message) = self.end.from_loop.try_recv() {
            self.take(message);
        }
    }

    fn take(&mut self, message: FromLoop) {
        match message {
            FromLoop::Done(order) => {
                let requests = self.forget(order.id);
                match order.fate {
                    Fate::Done => self.journalise(&requests, order.border),
                    Fate::Undone => self.commands.leave_stream(order.tag),
                    Fate::Dropped | Fate::Waits => {
                        self.commands.leave_stream(order.tag);
                        if let Some(left_out) = self.drops.line(Instant::now()) {
                            let count = left_out + 1;
                            tracing::warn!(count, "the stream that a command was for is over; it was dropped");
                        }
                    }
                }
                self.end.board.journalled.fetch_add(1, Ordering::Release);
                // The exchanged parts are freed here.
                drop(order);
            }
            FromLoop::Declined(order) => _ = self.forget(order.id),
            FromLoop::Saved(state) => {
                // A checkpoint without data must not replace one with data.
                if state.blocks > 0 {
                    let _ = self.write(&state);
                }
                self.room = Some(state);
            }
            FromLoop::Offered { .. } => {}
        }
    }

    /// Removes and returns the requests of an order that no longer waits.
    fn forget(&mut self, id: u64) -> Vec<Request> {
        self.lengths.remove(&id);
        self.waiting.remove(&id).unwrap_or_default()
    }

    /// Writes requests that take effect at a border to the journal: as many as readers have room
    /// for at once, the others by [`keep`](Self::keep).
    pub(super) fn journalise(&mut self, requests: &[Request], border: Border) {
        self.unsent.extend(requests.iter().map(|request| {
            let mut entry = Journal {
                stream_id: border.stream_id,
                block: border.block,
                request: *request,
            };
            entry.request.from_seq = border.from_seq;
            entry
        }));
        self.send_journal(Instant::now());
    }

    fn send_journal(&mut self, now: Instant) {
        if now >= self.journal_due {
            (self.may_send, self.journal_due) = (BURST, now + TICK);
        }
        let count = self.may_send.min(self.unsent.len());
        self.may_send -= count;
        for entry in self.unsent.drain(..count) {
            if let Err(e) = self.journal.send(&entry) {
                tracing::error!("{e}");
            }
        }
        let unsent = self.unsent.len() as u64;
        self.end.board.unsent.store(unsent, Ordering::Release);
    }

    /// Does periodic work.
    pub(super) fn keep(&mut self) {
        let now = Instant::now();
        self.tell_rest(now, false);
        self.send_journal(now);
        if now >= self.description_due {
            self.description_due = now + TICK;
            if let Err(e) = self.description.serve_late_joiners() {
                tracing::error!("{e}");
            }
        }
        if now >= self.memory_due {
            self.memory_due = now + MEMORY_PERIOD;
            let bytes = usage::resident_bytes(std::process::id()).unwrap_or(0);
            self.end.board.resident_bytes.store(bytes, Ordering::Relaxed);
            if let Err(e) = self.journal.serve_late_joiners() {
                tracing::error!("{e}");
            }
        }
        if self.checkpoint.is_some() && now >= self.checkpoint_due {
            self.checkpoint_due = now + self.period;
            self.ask_for_state();
        }
    }

    /// Logs how many lines were left out.
    pub(super) fn tell_rest(&mut self, now: Instant, end: bool) {
        if let Some(count) = self.refusals.rest(now, end) {
            tracing::warn!("{count} more requests refused");
        }
        if let Some(count) = self.drops.rest(now, end) {
            tracing::warn!("{count} more commands dropped: the streams that they were for are over");
        }
        if let Some(count) = self.acceptances.rest(now, end) {
            tracing::info!("{count} more commands taken");
        }
    }

    fn ask_for_state(&mut self) -> bool {
        let Some(room) = self.room.take() else { return false };
        match self.end.to_loop.try_send(ToLoop::Save(room)) {
            Ok(()) => true,
            Err(e) => {
                if let std::sync::mpsc::TrySendError::Full(ToLoop::Save(room))
                | std::sync::mpsc::TrySendError::Disconnected(ToLoop::Save(room)) = e
                {
                    self.room = Some(room);
                }
                false
            }
        }
    }

    fn save_now(&mut self) -> Response {
        let start = Instant::now();
        self.ask_for_state();
        while start.elapsed() < LOOP_ANSWERS {
            match self.end.from_loop.recv_timeout(LOOK) {
                Ok(FromLoop::Saved(state)) if state.blocks == 0 => {
                    self.room = Some(state);
                    let words = "no block has been estimated yet, so there is nothing to save";
                    return Response::new(response_code::REFUSED, words);
                }
                Ok(FromLoop::Saved(state)) => {
                    let outcome = self.write(&state);
                    let mut response = match outcome {
                        Ok(words) => Response::new(response_code::DONE, &words),
                        Err(words) => Response::new(response_code::FAILED, &words),
                    };
                    response.block = state.block;
                    self.room = Some(state);
                    return response;
                }
                Ok(message) => self.take(message),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Response::new(response_code::FAILED, "the identifier's loop does not answer")
    }

    fn write(&mut self, state: &NodeState) -> Result<String, String> {
        let Some(path) = &self.checkpoint else {
            return Err("checkpoint.dir is not set".to_owned());
        };
        let written = checkpoint::encode(self.commands.identity(), state)
            .and_then(|bytes| checkpoint::write(path, &bytes).map(|()| bytes.len()));
        match written {
            Ok(len) => {
                Board::count(&self.end.board.checkpoints);
                if std::mem::take(&mut self.failing) {
                    tracing::info!("checkpoints can be written again");
                }
                Ok(format!("{} ({len} bytes, block {})", path.display(), state.block))
            }
            Err(e) => {
                self.end
                    .board
                    .tell(LastError::with_text(ErrorCode::CheckpointFailed, 0, &e.to_string()));
                Board::count(&self.end.board.checkpoints_failed);
                // Report a full disk only once.
                if !std::mem::replace(&mut self.failing, true) {
                    tracing::error!("{e}; the previous checkpoint stays");
                }
                Err(e.to_string())
            }
        }
    }
}
