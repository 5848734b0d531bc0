//! Tables and figures from estimates.

mod summary;

pub use summary::{ChangeSummary, DerivedSummary, ParameterSummary, SampleCounts, Summary};
