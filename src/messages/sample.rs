//! Topic `sample`, and the user header of every message.

use super::table::message;
use super::{sample_flags, signals};
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

/// Converts a time to \[ns\]; a negative time and NaN become 0, `inf` the largest value.
pub(crate) fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

/// A signal of a [`Sample`]: a value for each joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    /// Its name in messages and files.
    pub name: &'static str,
    /// Its bit of [`Sample::signals`].
    pub flag: u32,
    /// Its unit; `{position}` and `{input}` stand for the units in the description.
    pub unit: &'static str,
}

/// The signals of a sample, in the order of the message.
pub const SIGNALS: [Signal; 6] = {
    const fn signal(name: &'static str, flag: u32, unit: &'static str) -> Signal {
        Signal { name, flag, unit }
    }
    [
        signal("q", signals::Q, "{position}"),
        signal("dq", signals::DQ, "{position}/s"),
        signal("ddq", signals::DDQ, "{position}/s^2"),
        signal("dddq", signals::DDDQ, "{position}/s^3"),
        signal("setpoint", signals::SETPOINT, "{position}"),
        signal("input", signals::INPUT, "{input}"),
    ]
};

impl Sample {
    /// The values of [`SIGNALS`], in their order.
    pub fn arrays(&self) -> [&[f64; MAX_JOINTS]; 6] {
        [&self.q, &self.dq, &self.ddq, &self.dddq, &self.setpoint, &self.input]
    }

    /// The values of [`SIGNALS`] in their order, mutable.
    pub fn arrays_mut(&mut self) -> [&mut [f64; MAX_JOINTS]; 6] {
        [
            &mut self.q,
            &mut self.dq,
            &mut self.ddq,
            &mut self.dddq,
            &mut self.setpoint,
            &mut self.input,
        ]
    }

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

#[cfg(test)]
mod tests {
    use super::super::Message as _;
    use super::*;

    #[test]
    fn prop_the_signals_are_the_arrays_of_the_message_in_name_unit_and_order() {
        let fields = Sample::LAYOUT.fields.iter().filter(|field| field.is_array);
        let fields: Vec<_> = fields.map(|field| (field.name, field.unit)).collect();
        assert_eq!(fields, SIGNALS.map(|signal| (signal.name, signal.unit)));
        assert_eq!(SIGNALS.iter().fold(0, |all, signal| all | signal.flag), signals::ALL);
        let mut sample = Sample::EMPTY;
        for (k, values) in sample.arrays_mut().into_iter().enumerate() {
            values[0] = k as f64;
        }
        assert_eq!(sample.arrays().map(|values| values[0]), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((sample.q[0], sample.ddq[0], sample.input[0]), (0.0, 2.0, 5.0));
    }
}
