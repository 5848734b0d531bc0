//! The monitor as a process: a line of text per estimate, estimates.csv, summary.json.

use super::args::{domain, quoted};
use super::description::monitor_of;
use super::live::Live;
use super::new_file::whole;
use super::record::{Records, recorder};
use super::wiring::monitor_node;
use super::{Exit, Failure, MonitorArgs, child, foreign, logging, out_dir, readiness};
use crate::bus::{Bus, SampleSubscriber, Subscriber};
use crate::config::Config;
use crate::files;
use crate::messages::Description;
use crate::node::monitor::MonitorNode;
use crate::node::simulated_plant::SimulatedLosses;
use crate::recording::{Entry, EstimatesCsv, RecordingReader, Span, oldest_file};
use crate::report::Summary;
use crate::runner::{MonitorPorts, RunError, Shutdown, TICK, apply_realtime, run_monitor};
use nix::fcntl::OFlag;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// Name of the file with one line per block.
pub(super) const ESTIMATES_CSV: &str = "estimates.csv";
/// How long an identifier may take to send its description.
const DESCRIBED_WITHIN: Duration = Duration::from_secs(1);
/// Name of the file with the end of the run.
pub(super) const SUMMARY_JSON: &str = "summary.json";

/// Follows the estimates of a robot until it is asked to stop.
///
/// # Errors
/// If the configuration is wrong, the directory is not empty, or the bus or a disk fails.
pub fn run(args: &MonitorArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    child::follow_launcher(&args.common)?;
    let out = quoted(args.out.as_ref().map(|dir| dir.display().to_string()));
    let config = args.common.load(Vec::new(), &[("monitor.out_dir", out)])?;
    let mut monitor = Monitor::begin(args, &config)?;
    let outcome = monitor.follow(shutdown)?;
    let recorded = monitor.records.finish();

    let summary = Summary::new(&monitor.node, &config.bus.robot, &monitor.model);
    if let Some(dir) = monitor.dir {
        write_summary(dir, &summary)?;
    }
    match outcome {
        Err(RunError::ForeignModel(_)) => return Err(foreign::estimates(&monitor.bus, &config)),
        outcome => outcome?,
    }
    if !args.common.is_launched() {
        logging::table(&summary, args.format)?;
        if let Some(dir) = monitor.dir {
            logging::note(args.format, &format!("results in {}", dir.display()))?;
        }
    }
    warn_of_losses(&monitor.ports, &monitor.node);
    let recording_lost = match recorded {
        Some(Ok(lost)) => lost > 0,
        Some(Err(())) => true,
        None => false,
    };
    // If nothing may be lost, a lost estimate affects the run's exit code; a gap in a recording
    // always does.
    let estimate_lost = args.common.launched.receipts && monitor.node.lost_estimates() > 0;
    Ok(if recording_lost || estimate_lost {
        Exit::DataLoss
    } else if shutdown.requested() && !monitor.node.is_complete() {
        Exit::Interrupted
    } else {
        Exit::Done
    })
}

/// A running monitor: its ports, its state, and its files.
struct Monitor<'a> {
    args: &'a MonitorArgs,
    config: &'a Config,
    /// Directory of its files.
    dir: Option<&'a Path>,
    ports: MonitorPorts,
    node: MonitorNode,
    /// Name of the model of the node's labels.
    model: String,
    records: Records,
    /// Last, so that it is dropped after all ports.
    bus: Bus,
}

