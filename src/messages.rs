//! The bus payloads: fixed size, `repr(C)`, explicit padding, one schema version.
//!
//! Samples are translated to and from core types here, the estimator's report to an estimate in
//! `node/estimate_message.rs`. Deriving `ZeroCopySend` is the only use of iceoryx2 outside `bus/`,
//! because a trait must be derived where the type is declared.
//!
//! Each message is one [table of fields](Layout); the structure, its empty value, the schema of
//! recordings and the layouts for other languages follow from it.
//!
//! Bit-identity of two runs covers every field except `stream_id`.

mod control;
mod description;
mod estimate;
mod machine_command;
mod parameter_set;
mod passage;
mod sample;
mod status;
pub(crate) mod table;
mod text;
mod usable;

pub use control::{
    Command, DATA, Item, Journal, MAX_ITEMS, MAX_PARTS, NAME, Parts, RESPONSE_TEXT, Request, RequestError, Response,
    UNIT, item_kind, request_flags, response_code, stream_tag,
};

pub use description::{DerivedInfo, Description, JointInfo, MEANING, ParameterInfo};
pub use estimate::{Estimate, State};
pub use machine_command::MachineCommand;
pub use parameter_set::ParameterSet;
pub use passage::Passage;
pub(crate) use sample::nanoseconds;
pub use sample::{Header, SIGNALS, Sample, Signal};
pub use status::{
    ERROR_TEXT, ErrorCode, LastError, ProcessStatus, RealtimeStatus, Status, StreamFaults, Timing, status_flags,
};
pub use table::{Field, Kind, Layout, Message, Per, Visit};
pub(crate) use text::FixedText;
pub use text::{put_text, text_of};
pub use usable::{ParameterNames, Usable};

/// Version of all payloads below; part of each type name and of the user header.
pub const SCHEMA_VERSION: u32 = 3;
/// The most derived values that an estimate can carry.
pub const MAX_DERIVED: usize = 32;

/// Flags of a [`Header`].
pub mod header_flags {
    /// The message was sent before: a reader that already has it drops it.
    pub const RESENT: u32 = 1 << 0;
}

/// Flags of a [`Sample`].
pub mod sample_flags {
    /// The last sample of a stream.
    pub const END: u32 = 1 << 0;
    /// A sample of a replay: what is learnt from it is discarded when the stream ends.
    pub const REPLAY: u32 = 1 << 1;
}

/// Bits of [`Sample::signals`]: which of its arrays hold data.
pub mod signals {
    /// q is valid.
    pub const Q: u32 = 1 << 0;
    /// q̇ is valid.
    pub const DQ: u32 = 1 << 1;
    /// q̈ is valid.
    pub const DDQ: u32 = 1 << 2;
    /// q⃛ is valid.
    pub const DDDQ: u32 = 1 << 3;
    /// The setpoint is valid.
    pub const SETPOINT: u32 = 1 << 4;
    /// The input is valid.
    pub const INPUT: u32 = 1 << 5;
    /// All of them.
    pub const ALL: u32 = (1 << 6) - 1;
}

/// Flags of an [`Estimate`].
pub mod estimate_flags {
    /// A change of the parameters was found in this block, at `t_change_ns`.
    pub const CHANGED: u32 = 1 << 0;
    /// Samples of this block are missing or were rejected.
    pub const INCOMPLETE: u32 = 1 << 1;
    /// The update could not be made; θ̂ is the previous one.
    pub const HELD: u32 = 1 << 2;
    /// The estimator continued from a checkpoint.
    pub const WARM: u32 = 1 << 3;
    /// The first estimate since a command took effect.
    pub const COMMANDED: u32 = 1 << 4;
    /// A signal of this block was saturated or frozen; it was left out, and θ̂ is the previous one.
    pub const SENSOR: u32 = 1 << 5;
}

/// The layouts of everything that the bus carries, in the order of the documentation.
pub fn layouts() -> [&'static Layout; 11] {
    [
        Header::LAYOUT,
        Sample::LAYOUT,
        Estimate::LAYOUT,
        Status::LAYOUT,
        Description::LAYOUT,
        MachineCommand::LAYOUT,
        Request::LAYOUT,
        Response::LAYOUT,
        Journal::LAYOUT,
        Item::LAYOUT,
        LastError::LAYOUT,
    ]
}

