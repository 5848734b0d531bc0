//! A user's machine on the bus: its role, its stream, and the numbering of its samples.

use super::{Bus, BusError, Delivery, Domain, Role, RoleLock, SamplePublisher, monotonic_ns};
use crate::messages::{Sample, sample_flags};
use crate::model::{JointSample, MAX_JOINTS};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Publishes the samples of a robot in the role of its plant.
///
/// ```no_run
/// use thetabus::bus::{Domain, Machine, monotonic_ns};
/// use thetabus::messages::signals;
/// use thetabus::model::JointSample;
///
/// # fn read_drives(sample: &mut JointSample) -> bool { false }
/// let mut machine = Machine::open(&Domain::new("default")?, "arm", 2)?;
/// let mut sample = JointSample::default();
/// while read_drives(&mut sample) {
///     machine.publish(monotonic_ns(), signals::Q | signals::INPUT, &sample)?;
/// }
/// machine.close()?;
/// # Ok::<(), thetabus::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct Machine {
    samples: SamplePublisher,
    _only_one: RoleLock,
    joints: usize,
    stream_id: u64,
    next_seq: u64,
    has_ended: bool,
}

impl Machine {
    /// Takes the role of the plant of `robot`, with 1 to 8 joints; never waits for consumers.
    ///
    /// # Errors
    /// If the number of joints is out of range, this robot already has a plant, or the bus cannot
    /// be joined.
    pub fn open(domain: &Domain, robot: &str, joints: usize) -> Result<Self, BusError> {
        Self::delivering(domain, robot, joints, Delivery::Realtime)
    }

    /// The same with another [`Delivery`]: a simulation faster than real time waits for its
    /// consumers, also in this call.
    ///
    /// # Errors
    /// See [`open`](Self::open).
    pub fn delivering(domain: &Domain, robot: &str, joints: usize, delivery: Delivery) -> Result<Self, BusError> {
        if !(1..=MAX_JOINTS).contains(&joints) {
            return Err(refused(format!(
                "expected a machine of 1 to {MAX_JOINTS} joints, got {joints}"
            )));
        }
        let only_one = RoleLock::acquire(domain, robot, Role::Plant)?;
        let bus = Bus::join(domain, robot, "machine")?;
        let mut samples = SamplePublisher::new(&bus, delivery, Arc::new(AtomicBool::new(false)))?;
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

    /// Sends the signals measured at stream time `t_ns`, CLOCK_MONOTONIC for a real machine;
    /// returns the sample's seq. `signals` states which arrays of `joints` hold data
    /// ([`crate::messages::signals`]).
    ///
    /// # Errors
    /// If the last sample has been published, or the bus fails.
    pub fn publish(&mut self, t_ns: u64, signals: u32, joints: &JointSample) -> Result<u64, BusError> {
        let mut sample = Sample::new(self.stream_id, self.next_seq, t_ns, self.joints, signals, joints);
        self.send(&mut sample)
    }

    /// The same with the last sample of the stream.
    ///
    /// # Errors
    /// See [`publish`](Self::publish).
    pub fn publish_last(&mut self, t_ns: u64, signals: u32, joints: &JointSample) -> Result<u64, BusError> {
        let mut sample = Sample::new(self.stream_id, self.next_seq, t_ns, self.joints, signals, joints);
        sample.flags |= sample_flags::END;
        self.send(&mut sample)
    }

    /// Sends a sample whose signals, time and flags are set; stream, seq and joints are filled in
    /// here.
    ///
    /// # Errors
    /// See [`publish`](Self::publish).
    pub fn send(&mut self, sample: &mut Sample) -> Result<u64, BusError> {
        if self.has_ended {
            return Err(refused(
                "the last sample has been published; open a machine anew for another stream".to_owned(),
            ));
        }
        (sample.stream_id, sample.seq, sample.joints, sample.pad) =
            (self.stream_id, self.next_seq, self.joints as u32, 0);
        self.samples.send(sample)?;
        self.samples.wake();
        self.next_seq += 1;
        self.has_ended = sample.is_end();
        Ok(sample.seq)
    }

    /// Counts samples that could not be measured, so that readers see them as missing.
    pub fn skip(&mut self, samples: u64) {
        self.next_seq = self.next_seq.saturating_add(samples);
    }

    /// Seq of the next sample.
    pub fn next_seq(&self) -> u64 {
        self.next_seq
    }

    /// Number of its joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Programs that receive the samples now.
    pub fn consumers(&self) -> usize {
        self.samples.attached()
    }

    /// Gives consumers a moment to receive the last samples, then leaves.
    ///
    /// # Errors
    /// If the bus fails.
    pub fn close(mut self) -> Result<(), BusError> {
        match self.next_seq {
            0 => Ok(()),
            _ => self.samples.linger().map(|_| ()),
        }
    }
}

fn refused(problem: String) -> BusError {
    BusError::Machine { problem }
}
