//! A robot of another host in this domain: its topics, and the requests to its identifier.

use crate::envelope::unix_ns;
use crate::error::{GatewayError, network};
use crate::incoming::{Body, Incoming, unreadable};
use crate::keys;
use crate::out::Counted;
use crate::questions;
use crate::tally::{Tally, say};
use crate::way;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use thetabus::bus::{
    Asked, Bus, BusError, ControlServer, Delivery, Latched, Publisher, Role, RoleLock, SamplePublisher, Topic,
};
use thetabus::messages::{Description, Estimate, Journal, Response, Sample, Status, response_code};
use thetabus::recording::{Dimensions, from_cdr, to_cdr};
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::query::{QueryTarget, Reply};
use zenoh::{Session, Wait};

/// A robot whose role another program holds is tried again after this time.
pub const RETRY_AFTER: Duration = Duration::from_secs(2);
/// The other gateway answers for the identifier within its own patience, and the network takes its
/// time. `ctl` waits for 3 s: whoever asks gets the gateway's words.
const CONTROL_LIMIT: Duration = questions::PATIENCE.saturating_add(Duration::from_millis(500));
/// From the first message that is missing until the log tells: statuses come twice a second.
const SETTLED: Duration = Duration::from_secs(1);
/// Shortest time between two lines about what is missing.
const LOSSES_EVERY: Duration = Duration::from_secs(10);
/// Requests taken at a time.
const REQUESTS_AT_A_TIME: usize = 8;

/// A robot of another host in this domain.
pub struct RemoteRobot {
    /// Its host.
    pub host: String,
    bus: Bus,
    /// The gateway of its host is there.
    pub is_there: bool,
    description: TopicPort<Description>,
    estimate: TopicPort<Estimate>,
    status: TopicPort<Status>,
    journal: TopicPort<Journal>,
    samples: Samples,
    control: Option<ControlServer>,
    /// Requests under way.
    asked: Vec<(Asked, FifoChannelHandler<Reply>)>,
    losses: Losses,
    _roles: [RoleLock; 2],
}

impl RemoteRobot {
    /// # Errors
    /// Another gateway sends this robot out of the domain or has brought it, another program has the
    /// identifier's role, or the bus fails.
    pub fn new(member: &Bus, host: &str, robot: &str, has_control: bool) -> Result<Self, GatewayError> {
        let domain = member.domain();
        // The way first: a robot that is sent out keeps its role, even while its identifier is not
        // there.
        let way = way::take(domain, robot)?;
        let role = RoleLock::acquire(domain, robot, Role::Identifier)?;
        let bus = member.for_robot(robot)?;
        Ok(Self {
            host: host.to_owned(),
            is_there: true,
            description: TopicPort::new(&bus)?,
            estimate: TopicPort::new(&bus)?,
            status: TopicPort::new(&bus)?,
            journal: TopicPort::new(&bus)?,
            samples: Samples {
                port: None,
                refused: None,
                tally: Tally::new(),
            },
            control: if has_control {
                Some(ControlServer::new(&bus)?)
            } else {
                None
            },
            asked: Vec::new(),
            bus,
            losses: Losses::default(),
            _roles: [way, role],
        })
    }

    /// Passes a message of the network on to the bus.
    ///
    /// # Errors
    /// The bus fails.
    pub fn message(&mut self, message: &Incoming) -> Result<(), GatewayError> {
        match &message.body {
            Body::Description(body) => self.description.take(message, body)?,
            Body::Estimate(body) => self.estimate.take(message, body)?,
            Body::Status(body) => self.status.take(message, body)?,
            Body::Journal(body) => self.journal.take(message, body)?,
            Body::Sample(body) => self.samples.take(message, body, &self.bus)?,
        }
        Ok(())
    }

    /// Counts a message that cannot be read, and says so of the first of its topic.
    pub fn leave_out(&mut self, topic: Topic, bytes: usize) {
        let tally = match topic {
            Topic::Description => &mut self.description.tally,
            Topic::Estimate => &mut self.estimate.tally,
            Topic::Status => &mut self.status.tally,
            Topic::Journal => &mut self.journal.tally,
            Topic::Sample => &mut self.samples.tally,
            Topic::Control | Topic::Command => return,
        };
        tally.left_out += 1;
        if tally.left_out == 1 {
            let why = unreadable(topic, bytes);
            tracing::warn!(host = self.host, robot = self.bus.robot(), "a message was left out: {why}");
        }
    }

