//! The simulated machine as a process.

use super::args::domain;
use super::readiness::ready;
use super::{Exit, Failure, PlantArgs, child, logging};
use crate::bus::{Bus, Delivery, Role, RoleLock, SamplePublisher, Subscriber};
use crate::config::{Config, FeedForward, Speed};
use crate::node::simulated_plant::sample_stream_of;
use crate::runner::{CommandPort, Pace, Shutdown, apply_realtime, run_plant};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::Duration;

/// Simulates the configured machine and publishes its samples, from start to END.
///
/// # Errors
/// If the configuration is wrong, this robot already has a plant, no consumer attaches in lockstep,
/// or the bus fails.
pub fn run(args: &PlantArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    child::follow_launcher(&args.common)?;
    let config = args.common.load(Vec::new(), &args.overrides())?;
    let domain = domain(&config)?;
    let robot = &config.bus.robot;
    let _only_one = RoleLock::acquire(&domain, robot, Role::Plant)?;

    let sim = &config.plant.sim;
    let samples = sim.sample_count();
    let mut node = sample_stream_of(&*config.model, sim, stream_id()).map_err(Failure::usage)?;

    let bus = Bus::join(&domain, robot, "plant_simulator")?;
    let delivery = delivery(&config);
    let mut publisher = SamplePublisher::new(&bus, delivery, shutdown.flag())?;
    tracing::info!(
        robot,
        domain = domain.name(),
        samples,
        delivery = delivery.name(),
        "plant simulator"
    );
    if delivery == Delivery::Realtime {
        publisher.hold_for(args.common.launched.await_consumers, limit(&config));
    }
    let pace = Pace::new(match config.plant.speed {
        Speed::Max => None,
        Speed::Factor(factor) => Some(factor),
    });
    apply_realtime(&config.realtime.plant);
    let commands = match config.controller.feed_forward {
        FeedForward::None => None,
        _ => {
            let awaited = (delivery != Delivery::Realtime).then(|| limit(&config));
            Some(CommandPort::new(Subscriber::new(&bus)?, awaited))
        }
    };
    if !args.common.is_launched() {
        ready();
    }
    let report = run_plant(&mut node, &mut publisher, commands, pace, shutdown)?;
    if report.pace.restarts > 0 {
        tracing::warn!(
            times = report.pace.restarts,
            "the plant could not keep its pace or was stopped, and its schedule started anew"
        );
    }
    if !args.common.is_launched() {
        logging::result(&format!("{} of {samples} samples sent", report.sent))?;
    }
    Ok(if !report.loss.is_none() {
        Exit::DataLoss
    } else if shutdown.requested() && report.sent < samples {
        Exit::Interrupted
    } else {
        Exit::Done
    })
}

pub(super) fn delivery(config: &Config) -> Delivery {
    if config.bus.lockstep(config.plant.speed) {
        Delivery::Lockstep {
            consumers: config.bus.lockstep_consumers,
            limit: limit(config),
        }
    } else {
        Delivery::Realtime
    }
}

pub(super) fn limit(config: &Config) -> Duration {
    Duration::from_secs_f64(config.bus.lockstep_limit_s)
}

/// A number that no earlier plant had; 0 means "none yet" in status.
pub(super) fn stream_id() -> u64 {
    RandomState::new().build_hasher().finish().max(1)
}
