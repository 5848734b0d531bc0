//! The topics of a recording over the Foxglove protocol, for Foxglove and Lichtblick.
//!
//! The messages are those of a recording, byte for byte: same topics, schemas and encoding. Clients
//! cannot send requests.

use crate::messages::{Estimate, Sample, Status};
use crate::recording::{Encoder, NameCollision, RunInfo};
use foxglove::{ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer};
use std::net::SocketAddr;
use std::sync::Arc;
use thiserror::Error;

/// Largest number of messages waiting for a client; the oldest are dropped first.
const WAITING: usize = 1024;

/// Why the server could not start.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FoxgloveStartError {
    /// The plant's names.
    #[error(transparent)]
    Names(#[from] NameCollision),
    /// The address, or the server.
    #[error("{0}")]
    Server(#[from] FoxgloveError),
}

/// A server for clients of the Foxglove protocol; it ends with the process.
pub struct FoxgloveServer {
    encoder: Encoder,
    channels: Vec<Arc<RawChannel>>,
    handle: foxglove::WebSocketServerHandle,
    /// Server and channels hold weak references to it: without it nothing is advertised.
    _context: Arc<Context>,
}

impl FoxgloveServer {
    /// Listens; port 0 for any free port.
    ///
    /// # Errors
    /// If the address is in use or not one of this machine, or names of the plant collide.
    pub fn start(info: &RunInfo, address: SocketAddr) -> Result<Self, FoxgloveStartError> {
        let encoder = Encoder::new(info)?;
        let context = Context::new();
        let channel = |channel: &crate::recording::Channel| {
            let schema = channel.schema.clone().into_bytes();
            ChannelBuilder::new(&channel.topic)
                .context(&context)
                .message_encoding("cdr")
                .schema(Schema::new(&channel.schema_name, "ros2msg", schema))
                .build_raw()
        };
        let channels = encoder.channels().iter().map(channel).collect::<Result<_, _>>()?;
        let handle = WebSocketServer::new()
            .name(format!("thetabus {}", info.robot))
            .bind(address.ip().to_string(), address.port())
            .message_backlog_size(WAITING)
            .context(&context)
            .start_blocking()?;
        Ok(Self {
            encoder,
            channels,
            handle,
            _context: context,
        })
    }

    /// The port that it listens on.
    pub fn port(&self) -> u16 {
        self.handle.port()
    }

    /// Sends a sample.
    pub fn sample(&mut self, sample: &Sample) {
        if self.channels[0].has_sinks() {
            let meta = PartialMetadata::with_log_time(sample.t_ns);
            self.channels[0].log_with_meta(self.encoder.sample(sample), meta);
        }
    }

    /// Sends an estimate.
    pub fn estimate(&mut self, estimate: &Estimate) {
        if self.channels[1].has_sinks() {
            let meta = PartialMetadata::with_log_time(estimate.t_last_ns);
            self.channels[1].log_with_meta(self.encoder.estimate(estimate), meta);
        }
    }

    /// Sends a status.
    pub fn status(&mut self, status: &Status) {
        if self.channels[2].has_sinks() {
            let meta = PartialMetadata::with_log_time(status.last_t_ns);
            self.channels[2].log_with_meta(self.encoder.status(status), meta);
        }
    }
}
