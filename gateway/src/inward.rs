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

use crate::envelope::{Envelope, unix_ns};
use crate::error::{GatewayError, network};
use crate::keys::{self, Host};
use crate::network::{self, NetworkArgs, Part};
use crate::out::Counted;
use crate::questions;
use crate::refusals::{Lines, Refusals};
use crate::tally::{HEAD, Tally, say};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use thetabus::bus::{
    Asked, Bus, BusError, ControlServer, Delivery, Domain, IDLE_TICK, Latched, Publisher, Role, RoleLock,
    SamplePublisher, Topic,
};
use thetabus::messages::{Description, Estimate, Journal, Response, SCHEMA_VERSION, Sample, Status, response_code};
use thetabus::recording::{Dimensions, OnWire, from_cdr, to_cdr};
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::query::{ConsolidationMode, QueryTarget, Reply};
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Messages that wait for this thread at most: 8 s of samples of one robot at 1 kHz.
const INBOX: usize = 8192;
/// Requests of the bus are looked after this often.
const PAUSE: Duration = Duration::from_millis(5);
/// Messages taken before the bus is looked after.
const AT_A_TIME: usize = 256;
/// A robot whose role another program holds gets another chance after this time.
const SECOND_CHANCE: Duration = Duration::from_secs(2);
/// The other gateway answers for the identifier within its own patience.
const CONTROL_LIMIT: Duration = questions::PATIENCE.saturating_add(Duration::from_secs(1));
/// Requests taken at a time.
const REQUESTS_AT_A_TIME: usize = 8;

/// What comes into a domain.
#[derive(Debug, Clone, clap::Args)]
pub struct InArgs {
    /// Domain of the bus
    #[arg(long, default_value = "default")]
    pub domain: String,
    /// Host whose robots come [default: all]
    #[arg(long)]
    pub from: Option<String>,
    /// Robot; may be repeated [default: all]
    #[arg(long)]
    pub robot: Vec<String>,
    /// Samples come, too, if their host sends them
    #[arg(long)]
    pub samples: bool,
    /// Nobody in the domain can send commands
    #[arg(long)]
    pub no_control: bool,
    /// Robots at most: each takes some megabytes of shared memory
    #[arg(long, default_value_t = 64)]
    pub max_robots: usize,
    /// How the network is reached
    #[command(flatten)]
    pub network: NetworkArgs,
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
    // A member from the start: what is wrong with the domain is said at once, and robots come and
    // go.
    let _member = Bus::join(&domain, args.robot.first().map_or("arm", String::as_str), "gateway_in")?;
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
    let mut guests = Guests {
        args,
        domain,
        session: &session,
        put: put.clone(),
        robots: BTreeMap::new(),
        refusals: Refusals::default(),
        lines: Lines::default(),
        strangers: 0,
    };
    let mut tick = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        guests.take(&inbox)?;
        let is_tick = tick.elapsed() >= IDLE_TICK;
        if is_tick {
            tick = Instant::now();
        }
        for robot in guests.robots.values_mut() {
            robot.turn(&session, is_tick)?;
        }
    }
    say(HEAD);
    guests.robots.values().for_each(Guest::report);
    let dropped = put.dropped.load(Ordering::Relaxed);
    if dropped + guests.strangers > 0 {
        say(format_args!(
            "inbox full: {dropped} messages, foreign keys: {}",
            guests.strangers
        ));
    }
    drop(guests);
    session.close().wait().map_err(network("closing the session"))
}

