//! A thread that keeps this process from waiting for objects that will never be completed.
//!
//! A program that opens an empty object hangs inside iceoryx2 until the object is completed or
//! removed, regardless of signals: when it joins, creates or opens a service or a port, connects to
//! a new port at run time, or leaves. Such a call cannot be cancelled, so the time limit is set
//! here: each member watches the domain's half-made objects from a separate thread, from before its
//! first call until after its last. Objects that no process has open are removed after 0.1 s, those
//! that a stopped creator has open after 1 s, and 1 s later if the program whose turn it is to
//! remove them is stopped too.

use super::half_made::Tender;
use super::{BusError, Domain};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Polling period. A check of 25 objects takes 0.1 ms.
const PERIOD: Duration = Duration::from_millis(100);
/// Polling period while an object is half-made.
const CLOSELY: Duration = Duration::from_millis(10);
/// The thread reads directories and writes a line of the log.
const STACK: usize = 512 * 1024;

/// Watches until dropped.
#[derive(Debug)]
pub(super) struct Watch {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch.
    ///
    /// # Errors
    /// [`BusError::Thread`] if the system refuses a thread: without it any later call could hang.
    pub(super) fn start(domain: &Domain) -> Result<Self, BusError> {
        let (stop, stopped) = channel::<()>();
        let mut tender = Tender::new(domain);
        let thread = std::thread::Builder::new()
            .name("bus-watch".into())
            .stack_size(STACK)
            .spawn(move || {
                let mut pause = PERIOD;
                while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    pause = if tender.sweep_once() > 0 { CLOSELY } else { PERIOD };
                }
            })
            .map_err(|source| BusError::Thread {
                domain: domain.name().into(),
                action: "looking after what other programs have left half-made",
                source,
            })?;
        Ok(Self {
            stop: Some(stop),
            thread: Some(thread),
        })
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic there has already been printed, and must not cause a second one here.
            let _ = thread.join();
        }
    }
}
