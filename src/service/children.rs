//! The processes of a run: starting in order, supervision, restarting, ending.
//!
//! A signal is passed on only to the plant, once: it flags its next sample END, and the others end
//! after it. Any child still running after the grace period receives SIGTERM, then SIGKILL. If the
//! launcher dies, its children terminate too.
//!
//! A process that ends before the plant's END without a request of the launcher has failed, even if
//! another process's signal ended it cleanly.
//!
//! A process that fails is restarted if `supervision.restarts` permits. The plant then begins a new
//! stream, the identifier continues with the next complete block, and the monitor appends to its
//! files. Each restart loses data, so the run ends with exit code 3.

use super::exit::INTERRUPTED;
use super::progress::Progress;
use super::record::RECORDING;
use super::supervision::Restarts;
use super::{Failure, LogFormat, WebArgs, logging};
use crate::bus::{Bus, Subscriber};
use crate::config::SupervisionConfig;
use crate::messages::{Estimate, Status};
use crate::runner::Shutdown;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Polling period of children and status.
const POLL: Duration = Duration::from_millis(20);
/// How long identifier and monitor may take to empty their queues after the plant has ended.
const GRACE: Duration = Duration::from_secs(10);
/// The same if the plant has ended before its first sample, so that there is nothing in the queues.
const NO_STREAM_GRACE: Duration = Duration::from_secs(1);
/// How long a process may take to end after its signal.
const SIGNAL_GRACE: Duration = Duration::from_secs(5);
/// How long the others may take to end by themselves after one has failed.
const FAILURE_GRACE: Duration = Duration::from_secs(2);
/// A signal that ends a child may reach the launcher an instant later too, if a whole job or
/// service is ended.
const SIGNALS_MEET: Duration = Duration::from_millis(300);
/// Number of last lines of a failed child to show again.
const LAST_LINES: usize = 8;

/// Settings for all children.
pub(super) struct Plan {
    pub(super) program: PathBuf,
    pub(super) config: PathBuf,
    pub(super) dir: PathBuf,
    pub(super) log_format: LogFormat,
    pub(super) lockstep: bool,
    pub(super) record: bool,
    /// Number of sample consumers.
    pub(super) consumers: usize,
    pub(super) warm: bool,
    /// True if there may be a checkpoint to start from.
    pub(super) checkpoints: bool,
    pub(super) supervision: SupervisionConfig,
    /// True if a controller is part of the run.
    pub(super) controller: bool,
    /// Web page of the monitor.
    pub(super) web: WebArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Monitor,
    Identifier,
    Controller,
    Plant,
}

impl Part {
    /// In starting order: each waits for the one before it.
    const ALL: [Self; 4] = [Self::Monitor, Self::Identifier, Self::Controller, Self::Plant];

    fn name(self) -> &'static str {
        match self {
            Self::Monitor => "monitor",
            Self::Identifier => "identifier",
            Self::Controller => "controller",
            Self::Plant => "plant",
        }
    }
}

/// One of the processes.
struct Process {
    part: Part,
    child: Child,
    last_lines: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
    started: Instant,
    ended: Option<(ExitStatus, Instant)>,
    signalled: Option<Instant>,
    /// True if the run is ending, so children may end early.
    excused: bool,
    restarts: Restarts,
    /// When it is restarted after a failure.
    due: Option<Instant>,
}

/// All processes, from their start to the end of the last.
pub(super) struct Children {
    processes: Vec<Process>,
    killed: bool,
}

impl Children {
    /// Starts all processes, or none.
    pub(super) fn start(plan: &Plan, progress: &Arc<Progress>) -> Result<Self, Failure> {
        let mut children = Self {
            processes: Vec::new(),
            killed: false,
        };
        for part in Part::ALL
            .into_iter()
            .filter(|part| *part != Part::Controller || plan.controller)
        {
            match Process::start(part, plan, progress, false) {
                Ok(process) => children.processes.push(process),
                Err(e) => {
                    children.end_all(Duration::ZERO);
                    return Err(Failure::Failed(format!("cannot start the {}: {e}", part.name())));
                }
            }
        }
        Ok(children)
    }

