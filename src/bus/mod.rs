//! Topics on shared memory; the only module that uses iceoryx2.
//!
//! ```text
//! plant ── sample ──▶ identifier ── estimate ──▶ monitor, controllers, anything
//!                          └─────── status ────▶
//! ```
//!
//! | topic | publishers | QoS |
//! |---|---|---|
//! | `sample` + event | one | by [`Delivery`]; 16 subscribers; in real time buffer 4096, history 256 |
//! | `estimate` + event | one, and a spare for bridges | overflow on, buffer 64, history 1; 32 subscribers |
//! | `status` | one, and a spare for bridges | overflow on, buffer 64, history 1; 32 subscribers |
//! | `description` | one, and a spare for bridges | overflow on, buffer 1, history 1; 32 subscribers |
//! | `journal` | one, and a spare for bridges | overflow on, buffer 64, history 64; 32 subscribers |
//! | `command` + event | one, and a spare | overflow on, buffer 16, history 1; 32 subscribers |
//! | `control` + event | request-response: one server, 8 clients | one request at a time per client |
//!
//! Numbers of subscribers and the buffer of samples are defaults: [`Limits`]. Service names are
//! `thetabus/<robot>/<topic>`, isolated from other runs by a [`Domain`]. Every message has the user
//! header [`Header`]. Ports belong to the thread that created them. The next process that joins
//! cleans up after a killed one.
//!
//! # Subscribing to the estimates
//!
//! ```no_run
//! use std::time::Duration;
//! use thetabus::bus::{Bus, Domain, Subscriber};
//! use thetabus::messages::Estimate;
//!
//! # fn main() -> Result<(), thetabus::bus::BusError> {
//! let bus = Bus::join(&Domain::new("default")?, "arm", "my_controller")?;
//! let mut estimates = Subscriber::<Estimate>::new(&bus)?;
//! loop {
//!   estimates.wait(Duration::from_millis(100))?;
//!   estimates.drain(|estimate| println!("block {}: {:?}", estimate.block, &estimate.theta[..9]))?;
//! }
//! # }
//! ```

mod bare;
mod control;
mod domain;
mod error;
mod half_made;
mod inspect;
mod lock;
mod lock_file;
mod machine;
mod management;
mod membership;
mod memory;
mod objects;
mod orphans;
mod participant;
mod publisher;
mod receipts;
mod sample_publisher;
mod sample_subscriber;
mod strangers;
mod subscriber;
#[cfg(test)]
mod tests;
mod time_limit;
mod topic;
mod watch;
mod wiped;

pub use crate::words::is_name;
pub use bare::{BareLink, End};
pub use control::{Asked, ControlClient, ControlServer, Pending};
pub use domain::{Domain, Limits};
pub use error::{BusError, ICEORYX2_VERSION};
pub use inspect::{
    Cleaned, DomainReport, LockReport, MemoryReport, NodeReport, ServiceReport, clean, domains, inspect,
};
pub use lock::{Role, RoleLock};
pub use machine::Machine;
pub use memory::shared_memory;
pub use participant::Bus;
pub use publisher::Publisher;
pub use sample_publisher::{Attached, Delivery, Loss, SamplePublisher};
pub use sample_subscriber::SampleSubscriber;
pub use subscriber::Subscriber;
pub use topic::{Latched, Topic};

use crate::messages::{Header, Request, Response};
use iceoryx2::prelude::ipc;
use std::time::Duration;

type Node = iceoryx2::node::Node<ipc::Service>;
type EventService = iceoryx2::service::port_factory::event::PortFactory<ipc::Service>;
type Listener = iceoryx2::port::listener::Listener<ipc::Service>;
type Notifier = iceoryx2::port::notifier::Notifier<ipc::Service>;
type PubSubService<T> = iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, T, Header>;
type ControlService =
    iceoryx2::service::port_factory::request_response::PortFactory<ipc::Service, Request, (), Response, ()>;
type PublisherPort<T> = iceoryx2::port::publisher::Publisher<ipc::Service, T, Header>;
type SubscriberPort<T> = iceoryx2::port::subscriber::Subscriber<ipc::Service, T, Header>;

/// Longest period for servicing a port: publishers connect late joiners, consumers connect to new
/// publishers.
pub const IDLE_TICK: Duration = Duration::from_millis(100);

/// CLOCK_MONOTONIC \[ns\], the clock of [`Header::sent_ns`].
pub fn monotonic_ns() -> u64 {
    // Linux always has this clock; 0 would mean "unknown".
    nix::time::clock_gettime(nix::time::ClockId::CLOCK_MONOTONIC)
        .map_or(0, |now| (now.tv_sec() as u64) * 1_000_000_000 + now.tv_nsec() as u64)
}
