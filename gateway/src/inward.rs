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
use crate::incoming::{Incoming, unreadable};
use crate::keys::{self, Host};
use crate::network::{self, NetworkArgs, Part};
use crate::refusals::{Lines, Refusals};
use crate::remote_robot::{RETRY_AFTER, RemoteRobot};
use crate::tally::{HEAD, say};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Domain, IDLE_TICK, Topic};
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Largest number of messages that wait for this thread: 8 s of samples of one robot at 1 kHz.
const INBOX: usize = 8192;
/// Period of serving requests of the bus.
const PAUSE: Duration = Duration::from_millis(5);
/// Number of messages taken before requests of the bus are served.
const AT_A_TIME: usize = 256;

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
    /// How the network is reached
    #[command(flatten)]
    pub network: NetworkArgs,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| "expected a number of robots, 1 or more".to_owned())
}

/// What zenoh's threads have for this one.
enum Event {
    Message {
        key: String,
        payload: Vec<u8>,
        envelope: Vec<u8>,
        is_live: bool,
    },
    Alive {
        key: String,
    },
    Gone {
        key: String,
    },
}

/// Hands events over and counts those for which there is no room.
#[derive(Clone)]
struct Inbox {
    events: SyncSender<Event>,
    dropped: Arc<AtomicU64>,
}

impl Inbox {
    fn put(&self, event: Event) {
        if self.events.try_send(event).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn sample(&self, sample: &zenoh::sample::Sample, is_live: bool) {
        if sample.kind() == SampleKind::Put {
            self.put(Event::Message {
                key: sample.key_expr().as_str().to_owned(),
                payload: sample.payload().to_bytes().into_owned(),
                envelope: sample
                    .attachment()
                    .map_or_else(Vec::new, |bytes| bytes.to_bytes().into_owned()),
                is_live,
            });
        }
    }
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
    let (events, inbox) = sync_channel(INBOX);
    let put = Inbox {
        events,
        dropped: Arc::default(),
    };
    subscribe(&session, from.as_ref(), args, &put)?;
    tracing::info!(
        from = from.as_ref().map_or("all hosts", Host::name),
        domain = args.domain,
        samples = args.samples,
        control = !args.no_control,
        "carries in"
    );
    let mut remote_robots = RemoteRobots {
        args,
        member,
        session: &session,
        put: put.clone(),
        robots: BTreeMap::new(),
        refusals: Refusals::default(),
        unreadable: Refusals::default(),
        unread: 0,
        lines: Lines::default(),
        strangers: 0,
    };
    let mut tick = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        remote_robots.take(&inbox)?;
        let is_tick = tick.elapsed() >= IDLE_TICK;
        if is_tick {
            tick = Instant::now();
        }
        for robot in remote_robots.robots.values_mut() {
            robot.turn(&session, is_tick)?;
        }
        if is_tick {
            remote_robots.tell_losses(Instant::now());
        }
    }
    say(HEAD);
    remote_robots.robots.values().for_each(RemoteRobot::report);
    let dropped = put.dropped.load(Ordering::Relaxed);
    let (strangers, unread) = (remote_robots.strangers, remote_robots.unread);
    if dropped + strangers + unread > 0 {
        say(format_args!(
            "inbox full: {dropped} messages, foreign keys: {strangers}, not readable from robots without a place: {unread}"
        ));
    }
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
                put.put(match token.kind() {
                    SampleKind::Put => Event::Alive { key },
                    SampleKind::Delete => Event::Gone { key },
                });
            })
            .background()
            .wait()
            .map_err(network("subscribing"))?;
    }
    Ok(())
}

/// The robots that have come.
struct RemoteRobots<'a> {
    args: &'a InArgs,
    member: Bus,
    session: &'a Session,
    put: Inbox,
    robots: BTreeMap<String, RemoteRobot>,
    refusals: Refusals,
    /// Robots from which nothing has come that can be read.
    unreadable: Refusals,
    /// Messages of theirs.
    unread: u64,
    /// Lines that names of the network can bring into the log.
    lines: Lines,
    /// Keys that are none of ours.
    strangers: u64,
}

