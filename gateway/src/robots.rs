//! All robots of other hosts in this domain: who has a place, and who gets none.

use crate::away::Away;
use crate::error::{GatewayError, network};
use crate::inbox::{Inbox, Message, Outbox, Overflow, Presence, Word};
use crate::incoming::{Incoming, unreadable};
use crate::inward::InArgs;
use crate::keys;
use crate::record::Record;
use crate::refusals::{Lines, Refusals};
use crate::remote_robot::{RETRY_AFTER, RemoteRobot};
use crate::tally::{HEAD, say};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, Topic};
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::{Session, Wait};

/// Period of serving requests of the bus.
const PAUSE: Duration = Duration::from_millis(5);
/// Number of messages taken before requests of the bus are served.
const AT_A_TIME: usize = 256;

/// Between two ticks of a process that runs there is less time.
const STANDSTILL: Duration = Duration::from_secs(1);

/// The robots that have come.
pub struct RemoteRobots<'a> {
    args: &'a InArgs,
    member: Bus,
    session: &'a Session,
    put: Inbox,
    outbox: Outbox,
    overflow: Overflow,
    /// Robots to ask for their last messages, one at a tick, so that the answers have room.
    to_ask: Vec<(String, String)>,
    robots: BTreeMap<String, RemoteRobot>,
    away: Away,
    /// When the last tick was.
    ticked: Instant,
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
    pub fn new(args: &'a InArgs, member: Bus, session: &'a Session, put: Inbox, outbox: Outbox) -> Self {
        Self {
            args,
            member,
            session,
            put,
            outbox,
            overflow: Overflow::default(),
            to_ask: Vec::new(),
            robots: BTreeMap::new(),
            away: Away::default(),
            ticked: Instant::now(),
            refusals: Refusals::default(),
            unreadable: Refusals::default(),
            unread: 0,
            lines: Lines::default(),
            strangers: 0,
        }
    }

    /// Waits for what the network sends, and takes it.
    ///
    /// # Errors
    /// The bus or the network fails.
    pub fn take(&mut self) -> Result<(), GatewayError> {
        if let Ok(first) = self.outbox.wait(PAUSE) {
            self.message(&first)?;
            for _ in 1..AT_A_TIME {
                let Ok(message) = self.outbox.next() else { break };
                self.message(&message)?;
            }
        }
        for (key, presence) in self.outbox.tokens() {
            self.token(&key, presence)?;
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
            let stood = now.duration_since(std::mem::replace(&mut self.ticked, now));
            if stood < STANDSTILL {
                self.give_back(now);
            } else {
                // What has come meanwhile is not taken yet: nobody was silent but this process.
                let robots = self.robots.values_mut();
                robots.for_each(|remote_robot| remote_robot.forgive(stood));
            }
            self.tell_overflow(now);
            if let Some((host, robot)) = self.to_ask.pop() {
                self.ask_for_last(&host, &robot)?;
            }
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
            ("inbox full", self.outbox.dropped(), " messages"),
            ("foreign keys", self.strangers, ""),
            ("not readable from robots without a place", self.unread, ""),
            ("silent robots without a line here", self.away.forgotten(), ""),
        ];
        if counts.iter().any(|(_, count, _)| *count > 0) {
            let words = counts.map(|(what, count, unit)| format!("{what}: {count}{unit}"));
            say(words.join(", "));
        }
    }

    /// A robot's gateway has come or gone.
    fn token(&mut self, key: &str, presence: Presence) -> Result<(), GatewayError> {
        let Some((host, robot, _)) = keys::parts(key) else {
            self.strangers += 1;
            return Ok(());
        };
        if let Some(remote_robot) = self.robots.get_mut(robot)
            && remote_robot.record.host == host
        {
            remote_robot.is_there = presence == Presence::Alive;
        }
        let line = self.lines.next(Instant::now());
        match presence {
            Presence::Alive => {
                if let Some(before) = line {
                    tracing::info!(host, robot, lines_left_out = before, "robot connected");
                }
                self.ask_for_last(host, robot)
            }
            Presence::Gone => {
                if let Some(before) = line {
                    tracing::warn!(host, robot, lines_left_out = before, "its gateway has gone");
                }
                Ok(())
            }
        }
    }

    fn message(&mut self, message: &Message) -> Result<(), GatewayError> {
        // A stranger may answer a question about last messages with samples.
        let wanted = |topic: &Topic| *topic != Topic::Sample || self.args.samples;
        let parts = keys::parts(&message.key);
        let known = parts.and_then(|(host, robot, last)| Some((host, robot, keys::topic(last).filter(wanted)?)));
        let Some((host, robot, topic)) = known else {
            self.strangers += 1;
            return Ok(());
        };
        let Some(read) = Incoming::read(topic, &message.payload, &message.envelope, message.is_live) else {
            self.leave_out(host, robot, topic, message.came);
            return Ok(());
        };
        match self.robot(host, robot, read.is_live)? {
            Some(remote_robot) => remote_robot.message(&read),
            None => Ok(()),
        }
    }

    /// Says that messages had no room. When there is room again, all robots are asked for their last
    /// messages: a description comes once, and may have been among them.
    fn tell_overflow(&mut self, now: Instant) {
        let dropped = self.outbox.dropped();
        match self.overflow.word(dropped, now) {
            Word::Nothing => {}
            Word::Tell(more) => tracing::warn!(
                "inbox full: {more} messages were dropped, {dropped} in all; more come than this process can take in"
            ),
            Word::Over => {
                tracing::info!("inbox has room again: {dropped} messages were dropped in all");
                let robots = self.robots.iter();
                self.to_ask = robots
                    .map(|(robot, remote_robot)| (remote_robot.record.host.clone(), robot.clone()))
                    .collect();
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
