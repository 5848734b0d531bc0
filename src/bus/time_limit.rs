//! Time limit for calls that may hang.

use super::{BusError, Domain};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Calls `f` on a separate thread; `action` describes it. Past the limit the thread is abandoned,
/// and its result is dropped.
///
/// # Errors
/// [`BusError::TimeLimit`] if `f` has not returned within `limit`, [`BusError::Thread`] if the
/// system refuses a thread.
pub(super) fn within<T: Send + 'static>(
    domain: &Domain,
    action: &'static str,
    limit: Duration,
    f: impl FnOnce() -> T + Send + 'static,
) -> Result<T, BusError> {
    let (done, result) = sync_channel(1);
    let spawned = std::thread::Builder::new().name("bus-call".into()).spawn(move || {
        let _ = done.send(f());
    });
    let thread = spawned.map_err(|source| BusError::Thread {
        domain: domain.name().into(),
        action,
        source,
    })?;
    match result.recv_timeout(limit) {
        Ok(value) => return Ok(value),
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => {
            if let Err(panic) = thread.join() {
                std::panic::resume_unwind(panic);
            }
        }
    }
    Err(BusError::TimeLimit {
        domain: domain.name().into(),
        action,
        limit_s: limit.as_secs_f64(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_call_that_hangs_is_given_up_at_the_limit() {
        let domain = Domain::new("limit").expect("a valid name");
        assert_eq!(within(&domain, "counting", Duration::from_secs(20), || 7).ok(), Some(7));
        let limit = Duration::from_millis(50);
        let start = std::time::Instant::now();
        let error = within(&domain, "sleeping", limit, || {
            std::thread::sleep(Duration::from_secs(20))
        });
        let error = error.expect_err("too long").to_string();
        assert!(error.contains("sleeping has not ended within 0.05 s"), "{error}");
        assert!(start.elapsed() >= limit && start.elapsed() < Duration::from_secs(10));
    }
}
