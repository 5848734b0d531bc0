//! Progress of a run on standard error: in place on a terminal, otherwise a line every few seconds.

use crate::bus::monotonic_ns;
use crate::live::{LiveState, columns, progress_line};
use crate::messages::{Estimate, State, Status};
use std::io::{IsTerminal, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Period of lines if they cannot be written in place.
const LINE_PERIOD: Duration = Duration::from_secs(5);
/// Period of updates in place.
const IN_PLACE_PERIOD: Duration = Duration::from_millis(200);

/// The progress line. All other output to standard error meanwhile goes through
/// [`Progress::pass_on`].
#[derive(Debug)]
pub(super) struct Progress {
    terminal: bool,
    samples: u64,
    block_len: u64,
    start: Instant,
    line: Mutex<Line>,
    /// The results shown in the line.
    live: Mutex<LiveState>,
}

#[derive(Debug)]
struct Line {
    last: Instant,
    shown: bool,
}

impl Progress {
    /// Progress towards `samples` samples in blocks of `block_len`.
    pub(super) fn new(samples: u64, block_len: u64, live: LiveState) -> Self {
        let now = Instant::now();
        Self {
            terminal: std::io::stderr().is_terminal(),
            samples,
            block_len: block_len.max(1),
            start: now,
            live: Mutex::new(live),
            line: Mutex::new(Line {
                last: now,
                shown: false,
            }),
        }
    }

    /// True if there is a line in place that shows results.
    pub(super) fn is_terminal(&self) -> bool {
        self.terminal
    }

    /// Takes an estimate.
    pub(super) fn found(&self, estimate: &Estimate, sent_ns: u64) {
        let mut live = self.live.lock().unwrap_or_else(PoisonError::into_inner);
        live.on_estimate(estimate, None, sent_ns);
    }

    /// Shows a status if it is due.
    pub(super) fn show(&self, status: &Status, sent_ns: u64) {
        let mut live = self.live.lock().unwrap_or_else(PoisonError::into_inner);
        live.on_status(status, sent_ns);
        let view = self.terminal.then(|| live.view(monotonic_ns()));
        drop(live);
        let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
        let period = if self.terminal { IN_PLACE_PERIOD } else { LINE_PERIOD };
        if line.last.elapsed() < period {
            return;
        }
        line.last = Instant::now();
        let text = match view {
            Some(view) => {
                let percent = format!("{:3.0} %  ", self.percent(status));
                let lost = match view.missing.saturating_add(view.rejected) {
                    0 => String::new(),
                    _ => format!("  {} missing, {} rejected", view.missing, view.rejected),
                };
                // A line wider than the terminal could not be overwritten.
                let room = columns().saturating_sub(percent.len() + lost.len() + 1);
                format!("{percent}{}{lost}", progress_line(&view, room))
            }
            None => self.text(status, self.start.elapsed()),
        };
        let mut stderr = std::io::stderr().lock();
        if self.terminal {
            line.shown = true;
            let _ = write!(stderr, "\r{text}\x1b[K");
        } else {
            let _ = writeln!(stderr, "{text}");
        }
        let _ = stderr.flush();
    }

    fn percent(&self, status: &Status) -> f64 {
        // A sum of received counters must not overflow.
        let taken = status
            .accepted
            .saturating_add(status.rejected)
            .saturating_add(status.missing);
        100.0 * taken as f64 / self.samples.max(1) as f64
    }

    fn text(&self, status: &Status, elapsed: Duration) -> String {
        let percent = self.percent(status);
        let blocks = self.samples / self.block_len;
        format!(
            "{percent:3.0} %  block {} of {blocks}  {}  {} accepted, {} missing, {} rejected  {:.1} s",
            status.last_block,
            State::from_wire(status.state).map_or("unknown", State::name),
            status.accepted,
            status.missing,
            status.rejected,
            elapsed.as_secs_f64()
        )
    }

    /// Writes a line of a child without breaking the progress line.
    pub(super) fn pass_on(&self, text: &str) {
        let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
        let clear = if std::mem::take(&mut line.shown) {
            "\r\x1b[K"
        } else {
            ""
        };
        let _ = writeln!(std::io::stderr().lock(), "{clear}{text}");
    }

    /// Removes the line in place.
    pub(super) fn clear(&self) {
        let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
        if std::mem::take(&mut line.shown) {
            let _ = write!(std::io::stderr().lock(), "\r\x1b[K");
        }
    }
}
