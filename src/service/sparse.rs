//! Limits log lines that other processes can cause: some lines per period, then the count of those
//! left out.

use std::time::{Duration, Instant};

/// Selects the lines of one kind to write.
#[derive(Debug)]
pub(super) struct Sparse {
    period: Duration,
    lines: u64,
    /// Start of the period, and the lines written in it.
    begun: Option<(Instant, u64)>,
    left_out: u64,
}

impl Sparse {
    /// At most `lines` lines per `period`.
    pub(super) fn new(lines: u64, period: Duration) -> Self {
        Self {
            period,
            lines,
            begun: None,
            left_out: 0,
        }
    }

    /// Registers a line: `Some` if it should be written, with the number of lines left out before
    /// it.
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

    /// Number of lines left out that have not been reported for a period, or, at the `end`, at all.
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
