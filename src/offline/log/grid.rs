//! Maps times of rows to places on the grid of sample periods, and refuses implausible ones.

use super::super::log_counts::LogCounts;
use super::super::log_error::{LogError, cut};
use super::super::suspicion::judge_period;
use super::row::{Row, RowReader};
use crate::messages::nanoseconds;
use std::collections::VecDeque;

/// Longest hole \[sample periods\] that counts in the average period.
const LONGEST_HOLE: f64 = 10.0;

/// Why a row gives no sample.
#[derive(Debug, Clone, Copy)]
pub(super) enum Refusal {
    Unreadable,
    NotFinite,
    Duplicated,
    OutOfOrder,
}

/// Position of the rows so far.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    period_s: f64,
    first_t_s: Option<f64>,
    /// Time of the last row in order, whether it was used or is a duplicate.
    row_s: f64,
    /// Time and `seq` of the last row that was used.
    pub last: Option<(f64, u64)>,
}

impl Grid {
    pub fn new(period_s: f64) -> Self {
        Self {
            period_s,
            first_t_s: None,
            row_s: f64::NEG_INFINITY,
            last: None,
        }
    }

    /// Time since the first row that was used \[s\].
    pub fn since_first(&self, t_s: f64) -> f64 {
        t_s - self.first_t_s.unwrap_or(t_s)
    }

    /// Time of the last row that was used \[s\].
    pub fn before(&self) -> f64 {
        self.last.map_or(f64::NEG_INFINITY, |(t_s, _)| t_s)
    }

    /// The `seq` of a row; `judges` are the rows after it.
    ///
    /// # Errors
    /// Why the row's time gives no sample.
    pub fn place<'a>(
        &mut self,
        row: &Row,
        judges: impl Iterator<Item = &'a Row>,
        counts: &mut LogCounts,
    ) -> Result<u64, Refusal> {
        let before = self.before();
        if row.t_s < before {
            return Err(Refusal::OutOfOrder);
        }
        if row.t_s == before {
            return Err(Refusal::Duplicated);
        }
        // One time far ahead would refuse all rows after it, so it is checked against them before
        // it is accepted.
        let (mut all, mut overtaken) = (0, 0);
        for judge in judges {
            all += 1;
            overtaken += usize::from(before < judge.t_s && judge.t_s < row.t_s);
        }
        if 2 * overtaken > all {
            return Err(Refusal::OutOfOrder);
        }
        let distance_s = row.t_s - self.row_s;
        self.row_s = row.t_s;
        // in whole periods, so that neither lost rows nor uneven time stamps bias the average
        let periods = (distance_s / self.period_s).round();
        if distance_s >= 0.0 && periods <= LONGEST_HOLE {
            counts.periods += periods as u64;
            counts.periods_span_ns += nanoseconds(distance_s);
        }
        let first = *self.first_t_s.get_or_insert(row.t_s);
        let on_grid = (row.t_s - first) / self.period_s;
        let mut seq = on_grid.round().max(0.0) as u64;
        if let Some((last_t_s, last_seq)) = self.last
            && seq <= last_seq
        {
            // Two rows in the same period because of jitter are two samples, unless there are more
            // rows than periods.
            let next = last_seq.saturating_add(1);
            if row.t_s - last_t_s < 0.5 * self.period_s || next as f64 - on_grid > 0.75 {
                return Err(Refusal::Duplicated);
            }
            seq = next;
        }
        if (on_grid - seq as f64).abs() > 0.25 {
            counts.irregular += 1;
            counts.first_irregular.get_or_insert(row.line);
        }
        Ok(seq)
    }

    /// Checks that the median distance of the first rows is the configured period.
    ///
    /// # Errors
    /// If it is not.
    pub fn check_period(&self, ahead: &VecDeque<Row>, reader: &RowReader) -> Result<(), LogError> {
        let Some(column) = reader.time_column() else {
            return Ok(());
        };
        let steps = ahead.iter().zip(ahead.iter().skip(1)).map(|(a, b)| b.t_s - a.t_s);
        let back = steps.clone().filter(|step| *step < 0.0).count();
        if 2 * back > steps.len() {
            return Err(LogError::Backwards {
                column: cut(column),
                back,
                steps: steps.len(),
            });
        }
        let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
        steps.sort_by(f64::total_cmp);
        let Some(&median) = steps.get(steps.len() / 2) else {
            return Ok(());
        };
        // uneven stamps have the right mean, and a log with a pause has the right median
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        let is_off = |period_s: f64| (period_s / self.period_s - 1.0).abs() > 0.2;
        if is_off(median) && is_off(mean) {
            return Err(LogError::Period {
                column: cut(column),
                got_s: (median * 1e9).round() * 1e-9,
                expected_s: self.period_s,
                likely: judge_period(median, self.period_s, reader.time_unit_s()).map(Box::new),
            });
        }
        Ok(())
    }

    /// Drops a first row far before all others, which would begin the log with a gap of years.
    pub fn check_first(&self, ahead: &mut VecDeque<Row>, counts: &mut LogCounts) {
        let far = |gap: f64| gap > 1000.0 * self.period_s;
        let mut times = ahead.iter().map(|row| row.t_s);
        if let [Some(first), Some(second), Some(third)] = [times.next(), times.next(), times.next()]
            && far(second - first)
            && !far((third - second).abs())
            && let Some(row) = ahead.pop_front()
        {
            counts.out_of_order += 1;
            let line = counts.first_refused.get_or_insert(row.line);
            *line = row.line.min(*line);
        }
    }
}
