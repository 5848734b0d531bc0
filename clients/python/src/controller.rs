//! A controller that sends feed-forward to a machine.

use crate::confined::Port;
use crate::{closed, failed};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use thetabus::bus::{Bus, BusError, Domain, Publisher, Role, RoleLock};
use thetabus::messages::MachineCommand;
use thetabus::model::MAX_JOINTS;

struct Sender {
    commands: Publisher<MachineCommand>,
    _only_one: RoleLock,
}

impl Sender {
    fn open(robot: &str, domain: &str) -> Result<Self, BusError> {
        let domain = Domain::new(domain)?;
        let only_one = RoleLock::acquire(&domain, robot, Role::Controller)?;
        let bus = Bus::join(&domain, robot, "python_controller")?;
        Ok(Self {
            commands: Publisher::new(&bus)?,
            _only_one: only_one,
        })
    }
}

/// Sends commands to the machine of a robot.
#[pyclass(frozen, module = "thetabus._thetabus")]
pub(crate) struct Controller(Port<Sender>);

#[pymethods]
impl Controller {
    #[new]
    fn new(py: Python<'_>, robot: &str, domain: &str) -> PyResult<Self> {
        let opened = py.detach(|| Port::new(|| Sender::open(robot, domain)));
        opened.map(Self).map_err(failed)
    }

    fn send(
        &self,
        py: Python<'_>,
        stream_id: u64,
        seq: u64,
        until_ns: u64,
        joints: usize,
        feed_forward: Vec<f64>,
    ) -> PyResult<()> {
        if feed_forward.len() != joints || joints > MAX_JOINTS {
            return Err(PyValueError::new_err(format!(
                "feed_forward: expected a number for each of {joints} joints, got {}",
                feed_forward.len()
            )));
        }
        let mut command = MachineCommand {
            stream_id,
            seq,
            until_ns,
            joints: joints as u32,
            ..MachineCommand::EMPTY
        };
        command.feed_forward[..joints].copy_from_slice(&feed_forward);
        let sent = py.detach(|| self.0.with(|port| port.commands.send(&command)));
        sent.ok_or_else(closed)?.map_err(failed)
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.0.close());
    }
}