    /// Passes requests and answers on, and serves whoever joined the bus.
    ///
    /// # Errors
    /// The bus or the network fails.
    pub fn turn(&mut self, session: &Session, is_tick: bool) -> Result<(), GatewayError> {
        if let Some(control) = &mut self.control {
            for _ in 0..REQUESTS_AT_A_TIME {
                let Some(asked) = control.take()? else { break };
                if !self.is_there {
                    let text = format!("the gateway of host {} is not there", self.host);
                    asked.answer(&Response::new(response_code::FAILED, &text));
                    continue;
                }
                let key = keys::key(&self.host, self.bus.robot(), Topic::Control.name());
                let question = session
                    .get(key)
                    .payload(to_cdr(asked.request()))
                    .target(QueryTarget::All);
                let question = question.timeout(CONTROL_LIMIT).with(FifoChannel::new(2)).wait();
                self.asked.push((asked, question.map_err(network("asking"))?));
            }
        }
        for (asked, replies) in std::mem::take(&mut self.asked) {
            match answer(&replies, &self.host) {
                Some(response) => asked.answer(&response),
                None => self.asked.push((asked, replies)),
            }
        }
        if is_tick {
            self.description.port.serve_late_joiners()?;
            self.estimate.port.serve_late_joiners()?;
            self.status.port.serve_late_joiners()?;
            self.journal.port.serve_late_joiners()?;
            if let Some((port, _)) = &mut self.samples.port {
                port.serve_late_joiners()?;
            }
        }
        Ok(())
    }

    fn tallies(&self) -> [(Topic, &Tally); keys::CARRIED.len()] {
        [
            (Topic::Description, &self.description.tally),
            (Topic::Estimate, &self.estimate.tally),
            (Topic::Status, &self.status.tally),
            (Topic::Journal, &self.journal.tally),
            (Topic::Sample, &self.samples.tally),
        ]
    }

    /// What is missing and was not told yet, in words for the log; `None` if there is nothing, or if
    /// it is to be told later.
    pub fn losses(&mut self, now: Instant) -> Option<String> {
        let missing = self.tallies().map(|(topic, tally)| (topic, tally.missing()));
        self.losses.tell(missing, now)
    }

    pub fn report(&self) {
        for (topic, tally) in self.tallies() {
            if topic != Topic::Sample || self.samples.port.is_some() {
                let key = keys::key(&self.host, self.bus.robot(), topic.name());
                say(format_args!("{key:<36} {tally}"));
            }
        }
    }
}

/// What the log has told of missing messages.
#[derive(Debug, Default)]
struct Losses {
    told: [u64; keys::CARRIED.len()],
    /// When the first loss was noticed that the log has not said yet.
    noticed: Option<Instant>,
    last: Option<Instant>,
}

impl Losses {
    /// How many more messages of each topic are missing than the log has said so far. The log says
    /// it once every topic has had the time to come again, and at most every [`LOSSES_EVERY`].
    fn tell(&mut self, missing: [(Topic, u64); keys::CARRIED.len()], now: Instant) -> Option<String> {
        if missing.iter().zip(self.told).all(|((_, count), told)| *count <= told) {
            return None;
        }
        let noticed = *self.noticed.get_or_insert(now);
        let is_early = now.duration_since(noticed) < SETTLED;
        if is_early || self.last.is_some_and(|last| now.duration_since(last) < LOSSES_EVERY) {
            return None;
        }
        (self.noticed, self.last) = (None, Some(now));
        let mut words = Vec::new();
        for ((topic, count), told) in missing.into_iter().zip(&mut self.told) {
            if count > *told {
                words.push(format!("{topic} {}", count - *told));
                *told = count;
            }
        }
        Some(words.join(", "))
    }
}