// Sizes are a contract with readers in other languages: a change here is a new schema version.
const _: () = {
    assert!(size_of::<Header>() == 16);
    assert!(size_of::<Sample>() == 424);
    assert!(size_of::<Estimate>() == 2992);
    assert!(size_of::<Status>() == 504);
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Fields follow each other without a gap, nested ones included.
    fn check(layout: &Layout) {
        let mut end = 0;
        for field in layout.fields {
            assert_eq!(
                field.offset, end,
                "{}.{}: implicit padding before it",
                layout.name, field.name
            );
            assert_eq!(
                field.per == Per::Padding,
                field.name.starts_with("pad"),
                "{}.{}",
                layout.name,
                field.name
            );
            assert!(
                !field.meaning.is_empty() && !field.meaning.ends_with('.'),
                "{}.{}",
                layout.name,
                field.name
            );
            if let Kind::Struct(inner) = field.kind {
                check(inner);
                assert!(
                    inner.type_name.is_empty() == layout.type_name.is_empty(),
                    "{}",
                    inner.name
                );
            }
            end += field.kind.size() * field.len;
        }
        assert_eq!(layout.size, end, "{}: implicit padding at its end", layout.name);
        let version = format!("V{SCHEMA_VERSION}");
        assert!(
            layout.type_name.ends_with(&version),
            "{}: the type name lacks {version}",
            layout.name
        );
    }

    #[test]
    fn prop_no_message_has_implicit_padding_and_each_name_has_the_version() {
        layouts().into_iter().for_each(check);
    }

    /// Adds up what the walk shows.
    #[derive(Default)]
    struct Count {
        bytes: usize,
        depth: usize,
        names: Vec<String>,
    }

    impl Visit for Count {
        type Error = std::convert::Infallible;
        fn u8s(&mut self, field: &Field, values: &mut [u8]) -> Result<(), Self::Error> {
            self.add(field, size_of_val(values))
        }
        fn u32s(&mut self, field: &Field, values: &mut [u32]) -> Result<(), Self::Error> {
            values.fill(1);
            self.add(field, size_of_val(values))
        }
        fn u64s(&mut self, field: &Field, values: &mut [u64]) -> Result<(), Self::Error> {
            self.add(field, size_of_val(values))
        }
        fn f64s(&mut self, field: &Field, values: &mut [f64]) -> Result<(), Self::Error> {
            self.add(field, size_of_val(values))
        }
        fn enter(&mut self, _: &Field, _: usize) {
            self.depth += 1;
        }
        fn leave(&mut self) {
            self.depth -= 1;
        }
    }

    impl Count {
        fn add(&mut self, field: &Field, bytes: usize) -> Result<(), std::convert::Infallible> {
            self.bytes += bytes;
            if self.depth == 0 {
                self.names.push(field.name.to_owned());
            }
            Ok(())
        }
    }

    fn walked<M: Message>() {
        let mut count = Count::default();
        let mut message = M::EMPTY;
        let Ok(()) = message.visit(&mut count);
        assert_eq!((count.bytes, count.depth), (size_of::<M>(), 0), "{}", M::LAYOUT.name);
        let plain = M::LAYOUT
            .fields
            .iter()
            .filter(|field| !matches!(field.kind, Kind::Struct(_)));
        assert!(
            plain.map(|field| field.name).eq(count.names.iter()),
            "{}",
            M::LAYOUT.name
        );
    }

    #[test]
    fn prop_the_walk_shows_every_byte_of_a_message_and_may_change_it() {
        walked::<Header>();
        walked::<Sample>();
        walked::<Estimate>();
        walked::<Status>();
        walked::<Description>();
        walked::<MachineCommand>();
        walked::<Response>();
        walked::<Journal>();
        let mut sample = Sample::EMPTY;
        let Ok(()) = sample.visit(&mut Count::default());
        assert_eq!((sample.flags, sample.joints, sample.signals), (1, 1, 1));
    }
}
