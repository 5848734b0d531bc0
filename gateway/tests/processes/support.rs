//! Domains, gateways and a machine of the test's own.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::io::{BufRead, BufReader, Read};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use thetabus::bus::{Bus, Delivery, Domain, Publisher, Role, RoleLock, SamplePublisher, Subscriber};
use thetabus::messages::{
    Command as Order, DerivedInfo, Description, Estimate, JointInfo, Journal, ParameterInfo, Request, SCHEMA_VERSION,
    Sample, Status,
};
use thetabus::recording::{Dimensions, OnWire, to_cdr};
use zenoh::Wait;

/// Nothing here takes this long unless it hangs.
pub const WATCHDOG: Duration = Duration::from_secs(60);

/// Longest wait for the last words of a program that has ended: an orphan may keep its pipes open.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// Seconds that the tests of long flows take; ten minutes, as docs/gateway.md tells, if the
/// environment says so.
pub fn seconds() -> Option<u64> {
    let text = std::env::var("THETABUS_GATEWAY_SECONDS").ok()?;
    Some(text.parse().expect("THETABUS_GATEWAY_SECONDS is a number of seconds"))
}

/// Waits until `find` has found something.
pub fn eventually<T>(what: &str, mut find: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = find() {
            return found;
        }
        assert!(start.elapsed() < WATCHDOG, "not within {WATCHDOG:?}: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Two domains and a directory for one test; `near` has the machine, `far` is where it is brought.
pub struct Site {
    pub near: Domain,
    pub far: Domain,
    pub dir: TempDir,
}

impl Site {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        let domain = |side| Domain::new(&format!("g{}-{n}-{side}", std::process::id())).expect("a valid name");
        Self {
            near: domain("near"),
            far: domain("far"),
            dir: tempfile::tempdir().expect("a temporary directory"),
        }
    }

    /// Writes a file into the test's directory.
    pub fn file(&self, name: &str, text: &str) -> String {
        let path = self.dir.path().join(name);
        std::fs::write(&path, text).expect("written");
        path.to_str().expect("UTF-8").to_owned()
    }

    /// `thetabus-gateway out` of the near domain, as host `cell`.
    pub fn out(&self, args: &[&str]) -> Process {
        gateway(&[&["out", "--host", "cell", "--domain", self.near.name()], args].concat())
    }

    /// `thetabus-gateway in` to the far domain.
    pub fn inward(&self, args: &[&str]) -> Process {
        gateway(&[&["in", "--domain", self.far.name()], args].concat())
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        for domain in [&self.near, &self.far] {
            let _ = std::fs::remove_dir_all(domain.root());
            for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
                if entry.file_name().to_string_lossy().starts_with(domain.prefix()) {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
    }
}

/// An endpoint on the loopback interface that nobody uses.
pub fn endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    format!("tcp/{}", listener.local_addr().expect("its address"))
}

pub fn gateway(args: &[&str]) -> Process {
    Process::start(Path::new(env!("CARGO_BIN_EXE_thetabus-gateway")), args)
}

/// A program of somebody else on the network, connected to `at`.
pub fn stranger(at: &str) -> zenoh::Session {
    let config = format!(
        "{{ mode: 'client', connect: {{ endpoints: ['{at}'] }}, scouting: {{ multicast: {{ enabled: false }} }} }}"
    );
    let config = zenoh::Config::from_json5(&config).expect("valid");
    eventually("a session", || zenoh::open(config.clone()).wait().ok())
}

/// The envelope of a stranger's message of this schema, in run 1; the number is that of the message.
pub fn envelope(schema: u32, number: u64, of: Dimensions) -> Vec<u8> {
    let mut bytes = vec![0; 40];
    bytes[0] = 1;
    bytes[4..8].copy_from_slice(&schema.to_le_bytes());
    bytes[8] = 1;
    bytes[16..24].copy_from_slice(&number.to_le_bytes());
    bytes[32..36].copy_from_slice(&[of.joints, of.equations, of.parameters, of.derived]);
    bytes
}

/// Puts a message as an honest gateway does.
pub fn put<M: OnWire>(session: &zenoh::Session, key: &str, number: u64, message: &M) {
    let put = session.put(key, to_cdr(message));
    put.attachment(envelope(SCHEMA_VERSION, number, message.dimensions()))
        .congestion_control(zenoh::qos::CongestionControl::Block)
        .wait()
        .expect("put");
}

/// What answers a question, with the keys of the answers.
pub fn replies(session: &zenoh::Session, key: &str) -> Vec<(String, Vec<u8>)> {
    let replies = session
        .get(key)
        .consolidation(zenoh::query::ConsolidationMode::None)
        .with(zenoh::handlers::FifoChannel::new(256))
        .wait()
        .expect("asked");
    let samples = std::iter::from_fn(|| replies.recv().ok()).filter_map(|reply| reply.into_result().ok());
    samples
        .map(|sample| {
            (
                sample.key_expr().as_str().to_owned(),
                sample.payload().to_bytes().into_owned(),
            )
        })
        .collect()
}

type Output = Arc<Mutex<String>>;

/// What comes out of a pipe, and the thread that reads it until it is closed.
fn collect(stream: impl Read + Send + 'static) -> (Output, JoinHandle<()>) {
    let text = Output::default();
    let sink = text.clone();
    let reader = std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            let mut text = sink.lock().expect("no panic above");
            text.push_str(&line);
            text.push('\n');
        }
    });
    (text, reader)
}