/// What came of a question to control; `None` while nothing has.
fn answer(replies: &FifoChannelHandler<Reply>, host: &str) -> Option<Response> {
    let failed = |text: &str| Response::new(response_code::FAILED, text);
    match replies.try_recv() {
        Ok(None) => None,
        Ok(Some(reply)) => Some(match reply.result() {
            Ok(sample) => from_cdr(&sample.payload().to_bytes(), Dimensions::ALL)
                .unwrap_or_else(|e| failed(&format!("host {host} answered what is {e}"))),
            Err(error) => match &*error.payload().to_bytes() {
                // zenoh's own word.
                b"Timeout" => failed(&format!(
                    "host {host} did not answer within {} s: its gateway hangs or is stopped, or the network fails",
                    CONTROL_LIMIT.as_secs_f64()
                )),
                words => failed(&format!("host {host}: {}", String::from_utf8_lossy(words))),
            },
        }),
        Err(_) => Some(failed(&format!(
            "host {host} does not answer: its gateway takes no commands, or has gone"
        ))),
    }
}

/// Counts a message; false if it is not new.
fn count<M: Counted>(tally: &mut Tally, message: &Incoming, body: &M) -> bool {
    if !tally.admit(&message.envelope) {
        return false;
    }
    if let Some((stream_id, seq)) = body.counted() {
        tally.place(stream_id, seq);
    }
    if message.is_live {
        tally.late(message.envelope.sent_unix_ns, unix_ns());
    }
    true
}

/// A topic of which the bus keeps the last message.
struct TopicPort<T: Latched> {
    port: Publisher<T>,
    tally: Tally,
}

impl<T: Latched + Counted> TopicPort<T> {
    fn new(bus: &Bus) -> Result<Self, BusError> {
        Ok(Self {
            port: Publisher::new(bus)?,
            tally: Tally::new(),
        })
    }

    fn take(&mut self, message: &Incoming, body: &T) -> Result<(), BusError> {
        match count(&mut self.tally, message, body) {
            true => self.port.send(body),
            false => Ok(()),
        }
    }
}

/// The samples of a robot: its topic is made when the first one comes.
struct Samples {
    port: Option<(SamplePublisher, RoleLock)>,
    refused: Option<Instant>,
    tally: Tally,
}

impl Samples {
    fn take(&mut self, message: &Incoming, sample: &Sample, bus: &Bus) -> Result<(), BusError> {
        if !count(&mut self.tally, message, sample) {
            return Ok(());
        }
        if self.port.is_none() {
            if self.refused.is_some_and(|since| since.elapsed() < RETRY_AFTER) {
                return Ok(());
            }
            match samples(bus) {
                Ok(port) => self.port = Some(port),
                Err(e) => {
                    if self.refused.is_none() {
                        tracing::error!("samples cannot come in: {e}");
                    }
                    self.refused = Some(Instant::now());
                }
            }
        }
        let Some((port, _)) = &mut self.port else {
            return Ok(());
        };
        port.send(sample)?;
        port.wake();
        Ok(())
    }
}

fn samples(bus: &Bus) -> Result<(SamplePublisher, RoleLock), BusError> {
    let role = RoleLock::acquire(bus.domain(), bus.robot(), Role::Plant)?;
    let port = SamplePublisher::new(bus, Delivery::Realtime, Arc::new(AtomicBool::new(false)))?;
    Ok((port, role))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_what_is_missing_is_told_once_when_all_topics_had_time_and_not_often() {
        let mut losses = Losses::default();
        let start = Instant::now();
        let mut told = Vec::new();
        for tenth in 0..300_u32 {
            let now = start + tenth * Duration::from_millis(100);
            // Samples are missing from 1 s on, an estimate from 1.5 s on, then a sample each second
            // from 5 s to 15 s.
            let samples = if tenth < 10 { 0 } else { 7 } + u64::from(tenth.clamp(50, 150) - 50) / 10;
            let missing = [
                (Topic::Description, 0),
                (Topic::Estimate, u64::from(tenth >= 15)),
                (Topic::Sample, samples),
                (Topic::Status, 0),
                (Topic::Journal, 0),
            ];
            if let Some(words) = losses.tell(missing, now) {
                told.push((tenth, words));
            }
        }
        let expected = [(20, "estimate 1, sample 7"), (120, "sample 7"), (220, "sample 3")];
        assert_eq!(told, expected.map(|(tenth, words)| (tenth, words.to_owned())));
    }
}
