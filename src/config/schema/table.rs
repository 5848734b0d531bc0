//! The macro that describes each key once, and the ranges shared by many keys.

use super::super::choice::Choice;
use super::super::kind::{Interval, Kind, Len};
use serde::{Deserialize, Serialize};

/// Whether a field may be left out.
pub(super) trait Field {
    const OPTIONAL: bool = false;
}
impl Field for bool {}
impl Field for u64 {}
impl Field for f64 {}
impl Field for String {}
impl<C: Choice> Field for C {}
impl<C: Choice> Field for RealOr<C> {}
impl<T: Field> Field for Vec<T> {}
impl<T: Field> Field for Option<T> {
    const OPTIONAL: bool = true;
}

/// A number, or a word instead.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RealOr<C> {
    /// A number.
    Real(f64),
    /// A word.
    Word(C),
}

/// A structure with a field for each key, and `keys` with their descriptions. A key is described
/// only here: name, type, default, kind of value, unit, meaning. A key whose type is an `Option`
/// may be left out. `where` names the preset with the defaults; without defaults a table has no
/// `Default`.
macro_rules! table {
    ($(#[$about:meta])* $struct:ident $(where $preset:pat = $from:expr;)? {
        $( $name:ident : $type:ty = $default:expr, $kind:expr, $unit:literal, $meaning:literal; )*
    }) => {
        $crate::config::schema::table::table! {
            $(#[$about])* $struct { $( $name: $type, $kind, $unit, $meaning; )* }
        }

        impl Default for $struct {
            fn default() -> Self {
                $( let $preset = $from; )?
                Self { $( $name: $default, )* }
            }
        }
    };
    ($(#[$about:meta])* $struct:ident { $( $name:ident : $type:ty, $kind:expr, $unit:literal, $meaning:literal; )* }) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $struct {
            $( #[doc = $meaning] pub $name: $type, )*
        }

        impl $struct {
            const COUNT: usize = [$( stringify!($name) ),*].len();

            /// The keys of a section of this name.
            pub(super) const fn keys(section: &'static str) -> [$crate::config::Key; Self::COUNT] {
                [ $( $crate::config::Key {
                    section,
                    name: stringify!($name),
                    kind: $kind,
                    unit: $unit,
                    meaning: $meaning,
                    optional: <$type as $crate::config::schema::table::Field>::OPTIONAL,
                }, )* ]
            }
        }
    };
}
pub(super) use table;

/// The structure of a file with a field for each section, and the list of its sections.
macro_rules! sections {
    ($(#[$about:meta])* $form:ident, $seen:vis $list:ident;
        $( $field:ident : $struct:ident = $section:literal, $meaning:literal; )*) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $form {
            $(
                #[doc = $meaning]
                #[serde(rename = $section)]
                pub $field: $struct,
            )*
        }

        $seen static $list: &[$crate::config::kind::Section] = &[ $( $crate::config::kind::Section {
            name: $section,
            meaning: $meaning,
            keys: &$struct::keys($section),
        }, )* ];
    };
}
pub(super) use sections;

pub(super) const FINITE: Interval = Interval::ANY;
pub(super) const POSITIVE: Interval = Interval::POSITIVE;
pub(super) const NOT_NEGATIVE: Interval = Interval::NOT_NEGATIVE;
/// Longest time of a key: about thirty years.
pub(super) const LONGEST_S: f64 = 1e9;
/// Any sensible number of entries.
pub(super) const LIST: Len = Len::From(1, 100_000);

/// One of the words of a choice.
pub(super) const fn choice<C: Choice>() -> Kind {
    Kind::Choice(C::WORDS)
}

/// A number, or the word of a choice that has one.
pub(super) const fn real_or<C: Choice>(interval: Interval) -> Kind {
    Kind::RealOr(interval, C::WORDS[0])
}

/// A number per joint.
pub(super) const fn joints(interval: Interval) -> Kind {
    Kind::Reals(Len::Joints, interval)
}

/// A number per parameter, or none.
pub(super) const fn parameters(interval: Interval) -> Kind {
    Kind::Reals(Len::Parameters, interval)
}

/// A number per joint of the model, or none.
pub(super) const fn model_joints(interval: Interval) -> Kind {
    Kind::Reals(Len::ModelJoints, interval)
}

/// A number per equation, or none.
pub(super) const fn equations(interval: Interval) -> Kind {
    Kind::Reals(Len::Equations, interval)
}
