//! Progress of a long command: one line on standard error that is overwritten, only on a terminal.
//!
//! The work reports its progress and continues; a separate thread writes, so a blocked terminal
//! does not delay it. The cursor returns to the start of the line, so any other output overwrites
//! it.

use crate::live::columns;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Period of updates.
const PERIOD: Duration = Duration::from_millis(200);
/// Resolution of the share as an integer.
const PARTS: f64 = 1e6;
/// No share has been reported yet.
const UNKNOWN: u64 = u64::MAX;

/// The line, removed on drop.
#[derive(Debug)]
pub(super) struct Ticker {
    shared: Arc<Shared>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    share: AtomicU64,
    /// The present stage, and its start.
    stage: Mutex<(String, Instant)>,
    /// The holder may write.
    stderr: Mutex<()>,
}

impl Ticker {
    /// Begins with a stage, described in a few words; silent unless on a terminal.
    pub(super) fn start(words: &str) -> Self {
        let shared = Arc::new(Shared {
            share: AtomicU64::new(UNKNOWN),
            stage: Mutex::new((words.to_owned(), Instant::now())),
            stderr: Mutex::new(()),
        });
        let (stop, stopped) = channel();
        let is_terminal = std::io::stderr().is_terminal();
        let thread = is_terminal.then(|| {
            let shared = shared.clone();
            std::thread::spawn(move || shared.follow(&stopped))
        });
        Self {
            shared,
            stop: Some(stop),
            thread,
        }
    }

    /// Begins the next stage.
    pub(super) fn stage(&self, words: &str) {
        let mut stage = self.shared.stage.lock().unwrap_or_else(PoisonError::into_inner);
        *stage = (words.to_owned(), Instant::now());
        self.shared.share.store(UNKNOWN, Ordering::Relaxed);
    }

    /// Sets the completed share of the stage, 0 to 1.
    pub(super) fn at(&self, share: f64) {
        let parts = (share.clamp(0.0, 1.0) * PARTS) as u64;
        self.shared.share.store(parts, Ordering::Relaxed);
    }

    /// Writes other output meanwhile, on a separate line.
    #[cfg(feature = "studies")]
    pub(super) fn aside<T>(&self, write: impl FnOnce() -> T) -> T {
        let _only = self.shared.stderr.lock().unwrap_or_else(PoisonError::into_inner);
        if self.thread.is_some() {
            clear();
        }
        write()
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
            clear();
        }
    }
}

impl Shared {
    fn follow(&self, stopped: &Receiver<()>) {
        loop {
            self.write();
            if stopped.recv_timeout(PERIOD) != Err(RecvTimeoutError::Timeout) {
                return;
            }
        }
    }

    fn write(&self) {
        let share = self.share.load(Ordering::Relaxed);
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let share = (share != UNKNOWN).then(|| share as f64 / PARTS);
        let text = line(&stage.0, share, stage.1.elapsed(), columns());
        let _only = self.stderr.lock().unwrap_or_else(PoisonError::into_inner);
        let mut stderr = std::io::stderr().lock();
        let _ = write!(stderr, "\r{text}\x1b[K\r");
        let _ = stderr.flush();
    }
}

fn clear() {
    let mut stderr = std::io::stderr().lock();
    let _ = write!(stderr, "\r\x1b[K");
    let _ = stderr.flush();
}

/// ` 42 % reading run/recording.mcap 12 s left`, in fewer than so many columns: a full line would
/// move on to the next.
fn line(words: &str, share: Option<f64>, elapsed: Duration, columns: usize) -> String {
    let percent = share.map_or_else(String::new, |share| format!("{:3.0} %  ", 100.0 * share));
    let time = match share {
        // Before that the rate says little.
        Some(share) if share > 0.02 && elapsed.as_secs() >= 1 => {
            let left = elapsed.as_secs_f64() * (1.0 - share) / share;
            format!("  {} left", duration(left))
        }
        Some(_) => String::new(),
        None => format!("  {}", duration(elapsed.as_secs_f64())),
    };
    let text = format!("{percent}{words}{time}");
    let room = columns.saturating_sub(1);
    match text.chars().count() <= room {
        true => text,
        false => text.chars().take(room).collect(),
    }
}

fn duration(seconds: f64) -> String {
    let seconds = seconds.round().min(1e9) as u64;
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        _ => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_the_line_says_what_how_far_and_how_long() {
        let line = |share, seconds| line("reading run.mcap", share, Duration::from_secs(seconds), 80);
        assert_eq!(line(Some(0.0), 0), "  0 %  reading run.mcap");
        assert_eq!(line(Some(0.25), 30), " 25 %  reading run.mcap  1 min 30 s left");
        assert_eq!(line(Some(0.5), 7200), " 50 %  reading run.mcap  2 h 00 min left");
        assert_eq!(line(Some(1.0), 5), "100 %  reading run.mcap  0 s left");
        assert_eq!(line(None, 5), "reading run.mcap  5 s");
    }

    #[test]
    fn prop_the_line_is_shorter_than_the_terminal() {
        for columns in 0..60 {
            let text = line("reading a recording", Some(0.5), Duration::from_secs(100), columns);
            assert!(text.chars().count() < columns.max(1), "{columns}: {text}");
        }
    }
}
