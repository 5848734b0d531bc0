//! Out of a domain: topics of the bus to keys of the network.
//!
//! ```text
//! bus ── estimate, status, description, journal, samples if asked for ──▶ thetabus/<host>/<robot>/<topic>
//!  ▲                                                                          the last of each, for late joiners
//!  └── request, answer ── one at a time ── questions to thetabus/<host>/<robot>/control
//! ```
//!
//! One thread does all of it; zenoh has its own.

use crate::envelope::{Envelope, unix_ns};
use crate::error::{GatewayError, network};
use crate::keys::{self, Host};
use crate::latest::{Latest, encoding};
use crate::network::{self, NetworkArgs, Part};
use crate::questions::Questions;
use crate::tally::{HEAD, Tally, say};
use crate::way;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Domain, IDLE_TICK, Latched, RoleLock, SampleSubscriber, Subscriber, Topic, monotonic_ns};
use thetabus::messages::{Description, Estimate, Journal, SCHEMA_VERSION, Sample, Status};
use thetabus::recording::{Encoder, OnWire, described, to_cdr};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// Pause if nothing wakes this thread; questions, statuses and the journal may wait this long.
const PAUSE: Duration = Duration::from_millis(5);
/// The same between samples of several robots.
const SHORT_PAUSE: Duration = Duration::from_millis(1);
/// Samples taken at a time, so that no topic waits for another.
const SAMPLES_AT_A_TIME: usize = 256;
/// Largest number of questions that wait.
const QUESTIONS: usize = 64;

/// What leaves a domain.
#[derive(Debug, Clone, clap::Args)]
pub struct OutArgs {
    /// Domain of the bus
    #[arg(long, default_value = "default")]
    pub domain: String,
    /// Robot; may be repeated
    #[arg(long, default_value = "arm", value_parser = keys::robot)]
    pub robot: Vec<String>,
    /// This host's name in the keys, [a-z0-9_-]{1,32} [default: the system's]
    #[arg(long)]
    pub host: Option<String>,
    /// Carry the samples, too
    #[arg(long)]
    pub samples: bool,
    /// Take no commands from the network
    #[arg(long)]
    pub no_control: bool,
    /// How the network is reached
    #[command(flatten)]
    pub network: NetworkArgs,
}

/// Carries until `stop` is set.
///
/// # Errors
/// The bus or the network fails, or the configuration is wrong.
pub fn run(args: &OutArgs, stop: &AtomicBool) -> Result<(), GatewayError> {
    let host = args.host.as_deref().map_or_else(Host::own, Host::new)?;
    let domain = Domain::new(&args.domain)?;
    // Before the network is waited for: what is wrong here is said at once. A robot that is named
    // twice is one.
    let mut buses: Vec<(Bus, RoleLock)> = Vec::new();
    let names: BTreeSet<&str> = args.robot.iter().map(String::as_str).collect();
    for robot in &names {
        let way = way::take(&domain, robot)?;
        let member = match buses.first() {
            Some((member, _)) => Bus::for_robot(member, robot)?,
            None => Bus::join(&domain, robot, "gateway_out")?,
        };
        buses.push((member, way));
    }
    let Some(session) = network::open(&args.network, Part::Host, stop)? else {
        return Ok(());
    };
    let run = unix_ns() ^ (u64::from(std::process::id()) << 40);
    let mut robots = Vec::new();
    for (bus, way) in buses {
        robots.push(OutRobot::new(bus, way, &host, run, args, &session)?);
    }
    tracing::info!(
        host = host.name(),
        domain = args.domain,
        robots = names.into_iter().collect::<Vec<_>>().join(", "),
        samples = args.samples,
        control = !args.no_control,
        "carries out"
    );
    let pause = if args.samples { SHORT_PAUSE } else { PAUSE };
    let mut tick = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let mut carried = 0;
        let is_tick = tick.elapsed() >= IDLE_TICK;
        for robot in &mut robots {
            carried += robot.turn(is_tick)?;
        }
        if is_tick {
            tick = Instant::now();
        }
        if carried == 0 {
            match &robots[..] {
                [robot] => robot.wait()?,
                _ => std::thread::sleep(pause),
            }
        }
    }
    say(HEAD);
    for robot in &robots {
        robot.report();
    }
    drop(robots);
    session.close().wait().map_err(network("closing the session"))
}