impl<'a> Monitor<'a> {
    /// Opens the files, then the bus.
    fn begin(args: &'a MonitorArgs, config: &'a Config) -> Result<Self, Failure> {
        let domain = domain(config)?;
        let robot = &config.bus.robot;
        // A launcher has created and checked the directory, and written the configuration to it.
        let dir = config.monitor.out_dir.as_deref();
        if let Some(dir) = dir.filter(|_| !args.common.is_launched()) {
            out_dir::check(dir)?;
            out_dir::create(dir)?;
        }
        // The truth is known for a launched plant; any other publisher may be a real machine.
        let truth = args.common.is_launched().then_some(&config.plant.sim);
        let mut node = monitor_node(config, truth);
        let resume = args.common.launched.resume;
        if let Some(path) = args.record.as_deref().filter(|_| resume) {
            remember(&mut node, path);
        }
        let equations = config.model.structure().equations.len();
        let csv = dir.map(|dir| {
            let path = dir.join(ESTIMATES_CSV);
            estimates_csv(&path, &node, equations, resume).map_err(|e| unwritable(&path, &e))
        });
        let csv = csv.transpose()?;
        let recorder = args
            .record
            .as_ref()
            .map(|path| recorder(path, config, &node, args.common.is_launched(), resume))
            .transpose()?;
        let live = Live::start(config, &node, args)?;
        let bus = Bus::join(&domain, robot, "monitor")?;
        let takes_samples = recorder.is_some() || args.web.takes_samples();
        let ports = connect(&bus, args.common.launched.receipts, takes_samples)?;
        let simulated = truth.map(SimulatedLosses::new);
        let records = Records::new(csv, recorder, Some(bus.clone()), live, simulated);
        tracing::info!(robot, domain = domain.name(), "monitor");
        apply_realtime(&config.realtime.monitor);
        if !args.common.is_launched() {
            readiness::ready();
        }
        Ok(Self {
            args,
            config,
            dir,
            bus,
            ports,
            node,
            model: config.model.name().to_owned(),
            records,
        })
    }

    /// Receives messages until asked to stop, or until the end of the stream. While nothing has
    /// been written under its labels, it adopts those of another model that the identifier
    /// describes.
    fn follow(&mut self, shutdown: &Shutdown) -> Result<Result<(), RunError>, Failure> {
        loop {
            let Self {
                node, ports, records, ..
            } = self;
            let outcome = run_monitor(node, ports, self.args.common.stay(), shutdown, records);
            let Err(RunError::ForeignModel(description)) = outcome else {
                return Ok(outcome);
            };
            // A recording contains this monitor's configuration for later identification, so it
            // must be the right one.
            if self.node.blocks() > 0 || self.records.is_recording() {
                return Ok(Err(RunError::ForeignModel(description)));
            }
            let description = match description {
                Some(description) => description,
                None => match await_description(&mut self.ports)? {
                    Some(description) => {
                        // A new subscriber receives the first estimate again.
                        self.ports.estimates = Subscriber::new(&self.bus)?;
                        description
                    }
                    None => return Ok(Err(RunError::ForeignModel(None))),
                },
            };
            self.take_labels(&description)?;
        }
    }

    /// Continues with the labels of another model.
    fn take_labels(&mut self, description: &Description) -> Result<(), Failure> {
        foreign::warn_of_description(description, self.config);
        self.node = monitor_of(description);
        self.records.rename(description);
        self.model = description.model().to_owned();
        if let Some(dir) = self.dir {
            let csv = renamed_csv(&dir.join(ESTIMATES_CSV), &self.node, description.equations)?;
            self.records.csv = Some(csv);
        }
        Ok(())
    }
}

/// Warns about lost and ignored messages.
fn warn_of_losses(ports: &MonitorPorts, node: &MonitorNode) {
    let left_out = ports.estimates.left_out().saturating_add(ports.status.left_out());
    if left_out > 0 {
        tracing::warn!(
            left_out,
            "messages of another schema, or of a publisher beside the identifier, were left out"
        );
    }
    let lost = node.lost_estimates();
    if lost > 0 {
        tracing::warn!(
            lost,
            "some blocks have no estimate here: lost on the way, or never made because their samples were"
        );
    }
}

