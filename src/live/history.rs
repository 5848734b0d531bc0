//! The estimates so far, in bounded memory: all of the newest, and fewer of the older ones.

use std::collections::VecDeque;

/// Total of numbers kept; divided by the number of quantities this is the number of points.
const NUMBERS: usize = 12_000;
/// Smallest and largest number of points.
const POINTS: (usize, usize) = (200, 1000);

/// The estimates of one block: values in the order of the quantities.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Block number, from 1.
    pub block: u64,
    /// Stream time of the block's last sample \[s\].
    pub t_s: f64,
    /// Estimates.
    pub values: Vec<f64>,
    /// Standard deviations; `NaN` if none is known.
    pub stds: Vec<f64>,
    /// Whether each may be used.
    pub usable: Vec<bool>,
    /// The true values; empty if unknown.
    pub truth: Vec<f64>,
}

/// Points in order of time.
#[derive(Debug, Clone)]
pub struct History {
    points: VecDeque<Point>,
    limit: usize,
}

impl History {
    /// A history of `quantities` quantities.
    pub fn new(quantities: usize) -> Self {
        Self {
            points: VecDeque::new(),
            limit: (NUMBERS / quantities.max(1)).clamp(POINTS.0, POINTS.1),
        }
    }

    /// Limits the number of points, at least 2.
    pub(super) fn at_most(mut self, points: usize) -> Self {
        self.limit = self.limit.min(points.max(2));
        self
    }

    /// Largest number of points.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// All points.
    pub fn points(&self) -> impl DoubleEndedIterator<Item = &Point> + ExactSizeIterator {
        self.points.iter()
    }

    /// The points of blocks after this one.
    pub fn after(&self, block: u64) -> impl ExactSizeIterator<Item = &Point> {
        let from = self.points.partition_point(|point| point.block <= block);
        self.points.range(from..)
    }

    pub(super) fn clear(&mut self) {
        self.points.clear();
    }

    /// Adds a point; if the history is full, drops every second one of the older half.
    pub(super) fn push(&mut self, point: Point) {
        if self.points.len() >= self.limit {
            let half = self.points.len() / 2;
            let mut index = 0;
            self.points.retain(|_| {
                index += 1;
                index > half || index % 2 == 1
            });
        }
        self.points.push_back(point);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(block: u64) -> Point {
        Point {
            block,
            t_s: block as f64,
            values: vec![0.0; 100],
            stds: Vec::new(),
            usable: Vec::new(),
            truth: Vec::new(),
        }
    }

    #[test]
    fn prop_a_history_of_months_keeps_its_beginning_and_its_newest_points_and_stays_bounded() {
        let mut history = History::new(100);
        assert_eq!(history.limit, 200);
        for block in 1..=1_000_000 {
            history.push(point(block));
            assert!(history.points().len() <= 200);
        }
        let blocks: Vec<u64> = history.points().map(|p| p.block).collect();
        assert_eq!((blocks[0], blocks[blocks.len() - 1]), (1, 1_000_000));
        assert!(blocks.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(blocks.ends_with(&(999_951..=1_000_000).collect::<Vec<_>>()));
        assert_eq!(history.after(999_990).len(), 10);
        assert_eq!(history.after(2_000_000).len(), 0);
    }
}
