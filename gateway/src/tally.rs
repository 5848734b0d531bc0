//! What was carried, what was lost, and how late it came.

use crate::envelope::{Envelope, unix_ns};
use crate::incoming::Incoming;
use hdrhistogram::Histogram;
use std::fmt;
use std::io::Write as _;
use thetabus::node::stream::{Place, StreamCursor};

/// Longest latency that the histogram resolves \[µs\].
const LONGEST_US: u64 = 60_000_000;

/// Where the numbers of one key stand.
#[derive(Debug, Clone, Copy, Default)]
pub struct Numbers {
    /// Run and number of the last message.
    last: Option<(u64, u64)>,
}

/// What a message's number tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Numbered {
    /// Messages of its run that are missing before it.
    pub lost: u64,
    /// It is the first of its run.
    pub is_new_run: bool,
}

impl Numbers {
    /// Places the next message; `None` for one that was there before, or that comes behind a later
    /// one: the last message of a topic stays the last.
    ///
    /// After an outage of the route the answer about last messages comes first. What is missing before
    /// it is lost, as before any other.
    pub fn admit(&mut self, envelope: &Envelope) -> Option<Numbered> {
        let (run, number) = (envelope.run, envelope.number);
        let before = self.last.filter(|(last_run, _)| *last_run == run).map(|(_, last)| last);
        if before.is_some_and(|last| number <= last) {
            return None;
        }
        self.last = Some((run, number));
        Some(Numbered {
            lost: before.map_or(0, |last| number - last - 1),
            is_new_run: before.is_none(),
        })
    }
}

/// Counts of one topic of one robot.
#[derive(Debug)]
pub struct Tally {
    /// Messages carried.
    pub carried: u64,
    /// Messages that the sending gateway numbered and that never came.
    pub lost: u64,
    /// Gaps in the machine's own count, seq of samples or number of blocks, wherever they arose: on
    /// the way, or while no gateway ran.
    pub gaps: u64,
    /// Messages that could not be read, or of another schema.
    pub left_out: u64,
    /// Runs of the sending gateway.
    pub runs: u64,
    numbers: Numbers,
    cursor: StreamCursor,
    latency_us: Histogram<u32>,
}

impl Tally {
    /// Nothing carried.
    pub fn new() -> Self {
        Self {
            carried: 0,
            lost: 0,
            gaps: 0,
            left_out: 0,
            runs: 0,
            numbers: Numbers::default(),
            cursor: StreamCursor::new(),
            latency_us: empty(),
        }
    }

    /// Places a message by its envelope; false for one that is not taken, as [`Numbers::admit`] says.
    pub fn admit(&mut self, envelope: &Envelope) -> bool {
        let mut numbers = self.numbers;
        let is_new = self.admit_by(&mut numbers, envelope);
        self.numbers = numbers;
        is_new
    }

    /// The same for one of several keys, which has `numbers` of its own.
    pub fn admit_by(&mut self, numbers: &mut Numbers, envelope: &Envelope) -> bool {
        let Some(place) = numbers.admit(envelope) else {
            return false;
        };
        self.carried += 1;
        self.lost += place.lost;
        self.runs += u64::from(place.is_new_run);
        true
    }

    /// Counts a message that came, with the machine's own count of it; false if it is not new.
    pub fn count(&mut self, message: &Incoming, counted: Option<(u64, u64)>) -> bool {
        if !self.admit(&message.envelope) {
            return false;
        }
        if let Some((stream_id, seq)) = counted {
            self.place(stream_id, seq);
        }
        if message.is_live {
            self.late(message.envelope.sent_unix_ns, unix_ns());
        }
        true
    }

    /// Places a message by the machine's own count.
    pub fn place(&mut self, stream_id: u64, seq: u64) {
        if let Place::Gap { missing } = self.cursor.advance(stream_id, seq) {
            self.gaps = self.gaps.saturating_add(missing);
        }
    }

    /// Messages that are missing by either count; the one that one of them cannot see, the other
    /// often can.
    pub fn missing(&self) -> u64 {
        self.lost.max(self.gaps)
    }

