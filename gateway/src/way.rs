//! The way that a robot of a domain goes: out of it or into it, never both.
//!
//! A robot that is sent out is not brought in, and what was brought in is not sent out. So what is on
//! the network was always published by an identifier of the sender's domain, and nothing can go round,
//! over whatever number of hosts and networks. The kernel keeps the lock, so the order in which
//! gateways start has no influence, and a killed one leaves none behind.

use crate::error::GatewayError;
use thetabus::bus::{BusError, Domain, Role, RoleLock};

/// Takes the robot's way, for as long as the lock lives.
///
/// # Errors
/// [`GatewayError::Way`] if another gateway has it, or the lock cannot be used.
pub fn take(domain: &Domain, robot: &str) -> Result<RoleLock, GatewayError> {
    RoleLock::acquire(domain, robot, Role::Gateway).map_err(|e| match e {
        BusError::AlreadyRunning { robot, domain, pid, .. } => GatewayError::Way { robot, domain, pid },
        other => other.into(),
    })
}
