//! Counts of a log's rows by kind, with the line of the first one.

/// Number of rows used to find the period of a log.
pub(super) const LOOK: usize = 200;

/// Counts of rows by kind, with the line of the first one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LogCounts {
    /// Rows of data read.
    pub rows: u64,
    /// Rows with the wrong number of fields, or a field that is no number.
    pub unreadable: u64,
    /// Rows with NaN or an infinity.
    pub not_finite: u64,
    /// Rows of the same sample period as the row before.
    pub duplicated: u64,
    /// Rows that are earlier than the row before, or later than those after.
    pub out_of_order: u64,
    /// Rows that were used although they are more than a quarter of a period off the grid.
    pub irregular: u64,
    /// Line of the first refused row.
    pub first_refused: Option<u64>,
    /// Line of the first irregular row.
    pub first_irregular: Option<u64>,
    /// Number of sample periods between consecutive rows without a long gap.
    pub periods: u64,
    /// Their total time span \[ns\].
    pub periods_span_ns: u64,
    /// Configured sample period \[ns\].
    pub period_ns: u64,
}

impl LogCounts {
    /// Rows that gave no sample.
    pub fn refused(&self) -> u64 {
        self.unreadable + self.not_finite + self.duplicated + self.out_of_order
    }

    /// The average period of the rows \[ns\] if it is more than 1 % off the configured one.
    pub fn other_period_ns(&self) -> Option<f64> {
        let mean_ns = self.periods_span_ns as f64 / self.periods as f64;
        let off = (mean_ns / self.period_ns as f64 - 1.0).abs();
        // a few rows are not enough; NaN for no rows is not above
        (self.periods >= LOOK as u64 / 2 && off > 0.01).then_some(mean_ns)
    }
}

impl std::fmt::Display for LogCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.rows, if self.rows == 1 { "row" } else { "rows" })?;
        let kinds = [
            (self.unreadable, "unreadable"),
            (self.not_finite, "not finite"),
            (self.duplicated, "duplicated"),
            (self.out_of_order, "out of order"),
        ];
        for (count, what) in kinds.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {what}")?;
        }
        if let Some(line) = self.first_refused {
            write!(f, " (the first in line {line})")?;
        }
        if let Some(line) = self.first_irregular {
            write!(f, ", {} irregularly timed (the first in line {line})", self.irregular)?;
        }
        if let Some(mean_ns) = self.other_period_ns() {
            let (mean, configured) = (mean_ns * 1e-9, self.period_ns as f64 * 1e-9);
            write!(
                f,
                ", {mean:.6} s apart on average and not {configured} s: set plant.sample_period_s to it"
            )?;
        }
        Ok(())
    }
}
