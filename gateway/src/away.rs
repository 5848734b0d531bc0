//! Robots whose roles were given back: what is known of them, until they send again.

use crate::record::Record;
use std::collections::BTreeMap;
use std::time::Instant;

/// Records that are kept, each of some 50 kB: names of the network must not fill the memory.
const KEPT: usize = 256;

/// Records by host and robot, with the time since when they are here.
#[derive(Default)]
pub struct Away {
    records: BTreeMap<(String, String), (Instant, Record)>,
    forgotten: u64,
}

impl Away {
    /// Keeps a record. If there are too many, the one that is here longest is forgotten.
    pub fn put(&mut self, record: Record, now: Instant) {
        self.records
            .insert((record.host.clone(), record.robot.clone()), (now, record));
        if self.records.len() > KEPT {
            let longest = self.records.iter().min_by_key(|(_, (since, _))| *since);
            if let Some(key) = longest.map(|(key, _)| key.clone()) {
                self.records.remove(&key);
                self.forgotten += 1;
            }
        }
    }

    /// The record of a robot that sends again.
    pub fn take(&mut self, host: &str, robot: &str) -> Option<Record> {
        let key = (host.to_owned(), robot.to_owned());
        self.records.remove(&key).map(|(_, record)| record)
    }

    /// All that are here.
    pub fn records(&self) -> impl Iterator<Item = &Record> {
        self.records.values().map(|(_, record)| record)
    }

    /// How many were forgotten.
    pub fn forgotten(&self) -> u64 {
        self.forgotten
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn fault_made_up_robots_that_fell_silent_do_not_fill_the_memory() {
        let (start, mut away) = (Instant::now(), Away::default());
        for i in 0..2 * KEPT {
            // In an order that is not that of their names.
            let name = format!("robot-{}", i * 7919 % 1000);
            away.put(Record::new("cell", &name), start + Duration::from_secs(i as u64));
            assert!(away.take("other", &name).is_none(), "of another host");
        }
        assert_eq!((away.records().count(), away.forgotten()), (KEPT, KEPT as u64));
        assert!(away.take("cell", "robot-0").is_none(), "the first was forgotten");
        let last = format!("robot-{}", (2 * KEPT - 1) * 7919 % 1000);
        assert!(away.take("cell", &last).is_some() && away.take("cell", &last).is_none());
    }
}