    /// Notes how long a message was under way, by the clocks of both hosts.
    pub fn late(&mut self, sent_unix_ns: u64, now_unix_ns: u64) {
        // A clock that is behind shows a time below zero.
        let us = now_unix_ns.saturating_sub(sent_unix_ns) / 1000;
        self.latency_us.saturating_record(us);
    }

    /// Latency below which a share of all messages stayed \[ms\].
    pub fn latency_ms(&self, share: f64) -> f64 {
        self.latency_us.value_at_quantile(share) as f64 / 1e3
    }
}

fn empty() -> Histogram<u32> {
    // The range is constant, so the second arm is never taken.
    Histogram::new_with_bounds(1, LONGEST_US, 2)
        .unwrap_or_else(|_| Histogram::new(2).unwrap_or_else(|_| unreachable!()))
}

/// Writes a line of results. A reader that has gone away is no reason to fail.
pub fn say(line: impl fmt::Display) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Head of a table of tallies.
pub const HEAD: &str = "topic                                  carried      lost      gaps  left out  runs   p50 [ms]   p99 [ms] p99.9 [ms]   max [ms]";

/// A line of the table, without the topic.
impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (carried, lost, gaps) = (self.carried, self.lost, self.gaps);
        write!(
            f,
            "{carried:>9} {lost:>9} {gaps:>9} {:>9} {:>5}",
            self.left_out, self.runs
        )?;
        if self.latency_us.is_empty() {
            return Ok(());
        }
        [0.5, 0.99, 0.999, 1.0]
            .into_iter()
            .try_for_each(|share| write!(f, " {:>10.3}", self.latency_ms(share)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thetabus::recording::Dimensions;

    fn envelope(run: u64, number: u64) -> Envelope {
        Envelope {
            schema: 3,
            run,
            number,
            sent_unix_ns: 0,
            dimensions: Dimensions::default(),
        }
    }

    #[test]
    fn prop_gaps_of_one_run_are_losses_and_a_new_run_is_none() {
        let mut tally = Tally::new();
        for (run, number, is_new, lost) in [
            (1, 7, true, 0),
            (1, 8, true, 0),
            (1, 8, false, 0),
            (1, 5, false, 0),
            (1, 12, true, 3),
            (2, 0, true, 3),
            (2, 2, true, 4),
        ] {
            assert_eq!(
                (tally.admit(&envelope(run, number)), tally.lost),
                (is_new, lost),
                "{run} {number}"
            );
        }
        assert_eq!((tally.carried, tally.runs), (5, 2));
    }

    #[test]
    fn prop_what_was_numbered_is_either_carried_or_lost_whatever_way_it_comes() {
        let mut tally = Tally::new();
        assert!(tally.admit(&envelope(1, 3)), "the last one, on request");
        assert_eq!(tally.lost, 0, "those before were for others");
        assert!(!tally.admit(&envelope(1, 3)), "the same one");
        assert!(tally.admit(&envelope(1, 6)), "the last one, after an outage");
        assert!(!tally.admit(&envelope(1, 5)), "too late: it is counted as lost");
        assert_eq!((tally.lost, tally.carried), (2, 2));
    }

    #[test]
    fn prop_gaps_in_the_machines_count_are_told_over_a_restart_of_the_gateway_but_not_of_the_machine() {
        let mut tally = Tally::new();
        for (stream, seq, gaps) in [(9, 0, 0), (9, 1, 0), (9, 5, 3), (4, 0, 3), (4, 2, 4)] {
            tally.place(stream, seq);
            assert_eq!(tally.gaps, gaps, "{stream} {seq}");
        }
    }

    #[test]
    fn prop_latencies_are_told_within_a_hundredth_and_clocks_that_disagree_give_zero() {
        let mut tally = Tally::new();
        (1..=1000).for_each(|ms| tally.late(0, ms * 1_000_000));
        // Two significant digits.
        assert!((tally.latency_ms(0.5) / 500.0 - 1.0).abs() < 0.01);
        assert!((tally.latency_ms(0.99) / 990.0 - 1.0).abs() < 0.01);
        let mut ahead = Tally::new();
        ahead.late(5_000_000, 1_000_000);
        // The histogram resolves one microsecond.
        assert!(ahead.latency_ms(1.0) <= 0.001);
    }
}
