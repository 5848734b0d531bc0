//! Order of a stream: detects the next sample, missing samples, and a new stream.

/// Place of a message in its stream, from `stream_id` and `seq`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The first message of a stream: the first that this consumer receives, or the first of a
    /// restarted publisher.
    First,
    /// The one after the previous one.
    Next,
    /// Messages are missing between the previous one and this one.
    Gap {
        /// Their number.
        missing: u64,
    },
    /// The same `seq` again.
    Duplicate,
}

/// Follows `stream_id` and `seq` of a stream.
///
/// A new `stream_id`, or a `seq` that goes back, starts a new stream and is never treated as a huge
/// gap. Messages before the first one received do not count as missing.
#[derive(Debug, Clone, Copy, Default)]
pub struct StreamCursor {
    last: Option<(u64, u64)>,
    streams: u64,
}

impl StreamCursor {
    /// A cursor at its start.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the place of the next message and moves to it.
    pub fn advance(&mut self, stream_id: u64, seq: u64) -> Place {
        let ahead = self
            .last
            .and_then(|(own, last)| if own == stream_id { seq.checked_sub(last) } else { None });
        let place = match ahead {
            Some(0) => Place::Duplicate,
            Some(1) => Place::Next,
            Some(ahead) => Place::Gap { missing: ahead - 1 },
            None => {
                self.streams += 1;
                Place::First
            }
        };
        self.last = Some((stream_id, seq));
        place
    }

    /// Number of streams seen so far.
    pub fn streams(&self) -> u64 {
        self.streams
    }
}

/// Place of a sample in its stream, from `stream_id` and `seq`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SamplePlace {
    /// The first sample of a stream.
    First,
    /// The one after the previous one.
    Next,
    /// Samples are missing between the previous one and this one.
    Gap {
        /// Their number.
        missing: u64,
    },
    /// The sample was already received.
    Duplicate,
    /// A missing sample that arrives after its successor.
    Late,
}

/// Follows the samples of a stream; distinguishes a late sample from a new stream by the holes so
/// far.
///
/// If `seq` goes back under the same `stream_id`, it is a late sample if that one was missing, a
/// new stream if it is 0 or continues for long, and otherwise a duplicate.
#[derive(Debug, Clone, Copy, Default)]
pub struct SampleCursor {
    last: Option<(u64, u64)>,
    streams: u64,
    /// The last holes, each from one `seq` up to another, exclusive.
    holes: [(u64, u64); Self::HOLES],
    next_hole: usize,
    /// Expected `seq` after the last sample that went back, and the number of such samples in a
    /// row.
    back: (u64, u32),
}

impl SampleCursor {
    const HOLES: usize = 8;
    /// Number of consecutive samples before the last of the stream that count as a new stream.
    const RUN: u32 = 16;

    /// A cursor at its start.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the place of the next sample and moves to it.
    pub fn advance(&mut self, stream_id: u64, seq: u64) -> SamplePlace {
        let Some((own, last)) = self.last else {
            return self.begin(stream_id, seq);
        };
        if own != stream_id {
            return self.begin(stream_id, seq);
        }
        if let Some(ahead) = seq.checked_sub(last) {
            self.back = (0, 0);
            self.last = Some((stream_id, seq));
            return match ahead {
                0 => SamplePlace::Duplicate,
                1 => SamplePlace::Next,
                ahead => {
                    self.holes[self.next_hole % Self::HOLES] = (last + 1, seq);
                    self.next_hole += 1;
                    SamplePlace::Gap { missing: ahead - 1 }
                }
            };
        }
        self.back = (
            seq.wrapping_add(1),
            if seq == self.back.0 { self.back.1 + 1 } else { 1 },
        );
        let hole = self.holes.iter_mut().find(|hole| (hole.0..hole.1).contains(&seq));
        match hole {
            _ if self.back.1 > Self::RUN => self.begin(stream_id, seq),
            Some(hole) => {
                // if a sample fills the middle of a hole, the later part is kept
                *hole = if seq + 1 == hole.1 {
                    (hole.0, seq)
                } else {
                    (seq + 1, hole.1)
                };
                SamplePlace::Late
            }
            None if seq == 0 => self.begin(stream_id, seq),
            None => SamplePlace::Duplicate,
        }
    }

    fn begin(&mut self, stream_id: u64, seq: u64) -> SamplePlace {
        *self = Self {
            last: Some((stream_id, seq)),
            streams: self.streams + 1,
            ..Self::default()
        };
        SamplePlace::First
    }

    /// Number of streams seen so far.
    pub fn streams(&self) -> u64 {
        self.streams
    }
}

/// Judgement on the time of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tick {
    /// It follows from the one before.
    Good,
    /// It does not: the sample is refused, and the next one decides.
    Jump,
    /// The clock was set, or the machine paused: time continues from the previous sample, which was
    /// refused.
    Set {
        /// It was set back.
        back: bool,
    },
}

/// Follows the time of a stream. A single wrong time is refused; if time continues from it, it is
/// accepted.
#[derive(Debug, Clone, Copy)]
pub struct StreamClock {
    period_ns: u64,
    last: Option<(u64, u64)>,
    candidate: Option<(u64, u64)>,
}

impl StreamClock {
    /// Largest difference of the time from that expected from `seq` \[ns\]: possible effect of a
    /// driver's scheduling on time stamps. At least 20 periods, and 2 % of the elapsed time more.
    const JITTER_NS: u64 = 100_000_000;