    /// Waits for the end; true if a child reports lost data.
    pub(super) fn supervise(
        &mut self,
        plan: &Plan,
        bus: &Bus,
        (mut status, mut estimates): (Subscriber<Status>, Option<Subscriber<Estimate>>),
        progress: &Arc<Progress>,
        shutdown: &Shutdown,
    ) -> Result<bool, Failure> {
        let mut streaming = false;
        loop {
            if let Some(estimates) = &mut estimates {
                estimates.drain_timed(|estimate, sent_ns| progress.found(estimate, sent_ns))?;
            }
            status.drain_timed(|status, sent_ns| {
                streaming |= status.stream_id != 0;
                progress.show(status, sent_ns);
            })?;
            for process in &mut self.processes {
                process.poll();
                process.excused |= shutdown.requested();
            }
            let may_restart = !shutdown.requested() && self.plant_gone().is_none();
            for process in &mut self.processes {
                process.plan_restart(may_restart);
                self.killed |= process.due.is_some();
                if process.is_due() {
                    // Frees the dead process's resources before its successor needs them.
                    bus.clean_up_dead();
                    process
                        .restart(plan, progress)
                        .map_err(|e| Failure::Failed(format!("cannot start the {} again: {e}", process.part.name())))?;
                }
            }
            if let Some(failure) = self.processes.iter().find_map(Process::failure) {
                // The plant's END lets the other processes write their results.
                self.signal(Part::Plant);
                self.end_all(FAILURE_GRACE);
                return Err(Failure::Failed(failure));
            }
            if self.processes.iter().all(|p| p.has_ended() && !p.is_open_question()) {
                self.join_readers();
                return Ok(self.processes.iter().any(Process::lost_data));
            }
            if shutdown.requested() {
                self.signal(Part::Plant);
            }
            if let Some(gone) = self.plant_gone() {
                // Without a first sample there is no END to wait for.
                let grace = if streaming { GRACE } else { NO_STREAM_GRACE };
                if gone.elapsed() > grace {
                    self.end_all(SIGNAL_GRACE);
                }
            } else if shutdown.requested() && self.signalled_since(Part::Plant) > SIGNAL_GRACE {
                self.end_all(SIGNAL_GRACE);
            }
            std::thread::sleep(POLL);
        }
    }

    fn plant_gone(&self) -> Option<Instant> {
        let plant = self.processes.iter().find(|process| process.part == Part::Plant)?;
        // A failed plant may be restarted.
        let gone = plant.has_ended() && plant.failure().is_none() && !plant.is_open_question();
        plant.ended.filter(|_| gone).map(|(_, at)| at)
    }

    fn signalled_since(&self, part: Part) -> Duration {
        let process = self.processes.iter().find(|process| process.part == part);
        process
            .and_then(|p| p.signalled)
            .map_or(Duration::ZERO, |at| at.elapsed())
    }

    /// One SIGTERM, however often this is called.
    fn signal(&mut self, part: Part) {
        for process in self.processes.iter_mut().filter(|process| process.part == part) {
            process.terminate();
        }
    }

    /// Ends the remaining children: by themselves within `grace`, then by SIGTERM, then by SIGKILL.
    fn end_all(&mut self, grace: Duration) {
        let start = Instant::now();
        while self.any_left() && start.elapsed() < grace + SIGNAL_GRACE {
            // The identifier drains the plant's END, the monitor the identifier's last status.
            if start.elapsed() >= grace {
                self.processes.iter_mut().for_each(Process::terminate);
            }
            std::thread::sleep(POLL);
        }
        for process in &mut self.processes {
            if process.ended.is_none() {
                self.killed = true;
                let _ = process.child.kill();
                let _ = process.child.wait();
                process.poll();
            }
        }
        self.killed |= self
            .processes
            .iter()
            .any(|p| p.ended.is_some_and(|(status, _)| status.signal().is_some()));
        self.join_readers();
    }

    /// True if a process ended without cleaning up.
    pub(super) fn has_killed(&self) -> bool {
        self.killed
    }

    /// Restarts by process.
    pub(super) fn restarts(&self) -> BTreeMap<String, u64> {
        let count = |process: &Process| (process.part.name().to_owned(), process.restarts.total());
        self.processes.iter().map(count).collect()
    }

    fn any_left(&mut self) -> bool {
        self.processes.iter_mut().for_each(Process::poll);
        self.processes.iter().any(|process| process.ended.is_none())
    }

    fn join_readers(&mut self) {
        for process in &mut self.processes {
            if let Some(reader) = process.reader.take() {
                let _ = reader.join();
            }
        }
    }
}

