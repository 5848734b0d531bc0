//! A subscriber of any topic.

use crate::confined::Port;
use crate::{bytes, closed, failed, limit};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, BusError, Domain, SampleSubscriber, Subscriber};
use thetabus::messages::{Description, Estimate, Journal, MachineCommand, Status};

/// How long a wait may keep Ctrl-C waiting.
const SLICE: Duration = Duration::from_millis(50);

enum Topic {
    Samples(SampleSubscriber),
    Estimates(Subscriber<Estimate>),
    Status(Subscriber<Status>),
    Description(Subscriber<Description>),
    Journal(Subscriber<Journal>),
    Command(Subscriber<MachineCommand>),
}

impl Topic {
    fn open(topic: &str, robot: &str, domain: &str) -> Result<Option<Self>, BusError> {
        let bus = Bus::join(&Domain::new(domain)?, robot, "python")?;
        Ok(Some(match topic {
            "sample" => Self::Samples(SampleSubscriber::new(&bus)?),
            "estimate" => Self::Estimates(Subscriber::new(&bus)?),
            "status" => Self::Status(Subscriber::new(&bus)?),
            "description" => Self::Description(Subscriber::new(&bus)?),
            "journal" => Self::Journal(Subscriber::new(&bus)?),
            "command" => Self::Command(Subscriber::new(&bus)?),
            _ => return Ok(None),
        }))
    }

    fn next(&mut self, limit: Duration) -> Result<Option<(Vec<u8>, u64)>, BusError> {
        Ok(match self {
            Self::Samples(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
            Self::Estimates(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
            Self::Status(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
            Self::Description(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
            Self::Journal(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
            Self::Command(port) => port.next(limit)?.map(|(m, sent)| (bytes::of(m), sent)),
        })
    }

    fn left_out(&self) -> u64 {
        match self {
            Self::Samples(port) => port.left_out(),
            Self::Estimates(port) => port.left_out(),
            Self::Status(port) => port.left_out(),
            Self::Description(port) => port.left_out(),
            Self::Journal(port) => port.left_out(),
            Self::Command(port) => port.left_out(),
        }
    }
}

/// Receives the messages of one topic as bytes.
#[pyclass(frozen, module = "thetabus._thetabus")]
pub(crate) struct Reader(Port<Topic>);

#[pymethods]
impl Reader {
    #[new]
    fn new(py: Python<'_>, topic: &str, robot: &str, domain: &str) -> PyResult<Self> {
        let opened = py.detach(|| {
            Port::new(|| match Topic::open(topic, robot, domain) {
                Ok(Some(port)) => Ok(port),
                Ok(None) => Err(None),
                Err(e) => Err(Some(e)),
            })
        });
        opened.map(Self).map_err(|e| match e {
            Some(e) => failed(e),
            None => PyValueError::new_err(format!(
                "topic: expected sample, estimate, status, description, journal or command, got {topic:?}"
            )),
        })
    }

    /// The next message with its time of sending in ns, or None past the limit in seconds.
    #[pyo3(signature = (timeout=None))]
    fn next<'py>(&self, py: Python<'py>, timeout: Option<f64>) -> PyResult<Option<(Bound<'py, PyBytes>, u64)>> {
        let (limit, start) = (limit(timeout)?, Instant::now());
        loop {
            let left = limit.saturating_sub(start.elapsed());
            let found = py.detach(|| self.0.with(|port| port.next(left.min(SLICE))));
            if let Some((message, sent_ns)) = found.ok_or_else(closed)?.map_err(failed)? {
                return Ok(Some((PyBytes::new(py, &message), sent_ns)));
            }
            py.check_signals()?;
            if start.elapsed() >= limit {
                return Ok(None);
            }
        }
    }

    /// Messages of another schema, or of a second publisher, that were left out.
    fn left_out(&self, py: Python<'_>) -> PyResult<u64> {
        py.detach(|| self.0.with(|port| port.left_out())).ok_or_else(closed)
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.0.close());
    }
}
