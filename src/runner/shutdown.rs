//! SIGINT, SIGTERM and SIGHUP: the first asks to finish, a second one later ends the process.
//!
//! Several signals often mean one request: `timeout` signals a process and then its group, a
//! terminal the whole job, and the kernel reports a launcher's death once for each of its threads.
//! Signals within [`TOGETHER`] of the first are the same request.

use super::RunError;
use nix::sys::signal::{SigSet, Signal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Exit code after a second signal.
const SECOND_SIGNAL: i32 = 130;

/// Signals within this time of the first belong to it. They are sent within microseconds, but the
/// sender may be preempted in between.
pub const TOGETHER: Duration = Duration::from_millis(500);

/// Whether this process has been asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<AtomicBool>);

impl Shutdown {
    /// A request that only the program itself can make.
    pub fn new() -> Self {
        Self::default()
    }

    /// A request that follows the process's signals; once per process. A signal that comes later
    /// than `together` after the first one ends the process with exit code 130.
    ///
    /// # Errors
    /// If the system refuses to handle signals, or they are already handled.
    pub fn on_signals(together: Duration) -> Result<Self, RunError> {
        let this = Self::new();
        let flag = this.clone();
        let signals: SigSet = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP].into_iter().collect();
        let failed = |e: nix::Error| RunError::Signals(e.to_string());
        // A launcher passes on its signal mask, and the handler's thread inherits the mask of this
        // thread.
        signals.thread_unblock().map_err(failed)?;
        let mut first = None;
        ctrlc::set_handler(move || {
            let now = Instant::now();
            flag.request();
            if now.duration_since(*first.get_or_insert(now)) > together {
                std::process::exit(SECOND_SIGNAL);
            }
        })
        .map_err(|e| RunError::Signals(e.to_string()))?;
        // The handler's thread receives them; in this thread and its children a signal would
        // interrupt a wait of the bus as a failure.
        signals.thread_block().map_err(failed)?;
        // A file beyond the limit on files is then a failed write, which is reported, instead of a
        // death without a word.
        let too_large: SigSet = [Signal::SIGXFSZ].into_iter().collect();
        too_large.thread_block().map_err(failed)?;
        Ok(this)
    }

    /// Asks to stop, as the first signal does.
    pub fn request(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// True if a stop has been requested.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for waits inside the bus.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }
}
