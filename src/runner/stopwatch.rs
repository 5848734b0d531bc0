//! Mean, 99th percentile and maximum of durations, in memory of fixed size.
//!
//! A histogram with 16 equal steps in each factor of two: any percentile is known to 1/16, at the
//! cost of a few instructions per value.

use crate::messages::Timing;
use std::time::Duration;

const STEPS: usize = 16;
/// 1 ns to 2^44 ns, five hours.
const CELLS: usize = 41 * STEPS;

/// Collects durations.
#[derive(Debug, Clone)]
pub(super) struct Stopwatch {
    cells: Box<[u64; CELLS]>,
    count: u64,
    sum_ns: u64,
    max_ns: u64,
}

impl Stopwatch {
    pub(super) fn new() -> Self {
        Self {
            cells: Box::new([0; CELLS]),
            count: 0,
            sum_ns: 0,
            max_ns: 0,
        }
    }

    pub(super) fn add(&mut self, duration: Duration) {
        let ns = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        self.cells[cell(ns)] += 1;
        self.count += 1;
        self.sum_ns = self.sum_ns.saturating_add(ns);
        self.max_ns = self.max_ns.max(ns);
    }

    pub(super) fn timing(&self) -> Timing {
        let rank = self.count - self.count / 100;
        let mut below = 0;
        let index = self.cells.iter().position(|&in_cell| {
            below += in_cell;
            below >= rank
        });
        Timing {
            count: self.count,
            mean_ns: self.sum_ns / self.count.max(1),
            p99_ns: index.map_or(0, upper).min(self.max_ns),
            max_ns: self.max_ns,
        }
    }
}

/// 0 to 15 have a cell each; above, the four bits after the leading one select one of 16 per power
/// of two.
fn cell(ns: u64) -> usize {
    if ns < STEPS as u64 {
        return ns as usize;
    }
    let power = ns.ilog2() as usize;
    let step = (ns >> (power - 4)) as usize - STEPS;
    ((power - 3) * STEPS + step).min(CELLS - 1)
}

/// The largest value of a cell.
fn upper(cell: usize) -> u64 {
    if cell < STEPS {
        return cell as u64;
    }
    let (power, step) = (cell / STEPS + 3, cell % STEPS);
    (((STEPS + step + 1) as u64) << (power - 4)) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_value_lies_in_a_cell_that_is_at_most_a_sixteenth_wide() {
        let mut last = 0;
        for ns in (0..100_000u64).chain((17..44).map(|power| (1 << power) + 12_345)) {
            let cell = cell(ns);
            assert!(cell >= last, "{ns}");
            last = cell;
            let upper = upper(cell);
            assert!(
                ns <= upper && upper as f64 <= ns as f64 * (1.0 + 1.0 / 16.0),
                "{ns} in a cell up to {upper}"
            );
        }
        assert_eq!(cell(u64::MAX), CELLS - 1);
    }

    #[test]
    fn prop_figures_of_a_thousand_durations() {
        let mut stopwatch = Stopwatch::new();
        assert_eq!(stopwatch.timing(), Timing::default());
        (1..=1000).for_each(|us| stopwatch.add(Duration::from_micros(us)));
        let timing = stopwatch.timing();
        assert_eq!(
            (timing.count, timing.mean_ns, timing.max_ns),
            (1000, 500_500, 1_000_000)
        );
        assert!((990_000..1_000_001).contains(&timing.p99_ns), "{timing:?}");
    }
}
