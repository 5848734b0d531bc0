//! A robot of another host in this domain: its topics, and the requests to its identifier.

use crate::error::{GatewayError, network};
use crate::incoming::{Body, Incoming, unreadable};
use crate::keys;
use crate::ports::{Samples, TopicPort};
use crate::questions;
use crate::record::Record;
use crate::silence::Silence;
use crate::way;
use std::time::{Duration, Instant};
use thetabus::bus::{Asked, Bus, ControlServer, Role, RoleLock, Topic};
use thetabus::messages::{Description, Estimate, Journal, Response, Status, response_code};
use thetabus::recording::{Dimensions, from_cdr, to_cdr};
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::query::{QueryTarget, Reply};
use zenoh::{Session, Wait};

/// A robot whose role another program holds is tried again after this time.
pub const RETRY_AFTER: Duration = Duration::from_secs(2);
/// The other gateway answers for the identifier within its own patience, and the network takes its
/// time. `ctl` waits for 3 s: whoever asks gets the gateway's words.
const CONTROL_LIMIT: Duration = questions::PATIENCE.saturating_add(Duration::from_millis(500));
/// Requests taken at a time.
const REQUESTS_AT_A_TIME: usize = 8;

/// A robot of another host in this domain. Its roles end with it.
pub struct RemoteRobot {
    pub record: Record,
    /// The gateway of its host is there.
    pub is_there: bool,
    /// When it last sent something that can be read.
    heard: Instant,
    bus: Bus,
    description: TopicPort<Description>,
    estimate: TopicPort<Estimate>,
    status: TopicPort<Status>,
    journal: TopicPort<Journal>,
    samples: Samples,
    control: Option<ControlServer>,
    /// Requests under way.
    asked: Vec<(Asked, FifoChannelHandler<Reply>)>,
    _roles: [RoleLock; 2],
}

impl RemoteRobot {
    /// Takes the roles in the domain. `record` is asked for once it has them.
    ///
    /// # Errors
    /// Another gateway sends this robot out of the domain or has brought it, another program has the
    /// identifier's role, or the bus fails.
    pub fn new(
        member: &Bus,
        robot: &str,
        has_control: bool,
        record: impl FnOnce() -> Record,
    ) -> Result<Self, GatewayError> {
        let domain = member.domain();
        // The way first: a robot that is sent out keeps its role, even while its identifier is not
        // there.
        let way = way::take(domain, robot)?;
        let role = RoleLock::acquire(domain, robot, Role::Identifier)?;
        let bus = member.for_robot(robot)?;
        Ok(Self {
            is_there: true,
            heard: Instant::now(),
            description: TopicPort::new(&bus)?,
            estimate: TopicPort::new(&bus)?,
            status: TopicPort::new(&bus)?,
            journal: TopicPort::new(&bus)?,
            samples: Samples::None,
            control: if has_control {
                Some(ControlServer::new(&bus)?)
            } else {
                None
            },
            asked: Vec::new(),
            bus,
            record: record(),
            _roles: [way, role],
        })
    }

    /// Whether nothing has come for longer than `silence` allows.
    pub fn is_silent(&self, silence: Silence, now: Instant) -> bool {
        silence.has_lasted(self.heard, now)
    }

    /// Does not count a time in which this process could not hear it.
    pub fn forgive(&mut self, stood: Duration) {
        self.heard += stood;
        self.samples.forgive(stood);
    }

    /// Gives its roles back; what is left is what is known of it.
    pub fn give_back(self) -> Record {
        let text = format!("nothing comes from host {} any more", self.record.host);
        for (asked, _) in self.asked {
            asked.answer(&Response::new(response_code::FAILED, &text));
        }
        self.record
    }

    /// Gives the plant's role back if no samples have come for longer than `silence` allows; true if
    /// it did.
    pub fn give_samples_back_if_silent(&mut self, silence: Silence, now: Instant) -> bool {
        self.samples.give_back_if_silent(silence, now)
    }

    /// Passes a message of the network on to the bus.
    ///
    /// # Errors
    /// The bus fails.
    pub fn message(&mut self, message: &Incoming) -> Result<(), GatewayError> {
        // An answer about last messages comes from the other gateway, and not from the robot.
        if message.is_live {
            self.heard = Instant::now();
        }
        let record = &mut self.record;
        if record.is_of_two(message.envelope.run) {
            tracing::error!(
                host = record.host,
                robot = record.robot,
                "two gateways send a robot of this name from hosts of this name, and their messages are mixed; give each its own --host"
            );
        }
        match &message.body {
            Body::Description(body) => self.description.take(&mut record.description, message, body)?,
            Body::Estimate(body) => self.estimate.take(&mut record.estimate, message, body)?,
            Body::Status(body) => self.status.take(&mut record.status, message, body)?,
            Body::Journal(body) => self.journal.take(&mut record.journal, message, body)?,
            Body::Sample(body) => self.samples.take(&mut record.sample, message, body, &self.bus)?,
        }
        Ok(())
    }

    /// Counts a message that cannot be read, and says so of the first of its topic.
    pub fn leave_out(&mut self, topic: Topic, bytes: usize) {
        if self.record.leave_out(topic) == 1 {
            let (host, robot) = (&self.record.host, &self.record.robot);
            let why = unreadable(topic, bytes);
            tracing::warn!(host, robot, "a message was left out: {why}");
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
                    let text = format!("the gateway of host {} is not there", self.record.host);
                    asked.answer(&Response::new(response_code::FAILED, &text));
                    continue;
                }
                let key = keys::key(&self.record.host, &self.record.robot, Topic::Control.name());
                let question = session
                    .get(key)
                    .payload(to_cdr(asked.request()))
                    .target(QueryTarget::All);
                let question = question.timeout(CONTROL_LIMIT).with(FifoChannel::new(2)).wait();
                self.asked.push((asked, question.map_err(network("asking"))?));
            }
        }
        for (asked, replies) in std::mem::take(&mut self.asked) {
            match answer(&replies, &self.record.host) {
                Some(response) => asked.answer(&response),
                None => self.asked.push((asked, replies)),
            }
        }
        if is_tick {
            self.description.serve_late_joiners()?;
            self.estimate.serve_late_joiners()?;
            self.status.serve_late_joiners()?;
            self.journal.serve_late_joiners()?;
            self.samples.serve_late_joiners()?;
        }
        Ok(())
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