/// A started program with its output; killed on drop.
pub struct Process {
    child: Child,
    stdout: Output,
    stderr: Output,
    readers: [JoinHandle<()>; 2],
}

impl Process {
    pub fn start(program: &Path, args: &[&str]) -> Self {
        let mut child = Command::new(program)
            .args(args)
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let (stdout, of_stdout) = collect(child.stdout.take().expect("piped"));
        let (stderr, of_stderr) = collect(child.stderr.take().expect("piped"));
        Self {
            child,
            stdout,
            stderr,
            readers: [of_stdout, of_stderr],
        }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn stderr(&self) -> String {
        self.stderr.lock().expect("no panic above").clone()
    }

    /// Waits for words in its log.
    pub fn says(&self, words: &str) {
        eventually(&format!("{words:?} in\n{}", self.stderr()), || {
            self.stderr().contains(words).then_some(())
        });
    }

    /// Stops it where it is, as one that hangs.
    pub fn stop(&self) {
        let pid = Pid::from_raw(self.child.id().cast_signed());
        kill(pid, Signal::SIGSTOP).expect("the process lives");
    }

    /// Lets it go on.
    pub fn go_on(&self) {
        let pid = Pid::from_raw(self.child.id().cast_signed());
        kill(pid, Signal::SIGCONT).expect("the process lives");
    }

    pub fn kill(mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("its end");
    }

    pub fn end(mut self) -> (ExitStatus, String, String) {
        let pid = Pid::from_raw(self.child.id().cast_signed());
        kill(pid, Signal::SIGTERM).expect("the process lives");
        self.wait()
    }

    /// Waits for the end, and for everything that was said until then.
    pub fn wait(&mut self) -> (ExitStatus, String, String) {
        let status = eventually("the program has ended", || self.child.try_wait().expect("its status"));
        let start = Instant::now();
        while !self.readers.iter().all(JoinHandle::is_finished) && start.elapsed() < LAST_WORDS {
            std::thread::sleep(Duration::from_millis(1));
        }
        let stdout = self.stdout.lock().expect("no panic above").clone();
        (status, stdout, self.stderr())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Figures of a line of the table that a gateway ends with: carried, lost, gaps, left out, runs.
pub fn figures(table: &str, key: &str) -> [u64; 5] {
    let line = table.lines().find(|line| line.split_whitespace().next() == Some(key));
    let line = line.unwrap_or_else(|| panic!("no {key} in\n{table}"));
    let figures: Vec<u64> = line
        .split_whitespace()
        .skip(1)
        .take(5)
        .map(|word| word.parse().expect("a number"))
        .collect();
    figures.try_into().expect("five figures")
}

/// A plant and its identifier on the bus, whose every message is known.
pub struct Machine {
    pub description: Publisher<Description>,
    pub estimates: Publisher<Estimate>,
    pub statuses: Publisher<Status>,
    pub journal: Publisher<Journal>,
    pub samples: Option<SamplePublisher>,
    _roles: [RoleLock; 2],
    pub bus: Bus,
}

impl Machine {
    pub fn new(domain: &Domain) -> Self {
        let bus = Bus::join(domain, "arm", "machine").expect("joined");
        let role = |role| RoleLock::acquire(domain, "arm", role).expect("free");
        let mut machine = Self {
            description: Publisher::new(&bus).expect("published"),
            estimates: Publisher::new(&bus).expect("published"),
            statuses: Publisher::new(&bus).expect("published"),
            journal: Publisher::new(&bus).expect("published"),
            samples: None,
            _roles: [role(Role::Identifier), role(Role::Plant)],
            bus,
        };
        machine.description.send(&description()).expect("sent");
        machine
    }

    pub fn with_samples(mut self) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        self.samples = Some(SamplePublisher::new(&self.bus, Delivery::Realtime, stop).expect("published"));
        self
    }

    pub fn sample(&mut self, seq: u64) {
        let samples = self.samples.as_mut().expect("with samples");
        samples.send(&sample(seq)).expect("sent");
        samples.wake();
    }

    /// The next message on the far side that `is_it` accepts, while this machine serves late
    /// joiners.
    pub fn until<T: thetabus::bus::Latched>(
        &mut self,
        subscriber: &mut Subscriber<T>,
        what: &str,
        is_it: impl Fn(&T) -> bool,
    ) -> T {
        eventually(what, || {
            self.tick();
            first(subscriber, &is_it)
        })
    }

    /// As an identifier does ten times a second.
    pub fn tick(&mut self) {
        self.description.serve_late_joiners().expect("served");
        self.estimates.serve_late_joiners().expect("served");
        self.statuses.serve_late_joiners().expect("served");
        self.journal.serve_late_joiners().expect("served");
        if let Some(samples) = &mut self.samples {
            samples.serve_late_joiners().expect("served");
        }
    }
}

pub fn description() -> Description {
    let parameters = (1..=9).map(|i| {
        ParameterInfo::new(
            &format!("theta_{i}"),
            "V s/rad",
            "a parameter",
            0.5,
            (0.0, f64::INFINITY),
        )
    });
    let joint = JointInfo::new("joint", "rad", "V");
    let mut description = Description::default().of_model("manipulator", 7, "V");
    description = description.with([joint; 2], parameters, [DerivedInfo::new("mass_2", "kg", "of link 2")]);
    description.equations = 2;
    description
}

pub fn estimate(block: u64) -> Estimate {
    let mut estimate = Estimate {
        stream_id: 11,
        block,
        params: 9,
        equations: 2,
        derived_len: 1,
        ..Estimate::EMPTY
    };
    for (i, theta) in estimate.theta[..9].iter_mut().enumerate() {
        *theta = block as f64 + 0.1 * i as f64;
    }
    estimate.theta_std[3] = f64::from_bits(0x7ff8_0000_0000_beef);
    estimate.derived[0] = 1.0 / 3.0;
    estimate
}

pub fn status(accepted: u64) -> Status {
    Status {
        stream_id: 11,
        accepted,
        ..Status::EMPTY
    }
}

pub fn journal(block: u64) -> Journal {
    Journal {
        stream_id: 11,
        block,
        request: Request::new(Order::Fix).named("theta_3").with_value(0.1 + 0.2),
    }
}

pub fn sample(seq: u64) -> Sample {
    let mut sample = Sample {
        stream_id: 11,
        seq,
        t_ns: seq * 1_000_000,
        joints: 2,
        signals: 33,
        ..Sample::EMPTY
    };
    sample.q[1] = seq as f64 * 0.001;
    sample.input[0] = -1.0 / 3.0;
    sample
}

/// Bytes of a message, so that not-a-number is compared, too.
pub fn bits(message: &Estimate) -> Vec<u64> {
    let all = message
        .theta
        .iter()
        .chain(&message.theta_std)
        .chain(&message.derived)
        .chain(&message.derived_std);
    [message.stream_id, message.block, message.params.into()]
        .into_iter()
        .chain(all.map(|x| x.to_bits()))
        .collect()
}

/// The next message on the far side that `is_it` accepts.
pub fn next<T: thetabus::bus::Latched>(subscriber: &mut Subscriber<T>, what: &str, is_it: impl Fn(&T) -> bool) -> T {
    eventually(what, || first(subscriber, &is_it))
}

fn first<T: thetabus::bus::Latched>(subscriber: &mut Subscriber<T>, is_it: &impl Fn(&T) -> bool) -> Option<T> {
    let mut found = None;
    let look = |message: &T| {
        if found.is_none() && is_it(message) {
            found = Some(*message);
        }
    };
    subscriber.drain(look).expect("received");
    found
}
