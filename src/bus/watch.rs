//! A thread that frees this process from waiting for what nobody will finish.
//!
//! A program that opens an empty object hangs inside iceoryx2 until the object is finished or gone,
//! signals or not, whether it joins, makes or opens a service or a port, connects to a new port
//! while it runs, or leaves. No such call can be given up from outside, so its limit is set here:
//! each member looks after the domain's half-made objects from a thread of its own, from before its
//! first call until after its last. What nobody has open goes after 0.1 s, what a stopped maker has
//! open after 1 s, and after 1 s more if the program whose turn it is to remove it is stopped, too.

use super::half_made::Tender;
use super::{BusError, Domain};
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
    /// Begins to watch.
    ///
    /// # Errors
    /// [`BusError::Thread`] if the system gives no thread: without it any later call could hang.
    pub(super) fn start(domain: &Domain) -> Result<Self, BusError> {
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
            // A panic there has been printed, and must not become a second one here.
            let _ = thread.join();
        }
    }
}
