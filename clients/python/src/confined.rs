//! Ports that may be used from any thread, by one at a time.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// A value that is not `Send`, behind a lock.
struct Confined<T>(T);

// SAFETY: ports count references to their node and service without atomics. Every `Confined` is
// made from a `Bus` of its own and holds all clones of it, so no count is shared with anything
// outside; and it is only reached through the mutex below, so no two threads touch it at a time.
// None of it keeps data per thread.
unsafe impl<T> Send for Confined<T> {}

/// A port behind a lock; `None` once it is closed.
pub(crate) struct Port<T>(Mutex<Option<Confined<T>>>);

impl<T> Port<T> {
    /// `make` must join the bus itself and keep everything that it makes of it within the value.
    pub(crate) fn new<E>(make: impl FnOnce() -> Result<T, E>) -> Result<Self, E> {
        Ok(Self(Mutex::new(Some(Confined(make()?)))))
    }

    /// Runs `act` on the port; `None` if it is closed.
    pub(crate) fn with<R>(&self, act: impl FnOnce(&mut T) -> R) -> Option<R> {
        self.lock().as_mut().map(|confined| act(&mut confined.0))
    }

    pub(crate) fn close(&self) {
        *self.lock() = None;
    }

    /// Closes it by what `end` does with the port.
    pub(crate) fn close_by<R>(&self, end: impl FnOnce(T) -> R) {
        let port = self.lock().take();
        port.map(|confined| end(confined.0));
    }

    fn lock(&self) -> MutexGuard<'_, Option<Confined<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