/// Subscribes to what is wanted and nothing else, so that nothing else is sent.
fn subscribe(session: &Session, from: Option<&Host>, args: &InArgs, put: &Inbox) -> Result<(), GatewayError> {
    let host = from.map_or("*", Host::name);
    let robots: Vec<&str> = match &args.robot[..] {
        [] => vec!["*"],
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
struct Guests<'a> {
    args: &'a InArgs,
    domain: Domain,
    session: &'a Session,
    put: Inbox,
    robots: BTreeMap<String, Guest>,
    refusals: Refusals,
    /// Lines that names of the network can bring into the log.
    lines: Lines,
    /// Keys that are none of ours.
    strangers: u64,
}

impl Guests<'_> {
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
                if let Some(guest) = self.robots.get_mut(robot).filter(|guest| guest.host == host) {
                    guest.is_there = true;
                }
                self.ask_for_last(host, robot)
            }
            Event::Gone { .. } => {
                if let Some(before) = self.lines.next(Instant::now()) {
                    tracing::warn!(host, robot, lines_left_out = before, "its gateway has gone");
                }
                if let Some(guest) = self.robots.get_mut(robot).filter(|guest| guest.host == host) {
                    guest.is_there = false;
                }
                Ok(())
            }
            Event::Message {
                payload,
                envelope,
                is_live,
                ..
            } => {
                let Some(topic) = keys::topic(last) else {
                    self.strangers += 1;
                    return Ok(());
                };
                let Some(guest) = self.guest(host, robot) else {
                    return Ok(());
                };
                guest.message(topic, payload, envelope, *is_live)
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
    fn guest(&mut self, host: &str, robot: &str) -> Option<&mut Guest> {
        if !self.robots.contains_key(robot) {
            let now = Instant::now();
            if self.refusals.is_recent(robot, SECOND_CHANCE, now) {
                return None;
            }
            match self.admit(host, robot) {
                Ok(guest) => {
                    self.refusals.forget(robot);
                    self.robots.insert(robot.to_owned(), guest);
                }
                Err(why) => {
                    if self.refusals.is_first(robot.to_owned(), now)
                        && let Some(before) = self.lines.next(now)
                    {
                        tracing::error!(host, robot, lines_left_out = before, "robot not admitted: {why}");
                    }
                    return None;
                }
            }
        }
        let guest = self.robots.get_mut(robot)?;
        if guest.host == host {
            return Some(guest);
        }
        let now = Instant::now();
        if self.refusals.is_first(format!("{host}/{robot}"), now)
            && let Some(before) = self.lines.next(now)
        {
            tracing::error!(
                lines_left_out = before,
                "robot {robot} comes from {} and from {host}; the second is ignored; select one with --from and give the other its own domain",
                guest.host
            );
        }
        None
    }

    fn admit(&self, host: &str, robot: &str) -> Result<Guest, String> {
        if self.robots.len() >= self.args.max_robots {
            return Err(format!("there are {} already, as --max-robots says", self.robots.len()));
        }
        Guest::new(&self.domain, host, robot, !self.args.no_control).map_err(|e| e.to_string())
    }
}

/// A robot of another host in this domain.
struct Guest {
    host: String,
    bus: Bus,
    is_there: bool,
    description: Inlet<Description>,
    estimate: Inlet<Estimate>,
    status: Inlet<Status>,
    journal: Inlet<Journal>,
    samples: Samples,
    control: Option<ControlServer>,
    /// Requests under way.
    asked: Vec<(Asked, FifoChannelHandler<Reply>)>,
    _role: RoleLock,
}

impl Guest {
    fn new(domain: &Domain, host: &str, robot: &str, has_control: bool) -> Result<Self, BusError> {
        let role = RoleLock::acquire(domain, robot, Role::Identifier)?;
        let bus = Bus::join(domain, robot, "gateway_in")?;
        Ok(Self {
            host: host.to_owned(),
            is_there: true,
            description: Inlet::new(&bus)?,
            estimate: Inlet::new(&bus)?,
            status: Inlet::new(&bus)?,
            journal: Inlet::new(&bus)?,
            samples: Samples {
                port: None,
                refused: None,
                tally: Tally::new(),
            },
            control: if has_control {
                Some(ControlServer::new(&bus)?)
            } else {
                None
            },
            asked: Vec::new(),
            bus,
            _role: role,
        })
    }

    fn message(&mut self, topic: Topic, payload: &[u8], envelope: &[u8], is_live: bool) -> Result<(), GatewayError> {
        let letter = Letter {
            payload,
            envelope,
            is_live,
        };
        match topic {
            Topic::Description => self.description.take(&letter)?,
            Topic::Estimate => self.estimate.take(&letter)?,
            Topic::Status => self.status.take(&letter)?,
            Topic::Journal => self.journal.take(&letter)?,
            Topic::Sample => self.samples.take(&letter, &self.bus)?,
            Topic::Control | Topic::Command => {}
        }
        Ok(())
    }

    /// Passes requests and answers on, and serves whoever joined the bus.
    fn turn(&mut self, session: &Session, is_tick: bool) -> Result<(), GatewayError> {
        if let Some(control) = &mut self.control {
            for _ in 0..REQUESTS_AT_A_TIME {
                let Some(asked) = control.take()? else { break };
                if !self.is_there {
                    let text = format!("the gateway of host {} is not there", self.host);
                    asked.answer(&Response::new(response_code::FAILED, &text));
                    continue;
                }
                let key = keys::key(&self.host, self.bus.robot(), Topic::Control.name());
                let question = session
                    .get(key)
                    .payload(to_cdr(asked.request()))
                    .target(QueryTarget::All);
                let question = question.timeout(CONTROL_LIMIT).with(FifoChannel::new(2)).wait();
                self.asked.push((asked, question.map_err(network("asking"))?));
            }
        }
        for (asked, replies) in std::mem::take(&mut self.asked) {
            match answer(&replies, &self.host) {
                Some(response) => asked.answer(&response),
                None => self.asked.push((asked, replies)),
            }
        }
        if is_tick {
            self.description.port.serve_late_joiners()?;
            self.estimate.port.serve_late_joiners()?;
            self.status.port.serve_late_joiners()?;
            self.journal.port.serve_late_joiners()?;
            if let Some((port, _)) = &mut self.samples.port {
                port.serve_late_joiners()?;
            }
        }
        Ok(())
    }

