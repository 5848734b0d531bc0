//! The identifier as a process: one robot, or all robots of a file, distributed over one thread per
//! core.

use super::args::{Launched, domain};
use super::desk::{Desk, DeskSetup, last_checkpoint};
use super::new_file::whole;
use super::readiness::{Watchdog, ready};
use super::wiring::identifier_node;
use super::{Exit, Failure, IdentifierArgs, child, logging, warm};
use crate::bus::{Bus, Domain, Publisher, Role, RoleLock, SampleSubscriber, monotonic_ns};
use crate::config::Config;
use crate::messages::{Estimate, State, Status};
use crate::node::command::NodeState;
use crate::node::identifier::Identifier;
use crate::runner::{IdentifierPorts, LoopEnd, Session, Shutdown, Stay, TICK, apply_realtime, desk, run_sessions};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// A robot before its session begins.
struct Robot {
    config: Config,
    node: Box<dyn Identifier>,
    desk: LoopEnd,
}

/// Settings for all threads.
#[derive(Clone, Copy)]
struct Setting<'a> {
    domain: &'a Domain,
    launched: &'a Launched,
    stay: Stay,
    shutdown: &'a Shutdown,
    started_ns: u64,
    /// True for the only robot of a process, which is woken by its samples.
    alone: bool,
    watchdog: &'a Watchdog,
}

/// A robot after its session.
struct Outcome {
    config: Config,
    state: NodeState,
    status: Status,
}

/// Identifies the parameters of robots from their samples until it is asked to stop.
///
/// # Errors
/// If the configuration is wrong, a robot already has an identifier, or the bus fails.
pub fn run(args: &IdentifierArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let started_ns = monotonic_ns();
    let common = &args.common;
    child::follow_launcher(common)?;
    let configs = common.load_robots(&[])?;
    let domain = domain(&configs[0])?;
    super::open_files::raise_limit();
    configs.iter().try_for_each(make_checkpoint_dir)?;
    let lock = |config: &Config| RoleLock::acquire(&domain, &config.bus.robot, Role::Identifier);
    let _only_ones = configs.iter().map(lock).collect::<Result<Vec<_>, _>>()?;
    let (mut robots, mut setups) = (Vec::with_capacity(configs.len()), Vec::with_capacity(configs.len()));
    for config in configs {
        let mut node = identifier_node(&config)?;
        let (desk, end) = desk();
        let warm = match args.warm {
            true => warm::start(&config, &mut *node, Some(&end.board))?,
            false => None,
        };
        setups.push(DeskSetup {
            config: config.clone(),
            end,
            warm,
        });
        robots.push(Robot { config, node, desk });
    }
    let alone = robots.len() == 1;
    let workers = match alone {
        true => 1,
        false => std::thread::available_parallelism()
            .map_or(1, usize::from)
            .min(robots.len()),
    };
    let watchdog = Watchdog::new(workers);
    let setting = Setting {
        domain: &domain,
        launched: &common.launched,
        stay: common.stay(),
        shutdown,
        started_ns,
        alone,
        watchdog: &watchdog,
    };
    let names: Vec<String> = robots.iter().map(|robot| robot.config.bus.robot.clone()).collect();
    let (mut outcomes, result) = match setting.alone {
        true => one(setting, robots, setups)?,
        false => many(setting, workers, robots, setups)?,
    };
    for outcome in &outcomes {
        last_checkpoint(&outcome.config, &outcome.state);
    }
    result?;
    outcomes.sort_by_key(|outcome| names.iter().position(|name| *name == outcome.config.bus.robot));
    if !common.is_launched() {
        conclude(&outcomes)?;
    }
    let ended = outcomes
        .iter()
        .all(|outcome| outcome.status.state == State::Ended as u32);
    Ok(if shutdown.requested() && !ended {
        Exit::Interrupted
    } else {
        Exit::Done
    })
}

/// Makes the directory of the checkpoints, so that a wrong one is found now and not when a
/// checkpoint is due.
fn make_checkpoint_dir(config: &Config) -> Result<(), Failure> {
    let Some(dir) = &config.checkpoint.dir else {
        return Ok(());
    };
    std::fs::create_dir_all(dir).map_err(|e| {
        let dir = whole(dir);
        let dir = dir.display();
        Failure::Usage(format!(
            "checkpoint.dir: {dir} cannot be made: {e}; name a directory that can be written"
        ))
    })
}

/// A robot in this thread.
fn one(
    setting: Setting<'_>,
    robots: Vec<Robot>,
    setups: Vec<DeskSetup>,
) -> Result<(Vec<Outcome>, Result<(), Failure>), Failure> {
    let mut desk = None;
    let opened = || {
        desk = Some(Desk::open(setting.domain, setups)?);
        Ok(true)
    };
    let served = serve(setting, 0, robots, opened);
    if let Some(desk) = desk {
        desk.close();
    }
    served
}

