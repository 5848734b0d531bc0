//! Messages of the bus as CDR for other hosts, with the encoding of recordings.
//!
//! An array has as many values as the sender's machine needs, so the numbers of joints, equations,
//! parameters and derived values are sent along with the bytes: [`Dimensions`]. Texts, bytes and
//! lists of structures have their full length.

use super::cdr::{CdrReader, CdrWriter};
use super::info::RunInfo;
use super::layout::Counts;
use super::unmeasured::{clear, marked};
use crate::messages::{
    Description, Estimate, Journal, MAX_DERIVED, Message, Request, Response, SCHEMA_VERSION, Sample, Status,
};
use crate::model::{MAX_JOINTS, MAX_PARAMS};
use crate::node::monitor::Label;

/// Number of values of each array of a message on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dimensions {
    /// Joints, 0 to 8.
    pub joints: u8,
    /// Equations, 0 to 8.
    pub equations: u8,
    /// Parameters, 0 to 128.
    pub parameters: u8,
    /// Derived values, 0 to 32.
    pub derived: u8,
}

impl Dimensions {
    /// The capacity of a message.
    pub const ALL: Self = Self {
        joints: MAX_JOINTS as u8,
        equations: MAX_JOINTS as u8,
        parameters: MAX_PARAMS as u8,
        derived: MAX_DERIVED as u8,
    };

    fn counts(self) -> Counts {
        Counts::new(
            self.joints.into(),
            self.equations.into(),
            self.parameters.into(),
            self.derived.into(),
        )
    }
}

/// A message that can be sent to other hosts.
pub trait OnWire: Message {
    /// The dimensions of this message.
    fn dimensions(&self) -> Dimensions {
        Dimensions::ALL
    }

    /// The message in written form.
    fn outgoing(&self) -> Self {
        *self
    }

    /// The message in its original form.
    fn incoming(self) -> Self {
        self
    }
}

impl OnWire for Description {}
impl OnWire for Journal {}
impl OnWire for Request {}
impl OnWire for Response {}

impl OnWire for Status {
    fn dimensions(&self) -> Dimensions {
        Dimensions::default()
    }
}

impl OnWire for Sample {
    fn dimensions(&self) -> Dimensions {
        Dimensions {
            joints: self.joints.min(MAX_JOINTS as u32) as u8,
            ..Dimensions::default()
        }
    }

    fn outgoing(&self) -> Self {
        marked(self)
    }

    fn incoming(mut self) -> Self {
        clear(&mut self);
        self
    }
}

impl OnWire for Estimate {
    fn dimensions(&self) -> Dimensions {
        Dimensions {
            joints: 0,
            equations: self.equations.min(MAX_JOINTS as u32) as u8,
            parameters: self.params.min(MAX_PARAMS as u32) as u8,
            derived: self.derived_len.min(MAX_DERIVED as u32) as u8,
        }
    }
}

/// Bytes that are not the expected message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "not a {message} in little-endian CDR of schema {SCHEMA_VERSION}: the {bytes} bytes are too few, or their dimensions are not its own"
)]
pub struct NotOnWire {
    /// The message.
    pub message: &'static str,
    /// Number of bytes.
    pub bytes: usize,
}

/// A message as CDR, byte for byte as in a recording of this machine.
pub fn to_cdr<M: OnWire>(message: &M) -> Vec<u8> {
    let mut buffer = Vec::new();
    let counts = message.dimensions().counts();
    let Ok(()) = message.outgoing().visit(&mut CdrWriter::new(&mut buffer, &counts));
    buffer
}

/// Decodes a message; fields that are not on the wire are zero.
///
/// # Errors
/// If the bytes are too few, not little-endian CDR, or of a message with other dimensions.
pub fn from_cdr<M: OnWire>(bytes: &[u8], dimensions: Dimensions) -> Result<M, NotOnWire> {
    let failed = NotOnWire {
        message: M::LAYOUT.name,
        bytes: bytes.len(),
    };
    let counts = dimensions.counts();
    let mut message = M::EMPTY;
    let read = CdrReader::new(bytes, &counts).and_then(|mut reader| message.visit(&mut reader));
    match read {
        Ok(()) if message.dimensions() == dimensions => Ok(message.incoming()),
        _ => Err(failed),
    }
}

