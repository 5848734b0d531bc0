//! SIGINT, SIGTERM and SIGHUP: the first asks to finish, the second ends the process.

use super::RunError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code after a second signal.
const SECOND_SIGNAL: i32 = 130;

/// Whether this process has been asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<AtomicBool>);

impl Shutdown {
    /// One that nobody asks but the program itself.
    pub fn new() -> Self {
        Self::default()
    }

    /// One that follows the process's signals; once per process.
    pub fn on_signals() -> Result<Self, RunError> {
        let this = Self::new();
        let flag = this.clone();
        ctrlc::set_handler(move || {
            if flag.0.swap(true, Ordering::SeqCst) {
                std::process::exit(SECOND_SIGNAL);
            }
        })
        .map_err(|e| RunError::Signals(e.to_string()))?;
        Ok(this)
    }

    /// Asks to stop, as the first signal does.
    pub fn request(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Has anybody asked?
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for waits inside the bus.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }
}
