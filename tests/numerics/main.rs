//! Numerics: model, rows, simulation and estimators, each against something independent of it.

mod model;
#[cfg(feature = "sim")]
mod sim;
mod support;
