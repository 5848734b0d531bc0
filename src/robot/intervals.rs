//! Intervals of time of equal length, such as blocks and slices.

/// Consecutive intervals; the first begins with a sample.
#[derive(Debug, Clone)]
pub(super) struct Intervals {
    length_s: f64,
    /// End of the present one \[s\].
    end_s: Option<f64>,
}

impl Intervals {
    /// Intervals of this length \[s\].
    pub fn new(length_s: f64) -> Self {
        Self { length_s, end_s: None }
    }

    /// The next sample begins an interval.
    pub fn restart(&mut self) {
        self.end_s = None;
    }

    /// True if the sample at this time ends an interval. After a long pause, empty intervals are
    /// not counted.
    pub fn is_end(&mut self, t_s: f64) -> bool {
        let end_s = *self.end_s.get_or_insert(t_s + self.length_s);
        if t_s < end_s {
            return false;
        }
        let next_s = end_s + self.length_s;
        self.end_s = Some(if next_s > t_s { next_s } else { t_s + self.length_s });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_pause_is_one_interval() {
        let mut intervals = Intervals::new(1.0);
        let ends: Vec<f64> = [0.0, 0.9, 1.1, 1.9, 2.0, 7.5, 8.4, 8.5]
            .into_iter()
            .filter(|t_s| intervals.is_end(*t_s))
            .collect();
        assert_eq!(ends, [1.1, 2.0, 7.5, 8.5]);
        intervals.restart();
        assert!(!intervals.is_end(20.0) && intervals.is_end(21.0));
    }
}
