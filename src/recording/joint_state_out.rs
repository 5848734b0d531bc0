//! Samples as `sensor_msgs/msg/JointState`, which all ROS 2 tools support; `joint_state.rs` lists
//! the fields.
//!
//! Names and frame are the same in every message, so they are encoded once. Signals that a sample
//! lacks are empty lists, as the message's definition requires.

use super::bag_error::SCHEMA;
use super::info::RunInfo;
use super::layout::{Channel, field_name};
use super::names::channel;
use crate::messages::{Sample, signals};

/// The fields of the message and of its two nested messages.
const DEFINITION: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";
/// Plain CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// After the encapsulation: seconds and nanoseconds.
const STAMP: std::ops::Range<usize> = 4..12;

/// Writes samples as joint states.
#[derive(Debug)]
pub(super) struct JointStates {
    joints: usize,
    /// The message up to its lists; the stamp is replaced for each sample.
    head: Vec<u8>,
}

impl JointStates {
    /// For the machine that `info` describes. The joints have the names of the equations if there
    /// is one per joint, as for robots; otherwise `joint_1` ….
    pub(super) fn new(info: &RunInfo) -> Self {
        let mut head = ENCAPSULATION.to_vec();
        head.resize(STAMP.end, 0);
        text(&mut head, "");
        align(&mut head, 4);
        head.extend((info.joints as u32).to_le_bytes());
        for joint in 0..info.joints {
            match info.equations.get(joint) {
                Some(name) if info.equations.len() == info.joints => text(&mut head, name),
                _ => text(&mut head, &format!("joint_{}", joint + 1)),
            }
        }
        Self {
            joints: info.joints,
            head,
        }
    }

    /// The topic with its schema.
    pub(super) fn channel(info: &RunInfo) -> Channel {
        Channel {
            id: channel::JOINT_STATES,
            topic: format!("/{}/joint_states", field_name(&info.robot)),
            schema_name: SCHEMA.to_owned(),
            schema: DEFINITION.to_owned(),
        }
    }

    /// A sample as CDR; `stamp_ns` is the time of day, since 1970.
    pub(super) fn write(&self, sample: &Sample, stamp_ns: u64, buffer: &mut Vec<u8>) {
        buffer.clear();
        buffer.extend_from_slice(&self.head);
        let second = i32::try_from(stamp_ns / 1_000_000_000).unwrap_or(i32::MAX);
        let nanosecond = (stamp_ns % 1_000_000_000) as u32;
        buffer[STAMP][..4].copy_from_slice(&second.to_le_bytes());
        buffer[STAMP][4..].copy_from_slice(&nanosecond.to_le_bytes());
        for (values, signal) in [
            (&sample.q, signals::Q),
            (&sample.dq, signals::DQ),
            (&sample.input, signals::INPUT),
        ] {
            align(buffer, 4);
            let count = match sample.signals & signal {
                0 => 0,
                _ => self.joints.min(values.len()),
            };
            buffer.extend((count as u32).to_le_bytes());
            for value in &values[..count] {
                align(buffer, 8);
                buffer.extend(value.to_le_bytes());
            }
        }
    }
}

/// Appends zeros up to a multiple of `size` after the encapsulation.
fn align(buffer: &mut Vec<u8>, size: usize) {
    let body = buffer.len() - ENCAPSULATION.len();
    buffer.resize(ENCAPSULATION.len() + body.next_multiple_of(size), 0);
}

/// The length includes the final zero.
fn text(buffer: &mut Vec<u8>, text: &str) {
    align(buffer, 4);
    buffer.extend((text.len() as u32 + 1).to_le_bytes());
    buffer.extend_from_slice(text.as_bytes());
    buffer.push(0);
}