/// Metadata of a machine of which only the description is known: enough for the names in a schema.
///
/// A description does not name the equations: they are called `joint_1` … if there is one per
/// joint, as in the built-in models, and otherwise `equation_1` ….
pub fn described(robot: &str, description: &Description) -> RunInfo {
    let joints = description.joints();
    let unit = |of: fn(&crate::messages::JointInfo) -> &str| joints.first().map_or("", of).to_owned();
    let equations = description.equations.min(MAX_JOINTS as u32) as usize;
    let stem = if equations == joints.len() { "joint" } else { "equation" };
    RunInfo {
        schema: SCHEMA_VERSION,
        robot: robot.to_owned(),
        model: description.model().to_owned(),
        model_hash: description.model_hash,
        config_hash: description.config_hash,
        joints: joints.len(),
        position_unit: description.position_unit().to_owned(),
        input_unit: unit(crate::messages::JointInfo::input_unit),
        equations: (1..=equations).map(|number| format!("{stem}_{number}")).collect(),
        parameters: description
            .parameters()
            .iter()
            .map(|p| Label::new(p.name(), p.unit()))
            .collect(),
        derived: description
            .derived()
            .iter()
            .map(|d| Label::new(d.name(), d.unit()))
            .collect(),
        ..RunInfo::default()
    }
}

#[cfg(test)]
mod tests {
    use super::super::encoder::Encoder;
    use super::super::info::tests::arm;
    use super::*;
    use crate::messages::{Command, DerivedInfo, JointInfo, ParameterInfo, response_code};

    fn estimate() -> Estimate {
        let mut estimate = Estimate {
            block: 7,
            params: 9,
            equations: 2,
            derived_len: 1,
            usable: [0, 8].into_iter().collect(),
            ..Estimate::EMPTY
        };
        estimate.theta[8] = 0.1 + 0.2;
        estimate.derived[0] = f64::MIN_POSITIVE;
        estimate
    }

    #[test]
    fn prop_every_message_comes_back_to_the_bit() {
        fn check<M: OnWire + PartialEq + std::fmt::Debug>(message: M) {
            let bytes = to_cdr(&message);
            assert_eq!(from_cdr::<M>(&bytes, message.dimensions()), Ok(message));
            for cut in 0..bytes.len() {
                assert!(from_cdr::<M>(&bytes[..cut], message.dimensions()).is_err(), "{cut}");
            }
        }
        let mut sample = Sample {
            joints: 2,
            signals: crate::messages::signals::Q,
            seq: 5,
            ..Sample::EMPTY
        };
        sample.q[1] = -1.5;
        check(sample);
        check(estimate());
        check(Status {
            pid: 3,
            ..Status::EMPTY
        });
        let request = Request::new(Command::Set).named("forgetting_factor").with_value(0.9);
        check(request);
        check(Journal {
            stream_id: 1,
            block: 2,
            request,
        });
        check(Response::new(response_code::REFUSED, "no such parameter"));
        let parameters = (0..9).map(|i| ParameterInfo::new(&format!("theta_{i}"), "kg", "", 0.0, (0.0, 1.0)));
        let description = Description::default().of_model("arm", 7, "V").with(
            [JointInfo::new("shoulder", "rad", "V")],
            parameters,
            [DerivedInfo::new("mass", "kg", "")],
        );
        check(description);
    }

    #[test]
    fn prop_the_bytes_are_those_of_a_recording() {
        let mut info = arm();
        info.derived = vec![Label {
            name: "mass_2".into(),
            unit: "kg".into(),
        }];
        let mut encoder = Encoder::new(&info).expect("names that differ");
        assert_eq!(to_cdr(&estimate()), encoder.estimate(&estimate()));
        let sample = Sample {
            joints: 2,
            ..Sample::EMPTY
        };
        assert_eq!(to_cdr(&sample), encoder.sample(&sample));
        assert_eq!(to_cdr(&Status::EMPTY), encoder.status(&Status::EMPTY));
    }

    #[test]
    fn fault_dimensions_of_another_message_are_refused() {
        let sample = Sample {
            joints: 2,
            ..Sample::EMPTY
        };
        let bytes = to_cdr(&sample);
        // One joint would fit into the bytes of two, but contradicts the message.
        let other = Dimensions {
            joints: 1,
            ..Dimensions::default()
        };
        let error = from_cdr::<Sample>(&bytes, other).expect_err("other dimensions");
        assert!(error.to_string().contains("not a Sample"), "{error}");
    }

    #[test]
    fn prop_a_description_gives_the_schema_of_the_recording() {
        let recorded = arm();
        let parameters = recorded.parameters.iter();
        let parameters = parameters.map(|p| ParameterInfo::new(&p.name, &p.unit, "", 0.0, (0.0, 1.0)));
        let derived = recorded.derived.iter().map(|d| DerivedInfo::new(&d.name, &d.unit, ""));
        let joint = JointInfo::new("", &recorded.position_unit, &recorded.input_unit);
        let mut description = Description::default().with(vec![joint; recorded.joints], parameters, derived);
        description.equations = recorded.equations.len() as u32;
        let info = described(&recorded.robot, &description);
        let channels = |info: &RunInfo| Encoder::new(info).expect("names that differ").channels().to_vec();
        assert_eq!(channels(&info), channels(&recorded));
    }
}
