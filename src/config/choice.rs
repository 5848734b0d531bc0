//! Keys with one of a few words: each is an enum, so the compiler checks every place that depends
//! on it.
//!
//! Words are defined in one place only, next to their variants. Choices that exist only in the
//! configuration are defined by [`choices!`]; those of core types are read and written by the core
//! types' names.

use crate::estimator::{Bound, Forgetting};
use crate::model::{DriveInput, Motion};
use crate::rows::InputTiming;
use crate::sim::{ControllerKind, FaultSignal, Interpolation, MoveProfile, PositionFeedback};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

/// A value that a file states as one of several words.
pub trait Choice: Copy + PartialEq + 'static {
    /// Every value with its word.
    const NAMES: &'static [(Self, &'static str)];
    /// The words, in the same order.
    const WORDS: &'static [&'static str];

    /// The word of this value.
    fn word(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(value, _)| *value == self);
        known.map_or("", |(_, word)| word)
    }
}

/// The words of a list of names.
pub(super) const fn words<T: Copy, const N: usize>(names: &[(T, &'static str); N]) -> [&'static str; N] {
    let mut words = [""; N];
    let mut i = 0;
    while i < N {
        words[i] = names[i].1;
        i += 1;
    }
    words
}

/// Enums that serde reads by the words beside their variants.
macro_rules! choices {
    ($( $(#[$about:meta])* $name:ident { $( $(#[$meaning:meta])* $variant:ident = $word:literal, )* } )*) => { $(
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $( $(#[$meaning])* #[serde(rename = $word)] $variant, )*
        }

        impl $crate::config::choice::Choice for $name {
            const NAMES: &'static [(Self, &'static str)] = &[ $( (Self::$variant, $word), )* ];
            const WORDS: &'static [&'static str] = &[ $( $word, )* ];
        }
    )* };
}
pub(super) use choices;

/// Each value of a type that has `ALL` and `name`, with its name.
macro_rules! named {
    ($name:ty) => {{
        let mut names = [(<$name>::ALL[0], ""); <$name>::ALL.len()];
        let mut i = 0;
        while i < names.len() {
            names[i] = (<$name>::ALL[i], <$name>::ALL[i].name());
            i += 1;
        }
        names
    }};
}

/// Choices of the core types, which do not use serde.
macro_rules! by_their_names {
    ($( $name:ty = $names:expr; )*) => { $(
        impl Choice for $name {
            const NAMES: &'static [(Self, &'static str)] = &$names;
            const WORDS: &'static [&'static str] = &words(&$names);
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.word())
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let word = String::deserialize(deserializer)?;
                let known = <Self as Choice>::NAMES.iter().find(|(_, known)| *known == word);
                known
                    .map(|(value, _)| *value)
                    .ok_or_else(|| D::Error::unknown_variant(&word, Self::WORDS))
            }
        }
    )* };
}

#[cfg(feature = "robot")]
by_their_names! {
    crate::robot::FrictionTerm = swapped(&crate::robot::FrictionTerm::NAMES);
}

/// Pairs of name and value the other way round.
#[cfg(feature = "robot")]
const fn swapped<T: Copy, const N: usize>(names: &[(&'static str, T); N]) -> [(T, &'static str); N] {
    let mut swapped = [(names[0].1, ""); N];
    let mut i = 0;
    while i < N {
        swapped[i] = (names[i].1, names[i].0);
        i += 1;
    }
    swapped
}

by_their_names! {
    Interpolation = Interpolation::NAMES;
    ControllerKind = ControllerKind::NAMES;
    PositionFeedback = PositionFeedback::NAMES;
    MoveProfile = MoveProfile::NAMES;
    FaultSignal = FaultSignal::NAMES;
    Motion = Motion::NAMES;
    DriveInput = DriveInput::NAMES;
    InputTiming = InputTiming::NAMES;
    Forgetting = named!(Forgetting);
    Bound = named!(Bound);
}
