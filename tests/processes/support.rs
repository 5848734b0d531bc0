//! Domains, processes and watchdogs.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use thetabus::bus::{Bus, Domain, Subscriber};
use thetabus::messages::{Estimate, State, Status};
use thetabus::report::Summary;

/// Nothing here takes this long unless it hangs.
pub const WATCHDOG: Duration = Duration::from_secs(60);

/// Longest wait for the last words of a program that has ended: an orphan may keep its pipes open.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// The paper's experiment: exact signals, so that every estimate has one right value.
pub const PAPER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/cedro2022.toml");

/// Positions and voltages alone: what `run` runs where no configuration is named.
pub const ENCODERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/encoder_only.toml");

/// A servo axis with friction: the other model that is built in.
pub const SERVO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml");

/// Short blocks and iterations enough to converge at once: what these tests need of the estimator.
pub const QUICK: [&str; 4] = [
    "--set",
    "estimator.block_len=200",
    "--set",
    "estimator.max_iterations=10",
];

#[derive(Debug, Clone, Copy)]
pub enum Program {
    Plant,
    Identifier,
    Monitor,
    Controller,
    Thetabus,
}

impl Program {
    fn path(self) -> &'static str {
        match self {
            Self::Plant => env!("CARGO_BIN_EXE_plant_simulator"),
            Self::Identifier => env!("CARGO_BIN_EXE_identifier"),
            Self::Monitor => env!("CARGO_BIN_EXE_monitor"),
            Self::Controller => env!("CARGO_BIN_EXE_controller"),
            Self::Thetabus => env!("CARGO_BIN_EXE_thetabus"),
        }
    }
}

/// A domain and a directory for one test.
pub struct Site {
    pub domain: Domain,
    pub dir: TempDir,
}

impl Site {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        let domain = Domain::new(&format!("t{}-{n}", std::process::id())).expect("valid name");
        Self {
            domain,
            dir: tempfile::tempdir().expect("a temporary directory"),
        }
    }

    pub fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    /// Starts a program in this domain; a plant, identifier or monitor with the paper's experiment
    /// unless it is given a configuration.
    pub fn start(&self, program: Program, args: &[&str]) -> Process {
        let named = matches!(program, Program::Thetabus) || args.contains(&"--config");
        let paper = if named { &[][..] } else { &["--config", PAPER] };
        let mut command = Command::new(program.path());
        command
            .current_dir(self.dir.path())
            .args(paper)
            .args(args)
            .args(["--domain", self.domain.name()]);
        Process::start(command)
    }

    /// `thetabus run`, results in `out()`: the paper's experiment unless the first argument is a
    /// configuration.
    pub fn start_run(&self, args: &[&str]) -> Process {
        let out = self.out();
        let out = out.to_str().expect("UTF-8");
        let named = args.first().is_some_and(|arg| arg.ends_with(".toml"));
        let paper = if named { &[][..] } else { &[PAPER] };
        self.start(Program::Thetabus, &[&["run", "--out", out], paper, args].concat())
    }

    /// What an observer in this domain sees.
    pub fn observer(&self) -> Observer {
        let bus = Bus::join(&self.domain, "arm", "observer").expect("join");
        Observer {
            estimates: Subscriber::new(&bus).expect("subscribe"),
            statuses: Subscriber::new(&bus).expect("subscribe"),
            last_estimate: None,
            last_status: None,
        }
    }

    /// Processes that have this test's directory or domain on their command line.
    pub fn processes(&self) -> Vec<u32> {
        let dir = self.dir.path().as_os_str().as_encoded_bytes();
        // A whole word: t1-1 is the beginning of t1-12.
        let domain = self.domain.name().as_bytes();
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
            let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse().ok()) else {
                continue;
            };
            let Ok(line) = std::fs::read(entry.path().join("cmdline")) else {
                continue;
            };
            let is_named = line.split(|&byte| byte == 0).any(|word| word == domain);
            if is_named || line.windows(dir.len()).any(|part| part == dir) {
                found.push(pid);
            }
        }
        found
    }

    /// The child of `launcher` in this role.
    pub fn child(&self, launcher: &Process, role: &str) -> Pid {
        eventually("the child has started", || {
            self.processes().into_iter().find(|&pid| {
                let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
                let is_role = line.split(|&byte| byte == 0).nth(1) == Some(role.as_bytes());
                is_role && parent(pid) == Some(launcher.pid())
            })
        })
        .pipe(|pid| Pid::from_raw(pid.cast_signed()))
    }

    /// Shared-memory objects of this domain, without the one that iceoryx2 keeps per domain.
    pub fn shared_memory(&self) -> Vec<String> {
        std::fs::read_dir("/dev/shm")
            .expect("/dev/shm")
            .flatten()
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .filter(|name| name.starts_with(self.domain.prefix()) && !name.ends_with(".global_mgmt"))
            .collect()
    }

    pub fn summary(&self) -> Summary {
        let text = std::fs::read_to_string(self.out().join("summary.json")).expect("summary.json");
        serde_json::from_str(&text).expect("a summary")
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        for pid in self.processes() {
            let _ = kill(Pid::from_raw(pid.cast_signed()), Signal::SIGKILL);
        }
        let _ = std::fs::remove_dir_all(self.domain.root());
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(self.domain.prefix()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

trait Pipe: Sized {
    fn pipe<T>(self, f: impl FnOnce(Self) -> T) -> T {
        f(self)
    }
}
impl<T> Pipe for T {}

fn parent(pid: u32) -> Option<u32> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may hold anything; state and parent follow it.
    stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()
}

/// A path as an argument of a program.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Numbers that look random, the same in every run of a test.
pub struct Dice(pub u64);

impl Dice {
    /// The next state; its upper bits look random (Knuth's MMIX generator).
    fn bits(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0
    }

    /// From 0 to below 1.
    pub fn roll(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// One of 0 to `count - 1`.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.bits() >> 33) % count as u64) as usize
    }
}

/// Processor time that a process has used.
pub fn cpu_time(pid: Pid) -> Duration {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("the process lives");
    let fields: Vec<&str> = stat.rsplit_once(')').expect("a name").1.split_whitespace().collect();
    // Fields 14 and 15 of proc(5), user and system, in ticks of 10 ms.
    let ticks: u64 = fields[11..13]
        .iter()
        .map(|field| field.parse::<u64>().expect("a number"))
        .sum();
    Duration::from_millis(10 * ticks)
}

/// A started program with its output; killed on drop.
pub struct Process {
    child: Child,
    stdout: Output,
    stderr: Output,
    readers: [JoinHandle<()>; 2],
}

type Output = Arc<Mutex<Vec<String>>>;

/// What comes out of a pipe, and the thread that reads it until it is closed.
fn collect(stream: impl Read + Send + 'static) -> (Output, JoinHandle<()>) {
    let lines = Output::default();
    let sink = lines.clone();
    let reader = thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            sink.lock().expect("no panic above").push(line);
        }
    });
    (lines, reader)
}

