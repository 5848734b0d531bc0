//! What travels beside the bytes of a message: 40 bytes, little-endian, as zenoh's attachment.
//!
//! | bytes | field |
//! |---|---|
//! | 0–3 | version of this envelope, 1 |
//! | 4–7 | schema version of the message |
//! | 8–15 | run: drawn at each start of the sending gateway |
//! | 16–23 | number: counts the messages of this key in this run, from 0 |
//! | 24–31 | time of sending on the bus, ns since 1970, UTC |
//! | 32–35 | joints, equations, parameters and derived values in the message |
//! | 36–39 | zero |

use std::time::{SystemTime, UNIX_EPOCH};
use thetabus::recording::Dimensions;

/// Length \[bytes\].
pub const LEN: usize = 40;
const VERSION: u32 = 1;

/// The envelope of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Envelope {
    /// Schema version of the message.
    pub schema: u32,
    /// Start of the sending gateway.
    pub run: u64,
    /// Number of the message in this run and on this key.
    pub number: u64,
    /// When it was sent on the bus, ns since 1970, UTC, by the clock of the sending host.
    pub sent_unix_ns: u64,
    /// What its arrays hold.
    pub dimensions: Dimensions,
}

impl Envelope {
    /// As bytes.
    pub fn to_bytes(self) -> [u8; LEN] {
        let mut bytes = [0; LEN];
        bytes[..4].copy_from_slice(&VERSION.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.schema.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.run.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.number.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.sent_unix_ns.to_le_bytes());
        let of = self.dimensions;
        bytes[32..36].copy_from_slice(&[of.joints, of.equations, of.parameters, of.derived]);
        bytes
    }

    /// From bytes; `None` if they are no envelope of this version.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; LEN] = bytes.try_into().ok()?;
        let word = |at: usize| bytes[at..].first_chunk().map_or(0, |chunk| u32::from_le_bytes(*chunk));
        let long = |at: usize| bytes[at..].first_chunk().map_or(0, |chunk| u64::from_le_bytes(*chunk));
        (word(0) == VERSION).then(|| Self {
            schema: word(4),
            run: long(8),
            number: long(16),
            sent_unix_ns: long(24),
            dimensions: Dimensions {
                joints: bytes[32],
                equations: bytes[33],
                parameters: bytes[34],
                derived: bytes[35],
            },
        })
    }
}

/// Time now, ns since 1970, UTC.
pub fn unix_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_an_envelope_comes_back_and_anything_else_is_refused() {
        let envelope = Envelope {
            schema: 3,
            run: u64::MAX,
            number: 5,
            sent_unix_ns: 1 << 60,
            dimensions: Dimensions {
                joints: 2,
                equations: 2,
                parameters: 9,
                derived: 7,
            },
        };
        let bytes = envelope.to_bytes();
        assert_eq!(Envelope::from_bytes(&bytes), Some(envelope));
        assert_eq!(Envelope::from_bytes(&bytes[..LEN - 1]), None);
        let mut newer = bytes;
        newer[0] = 2;
        assert_eq!(Envelope::from_bytes(&newer), None);
        assert_eq!(Envelope::from_bytes(&[]), None);
    }
}