    /// For samples every `period_ns`; 0 if unknown; time must then only increase.
    pub fn new(period_ns: u64) -> Self {
        Self {
            period_ns,
            last: None,
            candidate: None,
        }
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        (self.last, self.candidate) = (None, None);
    }

    /// Judges the time of the next sample.
    pub fn check(&mut self, seq: u64, t_ns: u64) -> Tick {
        let now = Some((seq, t_ns));
        let tick = match (self.last, self.candidate) {
            (None, _) => Tick::Good,
            (Some(last), _) if self.follows(last, (seq, t_ns)) => Tick::Good,
            (Some(last), Some(candidate)) if self.follows(candidate, (seq, t_ns)) => Tick::Set { back: t_ns <= last.1 },
            _ => Tick::Jump,
        };
        match tick {
            Tick::Jump => self.candidate = now,
            Tick::Good | Tick::Set { .. } => (self.last, self.candidate) = (now, None),
        }
        tick
    }

    fn follows(&self, (seq_0, t_0): (u64, u64), (seq, t): (u64, u64)) -> bool {
        let expected = u128::from(seq.saturating_sub(seq_0)) * u128::from(self.period_ns);
        let passed = u128::from(t.saturating_sub(t_0));
        // clocks of sensor and computer may differ by 2 %
        let tolerance = u128::from(Self::JITTER_NS.max(20 * self.period_ns)) + expected / 50;
        t > t_0 && (self.period_ns == 0 || passed.abs_diff(expected) <= tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_stream_is_followed_through_gaps_restarts_and_duplicates() {
        let mut cursor = StreamCursor::new();
        let steps = [
            // stream_id, seq, place: joined late at 7, which is no gap
            (1, 7, Place::First),
            (1, 8, Place::Next),
            (1, 8, Place::Duplicate),
            (1, 12, Place::Gap { missing: 3 }),
            (1, 13, Place::Next),
            // seq goes back under the same stream_id
            (1, 0, Place::First),
            (1, 1, Place::Next),
            // the publisher was restarted
            (2, 500, Place::First),
            (2, 501, Place::Next),
        ];
        for (stream_id, seq, place) in steps {
            assert_eq!(cursor.advance(stream_id, seq), place, "stream {stream_id} seq {seq}");
        }
        assert_eq!(cursor.streams(), 3);
    }

    #[test]
    fn prop_the_last_possible_seq_does_not_overflow() {
        let mut cursor = StreamCursor::new();
        cursor.advance(1, u64::MAX);
        assert_eq!(cursor.advance(1, u64::MAX), Place::Duplicate);
        assert_eq!(cursor.advance(1, 0), Place::First);
    }

    #[test]
    fn fault_late_repeated_and_restarted_samples_are_told_apart() {
        use SamplePlace::{Duplicate, First, Gap, Late, Next};
        let mut cursor = SampleCursor::new();
        let steps = [
            (0, First),
            (1, Next),
            (5, Gap { missing: 3 }),
            // two of the missing samples arrive late, one of them twice
            (3, Late),
            (3, Duplicate),
            (6, Next),
            (4, Late),
            (7, Next),
            (6, Duplicate),
            (7, Duplicate),
            (8, Next),
            // a publisher that begins again under the same stream_id
            (0, First),
            (1, Next),
        ];
        for (seq, place) in steps {
            assert_eq!(cursor.advance(1, seq), place, "seq {seq}");
        }
        for seq in 2..200 {
            cursor.advance(1, seq);
        }
        // one that begins in the middle is accepted after a while
        let places: Vec<_> = (50..70).map(|seq| cursor.advance(1, seq)).collect();
        assert_eq!(&places[..16], &[Duplicate; 16]);
        assert_eq!(&places[16..18], &[First, Next]);
    }

    #[test]
    fn fault_a_single_wrong_time_is_refused_and_a_clock_that_was_set_is_followed() {
        let ms = 1_000_000;
        let mut clock = StreamClock::new(ms);
        let cases = [
            (0, 0, Tick::Good),
            (1, ms, Tick::Good),
            // stands still, goes back, runs away: one sample each
            (2, ms, Tick::Jump),
            (3, 3 * ms, Tick::Good),
            (4, 0, Tick::Jump),
            (5, u64::MAX, Tick::Jump),
            (6, 6 * ms + 400_000, Tick::Good),
            // a minute of standstill
            (7, 60_000 * ms, Tick::Jump),
            (8, 60_001 * ms, Tick::Set { back: false }),
            (9, 60_002 * ms, Tick::Good),
            // an hour back
            (10, 3 * ms, Tick::Jump),
            (11, 4 * ms, Tick::Set { back: true }),
            (12, 5 * ms, Tick::Good),
            // the time of lost samples has passed
            (1012, 1005 * ms, Tick::Good),
        ];
        for (seq, t_ns, tick) in cases {
            assert_eq!(clock.check(seq, t_ns), tick, "seq {seq}");
        }
        let mut clock = StreamClock::new(0);
        for (seq, t_ns, tick) in [(0, 5, Tick::Good), (1, 50_000 * ms, Tick::Good), (2, 1, Tick::Jump)] {
            assert_eq!(clock.check(seq, t_ns), tick, "seq {seq}");
        }
    }
}
