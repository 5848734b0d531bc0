//! Decides whether and when a failed process is restarted: a limit, and a pause that doubles.

use crate::config::SupervisionConfig;
use std::time::Duration;

/// The restarts of one process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Restarts {
    policy: SupervisionConfig,
    /// Number since the process was last healthy.
    in_a_row: u64,
    total: u64,
}

impl Restarts {
    pub(super) fn new(policy: SupervisionConfig) -> Self {
        Self {
            policy,
            in_a_row: 0,
            total: 0,
        }
    }

    /// Records a failure after `ran_for`; returns the pause before the restart, `None` if there is
    /// none.
    pub(super) fn failed(&mut self, ran_for: Duration) -> Option<Duration> {
        if ran_for.as_secs_f64() >= self.policy.healthy_s {
            self.in_a_row = 0;
        }
        if self.in_a_row >= self.policy.restarts {
            return None;
        }
        let doublings = self.in_a_row.min(60) as i32;
        self.in_a_row += 1;
        self.total += 1;
        let pause_s = self.policy.backoff_s * f64::from(doublings).exp2();
        Some(Duration::from_secs_f64(pause_s.min(self.policy.backoff_limit_s)))
    }

    /// Restarts of the whole run.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// Restarts since the process was last healthy.
    pub(super) fn in_a_row(&self) -> u64 {
        self.in_a_row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLICY: SupervisionConfig = SupervisionConfig {
        restarts: 5,
        backoff_s: 0.1,
        backoff_limit_s: 0.5,
        healthy_s: 60.0,
    };

    #[test]
    fn prop_pauses_double_up_to_their_limit_and_restarts_end_at_theirs() {
        let mut restarts = Restarts::new(POLICY);
        let pauses: Vec<Option<u128>> = (0..7)
            .map(|_| restarts.failed(Duration::ZERO).map(|pause| pause.as_millis()))
            .collect();
        assert_eq!(
            pauses,
            [Some(100), Some(200), Some(400), Some(500), Some(500), None, None]
        );
        assert_eq!(restarts.total(), 5);
    }

    #[test]
    fn prop_a_process_that_was_healthy_begins_anew() {
        let mut restarts = Restarts::new(POLICY);
        for _ in 0..20 {
            assert_eq!(
                restarts.failed(Duration::from_secs(61)),
                Some(Duration::from_millis(100))
            );
        }
        assert_eq!((restarts.total(), restarts.in_a_row()), (20, 1));
    }

    #[test]
    fn prop_without_restarts_the_first_failure_is_the_last() {
        let mut restarts = Restarts::new(SupervisionConfig { restarts: 0, ..POLICY });
        assert_eq!(restarts.failed(Duration::from_secs(1000)), None);
    }
}
