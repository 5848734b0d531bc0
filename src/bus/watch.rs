//! A thread that frees this process from waiting for what nobody will finish.
//!
//! Whoever opens an empty object hangs inside iceoryx2 until the object is finished or gone, signals or not. So each member
//! looks after the domain's half-made objects from a thread of its own.

use super::Domain;
use super::half_made::Tender;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often it looks. A look at 25 objects takes 0.1 ms.
const PERIOD: Duration = Duration::from_millis(100);
/// How often it looks while something is in the making.
const CLOSELY: Duration = Duration::from_millis(10);
/// The thread reads directories and writes a line of the log.
const STACK: usize = 512 * 1024;

/// Watches as long as it lives.
#[derive(Debug)]
pub(super) struct Watch {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch. Without a thread, where the system refuses one, only joins and clean-ups look.
    pub(super) fn start(domain: &Domain) -> Self {
        let (stop, stopped) = channel::<()>();
        let mut tender = Tender::new(domain);
        let thread = std::thread::Builder::new()
            .name("bus-watch".into())
            .stack_size(STACK)
            .spawn(move || {
                let mut pause = PERIOD;
                while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    pause = if tender.look() > 0 { CLOSELY } else { PERIOD };
                }
            });
        Self {
            stop: Some(stop),
            thread: thread.ok(),
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed, and must not become a second one here.
            let _ = thread.join();
        }
    }
}
