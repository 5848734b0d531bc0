//! A machine that is driven from Python.

use crate::confined::Port;
use crate::{closed, failed};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use thetabus::bus::{self, Delivery, Domain, monotonic_ns};
use thetabus::messages::{Sample, sample_flags, signals};
use thetabus::model::{JointSample, MAX_JOINTS};

/// Publishes the samples of a machine.
#[pyclass(frozen, module = "thetabus._thetabus")]
pub(crate) struct Machine(Port<bus::Machine>);

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
        let limit = crate::limit(Some(consumer_timeout))?;
        let delivery = match consumers {
            0 => Delivery::Realtime,
            consumers => Delivery::Lockstep { consumers, limit },
        };
        let open = || bus::Machine::delivering(&Domain::new(domain)?, robot, joints, delivery);
        py.detach(|| Port::new(open)).map(Self).map_err(failed)
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
                let joints = port.joints();
                let mut joint = JointSample::default();
                let mask = put(&mut joint.q, q, joints, "q", signals::Q)?
                    | put(&mut joint.input, input, joints, "input", signals::INPUT)?
                    | put(&mut joint.dq, dq, joints, "dq", signals::DQ)?
                    | put(&mut joint.ddq, ddq, joints, "ddq", signals::DDQ)?
                    | put(&mut joint.dddq, dddq, joints, "dddq", signals::DDDQ)?
                    | put(&mut joint.setpoint, setpoint, joints, "setpoint", signals::SETPOINT)?;
                if let Some(seq) = seq {
                    let ahead = seq.checked_sub(port.next_seq()).ok_or_else(|| {
                        PyValueError::new_err(format!("seq: expected {} or more, got {seq}", port.next_seq()))
                    })?;
                    port.skip(ahead);
                }
                let mut sample = Sample::new(0, 0, now, joints, mask, &joint);
                if last {
                    sample.flags |= sample_flags::END;
                }
                port.send(&mut sample).map_err(failed)
            })
        })
        .ok_or_else(closed)?
    }

    /// Programs that receive the samples now.
    fn consumers(&self, py: Python<'_>) -> PyResult<usize> {
        py.detach(|| self.0.with(|port| port.consumers())).ok_or_else(closed)
    }

    /// Gives consumers a moment to take what was sent, then leaves.
    fn close(&self, py: Python<'_>) {
        // A bus that fails now has nothing to wait for.
        py.detach(|| self.0.close_by(bus::Machine::close));
    }
}
