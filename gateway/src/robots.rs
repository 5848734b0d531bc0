//! All robots of other hosts in this domain: who has a place, and who gets none.

use crate::away::Away;
use crate::error::{GatewayError, network};
use crate::inbox::{Event, Inbox};
use crate::incoming::{Incoming, unreadable};
use crate::inward::InArgs;
use crate::keys;
use crate::record::Record;
use crate::refusals::{Lines, Refusals};
use crate::remote_robot::{RETRY_AFTER, RemoteRobot};
use crate::tally::{HEAD, say};
use std::collections::BTreeMap;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Topic};
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::{Session, Wait};

/// Period of serving requests of the bus.
const PAUSE: Duration = Duration::from_millis(5);
/// Number of messages taken before requests of the bus are served.
const AT_A_TIME: usize = 256;

/// The robots that have come.
pub struct RemoteRobots<'a> {
    args: &'a InArgs,
    member: Bus,
    session: &'a Session,
    put: Inbox,
    robots: BTreeMap<String, RemoteRobot>,
    away: Away,
    refusals: Refusals,
    /// Robots from which nothing has come that can be read.
    unreadable: Refusals,
    /// Messages of theirs.
    unread: u64,
    /// Lines that names of the network can bring into the log.
    lines: Lines,
    /// Keys that are none of ours.
    strangers: u64,
}

impl<'a> RemoteRobots<'a> {
    /// None yet.
    pub fn new(args: &'a InArgs, member: Bus, session: &'a Session, put: Inbox) -> Self {
        Self {
            args,
            member,
            session,
            put,
            robots: BTreeMap::new(),
            away: Away::default(),
            refusals: Refusals::default(),
            unreadable: Refusals::default(),
            unread: 0,
            lines: Lines::default(),
            strangers: 0,
        }
    }