/// The ports of a monitor. With `receipts` the identifier waits for it.
fn connect(bus: &Bus, receipts: bool, takes_samples: bool) -> Result<MonitorPorts, Failure> {
    let mut ports = MonitorPorts {
        // First, because an identifier that waits for a subscriber of its estimates publishes to
        // the journal before that.
        journal: Subscriber::new(bus)?,
        estimates: Subscriber::new(bus)?,
        status: Subscriber::new(bus)?,
        description: Subscriber::new(bus)?,
        samples: None,
    };
    if receipts {
        ports.estimates.give_receipts(bus)?;
    }
    // Last, because in lockstep the plant starts when this process subscribes, and the identifier
    // may have found another reader to wait for.
    if takes_samples {
        ports.samples = Some(SampleSubscriber::new(bus)?);
    }
    Ok(ports)
}

/// The identifier's description, if it arrives within a second.
pub(super) fn await_description(ports: &mut MonitorPorts) -> Result<Option<Box<Description>>, Failure> {
    let start = Instant::now();
    let mut found = None;
    while found.is_none() && start.elapsed() < DESCRIBED_WITHIN {
        ports.description.wait(TICK / 4)?;
        ports
            .description
            .drain(|description| found = Some(Box::new(*description)))?;
    }
    Ok(found)
}

/// Restarts the table with other names; so far it has only its header.
fn renamed_csv(path: &Path, node: &MonitorNode, equations: u32) -> Result<EstimatesCsv<File>, Failure> {
    let begin = || {
        std::fs::remove_file(path)?;
        EstimatesCsv::new(
            File::create_new(path)?,
            node.parameters(),
            equations as usize,
            node.derived(),
        )
    };
    begin().map_err(|e| unwritable(path, &e))
}

/// A new file with its header, or that of a monitor that died.
fn estimates_csv(path: &Path, node: &MonitorNode, equations: usize, resume: bool) -> io::Result<EstimatesCsv<File>> {
    if !resume || !path.exists() {
        return EstimatesCsv::new(File::create_new(path)?, node.parameters(), equations, node.derived());
    }
    // Do not follow a link in place of the file, and do not wait for a pipe.
    let mut file = File::options()
        .read(true)
        .append(true)
        .custom_flags((OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK).bits())
        .open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("expected a file, got something else of its name"));
    }
    let mut text = String::new();
    file.read_to_string(&mut text)?;
    // Cut off an incomplete last line.
    let whole = text.rfind('\n').map_or(0, |at| at + 1);
    file.set_len(whole as u64)?;
    match text[..whole].lines().last() {
        None => EstimatesCsv::new(file, node.parameters(), equations, node.derived()),
        Some(last) => Ok(EstimatesCsv::resume(
            file,
            node.parameters(),
            equations,
            node.derived(),
            last,
        )),
    }
}

/// Restores what the dead monitor had received, from its recording.
fn remember(node: &mut MonitorNode, recording: &Path) {
    // The first file may have been removed in favour of a later one.
    let oldest = oldest_file(recording);
    let Some(Ok(mut reader)) = oldest.map(|path| RecordingReader::open(&path, Span::default())) else {
        return;
    };
    while let Ok(Some(entry)) = reader.next_entry() {
        match entry {
            Entry::Estimate { estimate, .. } => _ = node.on_estimate(estimate),
            Entry::Status { status, .. } => node.on_status(status),
            _ => {}
        }
    }
}

pub(super) fn write_summary(dir: &Path, summary: &Summary) -> Result<(), Failure> {
    let path = dir.join(SUMMARY_JSON);
    let write = || -> io::Result<()> {
        let mut text = serde_json::to_string_pretty(summary)?;
        text.push('\n');
        files::write_synced(&path, text.as_bytes())
    };
    write().map_err(|e| unwritable(&path, &e))
}

pub(super) fn unwritable(path: &Path, error: &io::Error) -> Failure {
    Failure::Failed(format!("{} cannot be written: {error}", whole(path).display()))
}
