//! Service `control` and topic `journal`: commands to an identifier and their outcome.

use super::table::message;
use super::text::{put_text, text_of};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;

/// Bytes of a name in a [`Request`].
pub const NAME: usize = 64;
/// Bytes of a unit in an [`Item`].
pub const UNIT: usize = 32;
/// Bytes of the text of a [`Response`].
pub const RESPONSE_TEXT: usize = 256;
/// Bytes of a state that one [`Request`] or [`Journal`] holds.
pub const DATA: usize = 1024;
/// Numbers that describe a payload.
pub const PAYLOAD: usize = 10;
/// Most parts of a state.
pub const MAX_PARTS: u32 = 1024;
/// Most items that a [`Response`] describes: 128 parameters, tunables, positions and inputs.
pub const MAX_ITEMS: usize = 160;

/// Commands that an identifier accepts.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Command {
    /// Take no more samples in.
    Pause = 1,
    /// Go on.
    Resume = 2,
    /// Back to the start values; tunables stay.
    Reset = 3,
    /// Set a tunable.
    Set = 4,
    /// Hold a parameter, at a value or at its estimate.
    Fix = 5,
    /// Estimate a parameter that was held.
    Free = 6,
    /// Write a checkpoint.
    Save = 7,
    /// Report names, units, bounds and tunables.
    Describe = 8,
    /// Continue from a state, sent in parts of [`DATA`] bytes: a warm start for replays.
    Restore = 9,
    /// A recorder reports how many samples it lost.
    Recorder = 10,
    /// What the flange of a robot carries from now on: nothing, or a known load.
    Payload = 11,
}

impl Command {
    const ALL: [(Self, &'static str); 11] = [
        (Self::Pause, "pause"),
        (Self::Resume, "resume"),
        (Self::Reset, "reset"),
        (Self::Set, "set"),
        (Self::Fix, "fix"),
        (Self::Free, "free"),
        (Self::Save, "save"),
        (Self::Describe, "describe"),
        (Self::Restore, "restore"),
        (Self::Recorder, "recorder"),
        (Self::Payload, "payload"),
    ];

    /// True for commands that consist of a name and a value alone: pause, resume, reset, set, fix,
    /// free, save and describe. The others carry other data, or are sent only by programs.
    pub fn is_plain(self) -> bool {
        !matches!(self, Self::Restore | Self::Recorder | Self::Payload)
    }

    /// The name as on the command line and in files.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize - 1].1
    }

    /// The command with this wire value; `None` for a value that this schema does not have.
    pub fn from_wire(value: u32) -> Option<Self> {
        let index = usize::try_from(value).ok()?.checked_sub(1)?;
        Self::ALL.get(index).map(|&(command, _)| command)
    }

    /// The command of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .iter()
            .find(|(_, own)| *own == name)
            .map(|&(command, _)| command)
    }
}

/// Flags of a [`Request`] and of a [`Journal`].
pub mod request_flags {
    /// `value` is set.
    pub const VALUE: u32 = 1 << 0;
}

/// The tag by which a [`Request`] names a stream; never 0. Two tags agree by chance only among
/// about 10⁵ streams.
pub fn stream_tag(stream_id: u64) -> u32 {
    ((stream_id ^ (stream_id >> 32)) as u32).max(1)
}

/// A request whose data cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The length is neither 0 nor that of a body.
    #[error("payload: expected {} bytes of a body, or 0 for nothing, got {got}", 8 * PAYLOAD)]
    Payload {
        /// Length that was given \[bytes\].
        got: usize,
    },
    /// A part of a state is not the next one, or is out of range.
    #[error("expected part {next} of a state, got {got} of {of}")]
    Part {
        /// Number of the next part, from 0.
        next: u32,
        /// Number that was given.
        got: u32,
        /// Parts of the state that was given.
        of: u32,
    },
}

message! {
    /// A request of service `control`.
    pub struct Request = "ThetabusRequestV3" {
        /// See [`Command`].
        command: u32, One, "", "1 pause, 2 resume, 3 reset, 4 set, 5 fix, 6 free, 7 save, 8 describe, 9 restore, 10 recorder, 11 payload";
        /// See [`request_flags`].
        flags: u32, One, "", "Bit 0: `value` is set";
        from_seq: u64, One, "", "Not before this sample of the stream; 0: at the next border between two blocks";
        value: f64, One, "", "Value of a tunable or parameter, in its unit; lost samples of a recorder";
        name: [u8; NAME], Text, "", "Tunable or parameter";
        part: u32, One, "", "Number of this part of a state, from 0";
        parts: u32, One, "", "Parts of the state";
        data_len: u32, One, "bytes", "Length of this part; of a payload 80, or 0 for none";
        /// See [`stream_tag`]. The request waits for that stream, and its effect is undone when
        /// another stream begins.
        stream: u32, One, "", "Tag of the only stream that this is for; 0: for whichever is open, and to stay";
        data: [u8; DATA], Byte, "", "The part; of a payload m, hx, hy, hz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the flange as float64";
    }
}

