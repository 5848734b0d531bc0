//! Many robots behind two routers on this host, with real messages and real processes.
//!
//! ```text
//! sender: so many hosts, a session each ──▶ router A ──▶ router B ──▶ this process: one subscriber of everything
//! ```
//!
//! No bus takes part: it is the network that is measured. Both ends have the same clock.

use crate::envelope::{Envelope, unix_ns};
use crate::error::{GatewayError, network};
use crate::keys;
use crate::latest::{Latest, encoding};
use crate::network::{self, NetworkArgs, Part};
use crate::tally::{HEAD, Numbers, Tally, say};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use thetabus::bus::Topic;
use thetabus::messages::{Description, Estimate, JointInfo, ParameterInfo, SCHEMA_VERSION, Sample, Status};
use thetabus::recording::{OnWire, to_cdr};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::{Session, Wait};

/// Declarations of all robots have passed the routers by then.
const WARM_UP: Duration = Duration::from_secs(120);
/// What is still under way at the end.
const AFTERMATH: Duration = Duration::from_secs(2);
/// Ticks of /proc/<pid>/stat in a second, a constant of Linux for programs.
const TICKS: f64 = 100.0;

/// How large the plant floor is.
#[derive(Debug, Clone, clap::Args)]
pub struct LoadArgs {
    /// What is sent
    #[command(flatten)]
    pub floor: Floor,
}

/// What robots send.
#[derive(Debug, Clone, clap::Args)]
pub struct Floor {
    /// Robots
    #[arg(long, default_value_t = 1000)]
    pub robots: usize,
    /// Hosts that they are spread over, with a session each
    #[arg(long, default_value_t = 100)]
    pub hosts: usize,
    /// How long they send [s]
    #[arg(long = "duration", alias = "duration-s", value_name = "S", default_value_t = 20.0)]
    pub duration_s: f64,
    /// Time between two estimates of a robot [s]
    #[arg(long, default_value_t = 1.9)]
    pub estimate_period_s: f64,
    /// Time between two statuses of a robot [s]
    #[arg(long, default_value_t = 0.5)]
    pub status_period_s: f64,
    /// Robots that send samples, too, at 1 kHz
    #[arg(long, default_value_t = 0)]
    pub sampled: usize,
}

/// The sending process.
#[derive(Debug, Clone, clap::Args)]
pub struct SenderArgs {
    #[command(flatten)]
    floor: Floor,
    #[command(flatten)]
    network: NetworkArgs,
}

