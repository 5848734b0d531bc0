//! Numerics: model, rows, simulation and estimators, each against something independent of it.

#[cfg(feature = "sim")]
mod compare;
#[cfg(feature = "config")]
mod config;
#[cfg(feature = "sim")]
mod emps;
mod estimator;
#[cfg(feature = "sim")]
mod estimator_study;
#[cfg(feature = "sim")]
mod faults;
mod model;
#[cfg(feature = "sim")]
mod projected;
mod relations;
#[cfg(feature = "sim")]
mod sim;
mod support;
