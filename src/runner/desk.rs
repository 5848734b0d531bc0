//! Connects the identifier's loop with its desk: two queues of fixed size and a board of figures.
//!
//! ```text
//! desk (a thread of its own) ── ToLoop ──▶ loop: looks once per batch, never within the step
//!                      ◀─ FromLoop ─
//!                      ── Board ───▶ memory in use, checkpoints, refusals: copied into each status
//! ```
//!
//! Objects in the queues are allocated by the desk, and returned to it to be freed.

use crate::messages::{LastError, Status, status_flags};
use crate::node::command::{Border, NodeState, Order};
use crate::node::identifier::Identifier;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Capacity of each queue.
const QUEUE: usize = 2 * crate::node::command::MAX_ORDERS;
/// How long the end of a stream may wait for the journal.
const SETTLE: Duration = Duration::from_millis(500);

/// To the loop.
#[derive(Debug)]
pub enum ToLoop {
    /// For the node.
    Offer(Order),
    /// A buffer for the node's state.
    Save(Box<NodeState>),
}

/// From the loop.
#[derive(Debug)]
pub enum FromLoop {
    /// An order has been accepted.
    Offered {
        /// Its id.
        id: u64,
        /// The border at which it will take effect.
        border: Border,
    },
    /// The node has no room for an order, or it does not fit.
    Declined(Order),
    /// An order took effect.
    Done(Order),
    /// The node's state.
    Saved(Box<NodeState>),
}

/// Figures of the desk for the status.
#[derive(Debug, Default)]
pub struct Board {
    /// Memory in use \[bytes\].
    pub resident_bytes: AtomicU64,
    /// Requests refused.
    pub refused: AtomicU64,
    /// Checkpoints written.
    pub checkpoints: AtomicU64,
    /// Checkpoints not written or not usable.
    pub checkpoints_failed: AtomicU64,
    /// Samples that a recorder lost.
    pub recorder_missing: AtomicU64,
    /// Orders that took effect and that the desk has passed to the journal.
    pub journalled: AtomicU64,
    /// Entries of the journal that wait until readers have room for them.
    pub unsent: AtomicU64,
    /// 1 if checkpoints are configured.
    pub checkpointing: AtomicU64,
    /// Length of the rows' windows \[s\], as the bits of the number; 0 for rows of single samples.
    pub window_s: AtomicU64,
    /// The last error, and the number of errors.
    error: Mutex<(LastError, u64)>,
}

impl Board {
    /// Reports an error.
    pub fn tell(&self, error: LastError) {
        if let Ok(mut last) = self.error.lock() {
            *last = (error, last.1 + 1);
        }
    }

    /// Adds one. Report its error first, so that a status that counts it has the text.
    pub fn count(counter: &AtomicU64) {
        counter.fetch_add(1, Ordering::Release);
    }
}

/// The loop's end.
#[derive(Debug)]
pub struct LoopEnd {
    from_desk: Receiver<ToLoop>,
    to_desk: SyncSender<FromLoop>,
    /// A message for which the queue had no room.
    unsent: Option<FromLoop>,
    board: Arc<Board>,
    /// Number of orders passed on that took effect.
    done: u64,
    /// Number of errors of the desk shown so far, and the node's last error at that time.
    errors_shown: u64,
    node_error: LastError,
    shown: LastError,
}

/// The desk's end.
#[derive(Debug)]
pub struct DeskEnd {
    /// To the loop.
    pub to_loop: SyncSender<ToLoop>,
    /// From the loop.
    pub from_loop: Receiver<FromLoop>,
    /// Figures for the status.
    pub board: Arc<Board>,
}

/// A connected pair of ends.
pub fn desk() -> (LoopEnd, DeskEnd) {
    let (to_loop, from_desk) = sync_channel(QUEUE);
    let (to_desk, from_loop) = sync_channel(QUEUE);
    let board = Arc::new(Board::default());
    let loop_end = LoopEnd {
        from_desk,
        to_desk,
        unsent: None,
        board: board.clone(),
        done: 0,
        errors_shown: 0,
        node_error: LastError::default(),
        shown: LastError::default(),
    };
    let desk_end = DeskEnd {
        to_loop,
        from_loop,
        board,
    };
    (loop_end, desk_end)
}

impl LoopEnd {
    /// Passes on all messages in both directions.
    pub(super) fn exchange(&mut self, node: &mut dyn Identifier) {
        let window_s = node.window_s().unwrap_or(0.0);
        self.board.window_s.store(window_s.to_bits(), Ordering::Relaxed);
        loop {
            self.return_done(node);
            if self.unsent.is_some() {
                return;
            }
            let answer = match self.from_desk.try_recv() {
                Ok(ToLoop::Offer(order)) => {
                    let id = order.id;
                    match node.offer(order) {
                        Ok(border) => FromLoop::Offered { id, border },
                        Err(order) => FromLoop::Declined(order),
                    }
                }
                Ok(ToLoop::Save(mut state)) => {
                    node.save(&mut state);
                    FromLoop::Saved(state)
                }
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return,
            };
            self.send(answer);
        }
    }

    fn return_done(&mut self, node: &mut dyn Identifier) {
        if let Some(unsent) = self.unsent.take() {
            self.send(unsent);
        }
        while self.unsent.is_none() {
            let Some(order) = node.take_done() else { return };
            self.done += 1;
            self.send(FromLoop::Done(order));
        }
    }

    fn send(&mut self, message: FromLoop) {
        match self.to_desk.try_send(message) {
            Ok(()) | Err(TrySendError::Disconnected(_)) => {}
            Err(TrySendError::Full(message)) => self.unsent = Some(message),
        }
    }

    /// Waits until every applied command and a warm start are in the journal, so that a reader who
    /// sees the end of the stream has already received them.
    pub(super) fn settle(&mut self, node: &mut dyn Identifier) {
        let start = Instant::now();
        self.exchange(node);
        let is_settled = |board: &Board, done: u64| {
            board.journalled.load(Ordering::Acquire) >= done && board.unsent.load(Ordering::Acquire) == 0
        };
        while !is_settled(&self.board, self.done) && start.elapsed() < SETTLE {
            std::thread::sleep(Duration::from_millis(1));
            self.exchange(node);
        }
    }

    /// Adds the desk's figures to a status.
    pub(super) fn complete(&mut self, status: &mut Status) {
        let board = &self.board;
        let read = |counter: &AtomicU64| counter.load(Ordering::Acquire);
        let process = &mut status.process;
        process.resident_bytes = read(&board.resident_bytes);
        process.refused = read(&board.refused);
        process.checkpoints = read(&board.checkpoints);
        process.checkpoints_failed = read(&board.checkpoints_failed);
        process.recorder_missing = read(&board.recorder_missing);
        if read(&board.checkpointing) != 0 {
            status.flags |= status_flags::CHECKPOINTS;
        }
        // of the node's errors and the desk's, the later one
        if status.error != self.node_error {
            (self.node_error, self.shown) = (status.error, status.error);
        }
        if let Ok(error) = self.board.error.try_lock()
            && error.1 != self.errors_shown
        {
            (self.errors_shown, self.shown) = (error.1, error.0);
        }
        status.error = self.shown;
    }
}
