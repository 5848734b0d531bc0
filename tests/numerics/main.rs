//! Numerics: model, rows, simulation and estimators, each against an independent result.

mod advice;
#[cfg(feature = "sim")]
mod belt;
mod cedro;
#[cfg(feature = "config")]
mod cell;
#[cfg(feature = "config")]
mod config;
#[cfg(feature = "config")]
mod configured;
#[cfg(feature = "sim")]
mod considered;
#[cfg(feature = "studies")]
mod efficiency;
#[cfg(all(feature = "robot", feature = "studies"))]
mod efficiency_robot;
#[cfg(feature = "studies")]
mod emps;
#[cfg(feature = "studies")]
mod encoder_study;
mod equations;
mod estimator;
#[cfg(feature = "sim")]
mod estimator_study;
#[cfg(feature = "config")]
mod evidence;
#[cfg(feature = "config")]
mod facade;
#[cfg(feature = "sim")]
mod faults;
#[cfg(feature = "studies")]
mod first_blocks;
#[cfg(feature = "sim")]
mod intake;
mod model;
#[cfg(feature = "sim")]
mod projected;
#[cfg(all(feature = "robot", feature = "studies"))]
mod random_robots;
mod relations;
#[cfg(feature = "robot")]
mod robot;
#[cfg(all(feature = "robot", feature = "studies"))]
mod robot_study;
#[cfg(feature = "config")]
mod short_moves;
#[cfg(feature = "sim")]
mod sim;
#[cfg(feature = "sim")]
mod standstill;
#[cfg(feature = "studies")]
mod studies;
mod support;
#[cfg(feature = "config")]
mod timing;
#[cfg(feature = "studies")]
mod trials;
#[cfg(feature = "sim")]
mod unmodelled;
#[cfg(feature = "studies")]
mod whole_runs;
