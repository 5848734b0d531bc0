//! A log that somebody else can fill: some lines per period, then the count of those left out.

use std::time::{Duration, Instant};

/// Which lines of a kind are written.
#[derive(Debug)]
pub(super) struct Sparse {
    period: Duration,
    lines: u64,
    /// When the period began, and the lines written in it.
    begun: Option<(Instant, u64)>,
    left_out: u64,
}

impl Sparse {
    /// At most so many lines per `period`.
    pub(super) fn new(lines: u64, period: Duration) -> Self {
        Self {
            period,
            lines,
            begun: None,
            left_out: 0,
        }
    }

    /// Another line: `Some` if it is to be written, with the number of those before it that were
    /// not.
    pub(super) fn line(&mut self, now: Instant) -> Option<u64> {
        if self.is_over(now) {
            self.begun = Some((now, 0));
        }
        match &mut self.begun {
            Some((_, written)) if *written < self.lines => {
                *written += 1;
                Some(std::mem::take(&mut self.left_out))
            }
            _ => {
                self.left_out += 1;
                None
            }
        }
    }

    /// Lines left out that nobody has been told of for a period, or at the `end` at all.
    pub(super) fn rest(&mut self, now: Instant, end: bool) -> Option<u64> {
        if self.left_out == 0 || !(end || self.is_over(now)) {
            return None;
        }
        self.begun = Some((now, 1));
        Some(std::mem::take(&mut self.left_out))
    }

    fn is_over(&self, now: Instant) -> bool {
        self.begun
            .is_none_or(|(begun, _)| now.duration_since(begun) >= self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_line_is_written_or_counted_and_no_more_than_allowed_are_written() {
        for lines in [1, 5] {
            let start = Instant::now();
            let mut sparse = Sparse::new(lines, Duration::from_secs(1));
            let (mut written, mut counted) = (0, 0);
            for millis in 0..30_000 {
                let now = start + Duration::from_millis(millis / 10);
                if let Some(left_out) = sparse.line(now) {
                    (written, counted) = (written + 1, counted + left_out);
                }
            }
            assert_eq!(written, 3 * lines);
            assert_eq!(sparse.rest(start + Duration::from_millis(2_999), false), None);
            let rest = sparse
                .rest(start + Duration::from_millis(2_999), true)
                .expect("some were left out");
            assert_eq!(written + counted + rest, 30_000);
            assert_eq!(sparse.rest(start + Duration::from_secs(20), true), None);
        }
    }
}
