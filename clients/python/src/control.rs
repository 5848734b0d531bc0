//! Requests to an identifier.

use crate::confined::Port;
use crate::{bytes, closed, failed, limit};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use thetabus::bus::{Bus, ControlClient, Domain};
use thetabus::messages::{Command, Request};

/// Asks the identifier of a robot.
#[pyclass(frozen, module = "thetabus._thetabus")]
pub(crate) struct Control(Port<ControlClient>);

#[pymethods]
impl Control {
    #[new]
    fn new(py: Python<'_>, robot: &str, domain: &str) -> PyResult<Self> {
        let opened = py.detach(|| {
            Port::new(|| {
                let bus = Bus::join(&Domain::new(domain)?, robot, "python")?;
                ControlClient::new(&bus)
            })
        });
        opened.map(Self).map_err(failed)
    }

    /// Sends a command and gives the answer's bytes.
    fn ask<'py>(
        &self,
        py: Python<'py>,
        command: &str,
        name: &str,
        value: Option<f64>,
        from_seq: u64,
        timeout: f64,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let known = Command::from_name(command)
            .filter(|command| command.is_plain())
            .ok_or_else(|| {
                PyValueError::new_err(format!(
                    "command: expected pause, resume, reset, set, fix, free, save or describe, got {command:?}; declare a payload with payload()"
                ))
            })?;
        let mut request = Request::new(known).named(name);
        if let Some(value) = value {
            request = request.with_value(value);
        }
        request.from_seq = from_seq;
        let limit = limit(Some(timeout))?;
        let answer = py.detach(|| self.0.with(|client| client.ask(&request, limit).map(bytes::of)));
        let answer = answer.ok_or_else(closed)?.map_err(failed)?;
        Ok(PyBytes::new(py, &answer))
    }

    /// Says what the flange of a robot carries, nothing if `mass` is 0, and gives the answer's bytes.
    fn payload<'py>(
        &self,
        py: Python<'py>,
        mass: f64,
        com: [f64; 3],
        inertia: Option<[f64; 6]>,
        timeout: f64,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let limit = limit(Some(timeout))?;
        let request = Request::load(mass, com, inertia);
        let answer = py.detach(|| self.0.with(|client| client.ask(&request, limit).map(bytes::of)));
        let answer = answer.ok_or_else(closed)?.map_err(failed)?;
        Ok(PyBytes::new(py, &answer))
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.0.close());
    }
}
