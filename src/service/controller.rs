//! The controller as a process.

use super::args::domain;
use super::{ControllerArgs, Exit, Failure, child, logging};
use crate::bus::{Bus, Publisher, Role, RoleLock, SampleSubscriber, Subscriber};
use crate::config::FeedForward;
use crate::control::{AdaptiveFeedForward, Trajectory};
use crate::messages::nanoseconds;
use crate::runner::{ControllerPorts, Follower, Shutdown, run_controller};

/// Sends feed-forward along the configured setpoints, from estimates or from fixed values, until
/// asked to stop.
///
/// # Errors
/// If the configuration has no controller or has setpoints that jump, if this robot already has a
/// controller, or if the bus fails.
pub fn run(args: &ControllerArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let common = &args.common;
    child::follow_launcher(common)?;
    let config = common.load(Vec::new(), &[])?;
    let settings = &config.controller;
    if settings.feed_forward == FeedForward::None {
        return Err(Failure::Usage(
            "there is nothing to control with: set controller.feed_forward = \"adaptive\" or \"fixed\", as config/adaptive.toml does".to_owned(),
        ));
    }
    let domain = domain(&config)?;
    let robot = &config.bus.robot;
    let _only_one = RoleLock::acquire(&domain, robot, Role::Controller)?;
    let sim = &config.plant.sim;
    let mut follower = Follower {
        trajectory: Trajectory::of(&*config.model, sim).map_err(Failure::usage)?,
        feed_forward: AdaptiveFeedForward::new(config.model.clone(), &settings.theta, settings.options)
            .map_err(|e| Failure::Usage(format!("controller: {e}")))?,
        period_ns: nanoseconds(sim.sample_period_s),
        deadline_ns: nanoseconds(settings.deadline_s),
    };
    let bus = Bus::join(&domain, robot, "controller")?;
    let adaptive = settings.feed_forward == FeedForward::Adaptive;
    let mut ports = ControllerPorts {
        commands: Publisher::new(&bus)?,
        estimates: adaptive.then(|| Subscriber::new(&bus)).transpose()?,
        // Last, because in lockstep the plant starts when this process subscribes.
        samples: SampleSubscriber::new(&bus)?,
    };
    tracing::info!(robot, domain = domain.name(), adaptive, "controller");
    let answered = run_controller(&mut follower, &mut ports, common.stay(), shutdown)?;
    if !common.is_launched() {
        let knowledge = format!("{:?}", follower.feed_forward.knowledge()).to_lowercase();
        logging::result(&format!("{answered} samples answered; parameters {knowledge}"))?;
    }
    Ok(if shutdown.requested() {
        Exit::Interrupted
    } else {
        Exit::Done
    })
}