/// Many robots, on one thread per core, with one desk for all of them.
fn many(
    setting: Setting<'_>,
    workers: usize,
    mut robots: Vec<Robot>,
    setups: Vec<DeskSetup>,
) -> Result<(Vec<Outcome>, Result<(), Failure>), Failure> {
    tracing::info!(
        robots = robots.len(),
        workers,
        domain = setting.domain.name(),
        "identifier"
    );
    let mut shares: Vec<Vec<Robot>> = (0..workers).map(|_| Vec::new()).collect();
    // Round-robin, to spread neighbours in the file, which are often alike.
    for (i, robot) in robots.drain(..).enumerate() {
        shares[i % workers].push(robot);
    }
    std::thread::scope(|scope| {
        let (told, opened) = channel();
        let mut threads = Vec::with_capacity(workers);
        let mut go = Vec::with_capacity(workers);
        for (number, share) in shares.into_iter().enumerate() {
            let (begin, begun): (Sender<()>, Receiver<()>) = channel();
            go.push(begin);
            let told = told.clone();
            threads.push(scope.spawn(move || {
                serve(setting, number, share, || {
                    let _ = told.send(());
                    // While a sender exists, the count of ready threads would wait for more.
                    drop(told);
                    // If a thread or the desk cannot be opened, the other end is dropped.
                    Ok(begun.recv().is_ok())
                })
            }));
        }
        drop(told);
        let is_open = opened.iter().take(workers).count() == workers;
        let desk = is_open.then(|| Desk::open(setting.domain, setups)).transpose();
        if matches!(desk, Ok(Some(_))) {
            go.iter().for_each(|begin| _ = begin.send(()));
        }
        drop(go);
        let (mut outcomes, mut result) = (Vec::new(), Ok(()));
        let mut note = |problem: Failure| {
            if result.is_ok() {
                result = Err(problem);
            }
        };
        for thread in threads {
            match thread.join() {
                Ok(Ok((share, ended))) => {
                    outcomes.extend(share);
                    ended.err().map(&mut note);
                }
                Ok(Err(e)) => note(e),
                Err(_) => note(Failure::Failed("a thread of the identifier broke off".to_owned())),
            }
        }
        if let Some(desk) = desk? {
            desk.close();
        }
        Ok((outcomes, result))
    })
}

/// Opens the ports of these robots, calls `opened`, and serves them until their end, as loop number
/// `number`. If `opened` returns false, because another thread could not begin, nothing is served.
fn serve(
    setting: Setting<'_>,
    number: usize,
    robots: Vec<Robot>,
    opened: impl FnOnce() -> Result<bool, Failure>,
) -> Result<(Vec<Outcome>, Result<(), Failure>), Failure> {
    let Setting { domain, shutdown, .. } = setting;
    let mut bus: Option<Bus> = None;
    let mut publishers = Vec::with_capacity(robots.len());
    for Robot { config, .. } in &robots {
        let own = match &bus {
            Some(bus) => bus.for_robot(&config.bus.robot)?,
            None => Bus::join(domain, &config.bus.robot, "identifier")?,
        };
        let status = Publisher::new(&own)?;
        let mut estimates = Publisher::new(&own)?;
        let limit = Duration::from_secs_f64(config.bus.lockstep_limit_s);
        if setting.launched.receipts {
            estimates.await_receipts(&own, limit, shutdown.flag())?;
        }
        await_readers(&mut estimates, setting.launched.await_consumers, limit, shutdown)?;
        publishers.push((own.clone(), status, estimates));
        bus = Some(own);
    }
    if !opened()? {
        return Ok((Vec::new(), Ok(())));
    }
    let (mut configs, mut sessions) = (Vec::with_capacity(robots.len()), Vec::with_capacity(robots.len()));
    let mut realtime = None;
    for (robot, (bus, status, estimates)) in robots.into_iter().zip(publishers) {
        // Last, because in lockstep the plant starts when this process subscribes.
        let samples = match setting.alone {
            true => SampleSubscriber::new(&bus)?,
            false => SampleSubscriber::polled(&bus)?,
        };
        let Robot { config, node, desk } = robot;
        if setting.alone {
            announce(&config, domain, &samples);
        }
        let ports = IdentifierPorts {
            samples,
            estimates,
            status,
            desk,
            started_ns: setting.started_ns,
            realtime: *realtime.get_or_insert_with(|| apply_realtime(&config.realtime.identifier)),
        };
        sessions.push(Session::new(&config.bus.robot, node, ports));
        configs.push(config);
    }
    if number == 0 && !setting.launched.is_launched() {
        ready();
    }
    let turned = || setting.watchdog.turned(number);
    let result = run_sessions(&mut sessions, setting.stay, shutdown, &turned);
    let outcomes = configs.into_iter().zip(sessions).map(|(config, session)| {
        let mut node = session.into_node();
        let mut state = NodeState::default();
        node.save(&mut state);
        let status = node.status();
        Outcome { config, state, status }
    });
    Ok((outcomes.collect(), result.map_err(Failure::from)))
}

fn announce(config: &Config, domain: &Domain, samples: &SampleSubscriber) {
    let robot = &config.bus.robot;
    tracing::info!(
        robot,
        domain = domain.name(),
        block_len = config.estimator.block_len,
        "identifier"
    );
    if !samples.is_connected() {
        tracing::info!(robot, domain = domain.name(), "no plant yet, waiting for its samples");
    }
}

/// Reports the outcome of the samples.
fn conclude(outcomes: &[Outcome]) -> Result<(), Failure> {
    let alone = outcomes.len() == 1;
    for Outcome { config, status, .. } in outcomes {
        let robot = match alone {
            true => String::new(),
            false => format!("{}: ", config.bus.robot),
        };
        logging::result(&format!(
            "{robot}{} samples accepted, {} missing, {} rejected, {} estimates in the last of {} streams",
            status.accepted, status.missing, status.rejected, status.estimates, status.streams
        ))?;
    }
    Ok(())
}

/// Waits for readers, so that they can receive the first estimate.
fn await_readers(
    estimates: &mut Publisher<Estimate>,
    count: usize,
    limit: Duration,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let start = Instant::now();
    while estimates.subscribers() < count && start.elapsed() < limit && !shutdown.requested() {
        estimates.serve_late_joiners()?;
        std::thread::sleep(TICK / 20);
    }
    Ok(())
}
