//! On-line identification of a running machine's physical parameters.
//!
//! thetabus attaches to a machine through shared memory and publishes its physical parameters with
//! their uncertainty, live, every N samples. The method is weighted recursive least squares,
//! generalised to models that are nonlinear in their parameters by linearising around the current
//! estimate; it starts from L. Cedro, *Model parameter on-line identification with nonlinear
//! parametrization – manipulator model* (Technical Transactions e2022007, 2022).
//!
//! It is also a library that needs no bus. This example simulates and identifies a two-joint arm:
#![cfg_attr(feature = "sim", doc = "```")]
#![cfg_attr(not(feature = "sim"), doc = "```ignore")]
//! use thetabus::identify::Identifier;
//! use thetabus::model::Manipulator;
//! use thetabus::sim::{ArmSimulator, SimOptions};
//!
//! let mut identifier = Identifier::builder(Manipulator::default())
//!     .exact_derivatives()
//!     .block_len(1900)
//!     .build()?;
//! let arm = SimOptions::cedro2022();
//! for sample in ArmSimulator::new(&arm)?.take(1900) {
//!     let Some(estimate) = identifier.push(&sample) else { continue };
//!     let values = estimate.theta.iter().zip(arm.true_theta(0.0));
//!     for (name, (theta_hat, theta)) in identifier.names().as_slice().iter().zip(values) {
//!         println!("{name} = {theta_hat:.9}, true {theta:.9}");
//! #       assert!((theta_hat / theta - 1.0).abs() < 1e-6);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The service consists of three processes on [iceoryx2](https://docs.rs/iceoryx2) topics:
//!
//! ```text
//! plant_simulator ──sample──▶ identifier ──estimate──▶ monitor, adaptive controllers, anything
//! (or your machine)                └──────status────▶
//! ```
//!
//! # Where things are
//!
//! | module | what | feature |
//! |---|---|---|
//! | [`model`] | the equations of a plant: the manipulator (24)–(27), the servo axis, or your own | |
//! | [`rows`] | samples → rows | |
//! | [`estimator`] | WRLS (2)–(4), the block recursion (6)–(11) and what lies beyond it | |
//! | [`messages`] | the bus payloads | |
//! | [`identify`] | identification in a few lines: a plant, samples in, estimates out | |
//! | [`control`] | feed-forward from estimates with `use_ok` | |
//! | [`node`] | plant, identifier and monitor as values: messages in, messages out, no I/O, no clock | |
//! | `sim` | the simulated arm (12)–(23) and servo axis, their sensors and faults | `sim` |
//! | `config` | TOML files ⇄ validated core types | `config` |
//! | `offline` | log files with columns of your own | `config` |
//! | `robot` | robots of up to 8 joints from a URDF | `robot` |
//! | `bus` | topics on shared memory, the only place that names iceoryx2 | `bus` |
//! | `recording` | MCAP and CSV files of a run | `recording` |
//! | `report` | summary, figures and page of a run | `report` |
//! | `live` | live views of an identification: a table in the terminal, a page in the browser, a stream for Foxglove | `live`, `web`, `foxglove` |
//! | `runner`, `service` | the programs: pacing, waiting, publishing, signals | `service` |
//! | `checkpoint` | the identifier's state, saved for its next start | `service` |
//! | `studies` | comparisons of estimators and trials of the evidence: the tables in `docs/` | `studies` |
//! | [`notation`] | every symbol of the paper with its name in the code | |
//!
//! `estimator` imports no other module: it sees rows, never a model or the simulator, so it works
//! for any plant and cannot see the truth. `model` imports only a helper for hashes.

#[cfg(feature = "bus")]
pub mod bus;
#[cfg(feature = "service")]
pub mod checkpoint;
#[cfg(feature = "config")]
pub mod config;
pub mod control;
pub mod estimator;
#[cfg(feature = "recording")]
mod files;
pub mod identify;
#[cfg(feature = "live")]
pub mod live;
pub mod messages;
pub mod model;
pub mod node;
pub mod notation;
#[cfg(feature = "config")]
pub mod offline;
#[cfg(any(feature = "config", feature = "recording"))]
mod pipe;
mod random;
#[cfg(feature = "recording")]
pub mod recording;
#[cfg(feature = "report")]
pub mod report;
#[cfg(feature = "robot")]
pub mod robot;
pub mod rows;
#[cfg(feature = "service")]
pub mod runner;
#[cfg(feature = "service")]
pub mod service;
#[cfg(feature = "sim")]
pub mod sim;
#[cfg(feature = "studies")]
pub mod studies;
mod words;

// The README's program compiles.
#[cfg(all(doctest, feature = "bus"))]
#[doc = include_str!("../README.md")]
struct Readme;