    fn report(&self) {
        let line = |topic: Topic, tally: &Tally| {
            let key = keys::key(&self.host, self.bus.robot(), topic.name());
            say(format_args!("{key:<36} {tally}"));
        };
        line(Topic::Description, &self.description.tally);
        line(Topic::Estimate, &self.estimate.tally);
        line(Topic::Status, &self.status.tally);
        line(Topic::Journal, &self.journal.tally);
        if self.samples.port.is_some() {
            line(Topic::Sample, &self.samples.tally);
        }
    }
}

/// What came of a question to control; `None` while nothing has.
fn answer(replies: &FifoChannelHandler<Reply>, host: &str) -> Option<Response> {
    let failed = |text: &str| Response::new(response_code::FAILED, text);
    match replies.try_recv() {
        Ok(None) => None,
        Ok(Some(reply)) => Some(match reply.result() {
            Ok(sample) => from_cdr(&sample.payload().to_bytes(), Dimensions::ALL)
                .unwrap_or_else(|e| failed(&format!("host {host} answered what is {e}"))),
            Err(error) => failed(&format!(
                "host {host}: {}",
                String::from_utf8_lossy(&error.payload().to_bytes())
            )),
        }),
        Err(_) => Some(failed(&format!(
            "host {host} does not answer: its gateway takes no commands, or has gone"
        ))),
    }
}

/// A message as it came.
struct Letter<'a> {
    payload: &'a [u8],
    envelope: &'a [u8],
    is_live: bool,
}

impl Letter<'_> {
    /// The message, if it is new and can be read.
    fn open<M: OnWire + Counted>(&self, tally: &mut Tally) -> Option<M> {
        let envelope = Envelope::from_bytes(self.envelope).filter(|envelope| envelope.schema == SCHEMA_VERSION);
        let message = envelope.and_then(|e| from_cdr::<M>(self.payload, e.dimensions).ok().map(|m| (e, m)));
        let Some((envelope, message)) = message else {
            if tally.left_out == 0 {
                tracing::warn!(
                    "a {} was left out: {} bytes that are none of schema {SCHEMA_VERSION}; use the same version of thetabus on both hosts",
                    M::LAYOUT.name,
                    self.payload.len()
                );
            }
            tally.left_out += 1;
            return None;
        };
        if !tally.admit(&envelope, self.is_live) {
            return None;
        }
        if let Some((stream_id, seq)) = message.counted() {
            tally.place(stream_id, seq);
        }
        if self.is_live {
            tally.late(envelope.sent_unix_ns, unix_ns());
        }
        Some(message)
    }
}

/// A topic of which the bus keeps the last message.
struct Inlet<T: Latched> {
    port: Publisher<T>,
    tally: Tally,
}

impl<T: Latched + OnWire + Counted> Inlet<T> {
    fn new(bus: &Bus) -> Result<Self, BusError> {
        Ok(Self {
            port: Publisher::new(bus)?,
            tally: Tally::new(),
        })
    }

    fn take(&mut self, letter: &Letter<'_>) -> Result<(), BusError> {
        match letter.open::<T>(&mut self.tally) {
            Some(message) => self.port.send(&message),
            None => Ok(()),
        }
    }
}

/// The samples of a robot: its topic is made when the first one comes.
struct Samples {
    port: Option<(SamplePublisher, RoleLock)>,
    refused: Option<Instant>,
    tally: Tally,
}

impl Samples {
    fn take(&mut self, letter: &Letter<'_>, bus: &Bus) -> Result<(), BusError> {
        let Some(sample) = letter.open::<Sample>(&mut self.tally) else {
            return Ok(());
        };
        if self.port.is_none() {
            if self.refused.is_some_and(|since| since.elapsed() < SECOND_CHANCE) {
                return Ok(());
            }
            match samples(bus) {
                Ok(port) => self.port = Some(port),
                Err(e) => {
                    if self.refused.is_none() {
                        tracing::error!("samples cannot come in: {e}");
                    }
                    self.refused = Some(Instant::now());
                }
            }
        }
        let Some((port, _)) = &mut self.port else {
            return Ok(());
        };
        port.send(&sample)?;
        port.wake();
        Ok(())
    }
}

fn samples(bus: &Bus) -> Result<(SamplePublisher, RoleLock), BusError> {
    let role = RoleLock::acquire(bus.domain(), bus.robot(), Role::Plant)?;
    let port = SamplePublisher::new(bus, Delivery::Realtime, Arc::new(AtomicBool::new(false)))?;
    Ok((port, role))
}
