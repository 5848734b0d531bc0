//! `thetabus load`: many simulated robots in real time, and the outcome of their samples.

use super::args::domain;
use super::plant::stream_id;
use super::{Exit, Failure, PlantArgs, logging, open_files};
use crate::bus::{Bus, Delivery, Domain, IDLE_TICK, Role, RoleLock, SamplePublisher, Subscriber};
use crate::config::{Config, Speed};
use crate::messages::{Sample, State, Status};
use crate::node::simulated_plant::sample_stream_of;
use crate::runner::{Shutdown, apply_realtime};
use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Largest memory for samples simulated in advance \[bytes\].
const MEMORY: usize = 2 << 30;
/// Pause between two rounds over the robots.
const ROUND: Duration = Duration::from_micros(250);
/// How long the identifiers may take to end with the streams.
const PATIENCE: Duration = Duration::from_secs(5);
/// Largest number of robots listed with lost samples.
const LISTED: usize = 8;

/// A robot that publishes samples simulated in advance.
struct Robot {
    name: String,
    publisher: SamplePublisher,
    status: Subscriber<Status>,
    samples: Rc<[Sample]>,
    stream_id: u64,
    /// Start of its stream, counted from the start of the load.
    begins: Duration,
    sent: usize,
    heard: Option<Status>,
}

/// Publishes the samples of all robots of a configuration in real time, then reports their
/// identifiers' status.
///
/// # Errors
/// If the configuration is wrong, a plant is already running, or the bus fails.
pub fn run(args: &PlantArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let configs = args.common.load_robots(&args.overrides())?;
    let first = &configs[0];
    let Speed::Factor(speed) = first.plant.speed else {
        return Err(Failure::Usage(
            "load runs in real time: state a number for --speed or plant.speed, for example --speed 1".to_owned(),
        ));
    };
    open_files::raise_limit();
    let domain = domain(first)?;
    let lock = |config: &Config| RoleLock::acquire(&domain, &config.bus.robot, Role::Plant);
    let _only_ones = configs.iter().map(lock).collect::<Result<Vec<_>, _>>()?;
    let mut robots = open(&domain, &configs, shutdown)?;
    tracing::info!(robots = robots.len(), domain = domain.name(), speed, "load");
    apply_realtime(&first.realtime.plant);
    // Identifiers that started earlier connect within a tick.
    await_identifiers(&mut robots, shutdown);
    let before = processor_times(&robots);
    let begun = Instant::now();
    let worst_lag = stream(&mut robots, speed, shutdown)?;
    let wall = begun.elapsed();
    let used = processor_times(&robots);
    settle(&mut robots)?;
    conclude(&robots, wall, worst_lag, &before, &used)
}

/// Simulates and opens every robot. Identical robots share their samples and begin at different
/// times, so that their blocks do not all end at once.
fn open(domain: &Domain, configs: &[Config], shutdown: &Shutdown) -> Result<Vec<Robot>, Failure> {
    let mut simulated: HashMap<String, Rc<[Sample]>> = HashMap::new();
    let mut bytes = 0;
    let mut robots = Vec::with_capacity(configs.len());
    let mut bus: Option<Bus> = None;
    for (i, config) in configs.iter().enumerate() {
        let name = config.bus.robot.clone();
        let alike = format!("{}{}", config.model.name(), config.to_toml().replacen(&name, "", 1));
        let samples = match simulated.get(&alike) {
            Some(samples) => samples.clone(),
            None => {
                bytes += config.plant.sim.sample_count() as usize * size_of::<Sample>();
                if bytes > MEMORY {
                    return Err(Failure::Usage(format!(
                        "the samples of all robots would take more than {} MiB: shorten --duration, or let more robots be alike",
                        MEMORY >> 20
                    )));
                }
                let samples = simulate(config, shutdown)?;
                simulated.insert(alike, samples.clone());
                samples
            }
        };
        let own = match &bus {
            Some(bus) => bus.for_robot(&name)?,
            None => Bus::join(domain, &name, "load")?,
        };
        let block_s = config.estimator.block_len as f64 * config.plant.sim.sample_period_s;
        robots.push(Robot {
            publisher: SamplePublisher::new(&own, Delivery::Realtime, shutdown.flag())?,
            status: Subscriber::new(&own)?,
            name,
            samples,
            stream_id: stream_id(),
            begins: Duration::from_secs_f64(block_s * i as f64 / configs.len() as f64),
            sent: 0,
            heard: None,
        });
        bus = Some(own);
    }
    Ok(robots)
}

fn simulate(config: &Config, shutdown: &Shutdown) -> Result<Rc<[Sample]>, Failure> {
    let sim = &config.plant.sim;
    let mut node = sample_stream_of(&*config.model, sim, 1).map_err(Failure::usage)?;
    let mut samples = Vec::with_capacity(sim.sample_count() as usize);
    while let Some(sample) = node.next_sample().filter(|_| !shutdown.requested()) {
        samples.push(sample);
    }
    match samples.last() {
        Some(last) if last.is_end() || shutdown.requested() => Ok(samples.into()),
        _ => Err(Failure::Failed(format!(
            "robot {}: the simulation stopped at sample {}: its state is no longer finite",
            config.bus.robot,
            samples.len()
        ))),
    }
}

