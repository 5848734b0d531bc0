//! The identifier's desk: a thread that answers requests, prepares commands, writes the journal and
//! checkpoints, and does periodic work, so that the loop need not.

use super::Failure;
use super::desk_work::{LOOK, Work};
use crate::bus::{Bus, BusError, ControlServer, Domain};
use crate::checkpoint;
use crate::config::Config;
use crate::messages::Request;
use crate::node::command::{Border, NodeState};
use crate::runner::DeskEnd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Largest number of requests answered in a row, so that clients without pauses cannot prevent
/// checkpoints or the end.
const ROUND: usize = 64;

/// A running desk.
pub(super) struct Desk {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Desk {
    /// Opens the desk for these robots.
    ///
    /// # Errors
    /// If the control service is already in use, or the bus fails.
    pub(super) fn open(domain: &Domain, setups: Vec<DeskSetup>) -> Result<Self, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        let (told, ready) = sync_channel::<Result<(), BusError>>(1);
        let (domain, stopped) = (domain.clone(), stop.clone());
        let thread = std::thread::Builder::new()
            .name("desk".to_owned())
            .spawn(move || {
                // Ports belong to the thread that creates them.
                match robot_desks(&domain, setups) {
                    Ok(mut robot_desks) => {
                        let _ = told.send(Ok(()));
                        work(&mut robot_desks, &stopped);
                    }
                    Err(e) => _ = told.send(Err(e)),
                }
            })
            .map_err(|e| Failure::Failed(format!("cannot start a thread: {e}")))?;
        let desk = Self {
            stop,
            thread: Some(thread),
        };
        match ready.recv() {
            Ok(Ok(())) => Ok(desk),
            Ok(Err(e)) => Err(e.into()),
            Err(_) => Err(Failure::Failed("the thread for commands ended at once".to_owned())),
        }
    }

    /// Ends the desk.
    pub(super) fn close(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        self.end();
    }
}

/// Setup of the desk for one robot.
pub(super) struct DeskSetup {
    /// The robot's configuration.
    pub config: Config,
    /// The desk's end of the queues to the loop.
    pub end: DeskEnd,
    /// The initial state of the node, as in the checkpoint.
    pub warm: Option<Vec<u8>>,
}

/// One for each robot, all with this thread's membership in the domain.
fn robot_desks(domain: &Domain, setups: Vec<DeskSetup>) -> Result<Vec<RobotDesk>, BusError> {
    let mut robot_desks = Vec::with_capacity(setups.len());
    let alone = setups.len() == 1;
    let mut bus: Option<Bus> = None;
    for setup in setups {
        let robot = &setup.config.bus.robot;
        let own = match &bus {
            Some(bus) => bus.for_robot(robot)?,
            None => Bus::join(domain, robot, "identifier_desk")?,
        };
        let description = setup.config.description();
        let mut robot_desk = RobotDesk::new(&own, &setup.config, setup.end, alone)?;
        robot_desk.begin(setup.warm.as_deref());
        robot_desk.desk.describe(&description)?;
        robot_desks.push(robot_desk);
        bus = Some(own);
    }
    Ok(robot_desks)
}

/// Serves all robots in turn until asked to stop.
fn work(robot_desks: &mut [RobotDesk], stop: &AtomicBool) {
    let mut busy = false;
    loop {
        let stopping = stop.load(Ordering::Relaxed);
        let pause = if stopping || busy { Duration::ZERO } else { LOOK };
        match robot_desks {
            [robot_desk] => robot_desk.wait(pause),
            _ => std::thread::sleep(pause),
        }
        busy = false;
        for robot_desk in robot_desks.iter_mut() {
            busy |= robot_desk.serve();
            if stopping {
                robot_desk.desk.tell_rest(Instant::now(), true);
            }
        }
        if stopping {
            return;
        }
    }
}

struct RobotDesk {
    server: ControlServer,
    desk: Work,
}

impl RobotDesk {
    fn new(bus: &Bus, config: &Config, end: DeskEnd, is_woken: bool) -> Result<Self, BusError> {
        Ok(Self {
            server: match is_woken {
                true => ControlServer::new(bus)?,
                false => ControlServer::polled(bus)?,
            },
            desk: Work::new(bus, config, end)?,
        })
    }

    /// A warm start is recorded in the journal like a command, at the very beginning.
    fn begin(&mut self, warm: Option<&[u8]>) {
        let parts = warm.and_then(Request::restore).unwrap_or_default();
        self.desk.journalise(&parts, Border::default());
    }

    fn wait(&self, pause: Duration) {
        if self.server.wait(pause).is_err() {
            // If waiting fails, the loop must not spin.
            std::thread::sleep(LOOK);
        }
    }

    /// Does the work that is due; true if more requests wait.
    fn serve(&mut self) -> bool {
        self.desk.hear();
        let desk = &mut self.desk;
        let served = self.server.serve(ROUND, |request| desk.answer(request));
        self.desk.keep();
        match served {
            Ok(served) => served == ROUND,
            Err(e) => {
                tracing::error!("{e}");
                false
            }
        }
    }
}

/// Writes a last checkpoint of a node that has ended.
pub(super) fn last_checkpoint(config: &Config, state: &NodeState) {
    let Some(dir) = config.checkpoint.dir.as_ref().filter(|_| state.blocks > 0) else {
        return;
    };
    let path = checkpoint::path(dir, &config.bus.robot);
    let identity = super::wiring::identity(config);
    let written = checkpoint::encode(&identity, state).and_then(|bytes| checkpoint::write(&path, &bytes));
    match written {
        Ok(()) => tracing::info!(block = state.block, "checkpoint {}", path.display()),
        Err(e) => tracing::error!("{e}; the previous checkpoint stays"),
    }
}
