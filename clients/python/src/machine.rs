//! A machine that is driven from Python.

use crate::confined::Port;
use crate::{closed, failed};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use thetabus::bus::{Bus, BusError, Delivery, Domain, Role, RoleLock, SamplePublisher, monotonic_ns};
use thetabus::messages::{Sample, sample_flags, signals};
use thetabus::model::{JointSample, MAX_JOINTS};

struct Publisher {
    samples: SamplePublisher,
    _only_one: RoleLock,
    joints: usize,
    stream_id: u64,
    next_seq: u64,
    has_ended: bool,
}

impl Publisher {
    fn open(robot: &str, joints: usize, domain: &str, consumers: usize, limit: Duration) -> Result<Self, BusError> {
        let domain = Domain::new(domain)?;
        let only_one = RoleLock::acquire(&domain, robot, Role::Plant)?;
        let bus = Bus::join(&domain, robot, "python_machine")?;
        let never = Arc::new(AtomicBool::new(false));
        let delivery = match consumers {
            0 => Delivery::Realtime,
            consumers => Delivery::Lockstep { consumers, limit },
        };
        let mut samples = SamplePublisher::new(&bus, delivery, never)?;
        samples.wait_for_consumers()?;
        Ok(Self {
            samples,
            _only_one: only_one,
            joints,
            // a number that no earlier start of this machine had, and never 0
            stream_id: (monotonic_ns() ^ u64::from(std::process::id()) << 40).max(1),
            next_seq: 0,
            has_ended: false,
        })
    }
}

/// Publishes the samples of a machine.
#[pyclass(frozen, module = "thetabus._thetabus")]
pub(crate) struct Machine(Port<Publisher>);

/// Writes a signal to its array; `None` leaves it out.
fn put(target: &mut [f64; MAX_JOINTS], values: Option<Vec<f64>>, joints: usize, name: &str, bit: u32) -> PyResult<u32> {
    let Some(values) = values else { return Ok(0) };
    if values.len() != joints {
        return Err(PyValueError::new_err(format!(
            "{name}: expected a number for each of {joints} joints, got {}",
            values.len()
        )));
    }
    target[..joints].copy_from_slice(&values);
    Ok(bit)
}

#[pymethods]
impl Machine {
    #[new]
    fn new(
        py: Python<'_>,
        robot: &str,
        joints: usize,
        domain: &str,
        consumers: usize,
        consumer_timeout: f64,
    ) -> PyResult<Self> {
        if !(1..=MAX_JOINTS).contains(&joints) {
            return Err(PyValueError::new_err(format!(
                "joints: expected 1 to {MAX_JOINTS}, got {joints}"
            )));
        }
        let limit = crate::limit(Some(consumer_timeout))?;
        let opened = py.detach(|| Port::new(|| Publisher::open(robot, joints, domain, consumers, limit)));
        opened.map(Self).map_err(failed)
    }

    /// Sends a sample; gives its seq.
    #[expect(clippy::too_many_arguments, reason = "the signals of a sample, by name")]
    #[pyo3(signature = (q, input, dq, ddq, dddq, setpoint, t_ns, seq, last))]
    fn publish(
        &self,
        py: Python<'_>,
        q: Option<Vec<f64>>,
        input: Option<Vec<f64>>,
        dq: Option<Vec<f64>>,
        ddq: Option<Vec<f64>>,
        dddq: Option<Vec<f64>>,
        setpoint: Option<Vec<f64>>,
        t_ns: Option<u64>,
        seq: Option<u64>,
        last: bool,
    ) -> PyResult<u64> {
        let now = t_ns.unwrap_or_else(monotonic_ns);
        py.detach(|| {
            self.0.with(|port| {
                if port.has_ended {
                    return Err(PyValueError::new_err(
                        "the last sample has been published; a new Machine begins a new stream",
                    ));
                }
                let mut joint = JointSample::default();
                let mask = put(&mut joint.q, q, port.joints, "q", signals::Q)?
                    | put(&mut joint.input, input, port.joints, "input", signals::INPUT)?
                    | put(&mut joint.dq, dq, port.joints, "dq", signals::DQ)?
                    | put(&mut joint.ddq, ddq, port.joints, "ddq", signals::DDQ)?
                    | put(&mut joint.dddq, dddq, port.joints, "dddq", signals::DDDQ)?
                    | put(
                        &mut joint.setpoint,
                        setpoint,
                        port.joints,
                        "setpoint",
                        signals::SETPOINT,
                    )?;
                let seq = seq.unwrap_or(port.next_seq);
                let mut sample = Sample::new(port.stream_id, seq, now, port.joints, mask, &joint);
                if last {
                    sample.flags |= sample_flags::END;
                }
                port.samples.send(&sample).map_err(failed)?;
                port.samples.wake();
                (port.next_seq, port.has_ended) = (seq + 1, last);
                Ok(seq)
            })
        })
        .ok_or_else(closed)?
    }

    /// Programs that receive the samples now.
    fn consumers(&self, py: Python<'_>) -> PyResult<usize> {
        py.detach(|| self.0.with(|port| port.samples.attached()))
            .ok_or_else(closed)
    }

    /// Gives consumers the time to take what was sent, then leaves.
    fn close(&self, py: Python<'_>) {
        py.detach(|| {
            // A bus that fails now has nothing to wait for.
            _ = self.0.with(|port| (port.next_seq > 0).then(|| port.samples.linger()));
            self.0.close();
        });
    }
}
