//! The last rows and their sums, kept separate from the estimate until it is clear that the machine
//! has not changed.

use super::rows::WeakRow;
use super::sums::JointSums;
use crate::model::MAX_JOINTS;

/// The rows of one window.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Instant {
    /// Middle of the window \[s\].
    pub t_s: f64,
    /// Mean torques; `NaN` for a joint without a row.
    pub torque: [f64; MAX_JOINTS],
}

/// The last windows with their rows, in a ring of fixed size.
#[derive(Debug, Clone)]
pub(super) struct RowRing {
    instants: Vec<Instant>,
    regressors: Vec<f64>,
    /// Offset of each joint's regressor within an instant.
    offsets: Vec<usize>,
    entries: usize,
    next: usize,
    len: usize,
}

impl RowRing {
    /// Workspace for `windows` windows of joints with these numbers of columns.
    pub fn new(windows: usize, columns: &[usize]) -> Self {
        let mut offsets = Vec::with_capacity(columns.len());
        let mut entries = 0;
        for count in columns {
            offsets.push(entries);
            entries += count;
        }
        Self {
            instants: vec![Instant::default(); windows],
            regressors: vec![0.0; windows * entries],
            offsets,
            entries,
            next: 0,
            len: 0,
        }
    }

    pub fn clear(&mut self) {
        (self.next, self.len) = (0, 0);
    }

    /// Adds a row; rows of one window must come consecutively.
    pub fn add(&mut self, row: &WeakRow<'_>) {
        let room = self.instants.len();
        if room == 0 {
            return;
        }
        let last = (self.next + room - 1) % room;
        let at = if self.len > 0 && self.instants[last].t_s == row.t_s {
            last
        } else {
            let at = self.next;
            self.instants[at] = Instant {
                t_s: row.t_s,
                torque: [f64::NAN; MAX_JOINTS],
            };
            self.next = (at + 1) % room;
            self.len = (self.len + 1).min(room);
            at
        };
        self.instants[at].torque[row.joint] = row.torque;
        let begin = at * self.entries + self.offsets[row.joint];
        self.regressors[begin..begin + row.regressor.len()].copy_from_slice(row.regressor);
    }

    pub fn len(&self) -> usize {
        self.len
    }

    /// Instant `age` from the oldest, with its index for [`regressor`](Self::regressor).
    pub fn get(&self, age: usize) -> (usize, &Instant) {
        let room = self.instants.len();
        let at = (self.next + room - self.len + age) % room;
        (at, &self.instants[at])
    }

    /// The regressor of a joint at the instant with this index; `len` is its number of columns.
    pub fn regressor(&self, at: usize, joint: usize, len: usize) -> &[f64] {
        let begin = at * self.entries + self.offsets[joint];
        &self.regressors[begin..begin + len]
    }
}

/// The sums over an interval of time.
#[derive(Debug, Clone)]
pub(super) struct Slice {
    /// Of each joint.
    pub sums: Vec<JointSums>,
    /// Middle of the first window in it \[s\].
    pub begin_s: f64,
}

/// The last slices, in a ring of fixed size.
#[derive(Debug, Clone)]
pub(super) struct SliceRing {
    slices: Vec<Slice>,
    next: usize,
    len: usize,
}

impl SliceRing {
    pub fn new(slices: usize, empty: &[JointSums]) -> Self {
        let slice = Slice {
            sums: empty.to_vec(),
            begin_s: 0.0,
        };
        Self {
            slices: vec![slice; slices],
            next: 0,
            len: 0,
        }
    }

    pub fn clear(&mut self) {
        (self.next, self.len) = (0, 0);
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_full(&self) -> bool {
        self.len == self.slices.len()
    }

    /// Slice `age` from the oldest.
    pub fn get(&self, age: usize) -> &Slice {
        let room = self.slices.len();
        &self.slices[(self.next + room - self.len + age) % room]
    }

    /// Writes the sums of the first `slices` slices and `before` to `into`.
    pub fn add_to(&self, slices: usize, before: &[JointSums], into: &mut [JointSums]) {
        for (into, before) in into.iter_mut().zip(before) {
            into.copy_from(before);
        }
        for age in 0..slices {
            for (into, slice) in into.iter_mut().zip(&self.get(age).sums) {
                into.add(slice);
            }
        }
    }

    /// Removes the oldest slice; its sums stay readable until the next [`push`](Self::push).
    pub fn pop(&mut self) -> Option<&Slice> {
        self.len = self.len.checked_sub(1)?;
        let room = self.slices.len();
        Some(&self.slices[(self.next + room - self.len - 1) % room])
    }

    /// Drops the newest slices; a ring without capacity, used if no payload is estimated, has none.
    pub fn drop_newest(&mut self, count: usize) {
        let room = self.slices.len();
        let count = count.min(self.len);
        if count == 0 {
            return;
        }
        self.next = (self.next + room - count) % room;
        self.len -= count;
    }

    /// Replaces the sums of the newest slice.
    pub fn replace_newest(&mut self, sums: Vec<JointSums>) {
        let room = self.slices.len();
        self.slices[(self.next + room - 1) % room].sums = sums;
    }

    /// Adds an empty slice, in place of the oldest if the ring is full.
    pub fn push(&mut self, begin_s: f64) -> &mut Slice {
        let room = self.slices.len();
        let at = self.next;
        self.next = (at + 1) % room;
        self.len = (self.len + 1).min(room);
        self.slices[at].begin_s = begin_s;
        &mut self.slices[at]
    }
}