impl Request {
    /// A request without name and value.
    pub fn new(command: Command) -> Self {
        Self {
            command: command as u32,
            ..Self::default()
        }
    }

    /// The same with the name of a tunable or parameter.
    #[must_use]
    pub fn named(mut self, name: &str) -> Self {
        put_text(&mut self.name, name);
        self
    }

    /// The same with a value.
    #[must_use]
    pub fn with_value(mut self, value: f64) -> Self {
        self.value = value;
        self.flags |= request_flags::VALUE;
        self
    }

    /// A request that sets the payload at the flange: nothing, or ten parameters about the flange,
    /// m, hx, hy, hz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    pub fn payload(body: Option<&[f64; PAYLOAD]>) -> Self {
        let mut request = Self::new(Command::Payload);
        for (bytes, x) in request.data.chunks_exact_mut(8).zip(body.into_iter().flatten()) {
            bytes.copy_from_slice(&x.to_le_bytes());
            request.data_len += 8;
        }
        request
    }

    /// A request that sets the payload at the flange by physical values: mass \[kg\], 0 for
    /// nothing, centre of mass in the flange's frame \[m\], inertia about it in the flange's axes,
    /// xx, xy, yy, xz, yz, zz \[kg m²\], or that of an aluminium ball. The identifier refuses
    /// values that no body can have.
    pub fn load(mass: f64, center: [f64; 3], inertia: Option<[f64; 6]>) -> Self {
        match mass == 0.0 {
            true => Self::payload(None),
            false => Self::payload(Some(&crate::model::load_at_flange(mass, center, inertia))),
        }
    }

    /// The payload of a request made by [`payload`](Self::payload).
    ///
    /// # Errors
    /// If the length is neither 0 nor that of a body.
    pub fn payload_body(&self) -> Result<Option<[f64; PAYLOAD]>, RequestError> {
        match self.data_len as usize {
            0 => Ok(None),
            len if len == 8 * PAYLOAD => {
                let mut body = [0.0; PAYLOAD];
                for (x, bytes) in body.iter_mut().zip(self.data.chunks_exact(8)) {
                    *x = f64::from_le_bytes(std::array::from_fn(|i| bytes[i]));
                }
                Ok(Some(body))
            }
            got => Err(RequestError::Payload { got }),
        }
    }

    /// The name.
    pub fn name(&self) -> &str {
        text_of(&self.name)
    }

    /// The value, if there is one.
    pub fn value(&self) -> Option<f64> {
        (self.flags & request_flags::VALUE != 0).then_some(self.value)
    }

    /// Requests that together carry a state; `None` if it is too long.
    pub fn restore(state: &[u8]) -> Option<Vec<Self>> {
        let parts = u32::try_from(state.len().div_ceil(DATA))
            .ok()
            .filter(|parts| *parts <= MAX_PARTS)?;
        let part = |(part, bytes): (usize, &[u8])| {
            let mut request = Self::new(Command::Restore);
            (request.part, request.parts) = (part as u32, parts);
            request.data_len = bytes.len() as u32;
            request.data[..bytes.len()].copy_from_slice(bytes);
            request
        };
        Some(state.chunks(DATA).enumerate().map(part).collect())
    }
}

/// Reassembles a state from its parts.
#[derive(Debug, Clone, Default)]
pub struct Parts {
    bytes: Vec<u8>,
    next: u32,
}

impl Parts {
    /// Takes the next part and returns the state with the last one.
    ///
    /// # Errors
    /// If a part is missing or out of range; then it begins anew.
    pub fn take(&mut self, part: &Request) -> Result<Option<Vec<u8>>, RequestError> {
        if part.part == 0 {
            *self = Self::default();
        }
        let len = part.data_len as usize;
        if part.part != self.next || part.part >= part.parts || part.parts > MAX_PARTS || len > DATA {
            let (next, got, of) = (self.next, part.part, part.parts);
            *self = Self::default();
            return Err(RequestError::Part { next, got, of });
        }
        self.bytes.extend_from_slice(&part.data[..len]);
        self.next += 1;
        Ok((self.next == part.parts).then(|| std::mem::take(self).bytes))
    }
}

/// Kinds of [`Item`].
pub mod item_kind {
    /// A parameter that is estimated.
    pub const PARAMETER: u32 = 1;
    /// A tunable.
    pub const TUNABLE: u32 = 2;
    /// A joint's position.
    pub const POSITION: u32 = 3;
    /// A joint's input.
    pub const INPUT: u32 = 4;
    /// A figure that the identifier chooses itself, as it is now.
    pub const FIGURE: u32 = 5;
}

