//! Requests to the identifier and its answers: one server, and clients with their own time limits.
//!
//! A request wakes the server by an event. A server that died or was stopped never answers, so a
//! client waits only up to its limit.

use super::memory;
use super::subscriber::{listener, wait};
use super::topic::control as sizes;
use super::{Bus, BusError, ControlService, Listener, Notifier, Topic};
use crate::messages::{Request, Response};
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::{client::Client, server::Server};
use iceoryx2::prelude::ipc;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::client::ClientCreateError;
use std::time::{Duration, Instant};

/// Polling period of a client.
const POLL: Duration = Duration::from_millis(2);

/// The identifier's end.
#[derive(Debug)]
pub struct ControlServer {
    /// `None` for a polled server.
    listener: Option<Listener>,
    port: Server<ipc::Service, Request, (), Response, ()>,
    _service: ControlService,
}

impl ControlServer {
    /// Becomes the only server of a robot.
    ///
    /// # Errors
    /// If there already is one, or the bus fails.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        Self::with(bus, true)
    }

    /// The same for a server that polls and needs no wake-up.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn polled(bus: &Bus) -> Result<Self, BusError> {
        Self::with(bus, false)
    }

    fn with(bus: &Bus, is_woken: bool) -> Result<Self, BusError> {
        let claim = memory::claim(bus, Topic::Control, sizes::server_bytes())?;
        let service = bus.create_control()?;
        let port = service.server_builder().create().map_err(|e| {
            bus.topic_error(
                Topic::Control,
                format!("cannot serve it, there may be a server already: {e:?}"),
            )
        })?;
        let listener = is_woken.then(|| listener(bus, Topic::Control)).transpose()?;
        claim.take()?;
        Ok(Self {
            listener,
            port,
            _service: service,
        })
    }

    /// Waits until a request may be there; at most `timeout`. Signals end the wait early. A
    /// [polled](Self::polled) one sleeps.
    ///
    /// # Errors
    /// The bus fails.
    pub fn wait(&self, timeout: Duration) -> Result<(), BusError> {
        match &self.listener {
            Some(listener) => wait(listener, Topic::Control, timeout),
            None => {
                std::thread::sleep(timeout);
                Ok(())
            }
        }
    }

    /// Answers the requests that have arrived, at most `limit`; returns their number.
    ///
    /// # Errors
    /// The bus fails.
    pub fn serve(&mut self, limit: usize, mut answer: impl FnMut(&Request) -> Response) -> Result<usize, BusError> {
        for count in 0..limit {
            let Some(asked) = self.take()? else { return Ok(count) };
            let response = answer(asked.request());
            asked.answer(&response);
        }
        Ok(limit)
    }

    /// Takes the next request, to answer it later; `None` if none has arrived.
    ///
    /// # Errors
    /// The bus fails.
    pub fn take(&mut self) -> Result<Option<Asked>, BusError> {
        let request = self.port.receive().map_err(|e| transfer("receiving", &e))?;
        Ok(request.map(Asked))
    }
}

/// A request that waits for its answer. If it is dropped without one, its client waits until its
/// own limit.
#[derive(Debug)]
pub struct Asked(ActiveRequest<ipc::Service, Request, (), Response, ()>);

impl Asked {
    /// The request.
    pub fn request(&self) -> &Request {
        self.0.payload()
    }

    /// Answers. A client that has left needs no answer.
    pub fn answer(self, response: &Response) {
        let _ = self.0.send_copy(*response);
    }
}

/// The client's end.
#[derive(Debug)]
pub struct ControlClient {
    bus: Bus,
    notifier: Notifier,
    port: Client<ipc::Service, Request, (), Response, ()>,
    service: ControlService,
}

impl ControlClient {
    /// Finds the identifier of the bus's robot.
    ///
    /// # Errors
    /// [`BusError::NoIdentifier`] if none is running.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        let service = bus.open_control()?.ok_or_else(|| nobody(bus))?;
        if service.dynamic_config().number_of_servers() == 0 {
            return Err(nobody(bus));
        }
        let claim = memory::claim(bus, Topic::Control, sizes::client_bytes())?;
        let port = service.client_builder().create().map_err(|e| {
            let problem = match e {
                ClientCreateError::ExceedsMaxSupportedClients => sizes::FULL.to_owned(),
                other => format!("cannot ask: {other:?}"),
            };
            bus.topic_error(Topic::Control, problem)
        })?;
        let notifier = bus
            .event(Topic::Control)?
            .notifier_builder()
            .create()
            .map_err(|e| bus.topic_error(Topic::Control, format!("cannot wake the identifier: {e:?}")))?;
        claim.take()?;
        Ok(Self {
            bus: bus.clone(),
            notifier,
            port,
            service,
        })
    }

    /// Sends a request and waits for its answer, at most for `limit`.
    ///
    /// # Errors
    /// [`BusError::NoAnswer`] past the limit, [`BusError::NoIdentifier`] if the identifier has
    /// ended.
    pub fn ask(&self, request: &Request, limit: Duration) -> Result<Response, BusError> {
        let start = Instant::now();
        let pending = self.begin(request)?;
        loop {
            if let Some(response) = self.look(&pending)? {
                return Ok(response);
            }
            if start.elapsed() >= limit {
                return Err(BusError::NoAnswer {
                    robot: self.bus.robot().into(),
                    domain: self.bus.domain().name().into(),
                    limit_s: limit.as_secs_f64(),
                });
            }
            std::thread::sleep(POLL);
        }
    }

    /// Sends a request without waiting; only one may be pending.
    ///
    /// # Errors
    /// If the bus fails, or an earlier request is still pending.
    pub fn begin(&self, request: &Request) -> Result<Pending, BusError> {
        let pending = self.port.send_copy(*request).map_err(|e| transfer("sending", &e))?;
        // Without a wake-up the server checks for requests once per tick.
        let _ = self.notifier.notify();
        Ok(Pending(pending))
    }

    /// The answer, if it has come.
    ///
    /// # Errors
    /// [`BusError::NoIdentifier`] if the identifier has ended; or if the bus fails.
    pub fn look(&self, pending: &Pending) -> Result<Option<Response>, BusError> {
        if let Some(response) = pending.0.receive().map_err(|e| transfer("receiving", &e))? {
            return Ok(Some(*response.payload()));
        }
        match self.service.dynamic_config().number_of_servers() {
            0 => Err(nobody(&self.bus)),
            _ => Ok(None),
        }
    }
}

/// A pending request.
#[derive(Debug)]
pub struct Pending(PendingResponse<ipc::Service, Request, (), Response, ()>);

fn nobody(bus: &Bus) -> BusError {
    BusError::NoIdentifier {
        robot: bus.robot().into(),
        domain: bus.domain().name().into(),
    }
}

fn transfer(action: &'static str, cause: &dyn std::fmt::Debug) -> BusError {
    BusError::Transfer {
        topic: Topic::Control,
        action,
        cause: format!("{cause:?}"),
    }
}