/// Measures and prints.
///
/// # Errors
/// A part cannot be started, or does not do its work.
pub fn run(args: &LoadArgs, stop: &AtomicBool) -> Result<(), GatewayError> {
    let floor = &args.floor;
    let [a, b] = [free_endpoint()?, free_endpoint()?];
    let router_a = Process::start("router A", &["route", "--listen", &a])?;
    let router_b = Process::start("router B", &["route", "--listen", &b, "--connect", &a])?;
    let network = NetworkArgs {
        connect: vec![b],
        ..NetworkArgs::default()
    };
    let Some(session) = network::open(&network, Part::Guest, stop)? else {
        return Ok(());
    };
    let receipts = Arc::new(Receipts::default());
    for topic in keys::CARRIED {
        let receipts = receipts.clone();
        session
            .declare_subscriber(keys::key("*", "*", topic.name()))
            .callback(move |sample| receipts.take(topic, &sample))
            .background()
            .wait()
            .map_err(network_failed())?;
    }
    let alive = receipts.clone();
    session
        .liveliness()
        .declare_subscriber(keys::key("*", "*", keys::ALIVE))
        .history(true)
        .callback(move |_| {
            alive.alive.fetch_add(1, Ordering::Relaxed);
        })
        .background()
        .wait()
        .map_err(network_failed())?;

    let began = Instant::now();
    let numbers = [
        ("--robots", floor.robots.to_string()),
        ("--hosts", floor.hosts.to_string()),
        ("--duration", floor.duration_s.to_string()),
        ("--estimate-period-s", floor.estimate_period_s.to_string()),
        ("--status-period-s", floor.status_period_s.to_string()),
        ("--sampled", floor.sampled.to_string()),
    ];
    let mut line = vec!["load-sender", "--connect", &a];
    numbers.iter().for_each(|(name, value)| line.extend([*name, value]));
    let mut sender = Process::start("sender", &line)?;
    let robots = floor.robots as u64;
    while receipts.alive.load(Ordering::Relaxed) < robots {
        if stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        if began.elapsed() > WARM_UP {
            let seen = receipts.alive.load(Ordering::Relaxed);
            return Err(GatewayError::Load(format!(
                "{seen} of {robots} robots have appeared within {WARM_UP:?}"
            )));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let appeared = began.elapsed();
    // The sender waits for this word, so that all of what it sends is routed.
    let first = sender.line()?;
    let own = Usage::of(std::process::id());
    let before = [&router_a, &router_b, &sender].map(|part| Usage::of(part.child.id()));
    let start = Instant::now();
    sender.go()?;
    let sent = sender.line()?;
    let wall = start.elapsed();
    std::thread::sleep(AFTERMATH);
    let late = Instant::now();
    let answered = ask(&session)?;
    let late = late.elapsed();

    say(format_args!(
        "{} robots on {} hosts, {} of them with samples at 1 kHz, for {:.1} s; load average {}",
        floor.robots,
        floor.hosts,
        floor.sampled,
        wall.as_secs_f64(),
        load_average()
    ));
    say(format_args!(
        "all have appeared after {:.2} s ({first})",
        appeared.as_secs_f64()
    ));
    say(format_args!("{sent}"));
    say(HEAD);
    let topics = receipts.topics.lock().unwrap_or_else(PoisonError::into_inner);
    let mut bytes = 0;
    for (topic, received) in topics.iter() {
        say(format_args!("{topic:<36} {}", received.tally));
        bytes += received.bytes;
    }
    drop(topics);
    say(format_args!(
        "payload received: {:.2} MB/s",
        bytes as f64 / wall.as_secs_f64() / 1e6
    ));
    say(format_args!(
        "last descriptions of {answered} robots, asked for at once: {:.0} ms",
        late.as_secs_f64() * 1e3
    ));
    say("process      CPU [% of a core]   memory [MiB]");
    let parts = [&router_a, &router_b, &sender].map(|part| (part.name, part.child.id()));
    let parts = parts
        .into_iter()
        .zip(before)
        .chain([(("receiver", std::process::id()), own)]);
    for ((name, pid), before) in parts {
        let now = Usage::of(pid);
        let share = (now.cpu_s - before.cpu_s) / (wall + AFTERMATH).as_secs_f64() * 100.0;
        say(format_args!("{name:<12} {share:>17.1} {:>14.1}", now.memory_mib));
    }
    session.close().wait().map_err(network_failed())
}

fn network_failed<E: std::fmt::Display>() -> impl FnOnce(E) -> GatewayError {
    network("measuring")
}

/// Asks for every last description, as a late joiner does; how many came.
fn ask(session: &Session) -> Result<usize, GatewayError> {
    let replies = session
        .get(keys::key("*", "*", Topic::Description.name()))
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .with(zenoh::handlers::FifoChannel::new(4096))
        .wait()
        .map_err(network_failed())?;
    Ok(std::iter::from_fn(|| replies.recv().ok())
        .filter(|reply| reply.result().is_ok())
        .count())
}

fn load_average() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().unwrap_or("unknown").to_owned()
}

fn free_endpoint() -> Result<String, GatewayError> {
    let failed = |source| GatewayError::System {
        action: "looking for a free port",
        source,
    };
    let listener = TcpListener::bind("127.0.0.1:0").map_err(failed)?;
    Ok(format!("tcp/{}", listener.local_addr().map_err(failed)?))
}

/// What has come, by topic.
#[derive(Default)]
struct Receipts {
    topics: Mutex<BTreeMap<&'static str, Received>>,
    alive: AtomicU64,
}

struct Received {
    tally: Tally,
    keys: BTreeMap<String, Numbers>,
    bytes: usize,
}

impl Receipts {
    fn take(&self, topic: Topic, sample: &zenoh::sample::Sample) {
        let now = unix_ns();
        let envelope = sample
            .attachment()
            .and_then(|bytes| Envelope::from_bytes(&bytes.to_bytes()));
        let mut topics = self.topics.lock().unwrap_or_else(PoisonError::into_inner);
        let received = topics.entry(topic.name()).or_insert_with(|| Received {
            tally: Tally::new(),
            keys: BTreeMap::new(),
            bytes: 0,
        });
        let Some(envelope) = envelope else {
            received.tally.left_out += 1;
            return;
        };
        let numbers = received.keys.entry(sample.key_expr().as_str().to_owned()).or_default();
        received.tally.admit_by(numbers, &envelope);
        received.tally.late(envelope.sent_unix_ns, now);
        received.bytes += sample.payload().len();
    }
}

/// A part of the load: a process of this program, killed with it.
struct Process {
    name: &'static str,
    child: Child,
    lines: Option<BufReader<std::process::ChildStdout>>,
}

impl Process {
    fn start(name: &'static str, args: &[&str]) -> Result<Self, GatewayError> {
        let failed = |source| GatewayError::System {
            action: "starting a part of the load",
            source,
        };
        let mut child = Command::new(std::env::current_exe().map_err(failed)?)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        let lines = child.stdout.take().map(BufReader::new);
        Ok(Self { name, child, lines })
    }

    /// The next line that it prints.
    fn line(&mut self) -> Result<String, GatewayError> {
        let mut line = String::new();
        let read = self.lines.as_mut().map_or(Ok(0), |lines| lines.read_line(&mut line));
        match read {
            Ok(n) if n > 0 => Ok(line.trim().to_owned()),
            _ => Err(GatewayError::Load(format!("{} has ended", self.name))),
        }
    }

    /// Lets it go on.
    fn go(&mut self) -> Result<(), GatewayError> {
        use std::io::Write as _;
        let mut stdin = self.child.stdin.as_ref();
        let written = stdin.as_mut().map_or(Ok(()), |stdin| stdin.write_all(b"go\n"));
        written.map_err(|source| GatewayError::System {
            action: "starting to send",
            source,
        })
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a process has used.
#[derive(Clone, Copy)]
struct Usage {
    cpu_s: f64,
    memory_mib: f64,
}

impl Usage {
    /// Zero for a process that has gone.
    fn of(pid: u32) -> Self {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        // The name in parentheses may hold anything. Behind it, user and system time are fields 12
        // and 13.
        let fields: Vec<&str> = stat
            .rsplit_once(')')
            .map_or("", |(_, rest)| rest)
            .split_whitespace()
            .collect();
        let ticks: f64 = fields
            .iter()
            .skip(11)
            .take(2)
            .filter_map(|field| field.parse::<f64>().ok())
            .sum();
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = resident
            .and_then(|rest| rest.split_whitespace().next())
            .and_then(|kib| kib.parse().ok());
        Self {
            cpu_s: ticks / TICKS,
            memory_mib: kib.unwrap_or(0.0) / 1024.0,
        }
    }
}

/// Sends as the robots of a plant floor do, after a line on standard input.
///
/// # Errors
/// The network fails.
pub fn send(args: &SenderArgs, stop: &AtomicBool) -> Result<(), GatewayError> {
    let floor = &args.floor;
    let began = Instant::now();
    let mut sessions = Vec::new();
    for _ in 0..floor.hosts.clamp(1, floor.robots.max(1)) {
        let Some(session) = network::open(&args.network, Part::Guest, stop)? else {
            return Ok(());
        };
        sessions.push(session);
    }
    let mut robots = Vec::new();
    for number in 0..floor.robots {
        let host = number % sessions.len();
        robots.push(Robot::new(
            &sessions[host],
            &format!("host-{host}"),
            &format!("arm-{number}"),
        )?);
    }
    say(format_args!("declared in {:.2} s", began.elapsed().as_secs_f64()));
    let mut word = String::new();
    // Whoever has started this has gone if there is no word.
    if !matches!(std::io::stdin().lock().read_line(&mut word), Ok(n) if n > 0) {
        return Ok(());
    }
    let counts = send_for(floor, &mut robots, stop)?;
    say(format_args!(
        "sent: {} estimates, {} statuses, {} samples",
        counts[0], counts[1], counts[2]
    ));
    // The queryables answer until this process is ended.
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// What is due, in the order of [`send_for`]'s counts.
const KINDS: usize = 3;

fn send_for(floor: &Floor, robots: &mut [Robot], stop: &AtomicBool) -> Result<[u64; KINDS], GatewayError> {
    let ns = |seconds: f64| (seconds.max(1e-6) * 1e9) as u64;
    let periods = [ns(floor.estimate_period_s), ns(floor.status_period_s), ns(1e-3)];
    let mut due = BinaryHeap::new();
    for robot in 0..robots.len() {
        for (kind, period) in periods.iter().enumerate() {
            if kind < 2 || robot < floor.sampled {
                // Robots are not in step.
                due.push(Reverse((period * robot as u64 / robots.len() as u64, robot, kind)));
            }
        }
    }
    let (start, end) = (Instant::now(), ns(floor.duration_s));
    let mut counts = [0; KINDS];
    while let Some(Reverse((at, robot, kind))) = due.pop() {
        if at > end || stop.load(Ordering::Relaxed) {
            break;
        }
        let now = start.elapsed();
        if let Some(left) = Duration::from_nanos(at).checked_sub(now) {
            std::thread::sleep(left);
        }
        robots[robot].send(kind)?;
        counts[kind] += 1;
        due.push(Reverse((at + periods[kind], robot, kind)));
    }
    Ok(counts)
}

/// A robot on the network, as a gateway shows it.
struct Robot {
    publishers: [(Publisher<'static>, u64); KINDS],
    estimate: Estimate,
    sample: Sample,
    run: u64,
    _queryable: zenoh::query::Queryable<()>,
    _alive: zenoh::liveliness::LivelinessToken,
}

impl Robot {
    fn new(session: &Session, host: &str, robot: &str) -> Result<Self, GatewayError> {
        let publisher = |topic: Topic| {
            let publisher = session
                .declare_publisher(keys::key(host, robot, topic.name()))
                .encoding(encoding(topic));
            let publisher = publisher.congestion_control(CongestionControl::Drop).wait();
            publisher.map(|publisher| (publisher, 0)).map_err(network_failed())
        };
        let run = unix_ns();
        let latest = Arc::new(Latest::default());
        let description = description();
        latest.keep(
            Topic::Description,
            &to_cdr(&description),
            &envelope(&description, run, 0),
        );
        let (own_host, own_name) = (host.to_owned(), robot.to_owned());
        let queryable = session
            .declare_queryable(keys::key(host, robot, "**"))
            .callback(move |query| latest.answer(&query, &own_host, &own_name))
            .wait()
            .map_err(network_failed())?;
        Ok(Self {
            publishers: [
                publisher(Topic::Estimate)?,
                publisher(Topic::Status)?,
                publisher(Topic::Sample)?,
            ],
            estimate: Estimate {
                params: 9,
                equations: 2,
                derived_len: 7,
                ..Estimate::EMPTY
            },
            sample: Sample {
                joints: 2,
                ..Sample::EMPTY
            },
            run,
            _queryable: queryable,
            _alive: session
                .liveliness()
                .declare_token(keys::key(host, robot, keys::ALIVE))
                .wait()
                .map_err(network_failed())?,
        })
    }

    fn send(&mut self, kind: usize) -> Result<(), GatewayError> {
        let (publisher, number) = &mut self.publishers[kind];
        let (payload, envelope) = match kind {
            0 => (to_cdr(&self.estimate), envelope(&self.estimate, self.run, *number)),
            1 => (to_cdr(&Status::EMPTY), envelope(&Status::EMPTY, self.run, *number)),
            _ => (to_cdr(&self.sample), envelope(&self.sample, self.run, *number)),
        };
        *number += 1;
        publisher
            .put(payload)
            .attachment(envelope)
            .wait()
            .map_err(network_failed())
    }
}

fn envelope(message: &impl OnWire, run: u64, number: u64) -> Vec<u8> {
    let envelope = Envelope {
        schema: SCHEMA_VERSION,
        run,
        number,
        sent_unix_ns: unix_ns(),
        dimensions: message.dimensions(),
    };
    envelope.to_bytes().to_vec()
}

/// An arm with two joints and nine parameters.
fn description() -> Description {
    let parameters = (1..=9).map(|i| ParameterInfo::new(&format!("theta_{i}"), "V s/rad", "", 0.0, (0.0, 1.0)));
    Description::default().of_model("manipulator", 1, "V").with(
        [JointInfo::new("joint_1", "rad", "V"); 2],
        parameters,
        [],
    )
}
