//! The last rows and their sums, kept separate from the estimate until it is clear that the machine
//! has not changed.

use super::model::RobotModel;
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

    /// Time of the newest window \[s\].
    pub fn last_s(&self) -> Option<f64> {
        self.len.checked_sub(1).map(|last| self.get(last).1.t_s)
    }

    /// Sums of the rows for whose time `wanted` is true.
    pub fn sum_up(&self, model: &RobotModel, sums: &mut [JointSums], wanted: impl Fn(f64) -> bool) {
        sums.iter_mut().for_each(JointSums::clear);
        for age in 0..self.len {
            let (at, instant) = self.get(age);
            if !wanted(instant.t_s) {
                continue;
            }
            for (j, sums) in sums.iter_mut().enumerate() {
                if instant.torque[j].is_finite() {
                    let row = self.regressor(at, j, model.columns(j).len());
                    sums.add_row(row, instant.torque[j]);
                }
            }
        }
        sums.iter_mut().for_each(JointSums::mirror);
    }

    /// (3) of [`change`](super::change): the instant after `begin` at which residuals with `before`
    /// become larger than those with `behind`, both in units of `std`.
    pub fn locate(&self, model: &RobotModel, begin: f64, before: &[f64], behind: &[f64], std: &[f64]) -> f64 {
        let (mut cost, mut least, mut t_s) = (0.0, 0.0, begin);
        // The instant before it, if the best boundary so far lies after that one.
        let mut open: Option<f64> = None;
        for age in 0..self.len {
            let (at, instant) = self.get(age);
            if instant.t_s < begin {
                continue;
            }
            if let Some(last) = open.take() {
                t_s = 0.5 * (last + instant.t_s);
            }
            for (j, std) in std.iter().enumerate() {
                if !instant.torque[j].is_finite() {
                    continue;
                }
                let columns = model.columns(j);
                let row = self.regressor(at, j, columns.len());
                let residual = |theta: &[f64]| -> f64 {
                    let predicted: f64 = row.iter().zip(columns).map(|(x, &k)| x * theta[k]).sum();
                    (instant.torque[j] - predicted) / std
                };
                cost += residual(before).powi(2) - residual(behind).powi(2); // (3)
            }
            if cost < least {
                (least, open) = (cost, Some(instant.t_s));
            }
        }
        open.unwrap_or(t_s)
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

    /// Adds a slice, in place of the oldest if the ring is full. Its sums must be overwritten.
    pub fn push(&mut self, begin_s: f64) -> &mut Slice {
        let room = self.slices.len();
        let at = self.next;
        self.next = (at + 1) % room;
        self.len = (self.len + 1).min(room);
        self.slices[at].begin_s = begin_s;
        &mut self.slices[at]
    }
}

/// The last slices, which may still turn out to be of a changed machine, and the rows in them.
#[derive(Debug, Clone)]
pub(super) struct PendingRows {
    slices: SliceRing,
    rows: RowRing,
    /// Number of slices that belong to the open block.
    in_block: usize,
    /// Slices since the start.
    seen: usize,
}

impl PendingRows {
    /// For this many slices of sums such as `empty`, and the rows of this many windows.
    pub fn new(slices: usize, windows: usize, empty: &[JointSums]) -> Self {
        let columns: Vec<usize> = empty.iter().map(|sums| sums.columns().len()).collect();
        Self {
            slices: SliceRing::new(slices, empty),
            rows: RowRing::new(windows, &columns),
            in_block: 0,
            seen: 0,
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.clear();
        self.rows.clear();
        self.seen = 0;
    }

    /// Drops the slices; the rows stay.
    pub fn clear(&mut self) {
        self.slices.clear();
        self.in_block = 0;
    }

    /// Drops the slices and the rows.
    pub fn clear_recording(&mut self) {
        self.clear();
        self.rows.clear();
    }

    /// Drops the slices of the open block.
    pub fn drop_block(&mut self) {
        self.slices.drop_newest(self.in_block);
        self.in_block = 0;
    }

    /// The next slice begins a block.
    pub fn end_block(&mut self) {
        self.in_block = 0;
    }

    /// Drops the rows, because others were lost after them.
    pub fn end_rows(&mut self) {
        self.rows.clear();
        self.in_block = 0;
    }

    /// Slices since the start.
    pub fn seen(&self) -> usize {
        self.seen
    }

    /// Counts at least this many slices as seen.
    pub fn set_seen(&mut self, slices: usize) {
        self.seen = slices;
    }

    /// Number of slices.
    pub fn len(&self) -> usize {
        self.slices.len()
    }

    /// True if the next slice takes the place of the oldest.
    pub fn is_full(&self) -> bool {
        self.slices.is_full()
    }

    /// Slice `age` from the oldest.
    pub fn get(&self, age: usize) -> &Slice {
        self.slices.get(age)
    }

    /// Removes the oldest slice; its sums stay readable until the next is added.
    pub fn pop(&mut self) -> Option<&Slice> {
        self.slices.pop()
    }

    /// Adds a slice.
    pub fn push(&mut self, begin_s: f64, sums: &[JointSums]) {
        let slice = self.slices.push(begin_s);
        for (kept, sums) in slice.sums.iter_mut().zip(sums) {
            kept.copy_from(sums);
        }
        self.in_block += 1;
        self.seen += 1;
    }

    /// Adds the rows for whose time `wanted` is true as a slice of a changed machine: the only one
    /// of the open block.
    pub fn push_rows(&mut self, begin_s: f64, model: &RobotModel, wanted: impl Fn(f64) -> bool) -> &Slice {
        let slice = self.slices.push(begin_s);
        self.rows.sum_up(model, &mut slice.sums, wanted);
        self.in_block = 1;
        slice
    }

    /// Writes the sums of the first `slices` slices and `before` to `into`.
    pub fn add_to(&self, slices: usize, before: &[JointSums], into: &mut [JointSums]) {
        self.slices.add_to(slices, before, into);
    }

    /// Adds a row.
    pub fn add_row(&mut self, row: &WeakRow<'_>) {
        self.rows.add(row);
    }

    /// The rows.
    pub fn rows(&self) -> &RowRing {
        &self.rows
    }
}
