//! From samples to the rows that an estimator sees.

mod pointwise;

pub use pointwise::{InputSource, PointwiseBlock, structure};
