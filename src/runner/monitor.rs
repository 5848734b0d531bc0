//! The monitor's loop.

use super::{RunError, Shutdown, Stay, TICK};
use crate::bus::Subscriber;
use crate::messages::{Estimate, Status};
use crate::node::monitor::MonitorNode;

/// What a monitor is connected to.
#[derive(Debug)]
pub struct MonitorPorts {
    /// Estimates in.
    pub estimates: Subscriber<Estimate>,
    /// Heartbeat in.
    pub status: Subscriber<Status>,
}

/// Follows the identifier until asked to stop, or to the end of the first stream; `show` gets each new estimate.
///
/// # Errors
/// The bus or the sink fails.
pub fn run_monitor(
    node: &mut MonitorNode,
    ports: &mut MonitorPorts,
    stay: Stay,
    shutdown: &Shutdown,
    mut show: impl FnMut(&MonitorNode, &Estimate) -> std::io::Result<()>,
) -> Result<(), RunError> {
    loop {
        ports.estimates.wait(TICK)?;
        let stopping = shutdown.requested();
        // A status is read before the estimates and told after them: what it speaks of has arrived then.
        let mut last_status = None;
        ports.status.drain(|status| last_status = Some(*status))?;
        let mut failure = None;
        ports.estimates.drain(|estimate| {
            if node.on_estimate(estimate) && failure.is_none() {
                failure = show(node, estimate).err();
            }
        })?;
        if let Some(e) = failure {
            return Err(e.into());
        }
        if let Some(status) = last_status {
            node.on_status(&status);
        }
        if stopping || (stay == Stay::UntilEnd && node.is_complete()) {
            return Ok(());
        }
    }
}