/// A robot whose topics leave.
struct OutRobot {
    name: String,
    description: Outlet<Description>,
    estimate: Outlet<Estimate>,
    status: Outlet<Status>,
    journal: Outlet<Journal>,
    samples: Option<SampleOutlet>,
    questions: Option<Questions>,
    latest: Arc<Latest>,
    _queryable: Queryable<()>,
    /// Tells others that this robot is here; gone as soon as the session is.
    _alive: zenoh::liveliness::LivelinessToken,
    _way: RoleLock,
}

impl OutRobot {
    fn new(
        bus: Bus,
        way: RoleLock,
        host: &Host,
        run: u64,
        args: &OutArgs,
        session: &Session,
    ) -> Result<Self, GatewayError> {
        let name = bus.robot().to_owned();
        let latest = Arc::new(Latest::default());
        let to = To {
            host,
            run,
            session,
            latest: &latest,
        };
        let description = Outlet::new(&bus, &to)?;
        let estimate = Outlet::new(&bus, &to)?;
        let status = Outlet::new(&bus, &to)?;
        let journal = Outlet::new(&bus, &to)?;
        let samples = match args.samples {
            true => Some(SampleOutlet {
                subscriber: SampleSubscriber::new(&bus)?,
                sender: Sender::new(&name, Topic::Sample, &to)?,
            }),
            false => None,
        };
        let (asks, asked) = sync_channel(QUESTIONS);
        let control = keys::key(host.name(), &name, Topic::Control.name());
        let queryable = answer(
            session,
            host,
            &name,
            latest.clone(),
            (!args.no_control).then_some((control, asks)),
        )?;
        let alive = session
            .liveliness()
            .declare_token(keys::key(host.name(), &name, keys::ALIVE))
            .wait()
            .map_err(network("declaring a token"))?;
        Ok(Self {
            name,
            description,
            estimate,
            status,
            journal,
            samples,
            questions: (!args.no_control).then(|| Questions::new(host.name(), bus, asked)),
            latest,
            _queryable: queryable,
            _alive: alive,
            _way: way,
        })
    }

    /// Carries what is there; how many messages and questions it was.
    fn turn(&mut self, is_tick: bool) -> Result<usize, GatewayError> {
        let (name, latest) = (&self.name, &self.latest);
        let mut count = self.description.carry(|description| {
            latest.keep_schemas(schemas(name, description));
        })?;
        count += self.estimate.carry(|_| {})?;
        count += self.status.carry(|_| {})?;
        count += self.journal.carry(|_| {})?;
        if let Some(samples) = &mut self.samples {
            count += samples.carry(is_tick)?;
        }
        if let Some(questions) = &mut self.questions {
            count += questions.turn();
        }
        Ok(count)
    }

    fn wait(&self) -> Result<(), GatewayError> {
        match &self.samples {
            Some(samples) => samples.subscriber.wait(PAUSE)?,
            None => self.estimate.subscriber.wait(PAUSE)?,
        }
        Ok(())
    }

    fn report(&self) {
        let line = |sender: &Sender| say(format_args!("{:<36} {}", sender.key, sender.tally));
        line(&self.description.sender);
        line(&self.estimate.sender);
        line(&self.status.sender);
        line(&self.journal.sender);
        if let Some(samples) = &self.samples {
            line(&samples.sender);
        }
    }
}

/// Answers questions of the network about `robot`: for its last messages at once, for control by
/// way of the bus.
fn answer(
    session: &Session,
    host: &Host,
    robot: &str,
    latest: Arc<Latest>,
    control: Option<(String, SyncSender<Query>)>,
) -> Result<Queryable<()>, GatewayError> {
    let all = keys::key(host.name(), robot, "**");
    let (host, robot) = (host.name().to_owned(), robot.to_owned());
    let queryable = session.declare_queryable(all).callback(move |query| match &control {
        // A question that merely includes control among others is none to it.
        Some((key, asks)) if query.key_expr().as_str() == key => {
            if let Err(TrySendError::Full(query) | TrySendError::Disconnected(query)) = asks.try_send(query) {
                // Not in the log, which others could fill.
                let _ = query.reply_err("too many commands wait").wait();
            }
        }
        _ => latest.answer(&query, &host, &robot),
    });
    queryable.wait().map_err(network("declaring a queryable"))
}

/// The `ros2msg` texts of a description's machine.
fn schemas(robot: &str, description: &Description) -> Vec<(Topic, String)> {
    match Encoder::new(&described(robot, description)) {
        Ok(encoder) => {
            let topics = [Topic::Sample, Topic::Estimate, Topic::Status];
            let texts = encoder.channels().iter().map(|channel| channel.schema.clone());
            topics.into_iter().zip(texts).collect()
        }
        Err(e) => {
            tracing::warn!("robot {robot}: no schemas for readers in other languages: {e}");
            Vec::new()
        }
    }
}

