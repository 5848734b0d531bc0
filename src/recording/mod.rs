//! Runs as files, in and out.

mod estimates_csv;

pub use estimates_csv::EstimatesCsv;
