//! Topic `sample`, and the user header of every message.

use super::sample_flags;
use super::table::message;
use crate::model::{JointSample, MAX_JOINTS};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;

message! {
    /// User header of every message.
    #[derive(Eq)]
    pub struct Header = "ThetabusHeaderV3" {
        /// See [`SCHEMA_VERSION`](super::SCHEMA_VERSION).
        schema: u32, One, "", "Schema version of the sender";
        /// See [`header_flags`](super::header_flags).
        flags: u32, One, "", "Bit 0: sent before, and may have reached this reader then";
        sent_ns: u64, One, "ns", "CLOCK_MONOTONIC at sending; latency is measured from it";
    }
}

message! {
    /// Topic `sample`: joints, setpoint and input of one instant.
    pub struct Sample = "ThetabusSampleV3" {
        stream_id: u64, One, "", "Random number drawn at each start of the publisher, never 0";
        seq: u64, One, "", "Counts from 0, one per sample period";
        t_ns: u64, One, "ns", "Stream time: simulated time, or CLOCK_MONOTONIC on a machine";
        flags: u32, One, "", "Bit 0: last sample of the stream; bit 1: of a replay";
        joints: u32, One, "", "Number of joints, 1 to 8";
        signals: u32, One, "", "Which arrays hold data: bits 0 to 5 are q, dq, ddq, dddq, setpoint, input";
        pad: u32, Padding, "", "Zero";
        q: [f64; MAX_JOINTS], Joint, "{position}", "Position";
        dq: [f64; MAX_JOINTS], Joint, "{position}/s", "Velocity";
        ddq: [f64; MAX_JOINTS], Joint, "{position}/s^2", "Acceleration";
        dddq: [f64; MAX_JOINTS], Joint, "{position}/s^3", "Jerk";
        setpoint: [f64; MAX_JOINTS], Joint, "{position}", "Commanded position";
        input: [f64; MAX_JOINTS], Joint, "{input}", "Drive's input: voltage, current, torque or force, as the description says";
    }
}

impl Sample {
    /// The joints' signals as the core types have them.
    pub fn joint_sample(&self) -> JointSample {
        JointSample {
            q: self.q,
            dq: self.dq,
            ddq: self.ddq,
            dddq: self.dddq,
            setpoint: self.setpoint,
            input: self.input,
        }
    }

    /// A message from the core type.
    pub fn new(stream_id: u64, seq: u64, t_ns: u64, joints: usize, signals: u32, sample: &JointSample) -> Self {
        Self {
            stream_id,
            seq,
            t_ns,
            joints: joints as u32,
            signals,
            q: sample.q,
            dq: sample.dq,
            ddq: sample.ddq,
            dddq: sample.dddq,
            setpoint: sample.setpoint,
            input: sample.input,
            ..Self::EMPTY
        }
    }

    /// True for the last sample of a stream.
    pub fn is_end(&self) -> bool {
        self.flags & sample_flags::END != 0
    }
}
