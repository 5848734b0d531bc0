//! A set of parameters, as messages carry it.

use super::table::{Field, Kind, Value, Visit};
use crate::model::MAX_PARAMS;
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

/// Words of 64 parameters each.
const WORDS: usize = MAX_PARAMS / 64;

/// A set of parameters, by their index from 0: bit i mod 64 of word i div 64.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusParameterSetV3"))]
pub struct ParameterSet {
    words: [u64; WORDS],
}

impl ParameterSet {
    /// No parameter.
    pub const EMPTY: Self = Self { words: [0; WORDS] };

    /// The set with parameter i for each bit i.
    pub const fn from_bits(bits: u128) -> Self {
        Self {
            words: [bits as u64, (bits >> 64) as u64],
        }
    }

    /// Bit i for each parameter i.
    pub const fn bits(self) -> u128 {
        self.words[0] as u128 | (self.words[1] as u128) << 64
    }

    /// Whether parameter `index` is in it; false for an index beyond [`MAX_PARAMS`].
    pub fn contains(&self, index: usize) -> bool {
        index < MAX_PARAMS && self.words[index / 64] >> (index % 64) & 1 == 1
    }

    /// Puts parameter `index` in; an index beyond [`MAX_PARAMS`] is ignored.
    pub fn insert(&mut self, index: usize) {
        if index < MAX_PARAMS {
            self.words[index / 64] |= 1 << (index % 64);
        }
    }

    /// True if no parameter is in it.
    pub fn is_empty(&self) -> bool {
        self.words == [0; WORDS]
    }

    /// How many parameters are in it.
    pub fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// The indices in it, from the lowest.
    pub fn iter(&self) -> impl Iterator<Item = usize> + use<> {
        let set = *self;
        (0..MAX_PARAMS).filter(move |&index| set.contains(index))
    }
}

impl FromIterator<usize> for ParameterSet {
    fn from_iter<I: IntoIterator<Item = usize>>(indices: I) -> Self {
        let mut set = Self::EMPTY;
        indices.into_iter().for_each(|index| set.insert(index));
        set
    }
}

impl fmt::Debug for ParameterSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

impl Value for ParameterSet {
    const ZERO: Self = Self::EMPTY;
    const KIND: Kind = Kind::U64;
    const LEN: usize = WORDS;
    const IS_ARRAY: bool = true;
    fn visit_value<V: Visit>(&mut self, field: &Field, visitor: &mut V) -> Result<(), V::Error> {
        visitor.u64s(field, &mut self.words)
    }
}

const _: () = assert!(WORDS == 2, "from_bits and bits know two words");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_set_holds_what_was_put_in_over_both_words() {
        let mut set = ParameterSet::default();
        assert!(set.is_empty());
        for index in [0, 63, 64, MAX_PARAMS - 1, MAX_PARAMS, usize::MAX] {
            set.insert(index);
        }
        assert_eq!(set.iter().collect::<Vec<_>>(), [0, 63, 64, 127]);
        assert_eq!((set.len(), set.bits()), (4, 1 | 1 << 63 | 1 << 64 | 1 << 127));
        assert_eq!(ParameterSet::from_bits(set.bits()), set);
        assert_eq!(set.iter().collect::<ParameterSet>(), set);
        assert!(!set.contains(1) && !set.contains(MAX_PARAMS) && !set.contains(usize::MAX));
        assert_eq!(format!("{set:?}"), "{0, 63, 64, 127}");
    }
}