impl Process {
    pub fn start(mut command: Command) -> Self {
        let mut child = command
            // A job of its own, as a shell gives it.
            .process_group(0)
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

    pub fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.pid().cast_signed()), signal).expect("the process lives");
    }

    /// A signal to the whole job, as Ctrl-C on a terminal does.
    pub fn signal_group(&self, signal: Signal) {
        kill(Pid::from_raw(-self.pid().cast_signed()), signal).expect("the job lives");
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }

    /// Waits for the end, and for everything that was said until then.
    pub fn wait(&mut self) -> ExitStatus {
        let start = Instant::now();
        while start.elapsed() < WATCHDOG {
            if let Some(status) = self.child.try_wait().expect("a child") {
                self.hear_out();
                return status;
            }
            thread::sleep(Duration::from_millis(5));
        }
        panic!("still running after {WATCHDOG:?}\n{}", self.said());
    }

    /// Waits until the readers have seen the end of both outputs.
    fn hear_out(&self) {
        let start = Instant::now();
        while !self.readers.iter().all(JoinHandle::is_finished) && start.elapsed() < LAST_WORDS {
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Waits for the end and for this exit code.
    #[track_caller]
    pub fn expect_code(&mut self, code: i32) {
        let status = self.wait();
        assert_eq!(
            status.code(),
            Some(code),
            "signal {:?}\n{}",
            status.signal(),
            self.said()
        );
    }

    pub fn stdout(&self) -> String {
        self.stdout.lock().expect("no panic there").join("\n")
    }

    pub fn stderr(&self) -> String {
        self.stderr.lock().expect("no panic there").join("\n")
    }

    pub fn said(&self) -> String {
        format!("--- stdout\n{}\n--- stderr\n{}", self.stdout(), self.stderr())
    }

    #[track_caller]
    pub fn expect_stderr(&self, parts: &[&str]) {
        for part in parts {
            eventually(&format!("standard error says {part:?}:\n{}", self.said()), || {
                self.stderr().contains(part).then_some(())
            });
        }
    }

    /// Waits for a line of the log.
    #[track_caller]
    pub fn wait_for_log(&self, part: &str) {
        eventually(&format!("the log says {part:?}"), || {
            self.stderr().contains(part).then_some(())
        });
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // A stopped process ends by SIGKILL, too.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Sees what the identifier publishes.
pub struct Observer {
    estimates: Subscriber<Estimate>,
    statuses: Subscriber<Status>,
    pub last_estimate: Option<Estimate>,
    pub last_status: Option<Status>,
}

impl Observer {
    pub fn look(&mut self) {
        let (estimate, status) = (&mut self.last_estimate, &mut self.last_status);
        self.estimates.drain(|e| *estimate = Some(*e)).expect("drain");
        self.statuses.drain(|s| *status = Some(*s)).expect("drain");
    }

    /// Waits for an estimate that is wanted.
    #[track_caller]
    pub fn estimate(&mut self, what: &str, wanted: impl Fn(&Estimate) -> bool) -> Estimate {
        eventually(what, || {
            self.look();
            self.last_estimate.filter(&wanted)
        })
    }

    /// Waits for a status that is wanted.
    #[track_caller]
    pub fn status(&mut self, what: &str, wanted: impl Fn(&Status) -> bool) -> Status {
        eventually(what, || {
            self.look();
            self.last_status.filter(&wanted)
        })
    }

    /// Waits for the end of a stream.
    #[track_caller]
    pub fn end(&mut self) -> Status {
        self.status("the stream has ended", |status| status.state == State::Ended as u32)
    }
}

/// Waits for a condition under the watchdog.
#[track_caller]
pub fn eventually<T>(what: &str, mut condition: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = condition() {
            return found;
        }
        assert!(start.elapsed() < WATCHDOG, "not within {WATCHDOG:?}: {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// The numbers of a column of estimates.csv.
pub fn column(csv: &Path, name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(csv).expect("estimates.csv");
    let mut lines = text.lines();
    let header = lines.next().expect("a header");
    let index = header.split(',').position(|column| column == name).expect("the column");
    lines
        .map(|line| {
            line.split(',')
                .nth(index)
                .expect("the column")
                .parse()
                .expect("a number")
        })
        .collect()
}