impl Process {
    fn start(part: Part, plan: &Plan, progress: &Arc<Progress>, resume: bool) -> std::io::Result<Self> {
        let mut command = Command::new(&plan.program);
        command
            .arg(part.name())
            .arg("--config")
            .arg(&plan.config)
            .arg("--launched-by")
            .arg(std::process::id().to_string())
            .arg("--log-format")
            .arg(logging::format_name(plan.log_format))
            // A separate process group: Ctrl-C on the terminal reaches only the launcher, which
            // passes it on once.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        if plan.lockstep && matches!(part, Part::Monitor | Part::Identifier) {
            command.arg("--receipts");
        }
        match part {
            Part::Monitor => {
                command.arg("--until-end").arg("--out").arg(&plan.dir);
                if plan.record {
                    command.arg("--record").arg(plan.dir.join(RECORDING));
                }
                if resume {
                    command.arg("--resume");
                }
                if let Some(address) = plan.web.web {
                    command.arg("--web").arg(address.to_string());
                }
                #[cfg(feature = "foxglove")]
                if let Some(address) = plan.web.foxglove {
                    command.arg("--foxglove").arg(address.to_string());
                    if plan.web.foxglove_open {
                        command.arg("--foxglove-open");
                    }
                }
                if plan.web.web_control {
                    command.arg("--web-control");
                }
                &mut command
            }
            Part::Identifier => {
                // A restarted identifier continues from its last checkpoint.
                if plan.warm || (resume && plan.checkpoints) {
                    command.arg("--warm");
                }
                command.args(["--until-end", "--await-consumers", "1"])
            }
            Part::Controller => command.arg("--until-end"),
            Part::Plant => command.arg("--await-consumers").arg(plan.consumers.to_string()),
        };
        let mut child = command.spawn()?;
        let last_lines = Arc::new(Mutex::new(VecDeque::new()));
        let reader = child.stderr.take().map(|stderr| {
            let (lines, progress) = (last_lines.clone(), progress.clone());
            std::thread::spawn(move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    progress.pass_on(&line);
                    let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
                    if lines.len() == LAST_LINES {
                        lines.pop_front();
                    }
                    lines.push_back(line);
                }
            })
        });
        Ok(Self {
            part,
            child,
            last_lines,
            reader,
            started: Instant::now(),
            ended: None,
            signalled: None,
            excused: false,
            restarts: Restarts::new(plan.supervision),
            due: None,
        })
    }

    /// Decides once about restarting a failed process; `allowed` is false if the run is ending
    /// anyway.
    fn plan_restart(&mut self, allowed: bool) {
        if !allowed {
            self.due = None;
            return;
        }
        let Some((status, at)) = self.ended.filter(|_| self.due.is_none() && self.signalled.is_none()) else {
            return;
        };
        // Its END has ended the others, so restarting is useless.
        if self.part == Part::Plant && self.interrupted().is_some() {
            return;
        }
        // Restarting does not help against wrong usage or configuration.
        let Some(failure) = self.failure().filter(|_| status.code() != Some(2)) else {
            return;
        };
        if let Some(pause) = self.restarts.failed(at - self.started) {
            self.due = Some(at + pause);
            tracing::warn!(
                restart = self.restarts.in_a_row(),
                pause_s = pause.as_secs_f64(),
                "{failure}; it is started again"
            );
        }
    }

    fn is_due(&self) -> bool {
        self.due.is_some_and(|due| Instant::now() >= due)
    }

    fn restart(&mut self, plan: &Plan, progress: &Arc<Progress>) -> std::io::Result<()> {
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
        let restarts = self.restarts;
        *self = Self::start(self.part, plan, progress, true)?;
        self.restarts = restarts;
        Ok(())
    }

    /// True if it has ended and will not be restarted.
    fn has_ended(&self) -> bool {
        self.ended.is_some() && self.due.is_none()
    }

    fn poll(&mut self) {
        if self.ended.is_none()
            && let Ok(Some(status)) = self.child.try_wait()
        {
            self.ended = Some((status, Instant::now()));
        }
    }

    fn terminate(&mut self) {
        if self.ended.is_none() && self.signalled.is_none() {
            self.signalled = Some(Instant::now());
            // Not yet waited for, so the process id is still this child's.
            let _ = kill(Pid::from_raw(self.child.id().cast_signed()), Signal::SIGTERM);
        }
    }

    fn lost_data(&self) -> bool {
        self.ended.is_some_and(|(status, _)| status.code() == Some(3))
    }

    /// When it ended because of a signal that did not come from the launcher.
    fn interrupted(&self) -> Option<Instant> {
        let (status, at) = self.ended.filter(|_| self.due.is_none())?;
        let unasked = self.signalled.is_none() && !self.excused;
        (unasked && status.code() == Some(i32::from(INTERRUPTED))).then_some(at)
    }

    /// True if it is not yet known whether that is a failure.
    fn is_open_question(&self) -> bool {
        self.interrupted().is_some_and(|at| at.elapsed() < SIGNALS_MEET)
    }

    /// Message for the user about a failed child.
    fn failure(&self) -> Option<String> {
        let (status, _) = self.ended.filter(|_| self.due.is_none())?;
        let how = match (status.code(), status.signal()) {
            (Some(0 | 3), _) => return None,
            (Some(code), _) if code == i32::from(INTERRUPTED) => match self.interrupted() {
                Some(at) if at.elapsed() >= SIGNALS_MEET => {
                    "was ended by a signal before the plant's stream had come to its end".to_owned()
                }
                _ => return None,
            },
            // The signal came before its handler was installed.
            (None, Some(number)) if number == Signal::SIGTERM as i32 && self.signalled.is_some() => return None,
            (Some(code), _) => format!("failed with exit code {code}"),
            (None, Some(number)) => {
                let name = Signal::try_from(number).map_or("unknown signal", Signal::as_str);
                format!("was killed by signal {number} ({name})")
            }
            (None, None) => format!("ended in an unknown way ({status})"),
        };
        let lines = self.last_lines.lock().unwrap_or_else(PoisonError::into_inner);
        let last: Vec<&str> = lines.iter().map(String::as_str).collect();
        let said = if last.is_empty() {
            "it said nothing".to_owned()
        } else {
            format!("its last lines:\n  {}", last.join("\n  "))
        };
        Some(format!(
            "the {}, process {}, {how}; {said}",
            self.part.name(),
            self.child.id()
        ))
    }
}
