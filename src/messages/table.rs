//! One table of fields per message, and the code generated from it.
//!
//! `message!` takes the table: name, type, what an array runs over, unit, meaning. From it come the
//! `repr(C)` structure with its documentation, an empty value, the [`Layout`] that programs can
//! read at run time, and a walk through the values. Recordings take their schema from the walk; the
//! C header and the Python dtype are written from the layout.

/// What the index of a field's values means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Per {
    /// A single value, or a set.
    One,
    /// Joints of the machine, from 1.
    Joint,
    /// Equations of the model, from 1.
    Equation,
    /// Parameters of the model, in the order of θ.
    Parameter,
    /// Derived values, in the order of the description.
    Derived,
    /// Entries of a list whose length is in another field.
    Item,
    /// Bytes of a text: UTF-8, filled up with zeros.
    Text,
    /// Bytes of anything else.
    Byte,
    /// Zeros that bring the next field to its alignment.
    Padding,
}

/// Type of one value of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A byte.
    U8,
    /// Unsigned, 4 bytes.
    U32,
    /// Unsigned, 8 bytes.
    U64,
    /// IEEE 754 double precision, 8 bytes.
    F64,
    /// A structure with a table of its own.
    Struct(&'static Layout),
}

impl Kind {
    /// Size of one value \[bytes\].
    pub fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U32 => 4,
            Self::U64 | Self::F64 => 8,
            Self::Struct(layout) => layout.size,
        }
    }
}

/// A field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name, the same in every language.
    pub name: &'static str,
    /// Type of one value.
    pub kind: Kind,
    /// Number of values; 1 unless the field is an array.
    pub len: usize,
    /// Whether the field is an array, even of one value.
    pub is_array: bool,
    /// What the index of the values means.
    pub per: Per,
    /// SI unit; empty for none. In braces if the [`Description`](super::Description) has it:
    /// `{position}`, `{input}`, `{parameter}`, `{derived}`.
    pub unit: &'static str,
    /// What it is, in a few words.
    pub meaning: &'static str,
    /// Place in the message \[bytes\].
    pub offset: usize,
}

/// The fields of a message, in the order of their places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name of the structure.
    pub name: &'static str,
    /// Name of the type on the bus, with the schema version; empty for structures that only files
    /// contain.
    pub type_name: &'static str,
    /// Size \[bytes\].
    pub size: usize,
    /// The fields.
    pub fields: &'static [Field],
}

/// A structure that is given by a table of fields.
pub trait Message: Copy + 'static {
    /// All zeros, to be filled.
    const EMPTY: Self;
    /// The table.
    const LAYOUT: &'static Layout;

    /// Passes every field to `visitor`, in order; those of a nested structure between
    /// [`enter`](Visit::enter) and [`leave`](Visit::leave).
    ///
    /// # Errors
    /// The visitor's.
    fn visit<V: Visit>(&mut self, visitor: &mut V) -> Result<(), V::Error>;
}

/// Takes the values of a message one field after another, and may change them.
pub trait Visit {
    /// Ends the walk.
    type Error;
    /// A text, bytes, or padding.
    ///
    /// # Errors
    /// Ends the walk.
    fn u8s(&mut self, field: &Field, values: &mut [u8]) -> Result<(), Self::Error>;
    /// One or more values.
    ///
    /// # Errors
    /// Ends the walk.
    fn u32s(&mut self, field: &Field, values: &mut [u32]) -> Result<(), Self::Error>;
    /// One or more values, or the words of a set.
    ///
    /// # Errors
    /// Ends the walk.
    fn u64s(&mut self, field: &Field, values: &mut [u64]) -> Result<(), Self::Error>;
    /// One or more values.
    ///
    /// # Errors
    /// Ends the walk.
    fn f64s(&mut self, field: &Field, values: &mut [f64]) -> Result<(), Self::Error>;
    /// Begins with a structure, number `index` of the field.
    fn enter(&mut self, _field: &Field, _index: usize) {}
    /// Ends it.
    fn leave(&mut self) {}
}

/// A type that an array can have.
pub trait Element: Copy {
    /// Zero.
    const ZERO: Self;
    /// Its type.
    const KIND: Kind;
    /// Passes the values of one field to the visitor.
    ///
    /// # Errors
    /// The visitor's.
    fn visit_all<V: Visit>(values: &mut [Self], field: &Field, visitor: &mut V) -> Result<(), V::Error>;
}

/// A type that a field can have.
pub trait Value: Copy {
    /// Zeros.
    const ZERO: Self;
    /// Type of one of its values.
    const KIND: Kind;
    /// Number of its values.
    const LEN: usize;
    /// Whether it is an array.
    const IS_ARRAY: bool;
    /// Passes the values to the visitor.
    ///
    /// # Errors
    /// The visitor's.
    fn visit_value<V: Visit>(&mut self, field: &Field, visitor: &mut V) -> Result<(), V::Error>;
}

