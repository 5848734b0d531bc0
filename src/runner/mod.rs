//! The runner: paces, waits, drains, publishes and handles signals, so that the nodes need not.
//!
//! ```text
//! plant:       node.next_sample ─▶ pace ─▶ send, wake
//! controller:  wait ─▶ drain ─▶ feed-forward ─▶ send commands
//! identifier:  wait ─▶ drain ─▶ node.on_sample ─▶ send estimates; heartbeat; serve late joiners
//! monitor:     wait ─▶ drain ─▶ node.on_estimate, node.on_status ─▶ the caller's sink
//! ```
//!
//! Each loop ends when the process is asked to stop, or, if so configured, with the stream. Between
//! a sample's arrival and the sending of its estimate nothing here allocates, locks or logs.

mod controller;
mod desk;
mod identifier;
mod log_state;
mod monitor;
mod pace;
mod plant;
mod realtime;
mod session;
mod shutdown;
mod stopwatch;

pub use controller::{ControllerPorts, Follower, run_controller};
pub use desk::{Board, DeskEnd, FromLoop, LoopEnd, ToLoop, desk};
pub use identifier::run_sessions;
pub use monitor::{MonitorPorts, MonitorSink, run_monitor};
pub use pace::{Pace, PaceReport};
pub use plant::{CommandPort, PlantReport, SampleSource, run_plant};
pub use realtime::apply_realtime;
pub use session::{IdentifierPorts, Session};
pub use shutdown::{Shutdown, TOGETHER};

use crate::bus::BusError;
use crate::messages::Description;
use std::time::Duration;
use thiserror::Error;

/// Longest wait of an idle service, and so the longest delay for late joiners and signals.
pub const TICK: Duration = crate::bus::IDLE_TICK;
/// Period of the identifier's heartbeat.
pub const HEARTBEAT: Duration = Duration::from_millis(500);

/// When a consumer's loop ends by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stay {
    /// A service: any number of streams, until asked to stop.
    Forever,
    /// To the end of the first stream.
    UntilEnd,
}

/// Why a loop ended early.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The source of samples ended early.
    #[error(
        "the simulation stopped at sample {seq} of {samples}: its state is no longer finite; the loop is unstable with these \
         gains or this step (plant.controller, plant.substeps)"
    )]
    SourceEnded {
        /// The sample that could not be produced.
        seq: u64,
        /// Expected number of samples.
        samples: u64,
    },
    /// The results could not be written.
    #[error("writing results: {0}")]
    Sink(#[from] std::io::Error),
    /// The estimates are of another model than the monitor's labels.
    #[error("the estimates are of another model than the monitor's names and units")]
    ForeignModel(Option<Box<Description>>),
    /// Signals cannot be handled.
    #[error("cannot handle signals: {0}")]
    Signals(String),
}
