//! A router: passes on what others send, by zenoh itself and without its plugins.

use crate::error::{GatewayError, network};
use crate::network::{self, NetworkArgs, Part};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use zenoh::Wait;

/// How often it looks whether it shall stop.
const PAUSE: Duration = Duration::from_millis(50);

/// Routes until `stop` is set.
///
/// # Errors
/// The network fails, or the configuration is wrong.
pub fn run(args: &NetworkArgs, stop: &AtomicBool) -> Result<(), GatewayError> {
    let Some(session) = network::open(args, Part::Router, stop)? else {
        return Ok(());
    };
    tracing::info!("routes");
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(PAUSE);
    }
    session.close().wait().map_err(network("closing the session"))
}
