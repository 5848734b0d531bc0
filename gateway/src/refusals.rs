//! Robots that are not admitted, and how often the log tells of them: a network can make up any
//! number of names, and must fill neither the memory nor the log.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Robots that are remembered.
const REMEMBERED: usize = 4096;
/// Lines per [`PERIOD`].
const LINES: u64 = 10;
const PERIOD: Duration = Duration::from_secs(1);

/// The robots that were refused, by the name that they were refused under.
#[derive(Debug, Default)]
pub struct Refusals {
    since: BTreeMap<String, Instant>,
}

impl Refusals {
    /// True if this one was refused within so long.
    pub fn is_recent(&self, name: &str, within: Duration, now: Instant) -> bool {
        self.since
            .get(name)
            .is_some_and(|since| now.duration_since(*since) < within)
    }

    /// Remembers a refusal; true if it is the first of this name as far as is remembered.
    pub fn is_first(&mut self, name: String, now: Instant) -> bool {
        if self.since.len() >= REMEMBERED && !self.since.contains_key(&name) {
            self.since.clear();
        }
        self.since.insert(name, now).is_none()
    }

    /// Forgets one that was admitted after all.
    pub fn forget(&mut self, name: &str) {
        self.since.remove(name);
    }
}

/// Limits the lines of a log to some per period.
#[derive(Debug, Default)]
pub struct Lines {
    /// When the period began, and the lines written in it.
    period: Option<(Instant, u64)>,
    left_out: u64,
}

impl Lines {
    /// Another line: `Some` if it is to be written, with the number of those before it that were
    /// not, if there were any.
    pub fn next(&mut self, now: Instant) -> Option<Option<u64>> {
        let period = self.period.filter(|(begun, _)| now.duration_since(*begun) < PERIOD);
        let (begun, written) = period.unwrap_or((now, 0));
        if written >= LINES {
            self.left_out += 1;
            return None;
        }
        self.period = Some((begun, written + 1));
        let left_out = std::mem::take(&mut self.left_out);
        Some((left_out > 0).then_some(left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_made_up_names_fill_neither_the_memory_nor_the_log() {
        let start = Instant::now();
        let (mut refusals, mut lines) = (Refusals::default(), Lines::default());
        let (mut written, mut left_out) = (0, 0);
        for i in 0..100_000 {
            let now = start + Duration::from_micros(20 * i);
            if refusals.is_first(format!("host-{i}/arm"), now)
                && let Some(before) = lines.next(now)
            {
                (written, left_out) = (written + 1, left_out + before.unwrap_or(0));
            }
            assert!(refusals.since.len() <= REMEMBERED);
        }
        // 2 s of them.
        assert_eq!((written, left_out + lines.left_out), (2 * LINES, 100_000 - 2 * LINES));
    }

    #[test]
    fn prop_a_refusal_is_told_once_and_forgotten_by_an_admission() {
        let (now, mut refusals) = (Instant::now(), Refusals::default());
        assert!(refusals.is_first("arm".to_owned(), now));
        assert!(!refusals.is_first("arm".to_owned(), now));
        assert!(refusals.is_recent("arm", PERIOD, now));
        assert!(!refusals.is_recent("arm", PERIOD, now + PERIOD));
        refusals.forget("arm");
        assert!(refusals.is_first("arm".to_owned(), now));
    }
}
