//! Commands from the network, put to the identifier one at a time.

use crate::latest::encoding;
use std::collections::VecDeque;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, BusError, ControlClient, Pending, Topic};
use thetabus::messages::{Request, Response, response_code};
use thetabus::recording::{Dimensions, from_cdr, to_cdr};
use zenoh::Wait;
use zenoh::query::Query;

/// How long the identifier may take.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// Questions to `control` of one robot.
pub struct Questions {
    bus: Bus,
    asked: Receiver<Query>,
    waiting: VecDeque<(Query, Request)>,
    client: Option<ControlClient>,
    under_way: Option<(Pending, Query, Instant)>,
}

impl Questions {
    /// Puts what `asked` gives to the identifier of `bus`.
    pub fn new(bus: Bus, asked: Receiver<Query>) -> Self {
        Self {
            bus,
            asked,
            waiting: VecDeque::new(),
            client: None,
            under_way: None,
        }
    }

    /// Takes questions, and gives the answer that has come; how many of both there were.
    pub fn turn(&mut self) -> usize {
        let mut count = 0;
        while let Ok(query) = self.asked.try_recv() {
            count += 1;
            let request = query
                .payload()
                .map(|payload| from_cdr(&payload.to_bytes(), Dimensions::ALL));
            match request {
                Some(Ok(request)) => self.waiting.push_back((query, request)),
                Some(Err(e)) => refuse(&query, &e.to_string()),
                None => refuse(&query, "a question to control needs a Request as its payload"),
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
            && let Some((query, request)) = self.waiting.pop_front()
        {
            count += 1;
            match self.begin(&request) {
                Ok(pending) => self.under_way = Some((pending, query, Instant::now())),
                Err(e) => {
                    self.client = None;
                    reply(&query, &failed(&e));
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
        Some(failed(&failure))
    }
}

fn failed(error: &BusError) -> Response {
    Response::new(response_code::FAILED, &error.to_string())
}

fn reply(query: &Query, response: &Response) {
    let answer = query.reply(query.key_expr().clone(), to_cdr(response));
    // Whoever asked may have gone.
    let _ = answer.encoding(encoding(Topic::Control)).wait();
}

fn refuse(query: &Query, why: &str) {
    tracing::warn!("a question to control was refused: {why}");
    let _ = query.reply_err(why.to_owned()).wait();
}
