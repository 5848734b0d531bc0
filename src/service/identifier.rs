//! The identifier as a process.

use super::args::domain;
use super::desk::{Desk, last_checkpoint};
use super::wiring::identifier_node;
use super::{Exit, Failure, IdentifierArgs, child, logging, warm};
use crate::bus::{Bus, Publisher, Role, RoleLock, SampleSubscriber, monotonic_ns};
use crate::messages::{Estimate, State};
use crate::node::command::NodeState;
use crate::runner::{IdentifierPorts, Shutdown, TICK, apply_realtime, desk, run_identifier};
use std::time::{Duration, Instant};

/// Identifies a robot's parameters from its samples until it is asked to stop.
///
/// # Errors
/// A wrong configuration, a second identifier of this robot, a bus that fails.
pub fn run(args: &IdentifierArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let started_ns = monotonic_ns();
    let common = &args.common;
    child::follow_launcher(common)?;
    let config = common.load(Vec::new(), &[])?;
    let domain = domain(&config)?;
    let robot = &config.bus.robot;
    let _only_one = RoleLock::acquire(&domain, robot, Role::Identifier)?;
    let mut node = identifier_node(&config)?;
    let (loop_end, desk_end) = desk();
    let warm = match args.warm {
        true => warm::start(&config, &mut *node, Some(&desk_end.board))?,
        false => None,
    };

    let bus = Bus::join(&domain, robot, "identifier")?;
    let status = Publisher::new(&bus)?;
    let mut estimates = Publisher::new(&bus)?;
    let limit = Duration::from_secs_f64(config.bus.lockstep_limit_s);
    if common.launched.receipts {
        estimates.await_receipts(&bus, limit, shutdown.flag())?;
    }
    await_readers(&mut estimates, common.launched.await_consumers, limit, shutdown)?;
    let desk = Desk::open(&domain, &config, desk_end, warm)?;
    // Last: in lockstep the plant starts when this one listens.
    let samples = SampleSubscriber::new(&bus)?;
    tracing::info!(
        robot,
        domain = domain.name(),
        block_len = config.estimator.block_len,
        "identifier"
    );
    if !samples.is_connected() {
        tracing::info!(robot, domain = domain.name(), "no plant yet, waiting for its samples");
    }
    let mut ports = IdentifierPorts {
        samples,
        estimates,
        status,
        desk: loop_end,
        started_ns,
        realtime: apply_realtime(&config.realtime.identifier),
    };
    let outcome = run_identifier(&mut *node, &mut ports, common.stay(), shutdown);
    // Whoever waits at the desk for an answer of the loop need not wait any longer.
    drop(ports);
    desk.close();
    let mut state = NodeState::default();
    node.save(&mut state);
    last_checkpoint(&config, &state);
    outcome?;
    let status = node.status();
    if !common.is_launched() {
        logging::result(&format!(
            "{} samples accepted, {} missing, {} rejected, {} estimates in the last of {} streams",
            status.accepted, status.missing, status.rejected, status.estimates, status.streams
        ))?;
    }
    let ended = status.state == State::Ended as u32;
    Ok(if shutdown.requested() && !ended {
        Exit::Interrupted
    } else {
        Exit::Done
    })
}

/// Gives readers of the estimates the chance to be there before the first one.
fn await_readers(
    estimates: &mut Publisher<Estimate>,
    count: usize,
    limit: Duration,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let start = Instant::now();
    while estimates.subscribers() < count && start.elapsed() < limit && !shutdown.requested() {
        estimates.serve_late_joiners()?;
        std::thread::sleep(TICK / 20);
    }
    Ok(())
}
