//! Lines of the log as its readers need them.
//!
//! zenoh reports a peer that cannot get in at each attempt, with the line of its source. Here such a
//! line comes without that, and from one place in zenoh once a minute at most.

use crate::error::words;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Shortest time between two lines from one place in zenoh.
const EVERY: Duration = Duration::from_secs(60);

/// When each place in zenoh's source was last heard.
#[derive(Debug, Default)]
struct Places(BTreeMap<String, Instant>);

impl Places {
    /// The line as it is to be written; `None` if it is not.
    fn line(&mut self, line: &str, now: Instant) -> Option<String> {
        if let Some(place) = place(line) {
            let last = self.0.get(place);
            if last.is_some_and(|last| now.duration_since(*last) < EVERY) {
                return None;
            }
            self.0.insert(place.to_owned(), now);
        }
        Some(words(line) + "\n")
    }
}

/// The line of zenoh's source that a line of the log ends with.
fn place(line: &str) -> Option<&str> {
    let (_, place) = line.trim_end().rsplit_once(" at /")?;
    place.contains(".rs:").then_some(place)
}

/// Standard error, a whole line at a time.
#[derive(Debug, Default)]
pub struct Log(Mutex<Places>);

impl Write for &Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let line = self
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .line(&text, Instant::now());
        if let Some(line) = line {
            io::stderr().lock().write_all(line.as_bytes())?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().lock().flush()
    }
}

impl<'a> tracing_subscriber::fmt::MakeWriter<'a> for Log {
    type Writer = &'a Log;

    fn make_writer(&'a self) -> Self::Writer {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_place_in_zenoh_is_heard_once_a_minute_and_everything_else_always() {
        let mut places = Places::default();
        let start = Instant::now();
        let refused = |port: u32| format!("ERROR refused: tcp/127.0.0.1:{port} at /a/zenoh/open.rs:526.\n");
        let mut written = 0;
        for second in 0..120_u32 {
            let now = start + Duration::from_secs(second.into());
            written += usize::from(places.line(&refused(second), now).is_some());
            assert_eq!(
                places.line("INFO robot connected\n", now).as_deref(),
                Some("INFO robot connected\n")
            );
        }
        assert_eq!(written, 2);
        let later = start + Duration::from_secs(200);
        assert_eq!(
            places.line(&refused(7), later).as_deref(),
            Some("ERROR refused: tcp/127.0.0.1:7\n")
        );
    }
}
