//! Messages of the network, read before anything is done for the robot that they name.

use crate::envelope::Envelope;
use thetabus::bus::Topic;
use thetabus::messages::{Description, Estimate, Journal, SCHEMA_VERSION, Sample, Status};
use thetabus::recording::{OnWire, from_cdr, to_cdr};

/// A message that can be read.
pub struct Incoming {
    pub envelope: Envelope,
    pub body: Body,
    /// It came as it was sent, and not as an answer about last messages.
    pub is_live: bool,
}

/// What it says.
pub enum Body {
    Description(Box<Description>),
    Estimate(Box<Estimate>),
    Status(Box<Status>),
    Journal(Box<Journal>),
    Sample(Box<Sample>),
}

impl Incoming {
    /// The message; `None` if the bytes are none of this topic and of this schema, or too many or too
    /// few.
    pub fn read(topic: Topic, payload: &[u8], envelope: &[u8], is_live: bool) -> Option<Self> {
        let envelope = Envelope::from_bytes(envelope).filter(|envelope| envelope.schema == SCHEMA_VERSION)?;
        let body = match topic {
            Topic::Description => Body::Description(body(payload, &envelope)?),
            Topic::Estimate => Body::Estimate(body(payload, &envelope)?),
            Topic::Status => Body::Status(body(payload, &envelope)?),
            Topic::Journal => Body::Journal(body(payload, &envelope)?),
            Topic::Sample => Body::Sample(body(payload, &envelope)?),
            Topic::Control | Topic::Command => return None,
        };
        Some(Self {
            envelope,
            body,
            is_live,
        })
    }
}

fn body<M: OnWire>(payload: &[u8], envelope: &Envelope) -> Option<Box<M>> {
    let message: M = from_cdr(payload, envelope.dimensions).ok()?;
    // CDR has no end of its own: bytes behind it would pass unseen.
    (to_cdr(&message).len() == payload.len()).then(|| Box::new(message))
}

/// Why a message cannot be read, for whoever has to mend it.
pub fn unreadable(topic: Topic, bytes: usize) -> String {
    format!(
        "what came as its {topic}, {bytes} bytes, is none of schema {SCHEMA_VERSION}; use the same version of thetabus on both \
         hosts"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use thetabus::recording::Dimensions;

    fn envelope(dimensions: Dimensions, schema: u32) -> [u8; crate::envelope::LEN] {
        let envelope = Envelope {
            schema,
            run: 1,
            number: 0,
            sent_unix_ns: 0,
            dimensions,
        };
        envelope.to_bytes()
    }

    #[test]
    fn prop_a_message_is_read_in_its_own_length_schema_and_topic_only() {
        let estimate = Estimate {
            params: 9,
            equations: 2,
            ..Estimate::EMPTY
        };
        let (bytes, dimensions) = (to_cdr(&estimate), estimate.dimensions());
        let ours = envelope(dimensions, SCHEMA_VERSION);
        let read = |topic, bytes: &[u8], envelope: &[u8]| Incoming::read(topic, bytes, envelope, true).is_some();
        assert!(read(Topic::Estimate, &bytes, &ours));
        assert!(!read(Topic::Estimate, &[&bytes[..], &[0]].concat(), &ours), "too long");
        assert!(!read(Topic::Estimate, &bytes[..bytes.len() - 1], &ours), "too short");
        assert!(
            !read(Topic::Estimate, &bytes, &envelope(dimensions, SCHEMA_VERSION + 1)),
            "of another schema"
        );
        assert!(!read(Topic::Estimate, &bytes, &[]), "without an envelope");
        assert!(!read(Topic::Status, &bytes, &ours), "of another topic");
        assert!(!read(Topic::Control, &bytes, &ours), "of a topic that does not come");
    }
}
