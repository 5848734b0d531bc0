//! Numerics: model, rows, simulation and estimators, each against something independent of it.

#[cfg(feature = "config")]
mod config;
mod estimator;
mod model;
#[cfg(feature = "sim")]
mod sim;
mod support;
