//! The windows of a block: one every `stride` samples of the grid, if the stretch without holes is
//! long enough on both sides.

use std::ops::Range;

/// One window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Position of the centre in the buffers.
    pub centre: usize,
    /// Number of the centre sample on the grid.
    pub number: i64,
    /// Times of its first and last sample \[ns\].
    pub start_ns: u64,
    pub end_ns: u64,
}

/// The windows of the block so far.
#[derive(Debug, Clone)]
pub(super) struct Windows {
    all: Vec<Window>,
    capacity: usize,
    /// Samples from one window to the next.
    pub stride: usize,
    /// Samples on either side of a centre within the window.
    half: usize,
    /// Samples on either side of a centre that its row needs.
    pub reach: usize,
}

impl Windows {
    /// Workspace for `capacity` windows of `half` samples on either side, whose rows need `reach`.
    pub fn new(half: usize, reach: usize, stride: usize, capacity: usize) -> Self {
        Self {
            all: Vec::with_capacity(capacity),
            capacity,
            stride,
            half,
            reach,
        }
    }

    /// All of them, in the order of time.
    #[inline]
    pub fn all(&self) -> &[Window] {
        &self.all
    }

    /// Number of windows, and so of rows of each equation.
    #[inline]
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Capacity in windows.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Adds a window around a sample if this lies on the grid of windows.
    pub fn place(&mut self, centre: usize, number: i64, t_ns: &[u64]) {
        if number.rem_euclid(self.stride as i64) == 0 && self.all.len() < self.capacity {
            self.all.push(Window {
                centre,
                number,
                start_ns: t_ns[centre - self.half],
                end_ns: t_ns[centre + self.half],
            });
        }
    }

    /// Samples from the first of the first window to the last of the last; empty without windows.
    pub fn covered(&self) -> Range<usize> {
        match (self.all.first(), self.all.last()) {
            (Some(first), Some(last)) => first.centre - self.half..last.centre + self.half + 1,
            _ => 0..0,
        }
    }

    /// Removes all windows.
    pub fn clear(&mut self) {
        self.all.clear();
    }
}
