//! Numerics: model, rows, simulation and estimators, each against something independent of it.

#[cfg(feature = "sim")]
mod compare;
#[cfg(feature = "config")]
mod config;
#[cfg(feature = "sim")]
mod considered;
#[cfg(feature = "sim")]
mod emps;
mod estimator;
#[cfg(feature = "sim")]
mod estimator_study;
#[cfg(feature = "config")]
mod evidence;
#[cfg(feature = "sim")]
mod faults;
#[cfg(feature = "sim")]
mod intake;
mod model;
#[cfg(feature = "sim")]
mod projected;
mod relations;
#[cfg(feature = "sim")]
mod sim;
#[cfg(feature = "sim")]
mod standstill;
mod support;
#[cfg(feature = "config")]
mod trials;
#[cfg(feature = "sim")]
mod unmodelled;