macro_rules! number {
    ($number:ty, $zero:literal, $kind:ident, $visit:ident) => {
        impl Element for $number {
            const ZERO: Self = $zero;
            const KIND: Kind = Kind::$kind;
            fn visit_all<V: Visit>(values: &mut [Self], field: &Field, visitor: &mut V) -> Result<(), V::Error> {
                visitor.$visit(field, values)
            }
        }
    };
}

number!(u8, 0, U8, u8s);
number!(u32, 0, U32, u32s);
number!(u64, 0, U64, u64s);
number!(f64, 0.0, F64, f64s);

impl<M: Message> Element for M {
    const ZERO: Self = M::EMPTY;
    const KIND: Kind = Kind::Struct(M::LAYOUT);
    fn visit_all<V: Visit>(values: &mut [Self], field: &Field, visitor: &mut V) -> Result<(), V::Error> {
        for (index, value) in values.iter_mut().enumerate() {
            visitor.enter(field, index);
            value.visit(visitor)?;
            visitor.leave();
        }
        Ok(())
    }
}

impl<T: Element> Value for T {
    const ZERO: Self = T::ZERO;
    const KIND: Kind = T::KIND;
    const LEN: usize = 1;
    const IS_ARRAY: bool = false;
    fn visit_value<V: Visit>(&mut self, field: &Field, visitor: &mut V) -> Result<(), V::Error> {
        T::visit_all(std::slice::from_mut(self), field, visitor)
    }
}

impl<T: Element, const N: usize> Value for [T; N] {
    const ZERO: Self = [T::ZERO; N];
    const KIND: Kind = T::KIND;
    const LEN: usize = N;
    const IS_ARRAY: bool = true;
    fn visit_value<V: Visit>(&mut self, field: &Field, visitor: &mut V) -> Result<(), V::Error> {
        T::visit_all(self, field, visitor)
    }
}

/// The sentence of documentation of a field.
macro_rules! sentence {
    ("", $meaning:tt) => {
        concat!($meaning, ".")
    };
    ($unit:tt, $meaning:tt) => {
        concat!($meaning, " \\[", $unit, "\\].")
    };
}

/// The name on the bus, if there is one.
macro_rules! name_on_bus {
    () => {
        ""
    };
    ($name:tt) => {
        $name
    };
}

/// A message from its table: `name: type, what it runs over, unit, meaning;`, one line per field.
macro_rules! message {
    (
        $(#[$outer:meta])*
        $vis:vis struct $name:ident $(= $type_name:tt)? {
            $( $(#[$more:meta])* $field:ident : $kind:ty, $per:ident, $unit:tt, $meaning:tt; )+
        }
    ) => {
        $(#[$outer])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq)]
        $(#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name($type_name))])?
        $vis struct $name {
            $( #[doc = $crate::messages::table::sentence!($unit, $meaning)] $(#[$more])* pub $field: $kind, )+
        }

        impl $crate::messages::table::Message for $name {
            const EMPTY: Self = Self { $( $field: <$kind as $crate::messages::table::Value>::ZERO, )+ };
            const LAYOUT: &'static $crate::messages::table::Layout = &$crate::messages::table::Layout {
                name: stringify!($name),
                type_name: $crate::messages::table::name_on_bus!($($type_name)?),
                size: size_of::<Self>(),
                fields: &[$( $crate::messages::table::Field {
                    name: stringify!($field),
                    kind: <$kind as $crate::messages::table::Value>::KIND,
                    len: <$kind as $crate::messages::table::Value>::LEN,
                    is_array: <$kind as $crate::messages::table::Value>::IS_ARRAY,
                    per: $crate::messages::table::Per::$per,
                    unit: $unit,
                    meaning: $meaning,
                    offset: std::mem::offset_of!(Self, $field),
                }, )+],
            };

            fn visit<V: $crate::messages::table::Visit>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
                let mut fields = Self::LAYOUT.fields.iter();
                $( if let Some(field) = fields.next() {
                    $crate::messages::table::Value::visit_value(&mut self.$field, field, visitor)?;
                } )+
                Ok(())
            }
        }

        impl $name {
            /// All zeros, to be filled.
            $vis const EMPTY: Self = <Self as $crate::messages::table::Message>::EMPTY;
        }

        impl Default for $name {
            /// All zeros.
            fn default() -> Self {
                <Self as $crate::messages::table::Message>::EMPTY
            }
        }
    };
}

pub(crate) use {message, name_on_bus, sentence};
