//! `thetabus watch`: a running identification in place on a terminal, one readable line per block
//! elsewhere.

use super::args::domain;
use super::description::monitor_of;
use super::live::{live_state, rename};
use super::monitor::await_description;
use super::wiring::monitor_node;
use super::{Exit, Failure, WatchArgs, foreign, logging};
use crate::bus::{Bus, ControlClient, Subscriber, monotonic_ns};
use crate::live::{Key, LiveState, Screen, TableContext, block_line};
use crate::messages::{Command, Estimate, Journal, Request, Sample, Status, estimate_flags, response_code};
use crate::node::monitor::{MonitorNode, seconds};
use crate::runner::{MonitorPorts, MonitorSink, RunError, Shutdown, Stay, run_monitor};
use std::io;
use std::time::{Duration, Instant};

/// Period of drawing when nothing else happens: the age of the heartbeat grows.
const PERIOD: Duration = Duration::from_millis(250);
/// How long the identifier may take for the answer to a key.
const PATIENCE: Duration = Duration::from_secs(2);

/// Shows the estimates of a robot until it is asked to stop.
///
/// # Errors
/// A wrong configuration, an identifier of another model, a bus that fails.
pub fn run(args: &WatchArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let config = args.common.load(Vec::new(), &[])?;
    let mut node = monitor_node(&config, None);
    let bus = Bus::join(&domain(&config)?, &config.bus.robot, "watch")?;
    let mut ports = MonitorPorts {
        journal: Subscriber::new(&bus)?,
        estimates: Subscriber::new(&bus)?,
        status: Subscriber::new(&bus)?,
        description: Subscriber::new(&bus)?,
        samples: None,
    };
    let screen = match Screen::is_possible() {
        true => Some(Screen::open().map_err(|e| Failure::Failed(format!("the terminal cannot be drawn on: {e}")))?),
        false => None,
    };
    let mut watch = Watch {
        state: live_state(&config),
        screen,
        bus: bus.clone(),
        shutdown: shutdown.clone(),
        answer: String::new(),
        drawn: None,
    };
    let outcome = loop {
        let outcome = run_monitor(&mut node, &mut ports, Stay::Forever, shutdown, &mut watch);
        let Err(RunError::ForeignModel(description)) = outcome else {
            break outcome;
        };
        // Another model than the configuration's: the identifier's own names hold.
        let description = match description {
            Some(description) => Some(description),
            None => await_description(&mut ports)?,
        };
        let Some(description) = description else {
            break Err(RunError::ForeignModel(None));
        };
        node = monitor_of(&description);
        rename(&mut watch.state, &description);
        // A new subscriber receives the first estimate again.
        ports.estimates = Subscriber::new(&bus)?;
    };
    // Gives the terminal back before anything else is said.
    drop(watch);
    match outcome {
        Err(RunError::ForeignModel(_)) => Err(foreign::estimates(&bus, &config)),
        outcome => outcome.map(|()| Exit::Done).map_err(Failure::from),
    }
}

struct Watch {
    state: LiveState,
    screen: Option<Screen>,
    bus: Bus,
    shutdown: Shutdown,
    /// To the last key.
    answer: String,
    /// When it was drawn; none if something is new.
    drawn: Option<Instant>,
}

impl Watch {
    fn ask(&mut self, command: Command) {
        let answer = ControlClient::new(&self.bus).and_then(|client| client.ask(&Request::new(command), PATIENCE));
        self.answer = match answer {
            Ok(response) if response.code == response_code::DONE => {
                format!("{}, from block {} on", response.text(), response.block)
            }
            Ok(response) => response.text().to_owned(),
            Err(e) => e.to_string(),
        };
    }
}

impl MonitorSink for Watch {
    fn sample(&mut self, _: &Sample, _: u64) -> io::Result<()> {
        Ok(())
    }

    fn estimate(&mut self, _: &MonitorNode, estimate: &Estimate, sent_ns: u64) -> io::Result<()> {
        self.state.on_estimate(estimate, None, sent_ns);
        self.drawn = None;
        if self.screen.is_some() {
            return Ok(());
        }
        let changed = estimate.flags & estimate_flags::CHANGED != 0;
        let view = self.state.view(sent_ns);
        let line = block_line(&view, changed.then(|| seconds(estimate.t_change_ns)));
        logging::result(&line).map_err(|e| io::Error::other(e.to_string()))
    }

    fn status(&mut self, status: &Status, sent_ns: u64) -> io::Result<()> {
        self.state.on_status(status, sent_ns);
        self.drawn = None;
        Ok(())
    }

    fn journal(&mut self, _: &Journal) -> io::Result<()> {
        Ok(())
    }

    fn round(&mut self) -> io::Result<()> {
        let Some(mut screen) = self.screen.take() else {
            return Ok(());
        };
        while let Some(key) = screen.key()? {
            self.drawn = None;
            match key {
                Key::Quit => self.shutdown.request(),
                Key::Pause => self.ask(Command::Pause),
                Key::Resume => self.ask(Command::Resume),
                Key::Redraw => {}
            }
        }
        if self.drawn.is_none_or(|drawn| drawn.elapsed() >= PERIOD) {
            self.drawn = Some(Instant::now());
            let about = TableContext {
                about: self.state.about(),
                quantities: self.state.quantities(),
                scroll: 0,
                colours: true,
                answer: &self.answer,
            };
            screen.draw(&self.state.view(monotonic_ns()), about)?;
        }
        self.screen = Some(screen);
        Ok(())
    }
}
