//! Calls that may hang, with a limit.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Calls `f` on a thread of its own; `None` where it has not returned within `limit`. The thread is then left to itself, and
/// what it may still return is dropped there.
pub(super) fn within<T: Send + 'static>(limit: Duration, f: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    let (done, result) = sync_channel(1);
    let spawned = std::thread::Builder::new().name("bus-call".into()).spawn(move || {
        let _ = done.send(f());
    });
    let Ok(thread) = spawned else { return None };
    match result.recv_timeout(limit) {
        Ok(value) => Some(value),
        Err(RecvTimeoutError::Timeout) => None,
        Err(RecvTimeoutError::Disconnected) => match thread.join() {
            Ok(()) => None,
            Err(panic) => std::panic::resume_unwind(panic),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_call_that_hangs_is_given_up_at_the_limit() {
        assert_eq!(within(Duration::from_secs(20), || 7), Some(7));
        let limit = Duration::from_millis(50);
        let start = std::time::Instant::now();
        assert_eq!(within(limit, || std::thread::sleep(Duration::from_secs(20))), None);
        assert!(start.elapsed() >= limit && start.elapsed() < Duration::from_secs(10));
    }
}
