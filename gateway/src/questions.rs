//! Commands from the network, put to the identifier one at a time.

use crate::latest::encoding;
use crate::refusals::Lines;
use std::collections::VecDeque;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, BusError, ControlClient, Pending, Topic};
use thetabus::messages::{Request, Response, response_code};
use thetabus::recording::{Dimensions, from_cdr, to_cdr};
use zenoh::Wait;
use zenoh::query::Query;

/// How long an answer may take from the question on. `ctl` waits for 3 s: whoever asks is to hear
/// from the gateway what is wrong, and the answer has a way to go.
pub const PATIENCE: Duration = Duration::from_secs(2);

/// Largest number of questions that wait here, and as many in the channel.
const WAITING: usize = 64;

/// Questions to `control` of one robot.
pub struct Questions {
    host: String,
    bus: Bus,
    asked: Receiver<Query>,
    /// With the time of asking.
    waiting: VecDeque<(Query, Request, Instant)>,
    client: Option<ControlClient>,
    under_way: Option<(Pending, Query, Instant)>,
    /// Lines that others can bring into the log.
    lines: Lines,
}

impl Questions {
    /// Puts what `asked` gives to the identifier of `bus` on this host.
    pub fn new(host: &str, bus: Bus, asked: Receiver<Query>) -> Self {
        Self {
            host: host.to_owned(),
            bus,
            asked,
            waiting: VecDeque::new(),
            client: None,
            under_way: None,
            lines: Lines::default(),
        }
    }

    /// Takes questions, and gives the answer that has come; how many of both there were.
    pub fn turn(&mut self) -> usize {
        let mut count = 0;
        while self.waiting.len() < WAITING
            && let Ok(query) = self.asked.try_recv()
        {
            count += 1;
            let request = query
                .payload()
                .map(|payload| from_cdr(&payload.to_bytes(), Dimensions::ALL));
            match request {
                Some(Ok(request)) => self.waiting.push_back((query, request, Instant::now())),
                Some(Err(e)) => self.refuse(&query, &e.to_string()),
                None => self.refuse(&query, "a question to control needs a Request as its payload"),
            }
        }
        if let Some((pending, query, since)) = self.under_way.take() {
            match self.look(&pending, since) {
                None => self.under_way = Some((pending, query, since)),
                Some(response) => {
                    count += 1;
                    reply(&query, &response);
                }
            }
        }
        if self.under_way.is_none()
            && let Some((query, request, since)) = self.waiting.pop_front()
        {
            count += 1;
            // Whoever asked gives up: a command that has failed must not take effect later, so the
            // identifier gets it with time left to answer or not at all.
            if since.elapsed() >= PATIENCE / 2 {
                reply(
                    &query,
                    &self.failed(&"the commands before it took too long, it was not given to the identifier"),
                );
            } else {
                match self.begin(&request) {
                    Ok(pending) => self.under_way = Some((pending, query, since)),
                    Err(e) => {
                        self.client = None;
                        reply(&query, &self.failed(&e));
                    }
                }
            }
        }
        count
    }

    fn begin(&mut self, request: &Request) -> Result<Pending, BusError> {
        let client = match self.client.take() {
            Some(client) => client,
            None => ControlClient::new(&self.bus)?,
        };
        let pending = client.begin(request)?;
        self.client = Some(client);
        Ok(pending)
    }

    /// The answer, or why there will be none; `None` as long as there may be one.
    fn look(&mut self, pending: &Pending, since: Instant) -> Option<Response> {
        let client = self.client.as_ref()?;
        let failure = match client.look(pending) {
            Ok(Some(response)) => return Some(response),
            Ok(None) if since.elapsed() < PATIENCE => return None,
            Ok(None) => BusError::NoAnswer {
                robot: self.bus.robot().into(),
                domain: self.bus.domain().name().into(),
                limit_s: PATIENCE.as_secs_f64(),
            },
            Err(e) => e,
        };
        // A new client does not wait for what this one has lost.
        self.client = None;
        Some(self.failed(&failure))
    }

    fn refuse(&mut self, query: &Query, why: &str) {
        if let Some(before) = self.lines.next(Instant::now()) {
            tracing::warn!(lines_left_out = before, "a question to control was refused: {why}");
        }
        let _ = query.reply_err(why.to_owned()).wait();
    }

    /// The domain in an error is one of this host, not of the one that asks.
    fn failed(&self, why: &dyn std::fmt::Display) -> Response {
        Response::new(response_code::FAILED, &format!("host {}: {why}", self.host))
    }
}

fn reply(query: &Query, response: &Response) {
    let answer = query.reply(query.key_expr().clone(), to_cdr(response));
    // Whoever asked may have gone.
    let _ = answer.encoding(encoding(Topic::Control)).wait();
}
