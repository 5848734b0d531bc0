//! Notifies a service manager that sets NOTIFY_SOCKET and WATCHDOG_USEC, such as systemd, that a
//! program is ready and then that all of its loops are running.

use crate::bus::monotonic_ns;
use sd_notify::NotifyState;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Reports that the program is ready. Does nothing without a service manager.
pub(super) fn ready() {
    // If the service manager cannot be reached, it either does not need the message or ends this
    // program.
    let _ = sd_notify::notify(&[NotifyState::Ready]);
}

/// The watchdog of a process: notified while every loop has turned within half the permitted time.
pub(super) struct Watchdog {
    /// Time of the last turn of each loop \[ns of CLOCK_MONOTONIC\].
    turns: Vec<AtomicU64>,
    fed_ns: AtomicU64,
    limit: Option<Duration>,
}

impl Watchdog {
    /// For a process with `loops` loops, which have just begun.
    pub(super) fn new(loops: usize) -> Self {
        let now = monotonic_ns();
        Self {
            turns: (0..loops).map(|_| AtomicU64::new(now)).collect(),
            fed_ns: AtomicU64::new(0),
            limit: sd_notify::watchdog_enabled(),
        }
    }

    /// Records that a loop has turned; call it several times within the limit.
    pub(super) fn turned(&self, number: usize) {
        let Some(limit) = self.limit else { return };
        let now = monotonic_ns();
        if let Some(turn) = self.turns.get(number) {
            turn.store(now, Ordering::Relaxed);
        }
        let half = limit.as_nanos() as u64 / 2;
        let is_recent = |turn: &AtomicU64| now.saturating_sub(turn.load(Ordering::Relaxed)) < half;
        let is_due = now.saturating_sub(self.fed_ns.load(Ordering::Relaxed)) >= half / 2;
        if is_due && self.turns.iter().all(is_recent) {
            self.fed_ns.store(now, Ordering::Relaxed);
            let _ = sd_notify::notify(&[NotifyState::Watchdog]);
        }
    }
}