/// Where messages go.
struct To<'a> {
    host: &'a Host,
    run: u64,
    session: &'a Session,
    latest: &'a Arc<Latest>,
}

/// Sends messages of one topic to its key.
struct Sender {
    key: String,
    topic: Topic,
    run: u64,
    number: u64,
    publisher: Publisher<'static>,
    latest: Arc<Latest>,
    tally: Tally,
}

impl Sender {
    fn new(robot: &str, topic: Topic, to: &To<'_>) -> Result<Self, GatewayError> {
        let key = keys::key(to.host.name(), robot, topic.name());
        // What comes often is dropped if the network stands still; what comes once waits for it,
        // for 5 s at most.
        let (congestion, priority) = match topic {
            Topic::Sample => (CongestionControl::Drop, Priority::DataLow),
            Topic::Status => (CongestionControl::Drop, Priority::Data),
            _ => (CongestionControl::Block, Priority::Data),
        };
        let publisher = to
            .session
            .declare_publisher(key.clone())
            .encoding(encoding(topic))
            .congestion_control(congestion)
            .priority(priority)
            .express(topic == Topic::Estimate)
            .wait()
            .map_err(network("declaring a publisher"))?;
        Ok(Self {
            key,
            topic,
            run: to.run,
            number: 0,
            publisher,
            latest: to.latest.clone(),
            tally: Tally::new(),
        })
    }

    fn send<M: OnWire>(&mut self, message: &M, sent_ns: u64) -> Result<(), GatewayError> {
        let on_the_bus = monotonic_ns().saturating_sub(sent_ns);
        let now = unix_ns();
        let envelope = Envelope {
            schema: SCHEMA_VERSION,
            run: self.run,
            number: self.number,
            sent_unix_ns: now.saturating_sub(on_the_bus),
            dimensions: message.dimensions(),
        };
        self.number += 1;
        let (payload, envelope) = (to_cdr(message), envelope.to_bytes());
        self.latest.keep(self.topic, &payload, &envelope);
        self.tally.carried += 1;
        let put = self.publisher.put(payload).attachment(envelope.to_vec());
        put.wait().map_err(network("sending"))
    }
}

/// A topic of which the bus keeps the last message.
struct Outlet<T: Latched + OnWire> {
    subscriber: Subscriber<T>,
    sender: Sender,
}

impl<T: Latched + OnWire + Counted> Outlet<T> {
    fn new(bus: &Bus, to: &To<'_>) -> Result<Self, GatewayError> {
        Ok(Self {
            subscriber: Subscriber::new(bus)?,
            sender: Sender::new(bus.robot(), T::TOPIC, to)?,
        })
    }

    fn carry(&mut self, mut look: impl FnMut(&T)) -> Result<usize, GatewayError> {
        let sender = &mut self.sender;
        let mut failed = None;
        let count = self.subscriber.drain_timed(|message, sent_ns| {
            look(message);
            if let Some((stream_id, seq)) = message.counted() {
                sender.tally.place(stream_id, seq);
            }
            if let Err(e) = sender.send(message, sent_ns) {
                failed = Some(e);
            }
        })?;
        sender.tally.left_out = self.subscriber.left_out();
        failed.map_or(Ok(count), Err)
    }
}

struct SampleOutlet {
    subscriber: SampleSubscriber,
    sender: Sender,
}

impl SampleOutlet {
    fn carry(&mut self, is_tick: bool) -> Result<usize, GatewayError> {
        let sender = &mut self.sender;
        let mut failed = None;
        let count = self.subscriber.drain_timed(SAMPLES_AT_A_TIME, |sample, sent_ns| {
            sender.tally.place(sample.stream_id, sample.seq);
            if let Err(e) = sender.send(sample, sent_ns) {
                failed = Some(e);
            }
        })?;
        if count == 0 && is_tick {
            self.subscriber.refresh()?;
        }
        sender.tally.left_out = self.subscriber.left_out();
        failed.map_or(Ok(count), Err)
    }
}

/// A message that the machine or its identifier counts.
pub trait Counted {
    /// Stream and place in it, if there is a count.
    fn counted(&self) -> Option<(u64, u64)> {
        None
    }
}

impl Counted for Description {}
impl Counted for Status {}
impl Counted for Journal {}

impl Counted for Estimate {
    fn counted(&self) -> Option<(u64, u64)> {
        Some((self.stream_id, self.block))
    }
}

impl Counted for Sample {
    fn counted(&self) -> Option<(u64, u64)> {
        Some((self.stream_id, self.seq))
    }
}
