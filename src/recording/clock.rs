//! Time of day in recordings, as ROS 2 tools expect it: the shifts of stream times and of the clock
//! at sending.
//!
//! A stream's time is CLOCK_MONOTONIC on a machine and simulated time in a simulation. The time of
//! day at which it was 0 is its epoch; a metadata record `thetabus_clock` states it before the
//! first message shifted by it.

use crate::messages::Sample;
use std::collections::BTreeMap;

/// If a sample is sent within this time of its own time, its time is CLOCK_MONOTONIC \[ns\].
const SAME_CLOCK_NS: u64 = 2_000_000_000;

/// Shifts the times of messages to the time of day.
#[derive(Debug, Clone, Copy)]
pub(super) struct WallClock {
    /// Time of day at which CLOCK_MONOTONIC was 0.
    clock_epoch_ns: u64,
    /// Time of day at which the stream's time was 0.
    stream_epoch_ns: u64,
    stream_id: Option<u64>,
}

impl WallClock {
    /// Before the first sample.
    pub(super) fn new(clock_epoch_ns: u64) -> Self {
        Self {
            clock_epoch_ns,
            stream_epoch_ns: clock_epoch_ns,
            stream_id: None,
        }
    }

    /// Follows the stream of a sample; true if the shift changes from here on.
    pub(super) fn follow(&mut self, sample: &Sample, sent_ns: u64) -> bool {
        if self.stream_id == Some(sample.stream_id) {
            return false;
        }
        let epoch = match sent_ns.abs_diff(sample.t_ns) < SAME_CLOCK_NS {
            true => self.clock_epoch_ns,
            false => self.of_sending(sent_ns).saturating_sub(sample.t_ns),
        };
        let is_first = self.stream_id.replace(sample.stream_id).is_none();
        let differs = std::mem::replace(&mut self.stream_epoch_ns, epoch) != epoch;
        is_first || differs
    }

    /// Time of day of a stream time.
    pub(super) fn of_stream(&self, t_ns: u64) -> u64 {
        self.stream_epoch_ns.saturating_add(t_ns)
    }

    /// Time of day of an instant of CLOCK_MONOTONIC.
    pub(super) fn of_sending(&self, sent_ns: u64) -> u64 {
        self.clock_epoch_ns.saturating_add(sent_ns)
    }

    /// As the pairs of a metadata record; `None` before the first sample.
    pub(super) fn to_map(self) -> Option<BTreeMap<String, String>> {
        let stream_id = self.stream_id?;
        Some(
            [
                ("stream_id", stream_id.to_string()),
                ("stream_epoch_ns", self.stream_epoch_ns.to_string()),
            ]
            .map(|(key, value)| (key.to_owned(), value))
            .into(),
        )
    }
}

/// The time of day at which the stream's time was 0, from the pairs of a metadata record.
pub(super) fn stream_epoch(map: &BTreeMap<String, String>) -> Option<u64> {
    map.get("stream_epoch_ns")?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_each_stream_has_the_time_of_day_at_which_its_first_sample_was_sent() {
        let mut clock = WallClock::new(1_000_000_000_000);
        let sample = |stream_id: u64, t_ns: u64| Sample {
            stream_id,
            t_ns,
            ..Sample::EMPTY
        };
        // On a machine: the time of the sample itself, not of its sending.
        assert!(clock.to_map().is_none());
        assert!(clock.follow(&sample(1, 50_000_000_000), 50_000_300_000));
        assert_eq!(clock.of_stream(50_000_000_000), 1_050_000_000_000);
        assert!(!clock.follow(&sample(1, 51_000_000_000), 59_000_300_000));
        // A simulation begins at 0.
        assert!(clock.follow(&sample(2, 0), 60_000_000_000));
        assert_eq!(clock.of_stream(1_000_000), 1_060_001_000_000);
        assert_eq!(clock.of_sending(60_000_000_000), 1_060_000_000_000);
        let map = clock.to_map().unwrap();
        assert_eq!(stream_epoch(&map), Some(1_060_000_000_000));
        // The machine's next stream has the clock of the first one.
        assert!(clock.follow(&sample(3, 70_000_000_000), 70_000_300_000));
        assert!(!clock.follow(&sample(4, 80_000_000_000), 80_000_300_000));
    }
}
