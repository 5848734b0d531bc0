//! Order of a stream: which sample comes next, what is missing, where a new stream begins.

/// What a message's `boot_id` and `seq` say about its place in the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The first message of a stream: of all that this consumer sees, or of a publisher that was started again.
    First,
    /// The one after the previous one.
    Next,
    /// Messages between the previous one and this one are missing.
    Gap {
        /// How many.
        missing: u64,
    },
    /// The same `seq` again.
    Duplicate,
}

/// Follows `boot_id` and `seq` of a stream.
///
/// A new `boot_id`, or a `seq` that goes back, starts a new stream and is never taken for a huge gap. What was sent before the
/// first message that this consumer received is not missing.
#[derive(Debug, Clone, Copy, Default)]
pub struct StreamCursor {
    last: Option<(u64, u64)>,
    streams: u64,
}

impl StreamCursor {
    /// A cursor that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Places the next message and moves on to it.
    pub fn advance(&mut self, boot_id: u64, seq: u64) -> Place {
        let ahead = self
            .last
            .and_then(|(boot, last)| if boot == boot_id { seq.checked_sub(last) } else { None });
        let place = match ahead {
            Some(0) => Place::Duplicate,
            Some(1) => Place::Next,
            Some(ahead) => Place::Gap { missing: ahead - 1 },
            None => {
                self.streams += 1;
                Place::First
            }
        };
        self.last = Some((boot_id, seq));
        place
    }

    /// Number of streams seen so far.
    pub fn streams(&self) -> u64 {
        self.streams
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_stream_is_followed_through_gaps_restarts_and_duplicates() {
        let mut cursor = StreamCursor::new();
        let steps = [
            // boot, seq, place: joined late at 7, which is no gap
            (1, 7, Place::First),
            (1, 8, Place::Next),
            (1, 8, Place::Duplicate),
            (1, 12, Place::Gap { missing: 3 }),
            (1, 13, Place::Next),
            // seq goes back under the same boot_id
            (1, 0, Place::First),
            (1, 1, Place::Next),
            // the publisher was started again
            (2, 500, Place::First),
            (2, 501, Place::Next),
        ];
        for (boot, seq, place) in steps {
            assert_eq!(cursor.advance(boot, seq), place, "boot {boot} seq {seq}");
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
}
