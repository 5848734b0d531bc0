//! Maps stream time to wall time with absolute deadlines, so a late sample does not delay later
//! ones.

use std::time::{Duration, Instant};

/// Lag beyond which the process was stopped or the machine is too slow: the schedule restarts
/// instead of sending a burst.
const MAX_LAG: Duration = Duration::from_millis(500);

/// When samples are due.
#[derive(Debug, Clone)]
pub struct Pace {
    /// Stream seconds per second; `None` for as fast as possible.
    factor: Option<f64>,
    /// A wall time and the stream time \[ns\] that was due then.
    anchor: Option<(Instant, u64)>,
    report: PaceReport,
}

/// How well the pace was kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PaceReport {
    /// Number of restarts of the schedule.
    pub restarts: u64,
    /// Largest lag apart from these.
    pub worst_lag: Duration,
}

impl Pace {
    /// A pace of `factor` stream seconds per second, finite and positive; `None` for as fast as
    /// possible.
    pub fn new(factor: Option<f64>) -> Self {
        Self {
            factor,
            anchor: None,
            report: PaceReport::default(),
        }
    }

    /// True if nothing is ever waited for.
    pub fn is_max(&self) -> bool {
        self.factor.is_none()
    }

    /// Time until the sample of stream time `t_ns` is due; `None` if it is due. The first one is
    /// due at once.
    pub fn pause(&mut self, t_ns: u64, now: Instant) -> Option<Duration> {
        let factor = self.factor?;
        let (wall, stream_ns) = *self.anchor.get_or_insert((now, t_ns));
        let due = wall + Duration::from_secs_f64(t_ns.saturating_sub(stream_ns) as f64 * 1e-9 / factor);
        if due > now {
            return Some(due - now);
        }
        let lag = now - due;
        if lag > MAX_LAG {
            self.anchor = Some((now, t_ns));
            self.report.restarts += 1;
        } else {
            self.report.worst_lag = self.report.worst_lag.max(lag);
        }
        None
    }

    /// How well it was kept so far.
    pub fn report(&self) -> PaceReport {
        self.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn prop_deadlines_are_absolute_so_lateness_does_not_add_up() {
        let mut pace = Pace::new(Some(2.0));
        let start = Instant::now();
        assert_eq!(pace.pause(0, start), None);
        // Woken 3 ms late for the sample due after 5 ms, the next one is still due after 10 ms.
        let late = start + Duration::from_millis(8);
        assert_eq!(pace.pause(10 * MS, late), None);
        assert_eq!(pace.pause(20 * MS, late), Some(Duration::from_millis(2)));
        assert_eq!(pace.report().worst_lag, Duration::from_millis(3));
    }

    #[test]
    fn prop_after_a_long_stop_the_schedule_starts_anew() {
        let mut pace = Pace::new(Some(1.0));
        let start = Instant::now();
        pace.pause(0, start);
        let stopped = start + Duration::from_secs(3);
        assert_eq!(pace.pause(MS, stopped), None);
        assert_eq!(pace.pause(2 * MS, stopped), Some(Duration::from_millis(1)));
        assert_eq!(pace.report().restarts, 1);
    }

    #[test]
    fn prop_as_fast_as_possible_never_waits() {
        let mut pace = Pace::new(None);
        assert!(pace.is_max());
        assert_eq!(pace.pause(u64::MAX, Instant::now()), None);
    }
}
