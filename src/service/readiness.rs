//! What a service manager is told, if it asks for it by NOTIFY_SOCKET and WATCHDOG_USEC as systemd
//! does: that a program is ready, and from then on that all of its loops turn.

use crate::bus::monotonic_ns;
use sd_notify::NotifyState;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Says that the program takes part. Without a service manager nothing happens.
pub(super) fn ready() {
    // A service manager that cannot be reached either does without, or ends this program.
    let _ = sd_notify::notify(&[NotifyState::Ready]);
}

/// The watchdog of a process: fed as long as every loop has turned in half the time that it allows.
pub(super) struct Watchdog {
    /// When each loop turned last \[ns of CLOCK_MONOTONIC\].
    turns: Vec<AtomicU64>,
    fed_ns: AtomicU64,
    limit: Option<Duration>,
}

impl Watchdog {
    /// For a process of so many loops, which have just begun.
    pub(super) fn new(loops: usize) -> Self {
        let now = monotonic_ns();
        Self {
            turns: (0..loops).map(|_| AtomicU64::new(now)).collect(),
            fed_ns: AtomicU64::new(0),
            limit: sd_notify::watchdog_enabled(),
        }
    }

    /// A loop has turned; to be called several times within the limit.
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