fn await_identifiers(robots: &mut [Robot], shutdown: &Shutdown) {
    let begun = Instant::now();
    while begun.elapsed() < 3 * IDLE_TICK && !shutdown.requested() {
        for robot in &mut *robots {
            robot.publisher.wake();
            robot.listen();
        }
        std::thread::sleep(IDLE_TICK / 4);
    }
}

/// Sends every sample when it is due; returns how late the latest one was.
fn stream(robots: &mut [Robot], speed: f64, shutdown: &Shutdown) -> Result<Duration, Failure> {
    let begun = Instant::now();
    let (mut worst_lag, mut tick) = (Duration::ZERO, begun);
    loop {
        let mut is_open = false;
        let stopping = shutdown.requested();
        for robot in &mut *robots {
            let elapsed = begun.elapsed();
            while let Some(sample) = robot.samples.get(robot.sent) {
                let due = robot.begins + Duration::from_secs_f64(sample.t_ns as f64 * 1e-9 / speed);
                is_open = true;
                if due > elapsed && !stopping {
                    break;
                }
                let mut sample = *sample;
                sample.stream_id = robot.stream_id;
                if stopping {
                    sample.flags |= crate::messages::sample_flags::END;
                } else {
                    worst_lag = worst_lag.max(elapsed - due);
                }
                robot.publisher.send(&sample)?;
                robot.publisher.wake();
                robot.sent += 1;
                if stopping {
                    robot.samples = Rc::default();
                }
            }
        }
        if !is_open || stopping {
            return Ok(worst_lag);
        }
        if tick.elapsed() >= IDLE_TICK {
            tick = Instant::now();
            for robot in &mut *robots {
                robot.publisher.serve_late_joiners()?;
                robot.listen();
            }
        }
        std::thread::sleep(ROUND);
    }
}

/// Stays until the identifiers have reported the end, or for [`PATIENCE`].
fn settle(robots: &mut [Robot]) -> Result<(), Failure> {
    let begun = Instant::now();
    loop {
        for robot in &mut *robots {
            robot.publisher.serve_late_joiners()?;
            robot.publisher.wake();
            robot.listen();
        }
        let waited = begun.elapsed();
        let open = robots
            .iter()
            .any(|robot| robot.heard.is_some() && robot.end().is_none());
        if waited >= PATIENCE || (waited >= 2 * IDLE_TICK && !open) {
            return Ok(());
        }
        std::thread::sleep(IDLE_TICK / 4);
    }
}

impl Robot {
    fn listen(&mut self) {
        let heard = &mut self.heard;
        // A status that cannot be read counts as not received.
        let _ = self.status.drain(|status| *heard = Some(*status));
    }

    /// Its identifier's status at the end of this stream.
    fn end(&self) -> Option<&Status> {
        let ended = |status: &&Status| status.stream_id == self.stream_id && status.state == State::Ended as u32;
        self.heard.as_ref().filter(ended)
    }
}

/// Processor time of each identifier's process so far, and its memory \[s, bytes\].
fn processor_times(robots: &[Robot]) -> HashMap<u32, (f64, u64)> {
    let pids: BTreeSet<u32> = robots
        .iter()
        .filter_map(|robot| robot.heard.map(|status| status.pid))
        .collect();
    let usage = |pid: u32| super::usage::of(pid).map(|usage| (pid, usage));
    pids.into_iter().filter_map(usage).collect()
}

fn conclude(
    robots: &[Robot],
    wall: Duration,
    worst_lag: Duration,
    before: &HashMap<u32, (f64, u64)>,
    used: &HashMap<u32, (f64, u64)>,
) -> Result<Exit, Failure> {
    let sent: usize = robots.iter().map(|robot| robot.sent).sum();
    let ends: Vec<&Status> = robots.iter().filter_map(Robot::end).collect();
    let sum = |field: fn(&Status) -> u64| ends.iter().map(|status| field(status)).sum::<u64>();
    let (accepted, missing, rejected) = (sum(|s| s.accepted), sum(|s| s.missing), sum(|s| s.rejected));
    logging::result(&format!(
        "{} robots, {sent} samples sent in {:.1} s, the latest {:.1} ms after it was due",
        robots.len(),
        wall.as_secs_f64(),
        1e3 * worst_lag.as_secs_f64()
    ))?;
    logging::result(&format!(
        "identifiers of {} robots: {accepted} samples accepted, {missing} missing, {rejected} rejected, {} estimates, longest block {:.2} ms",
        ends.len(),
        sum(|s| s.estimates),
        1e-6 * ends.iter().map(|s| s.block.max_ns).max().unwrap_or(0) as f64
    ))?;
    for (pid, (seconds, bytes)) in used {
        let began = before.get(pid).map_or(0.0, |(seconds, _)| *seconds);
        let cores = (seconds - began) / wall.as_secs_f64().max(1e-9);
        logging::result(&format!(
            "identifier {pid}: {:.1} % of a core, {:.0} MB",
            100.0 * cores,
            1e-6 * *bytes as f64
        ))?;
    }
    let is_lost = |robot: &&Robot| robot.end().is_some_and(|status| status.accepted < robot.sent as u64);
    let lost: Vec<&str> = robots.iter().filter(is_lost).map(|robot| robot.name.as_str()).collect();
    if lost.is_empty() {
        return Ok(Exit::Done);
    }
    tracing::warn!(
        robots = lost.len(),
        "not every sample was accepted: {}",
        lost[..lost.len().min(LISTED)].join(", ")
    );
    Ok(Exit::DataLoss)
}