message! {
    /// What `describe` reports about a parameter, a tunable or a signal.
    pub struct Item = "ThetabusItemV3" {
        /// See [`item_kind`].
        kind: u32, One, "", "1 parameter, 2 tunable, 3 position, 4 input, 5 figure";
        pad: u32, Padding, "", "Zero";
        value: f64, One, "{item}", "Value of a tunable; start value of a parameter";
        lower: f64, One, "{item}", "Lower bound, -inf for none";
        upper: f64, One, "{item}", "Upper bound, inf for none";
        name: [u8; NAME], Text, "", "Name";
        unit: [u8; UNIT], Text, "", "Unit";
    }
}

impl Item {
    /// An item.
    pub fn new(kind: u32, name: &str, unit: &str, value: f64, (lower, upper): (f64, f64)) -> Self {
        let mut item = Self {
            kind,
            value,
            lower,
            upper,
            ..Self::default()
        };
        put_text(&mut item.name, name);
        put_text(&mut item.unit, unit);
        item
    }
}

/// Codes of a [`Response`].
pub mod response_code {
    /// Done, or scheduled for `from_seq`.
    pub const DONE: u32 = 0;
    /// Refused; `text` says why.
    pub const REFUSED: u32 = 1;
    /// Could not be done; `text` says why.
    pub const FAILED: u32 = 2;
}

message! {
    /// The answer to a [`Request`].
    pub struct Response = "ThetabusResponseV3" {
        /// See [`response_code`].
        code: u32, One, "", "0 done, 1 refused, 2 failed";
        items_len: u32, One, "", "Items in use";
        from_seq: u64, One, "", "First sample to which the command applies; 0 if not known";
        block: u64, One, "", "Block that begins there; 0 if not known";
        text: [u8; RESPONSE_TEXT], Text, "", "What was done, or why not";
        items: [Item; MAX_ITEMS], Item, "", "Items listed by `describe`";
    }
}

impl Response {
    /// An answer without items.
    pub fn new(code: u32, words: &str) -> Self {
        let mut response = Self {
            code,
            ..Self::default()
        };
        put_text(&mut response.text, words);
        response
    }

    /// The words.
    pub fn text(&self) -> &str {
        text_of(&self.text)
    }

    /// The items in use.
    pub fn items(&self) -> &[Item] {
        &self.items[..(self.items_len as usize).min(MAX_ITEMS)]
    }
}

message! {
    /// Topic `journal`: a command that took effect, with its border. A recording keeps these, so a
    /// replay repeats them.
    pub struct Journal = "ThetabusJournalV3" {
        stream_id: u64, One, "", "The sample stream; 0 before the first one";
        block: u64, One, "", "Number of the first block to which the command applies";
        request: Request, One, "", "The request; from_seq is the first sample to which it applies";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_commands_come_back_from_wire_and_name() {
        for (command, name) in Command::ALL {
            assert_eq!(Command::from_wire(command as u32), Some(command));
            assert_eq!(Command::from_name(name), Some(command));
            assert_eq!(command.name(), name);
        }
        assert_eq!((Command::from_wire(0), Command::from_wire(12)), (None, None));
        // the list in the clients' messages
        let plain: Vec<u32> = (1..=11)
            .filter(|c| Command::from_wire(*c).is_some_and(Command::is_plain))
            .collect();
        assert_eq!(plain, (1..=8).collect::<Vec<u32>>());
    }

    #[test]
    fn prop_a_payload_comes_back_from_its_request() {
        let body: [f64; PAYLOAD] = std::array::from_fn(|i| 0.1 * i as f64 - 0.3);
        assert_eq!(Request::payload(Some(&body)).payload_body(), Ok(Some(body)));
        assert_eq!(Request::payload(None).payload_body(), Ok(None));
        let mut cut = Request::payload(Some(&body));
        cut.data_len = 79;
        assert!(cut.payload_body().unwrap_err().to_string().contains("got 79"));
    }

    #[test]
    fn prop_a_state_comes_back_from_its_parts_and_a_missing_part_is_told() {
        let state: Vec<u8> = (0..3000u32).map(|i| i as u8).collect();
        let requests = Request::restore(&state).unwrap();
        assert_eq!(requests.len(), 3);
        let mut parts = Parts::default();
        let taken: Vec<_> = requests.iter().map(|r| parts.take(r).unwrap()).collect();
        assert_eq!(taken, [None, None, Some(state)]);
        assert!(parts.take(&requests[1]).unwrap_err().to_string().contains("part 0"));
        let mut mad = requests[0];
        mad.data_len = u32::MAX;
        assert!(parts.take(&mad).is_err());
    }
}
