//! Into a domain: keys of the network to topics of a bus on this host.
//!
//! ```text
//! thetabus/<host>/<robot>/<topic> ── callbacks of zenoh ──▶ inbox ── one thread ──▶ bus
//!                                                                       │  ▲
//!                     questions to thetabus/<host>/<robot>/control ◀────┘  └── requests of ctl
//! ```
//!
//! In the domain this process is the identifier of each robot that it brings, and its plant where
//! it brings samples.

use crate::error::{GatewayError, network};
use crate::inbox::{Inbox, Presence};
use crate::keys::{self, Host};
use crate::network::{self, NetworkArgs, Part};
use crate::robots::RemoteRobots;
use crate::silence::Silence;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use thetabus::bus::{Bus, Domain, IDLE_TICK, Topic};
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// What comes into a domain.
#[derive(Debug, Clone, clap::Args)]
pub struct InArgs {
    /// Domain of the bus
    #[arg(long, default_value = "default")]
    pub domain: String,
    /// Host whose robots are brought in [default: all]
    #[arg(long)]
    pub from: Option<String>,
    /// Robot; may be repeated [default: all]
    #[arg(long, value_parser = keys::robot)]
    pub robot: Vec<String>,
    /// Bring in the samples, too, if their host sends them
    #[arg(long)]
    pub samples: bool,
    /// Take no commands from the domain
    #[arg(long)]
    pub no_control: bool,
    /// Largest number of robots; each takes some megabytes of shared memory
    #[arg(long, default_value_t = 64, value_parser = at_least_one)]
    pub max_robots: usize,
    /// Seconds of silence after which a robot's roles in the domain are given back, or `never`
    #[arg(long, value_name = "SECONDS", default_value = "60")]
    pub give_back_after: Silence,
    /// How the network is reached
    #[command(flatten)]
    pub network: NetworkArgs,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| "expected a number of robots, 1 or more".to_owned())
}

/// Carries until `stop` is set.
///
/// # Errors
/// The bus or the network fails, or the configuration is wrong.
pub fn run(args: &InArgs, stop: &AtomicBool) -> Result<(), GatewayError> {
    let from = args.from.as_deref().map(Host::new).transpose()?;
    let domain = Domain::new(&args.domain)?;
    // A member from the start: what is wrong with the domain is said at once. One for all robots,
    // because each watches the domain by a thread of its own.
    let member = Bus::join(&domain, args.robot.first().map_or("arm", String::as_str), "gateway_in")?;
    let Some(session) = network::open(&args.network, Part::Guest, stop)? else {
        return Ok(());
    };
    let (put, outbox) = Inbox::new();
    subscribe(&session, from.as_ref(), args, &put)?;
    tracing::info!(
        from = from.as_ref().map_or("all hosts", Host::name),
        domain = args.domain,
        samples = args.samples,
        control = !args.no_control,
        "carries in"
    );
    let mut remote_robots = RemoteRobots::new(args, member, &session, put, outbox);
    let mut tick = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        remote_robots.take()?;
        let is_tick = tick.elapsed() >= IDLE_TICK;
        if is_tick {
            tick = Instant::now();
        }
        remote_robots.turn(is_tick)?;
    }
    remote_robots.report();
    drop(remote_robots);
    session.close().wait().map_err(network("closing the session"))
}

/// Subscribes to what is wanted and nothing else, so that nothing else is sent.
fn subscribe(session: &Session, from: Option<&Host>, args: &InArgs, put: &Inbox) -> Result<(), GatewayError> {
    let host = from.map_or("*", Host::name);
    let robots: BTreeSet<&str> = match &args.robot[..] {
        [] => BTreeSet::from(["*"]),
        named => named.iter().map(String::as_str).collect(),
    };
    for robot in robots {
        for topic in keys::CARRIED {
            if topic == Topic::Sample && !args.samples {
                continue;
            }
            let put = put.clone();
            session
                .declare_subscriber(keys::key(host, robot, topic.name()))
                .callback(move |sample| put.sample(&sample, true))
                .background()
                .wait()
                .map_err(network("subscribing"))?;
        }
        // After the topics: whoever appears is asked for its last messages, and nothing may fall
        // between.
        let put = put.clone();
        session
            .liveliness()
            .declare_subscriber(keys::key(host, robot, keys::ALIVE))
            .history(true)
            .callback(move |token| {
                let key = token.key_expr().as_str().to_owned();
                let presence = match token.kind() {
                    SampleKind::Put => Presence::Alive,
                    SampleKind::Delete => Presence::Gone,
                };
                put.token(key, presence);
            })
            .background()
            .wait()
            .map_err(network("subscribing"))?;
    }
    Ok(())
}