impl RemoteRobots<'_> {
    /// Waits for events and takes them.
    fn take(&mut self, inbox: &Receiver<Event>) -> Result<(), GatewayError> {
        let Ok(first) = inbox.recv_timeout(PAUSE) else {
            return Ok(());
        };
        self.event(first)?;
        for _ in 1..AT_A_TIME {
            let Ok(event) = inbox.try_recv() else { break };
            self.event(event)?;
        }
        Ok(())
    }

    fn event(&mut self, event: Event) -> Result<(), GatewayError> {
        let (Event::Message { key, .. } | Event::Alive { key } | Event::Gone { key }) = &event;
        let Some((host, robot, last)) = keys::parts(key) else {
            self.strangers += 1;
            return Ok(());
        };
        match &event {
            Event::Alive { .. } => {
                if let Some(before) = self.lines.next(Instant::now()) {
                    tracing::info!(host, robot, lines_left_out = before, "robot connected");
                }
                if let Some(remote_robot) = self
                    .robots
                    .get_mut(robot)
                    .filter(|remote_robot| remote_robot.host == host)
                {
                    remote_robot.is_there = true;
                }
                self.ask_for_last(host, robot)
            }
            Event::Gone { .. } => {
                if let Some(before) = self.lines.next(Instant::now()) {
                    tracing::warn!(host, robot, lines_left_out = before, "its gateway has gone");
                }
                if let Some(remote_robot) = self
                    .robots
                    .get_mut(robot)
                    .filter(|remote_robot| remote_robot.host == host)
                {
                    remote_robot.is_there = false;
                }
                Ok(())
            }
            Event::Message {
                payload,
                envelope,
                is_live,
                ..
            } => {
                // A stranger may answer a question about last messages with samples.
                let wanted = |topic: &Topic| *topic != Topic::Sample || self.args.samples;
                let Some(topic) = keys::topic(last).filter(wanted) else {
                    self.strangers += 1;
                    return Ok(());
                };
                let Some(message) = Incoming::read(topic, payload, envelope, *is_live) else {
                    self.leave_out(host, robot, topic, payload.len());
                    return Ok(());
                };
                let Some(remote_robot) = self.robot(host, robot) else {
                    return Ok(());
                };
                remote_robot.message(&message)
            }
        }
    }

    /// Counts a message that cannot be read. It makes no place for a robot that has none.
    fn leave_out(&mut self, host: &str, robot: &str, topic: Topic, bytes: usize) {
        match self.robots.get_mut(robot) {
            Some(remote_robot) if remote_robot.host == host => remote_robot.leave_out(topic, bytes),
            _ => {
                self.unread += 1;
                let now = Instant::now();
                if self.unreadable.is_first(format!("{host}/{robot}"), now)
                    && let Some(before) = self.lines.next(now)
                {
                    let why = unreadable(topic, bytes);
                    tracing::warn!(host, robot, lines_left_out = before, "robot not admitted: {why}");
                }
            }
        }
    }

    /// Says what has not come, while it can still be mended.
    fn tell_losses(&mut self, now: Instant) {
        for (robot, remote_robot) in &mut self.robots {
            if let Some(missing) = remote_robot.losses(now)
                && let Some(before) = self.lines.next(now)
            {
                tracing::warn!(
                    host = remote_robot.host,
                    robot,
                    lines_left_out = before,
                    "messages are missing: {missing}"
                );
            }
        }
    }

    /// Asks for the last messages of a robot that has appeared; they come as events.
    fn ask_for_last(&self, host: &str, robot: &str) -> Result<(), GatewayError> {
        let put = self.put.clone();
        self.session
            .get(keys::key(host, robot, "*"))
            .target(QueryTarget::All)
            // The journal has many messages under one key.
            .consolidation(ConsolidationMode::None)
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    put.sample(sample, false);
                }
            })
            .wait()
            .map_err(network("asking for last messages"))
    }

    /// The robot's place in the domain; `None` if there is none for it.
    fn robot(&mut self, host: &str, robot: &str) -> Option<&mut RemoteRobot> {
        if !self.robots.contains_key(robot) {
            let now = Instant::now();
            if self.refusals.is_recent(robot, RETRY_AFTER, now) {
                return None;
            }
            match self.admit(host, robot) {
                Ok(remote_robot) => {
                    self.refusals.forget(robot);
                    self.unreadable.forget(&format!("{host}/{robot}"));
                    self.robots.insert(robot.to_owned(), remote_robot);
                }
                Err(why) => {
                    if self.refusals.is_first(robot.to_owned(), now)
                        && let Some(before) = self.lines.next(now)
                    {
                        match why {
                            // As it is to be where gateways both ways share a domain.
                            GatewayError::Way { .. } => {
                                tracing::warn!(host, robot, lines_left_out = before, "robot not admitted: {why}");
                            }
                            _ => tracing::error!(host, robot, lines_left_out = before, "robot not admitted: {why}"),
                        }
                    }
                    return None;
                }
            }
        }
        let remote_robot = self.robots.get_mut(robot)?;
        if remote_robot.host == host {
            return Some(remote_robot);
        }
        let now = Instant::now();
        if self.refusals.is_first(format!("{host}/{robot}"), now)
            && let Some(before) = self.lines.next(now)
        {
            tracing::error!(
                lines_left_out = before,
                "robot {robot} comes from {} and from {host}; the second is ignored; select one with --from and give the other its own domain",
                remote_robot.host
            );
        }
        None
    }

    fn admit(&self, host: &str, robot: &str) -> Result<RemoteRobot, GatewayError> {
        if self.robots.len() >= self.args.max_robots {
            return Err(GatewayError::Full(self.robots.len()));
        }
        RemoteRobot::new(&self.member, host, robot, !self.args.no_control)
    }
}