    /// Waits for events and takes them.
    ///
    /// # Errors
    /// The bus or the network fails.
    pub fn take(&mut self, inbox: &Receiver<Event>) -> Result<(), GatewayError> {
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

    /// Passes requests and answers on; at a tick it also looks after what takes its time.
    ///
    /// # Errors
    /// The bus or the network fails.
    pub fn turn(&mut self, is_tick: bool) -> Result<(), GatewayError> {
        for robot in self.robots.values_mut() {
            robot.turn(self.session, is_tick)?;
        }
        if is_tick {
            let now = Instant::now();
            self.tell_losses(now);
            self.give_back(now);
        }
        Ok(())
    }

    /// Writes the table.
    pub fn report(&self) {
        say(HEAD);
        let here = self.robots.values().map(|remote_robot| &remote_robot.record);
        let mut records: Vec<&Record> = here.chain(self.away.records()).collect();
        records.sort_by_key(|record| (&record.robot, &record.host));
        records.into_iter().for_each(Record::report);
        let counts = [
            ("inbox full", self.put.dropped(), " messages"),
            ("foreign keys", self.strangers, ""),
            ("not readable from robots without a place", self.unread, ""),
            ("silent robots without a line here", self.away.forgotten(), ""),
        ];
        if counts.iter().any(|(_, count, _)| *count > 0) {
            let words = counts.map(|(what, count, unit)| format!("{what}: {count}{unit}"));
            say(words.join(", "));
        }
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
                if let Some(remote_robot) = self
                    .robots
                    .get_mut(robot)
                    .filter(|remote_robot| remote_robot.record.host == host)
                {
                    remote_robot.is_there = true;
                }
                self.ask_for_last(host, robot)
            }
            Event::Gone { .. } => {
                if let Some(before) = self.lines.next(Instant::now()) {
                    tracing::warn!(host, robot, lines_left_out = before, "its gateway has gone");
                }
                if let Some(remote_robot) = self
                    .robots
                    .get_mut(robot)
                    .filter(|remote_robot| remote_robot.record.host == host)
                {
                    remote_robot.is_there = false;
                }
                Ok(())
            }
            Event::Message {
                payload,
                envelope,
                is_live,
                ..
            } => {
                // A stranger may answer a question about last messages with samples.
                let wanted = |topic: &Topic| *topic != Topic::Sample || self.args.samples;
                let Some(topic) = keys::topic(last).filter(wanted) else {
                    self.strangers += 1;
                    return Ok(());
                };
                let Some(message) = Incoming::read(topic, payload, envelope, *is_live) else {
                    self.leave_out(host, robot, topic, payload.len());
                    return Ok(());
                };
                let Some(remote_robot) = self.robot(host, robot, *is_live)? else {
                    return Ok(());
                };
                remote_robot.message(&message)
            }
        }
    }

    /// Counts a message that cannot be read. It makes no place for a robot that has none.
    fn leave_out(&mut self, host: &str, robot: &str, topic: Topic, bytes: usize) {
        match self.robots.get_mut(robot) {
            Some(remote_robot) if remote_robot.record.host == host => remote_robot.leave_out(topic, bytes),
            _ => {
                self.unread += 1;
                let now = Instant::now();
                if self.unreadable.is_first(format!("{host}/{robot}"), now)
                    && let Some(before) = self.lines.next(now)
                {
                    let why = unreadable(topic, bytes);
                    tracing::warn!(host, robot, lines_left_out = before, "robot not admitted: {why}");
                }
            }
        }
    }

    /// Says what has not come, while it can still be mended.
    fn tell_losses(&mut self, now: Instant) {
        for (robot, remote_robot) in &mut self.robots {
            if let Some(missing) = remote_robot.record.losses(now)
                && let Some(before) = self.lines.next(now)
            {
                tracing::warn!(
                    host = remote_robot.record.host,
                    robot,
                    lines_left_out = before,
                    "messages are missing: {missing}"
                );
            }
        }
    }

    /// Gives back the roles of robots that have been silent for long, and says so, in one line for
    /// those of a host.
    fn give_back(&mut self, now: Instant) {
        let silence = self.args.give_back_after;
        let mut silent: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (robot, remote_robot) in &mut self.robots {
            let host = &remote_robot.record.host;
            if remote_robot.is_silent(silence, now) {
                silent.entry(host.clone()).or_default().push(robot.clone());
            } else if remote_robot.give_samples_back_if_silent(silence, now) {
                let host = &remote_robot.record.host;
                tracing::warn!(
                    host,
                    robot,
                    "no samples for {silence} s: the plant's role in this domain is given back"
                );
            }
        }
        for (host, robots) in silent {
            let names = robots.join(", ");
            for robot in &robots {
                if let Some(remote_robot) = self.robots.remove(robot) {
                    self.away.put(remote_robot.give_back(), now);
                }
            }
            tracing::warn!(
                host,
                robots = names,
                "nothing has come for {silence} s: the roles in this domain are given back; they are taken again when something comes \
                 and nobody else has them"
            );
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

    /// The robot's place in the domain, for a message that can be read; `None` if there is none for
    /// it.
    fn robot(&mut self, host: &str, robot: &str, is_live: bool) -> Result<Option<&mut RemoteRobot>, GatewayError> {
        let now = Instant::now();
        if !self.robots.contains_key(robot) {
            if self.refusals.is_recent(robot, RETRY_AFTER, now) {
                return Ok(None);
            }
            match self.admit(host, robot) {
                Ok(remote_robot) => {
                    self.robots.insert(robot.to_owned(), remote_robot);
                    let of_this_host = format!("{host}/{robot}");
                    self.refusals.forget(robot);
                    self.refusals.forget(&of_this_host);
                    self.unreadable.forget(&of_this_host);
                    if is_live {
                        // What came while it had no place is gone, the description, too.
                        self.ask_for_last(host, robot)?;
                    }
                }
                Err(why) => {
                    self.tell_refusal(host, robot, &why, now);
                    return Ok(None);
                }
            }
        }
        match self.robots.get_mut(robot) {
            Some(remote_robot) if remote_robot.record.host == host => Ok(Some(remote_robot)),
            Some(remote_robot) => {
                if self.refusals.is_first(format!("{host}/{robot}"), now)
                    && let Some(before) = self.lines.next(now)
                {
                    tracing::error!(
                        lines_left_out = before,
                        "robot {robot} comes from {} and from {host}; the second is ignored; select one with --from and give the other its own domain",
                        remote_robot.record.host
                    );
                }
                Ok(None)
            }
            None => Ok(None),
        }
    }

    fn tell_refusal(&mut self, host: &str, robot: &str, why: &GatewayError, now: Instant) {
        if self.refusals.is_first(robot.to_owned(), now)
            && let Some(before) = self.lines.next(now)
        {
            match why {
                // As it is to be where gateways both ways share a domain.
                GatewayError::Way { .. } => {
                    tracing::warn!(host, robot, lines_left_out = before, "robot not admitted: {why}");
                }
                _ => tracing::error!(host, robot, lines_left_out = before, "robot not admitted: {why}"),
            }
        }
    }

    fn admit(&mut self, host: &str, robot: &str) -> Result<RemoteRobot, GatewayError> {
        if self.robots.len() >= self.args.max_robots {
            return Err(GatewayError::Full(self.robots.len()));
        }
        let (away, lines) = (&mut self.away, &mut self.lines);
        RemoteRobot::new(&self.member, robot, !self.args.no_control, || {
            match away.take(host, robot) {
                Some(record) => {
                    if let Some(before) = lines.next(Instant::now()) {
                        tracing::info!(
                            host,
                            robot,
                            lines_left_out = before,
                            "robot is back: it has its roles in this domain again"
                        );
                    }
                    record
                }
                None => Record::new(host, robot),
            }
        })
    }
}
