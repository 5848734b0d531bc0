//! Messages in the identifier's log.

use crate::messages::{Status, status_flags};
use crate::node::identifier::Identifier;

/// Log messages, at most once per heartbeat and never from within the step.
#[derive(Debug, Default)]
pub(super) struct LogState {
    connected: bool,
    stream: u64,
    missing: u64,
    rejected: u64,
    window_s: Option<f64>,
    is_replay: bool,
    /// The stream whose lack of estimates was reported.
    without_estimate: u64,
}

impl LogState {
    /// Logs the length of windows chosen from the signals whenever it changes, once samples have
    /// arrived.
    pub(super) fn window(&mut self, node: &dyn Identifier) {
        let window_s = node.window_s().filter(|_| node.status().estimates > 0);
        if let Some(length_s) = window_s.filter(|_| window_s != self.window_s) {
            tracing::info!("window of the projected rows: {:.3} ms", 1e3 * length_s);
            self.window_s = window_s;
        }
    }

    pub(super) fn plant(&mut self, connected: bool) {
        if connected != self.connected {
            self.connected = connected;
            tracing::info!(
                "{}",
                if connected {
                    "plant connected"
                } else {
                    "plant disconnected"
                }
            );
        }
    }

    /// Logs the number of ignored messages; the first one was logged when it arrived.
    pub(super) fn left_out(&self, samples: u64) {
        if samples > 0 {
            tracing::warn!(samples, "messages of another schema were left out");
        }
    }

    pub(super) fn replay(&mut self, status: &Status) {
        let is_replay = status.flags & status_flags::REPLAY != 0;
        if is_replay != self.is_replay {
            self.is_replay = is_replay;
            tracing::info!(
                "{}",
                if is_replay {
                    "replay started: its estimates are discarded when the next stream begins"
                } else {
                    "replay ended: the estimates continue from the state before it"
                }
            );
        }
    }

    /// Logs once per stream why its blocks give no estimate.
    pub(super) fn no_estimate(&mut self, status: &Status) {
        if let Some(words) = status
            .no_estimate()
            .filter(|_| self.without_estimate != status.stream_id)
        {
            self.without_estimate = status.stream_id;
            tracing::warn!("no estimate yet: {words}");
        }
    }

    pub(super) fn losses(&mut self, status: &Status) {
        if status.stream_id != self.stream {
            (self.stream, self.missing, self.rejected) = (status.stream_id, 0, 0);
        }
        if (status.missing, status.rejected) != (self.missing, self.rejected) {
            let missing = status.missing.saturating_sub(self.missing);
            let rejected = status.rejected.saturating_sub(self.rejected);
            let refused = status.rejected > 0;
            tracing::warn!(
                missing,
                rejected,
                last_seq = status.last_seq,
                so_far = refused.then(|| tracing::field::display(&status.faults)),
                last = status.error.words(),
                "samples were lost or refused"
            );
            (self.missing, self.rejected) = (status.missing, status.rejected);
        }
    }
}
