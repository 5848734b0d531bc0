//! Sets of parameters, equations and groups.

use super::MAX_PARAMS;
use super::persist::Visit;
use std::fmt;

/// A set of parameters, equations or groups, by their index from 0 to 127.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct IndexSet(u128);

impl IndexSet {
    /// Nothing.
    pub const EMPTY: Self = Self(0);

    /// Whether `index` is in it; false for an index beyond 127.
    pub fn contains(self, index: usize) -> bool {
        index < MAX_PARAMS && self.0 >> index & 1 == 1
    }

    /// Puts `index` in; an index beyond 127 is ignored.
    pub fn insert(&mut self, index: usize) {
        if index < MAX_PARAMS {
            self.0 |= 1 << index;
        }
    }

    /// Takes `index` out.
    pub fn remove(&mut self, index: usize) {
        *self = self.difference([index].into_iter().collect());
    }

    /// True if nothing is in it.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// How many are in it.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// The indices in it, from the lowest.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..MAX_PARAMS).filter(move |&index| self.contains(index))
    }

    /// What is in this set or in the other.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// What is in both sets.
    pub fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// What is in this set and not in the other.
    pub fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// State kept from block to block, a bit for each index below 64.
    pub(super) fn visit(&mut self, v: &mut impl Visit) {
        let mut bits = self.0 as u64;
        v.count(&mut bits);
        self.0 = bits.into();
    }
}

impl FromIterator<usize> for IndexSet {
    fn from_iter<I: IntoIterator<Item = usize>>(indices: I) -> Self {
        let mut set = Self::EMPTY;
        indices.into_iter().for_each(|index| set.insert(index));
        set
    }
}

impl fmt::Debug for IndexSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_set_holds_what_was_put_in_and_combines_with_another() {
        let mut set: IndexSet = [0, 63, 64, 127, 128, usize::MAX].into_iter().collect();
        assert!(set.iter().eq([0, 63, 64, 127]) && set.len() == 4);
        assert!(!set.contains(1) && !set.contains(128) && !set.contains(usize::MAX));
        let other = (62..65).collect();
        assert!(set.union(other).iter().eq([0, 62, 63, 64, 127]));
        assert!(set.intersection(other).iter().eq([63, 64]));
        assert!(set.difference(other).iter().eq([0, 127]));
        assert_eq!(format!("{set:?}"), "{0, 63, 64, 127}");
        set.remove(usize::MAX);
        set.iter().for_each(|index| set.remove(index));
        assert!(set.is_empty());
    }
}
