//! Service `control` and topic `journal`: what an identifier is told, and what became of it.

use super::text::{put_text, text_of};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;
use std::mem::{offset_of, size_of};

/// Bytes of a name in a [`Request`].
pub const NAME: usize = 64;
/// Bytes of a unit in an [`Item`].
pub const UNIT: usize = 32;
/// Bytes of the text of a [`Response`].
pub const RESPONSE_TEXT: usize = 256;
/// Bytes of a state that one [`Request`] or [`Journal`] holds.
pub const DATA: usize = 1024;
/// Most parts of a state.
pub const MAX_PARTS: u32 = 1024;
/// Most items that a [`Response`] describes: 64 parameters, tunables, positions and inputs.
pub const MAX_ITEMS: usize = 96;

/// What an identifier can be told.
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
    /// Tell names, units, bounds, tunables.
    Describe = 8,
    /// Go on from a state, in parts of [`DATA`] bytes: what a warm start does, for replays.
    Restore = 9,
    /// A recorder tells how many samples it lost.
    Recorder = 10,
}

impl Command {
    const ALL: [(Self, &'static str); 10] = [
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
    ];

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
    /// `value` holds.
    pub const VALUE: u32 = 1 << 0;
}

/// What a [`Request`] knows a stream by; never 0. Two of some 10⁵ streams would have to meet for two tags to agree by chance.
pub fn stream_tag(boot_id: u64) -> u32 {
    ((boot_id ^ (boot_id >> 32)) as u32).max(1)
}

/// A request of service `control`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusRequestV2"))]
pub struct Request {
    /// [`Command`].
    pub command: u32,
    /// [`request_flags`].
    pub flags: u32,
    /// Not before this sample of the stream; 0: at the next border between two blocks.
    pub from_seq: u64,
    /// Value of a tunable or parameter, in its unit; lost samples of a recorder.
    pub value: f64,
    /// Tunable or parameter, UTF-8, filled up with zeros.
    pub name: [u8; NAME],
    /// Number of this part of a state, from 0.
    pub part: u32,
    /// Parts of the state.
    pub parts: u32,
    /// Bytes of the state in this part.
    pub data_len: u32,
    /// [`stream_tag`] of the only stream that this is for: it waits for that stream, and what it did is undone when another one
    /// begins. 0: for whichever is open, and to stay.
    pub stream: u32,
    /// The part.
    pub data: [u8; DATA],
}

impl Request {
    /// A request without name and value.
    pub fn new(command: Command) -> Self {
        Self {
            command: command as u32,
            flags: 0,
            from_seq: 0,
            value: 0.0,
            name: [0; NAME],
            part: 0,
            parts: 0,
            data_len: 0,
            stream: 0,
            data: [0; DATA],
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

    /// The name.
    pub fn name(&self) -> &str {
        text_of(&self.name)
    }

    /// The value, where there is one.
    pub fn value(&self) -> Option<f64> {
        (self.flags & request_flags::VALUE != 0).then_some(self.value)
    }

    /// Requests that together carry a state; `None` where it is too long.
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

/// Puts the parts of a state together again.
#[derive(Debug, Clone, Default)]
pub struct Parts {
    bytes: Vec<u8>,
    next: u32,
}

impl Parts {
    /// Takes the next part; gives the state with the last one, an error where a part is missing or out of its range.
    pub fn take(&mut self, part: &Request) -> Result<Option<Vec<u8>>, String> {
        if part.part == 0 {
            *self = Self::default();
        }
        let len = part.data_len as usize;
        if part.part != self.next || part.part >= part.parts || part.parts > MAX_PARTS || len > DATA {
            let (next, got, of) = (self.next, part.part, part.parts);
            *self = Self::default();
            return Err(format!("expected part {next} of a state, got {got} of {of}"));
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
    /// A figure in force that the identifier chooses itself.
    pub const FIGURE: u32 = 5;
}

/// What `describe` tells of a parameter, a tunable or a signal.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusItemV2"))]
pub struct Item {
    /// [`item_kind`].
    pub kind: u32,
    /// Zero.
    pub pad: u32,
    /// Value of a tunable; start value of a parameter.
    pub value: f64,
    /// Lower bound, `-inf` for none.
    pub lower: f64,
    /// Upper bound, `inf` for none.
    pub upper: f64,
    /// Name.
    pub name: [u8; NAME],
    /// Unit.
    pub unit: [u8; UNIT],
}

impl Item {
    /// An item.
    pub fn new(kind: u32, name: &str, unit: &str, value: f64, (lower, upper): (f64, f64)) -> Self {
        let mut item = Self {
            kind,
            pad: 0,
            value,
            lower,
            upper,
            name: [0; NAME],
            unit: [0; UNIT],
        };
        put_text(&mut item.name, name);
        put_text(&mut item.unit, unit);
        item
    }
}

/// Codes of a [`Response`].
pub mod response_code {
    /// Done, or ordered for `from_seq`.
    pub const DONE: u32 = 0;
    /// Refused; `text` tells why.
    pub const REFUSED: u32 = 1;
    /// Could not be done; `text` tells why.
    pub const FAILED: u32 = 2;
}

/// The answer to a [`Request`].
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusResponseV2"))]
pub struct Response {
    /// [`response_code`].
    pub code: u32,
    /// Items in use.
    pub items_len: u32,
    /// First sample that the command holds for, as far as it is known.
    pub from_seq: u64,
    /// Block that begins there.
    pub block: u64,
    /// What was done, or why not.
    pub text: [u8; RESPONSE_TEXT],
    /// What `describe` tells.
    pub items: [Item; MAX_ITEMS],
}

impl Response {
    /// An answer without items.
    pub fn new(code: u32, words: &str) -> Self {
        let mut text = [0; RESPONSE_TEXT];
        put_text(&mut text, words);
        Self {
            code,
            items_len: 0,
            from_seq: 0,
            block: 0,
            text,
            items: [Item::new(0, "", "", 0.0, (0.0, 0.0)); MAX_ITEMS],
        }
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

/// Topic `journal`: a command that took effect, with the place where it did. A recording keeps them, so that a replay repeats them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusJournalV2"))]
pub struct Journal {
    /// The sample stream; 0 before the first one.
    pub boot_id: u64,
    /// Number of the block that begins at `request.from_seq`.
    pub block: u64,
    /// What was asked for; `from_seq` is the first sample that it holds for.
    pub request: Request,
}

// The layout is a contract with readers in other languages: a change here is a new schema version.
const _: () = {
    assert!(offset_of!(Request, name) == 24);
    assert!(offset_of!(Request, data) == 24 + NAME + 16);
    assert!(size_of::<Request>() == 40 + NAME + DATA);
    assert!(size_of::<Item>() == 32 + NAME + UNIT);
    assert!(offset_of!(Response, items) == 24 + RESPONSE_TEXT);
    assert!(size_of::<Response>() == 24 + RESPONSE_TEXT + MAX_ITEMS * size_of::<Item>());
    assert!(size_of::<Journal>() == 16 + size_of::<Request>());
};

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
        assert_eq!((Command::from_wire(0), Command::from_wire(11)), (None, None));
    }

    #[test]
    fn prop_a_state_comes_back_from_its_parts_and_a_missing_part_is_told() {
        let state: Vec<u8> = (0..3000u32).map(|i| i as u8).collect();
        let requests = Request::restore(&state).unwrap();
        assert_eq!(requests.len(), 3);
        let mut parts = Parts::default();
        let taken: Vec<_> = requests.iter().map(|r| parts.take(r).unwrap()).collect();
        assert_eq!(taken, [None, None, Some(state)]);
        assert!(parts.take(&requests[1]).unwrap_err().contains("part 0"));
        let mut mad = requests[0];
        mad.data_len = u32::MAX;
        assert!(parts.take(&mad).is_err());
    }
}
