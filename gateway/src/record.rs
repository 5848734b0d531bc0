//! What is known of a robot of another host, whether or not it has a place in the domain.

use crate::keys;
use crate::tally::{Tally, say};
use std::time::{Duration, Instant};
use thetabus::bus::Topic;

/// Returns of a run that was replaced: the last messages of a gateway that has died come once at most.
const RETURNS: u32 = 4;
/// From the first message that is missing until the log tells: statuses come twice a second.
const SETTLED: Duration = Duration::from_secs(1);
/// Shortest time between two lines about what is missing.
const LOSSES_EVERY: Duration = Duration::from_secs(10);

/// Names and counts of a robot. They outlive its place, so that what it sent while it had none shows
/// as missing.
pub struct Record {
    pub host: String,
    pub robot: String,
    pub description: Tally,
    pub estimate: Tally,
    pub status: Tally,
    pub journal: Tally,
    pub sample: Tally,
    runs: Runs,
    losses: Losses,
}

impl Record {
    /// Nothing has come.
    pub fn new(host: &str, robot: &str) -> Self {
        Self {
            host: host.to_owned(),
            robot: robot.to_owned(),
            description: Tally::new(),
            estimate: Tally::new(),
            status: Tally::new(),
            journal: Tally::new(),
            sample: Tally::new(),
            runs: Runs::default(),
            losses: Losses::default(),
        }
    }

    fn tallies(&self) -> [(Topic, &Tally); keys::CARRIED.len()] {
        [
            (Topic::Description, &self.description),
            (Topic::Estimate, &self.estimate),
            (Topic::Status, &self.status),
            (Topic::Journal, &self.journal),
            (Topic::Sample, &self.sample),
        ]
    }

    /// Notes the run of a message; true if two gateways turn out to send under this name.
    pub fn is_of_two(&mut self, run: u64) -> bool {
        self.runs.is_of_two(run)
    }

    /// Counts a message that cannot be read; how many there were of its topic.
    pub fn leave_out(&mut self, topic: Topic) -> u64 {
        let tally = match topic {
            Topic::Description => &mut self.description,
            Topic::Estimate => &mut self.estimate,
            Topic::Status => &mut self.status,
            Topic::Journal => &mut self.journal,
            Topic::Sample => &mut self.sample,
            Topic::Control | Topic::Command => return 0,
        };
        tally.left_out += 1;
        tally.left_out
    }

    /// What is missing and was not told yet, in words for the log; `None` if there is nothing, or if
    /// it is to be told later.
    pub fn losses(&mut self, now: Instant) -> Option<String> {
        let missing = self.tallies().map(|(topic, tally)| (topic, tally.missing()));
        self.losses.tell(missing, now)
    }

    /// Writes its lines of the table.
    pub fn report(&self) {
        for (topic, tally) in self.tallies() {
            if topic != Topic::Sample || tally.carried + tally.left_out > 0 {
                let key = keys::key(&self.host, &self.robot, topic.name());
                say(format_args!("{key:<36} {tally}"));
            }
        }
    }
}

/// Runs of the gateway that sends. A new one replaces the one before; if that returns again and
/// again, there are two.
#[derive(Debug, Default)]
struct Runs {
    now: Option<u64>,
    before: Option<u64>,
    returns: u32,
}

impl Runs {
    fn is_of_two(&mut self, run: u64) -> bool {
        if self.now == Some(run) {
            return false;
        }
        let has_returned = self.before == Some(run);
        (self.before, self.now) = (self.now, Some(run));
        self.returns = if has_returned {
            self.returns.saturating_add(1)
        } else {
            0
        };
        has_returned && self.returns == RETURNS
    }
}

/// What the log has told of missing messages.
#[derive(Debug, Default)]
struct Losses {
    told: [u64; keys::CARRIED.len()],
    /// When the first loss was noticed that the log has not said yet.
    noticed: Option<Instant>,
    last: Option<Instant>,
}

impl Losses {
    /// How many more messages of each topic are missing than the log has said so far. The log says
    /// it once every topic has had the time to come again, and at most every [`LOSSES_EVERY`].
    fn tell(&mut self, missing: [(Topic, u64); keys::CARRIED.len()], now: Instant) -> Option<String> {
        if missing.iter().zip(self.told).all(|((_, count), told)| *count <= told) {
            return None;
        }
        let noticed = *self.noticed.get_or_insert(now);
        let is_early = now.duration_since(noticed) < SETTLED;
        if is_early || self.last.is_some_and(|last| now.duration_since(last) < LOSSES_EVERY) {
            return None;
        }
        (self.noticed, self.last) = (None, Some(now));
        let mut words = Vec::new();
        for ((topic, count), told) in missing.into_iter().zip(&mut self.told) {
            if count > *told {
                words.push(format!("{topic} {}", count - *told));
                *told = count;
            }
        }
        Some(words.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_two_gateways_of_one_name_are_told_once_and_restarts_are_none() {
        let (mut restarts, mut both) = (Runs::default(), Runs::default());
        let told = |runs: &mut Runs, sent: &[u64]| sent.iter().filter(|run| runs.is_of_two(**run)).count();
        // A message of the run that has ended comes late.
        assert_eq!(told(&mut restarts, &[1, 1, 2, 1, 2, 2, 3, 3, 4, 3, 4]), 0);
        assert_eq!(told(&mut both, &[7, 8].repeat(20)), 1);
    }

    #[test]
    fn prop_what_is_missing_is_told_once_when_all_topics_had_time_and_not_often() {
        let mut losses = Losses::default();
        let start = Instant::now();
        let mut told = Vec::new();
        for tenth in 0..300_u32 {
            let now = start + tenth * Duration::from_millis(100);
            // Samples are missing from 1 s on, an estimate from 1.5 s on, then a sample each second
            // from 5 s to 15 s.
            let samples = if tenth < 10 { 0 } else { 7 } + u64::from(tenth.clamp(50, 150) - 50) / 10;
            let missing = [
                (Topic::Description, 0),
                (Topic::Estimate, u64::from(tenth >= 15)),
                (Topic::Sample, samples),
                (Topic::Status, 0),
                (Topic::Journal, 0),
            ];
            if let Some(words) = losses.tell(missing, now) {
                told.push((tenth, words));
            }
        }
        let expected = [(20, "estimate 1, sample 7"), (120, "sample 7"), (220, "sample 3")];
        assert_eq!(told, expected.map(|(tenth, words)| (tenth, words.to_owned())));
    }
}
