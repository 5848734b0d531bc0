//! Numbers under the pointer for lines without dots: a panel is divided into slots, each with the
//! values at its middle.

use std::fmt::Write as _;

/// Slots of a panel: about seven pixels each, wide enough to point at.
const SLOTS: usize = 100;

/// A part of the abscissa and its text.
#[derive(Debug, PartialEq)]
pub(super) struct Slot {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) text: String,
}

/// Time and value, and the name of the line.
pub(super) type Line<'a> = (&'a [(f64, f64)], Option<&'a str>);

/// The slots of a panel between two ends of the abscissa, if a line has values there.
pub(super) fn slots(lines: &[Line<'_>], (from, to): (f64, f64), number: impl Fn(f64) -> String) -> Vec<Slot> {
    let width = (to - from) / SLOTS as f64;
    let slot = |index: usize| {
        let left = from + width * index as f64;
        let middle = left + 0.5 * width;
        let mut text = String::new();
        for (points, legend) in lines {
            let Some(value) = at(points, middle).filter(|v| v.is_finite()) else {
                continue;
            };
            let between = if text.is_empty() { "" } else { ", " };
            let name = legend.map_or_else(String::new, |name| format!("{name} "));
            let _ = write!(text, "{between}{name}{}", number(value));
        }
        (!text.is_empty()).then(|| Slot {
            from: left,
            to: left + width,
            text: format!("{} s: {text}", number(middle)),
        })
    };
    (0..SLOTS).filter_map(slot).collect()
}

/// The value of the point that is nearest to an abscissa.
fn at(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let behind = points.partition_point(|point| point.0 < x);
    let near = points[behind.saturating_sub(1)..].iter().take(2);
    near.min_by(|a, b| (a.0 - x).abs().total_cmp(&(b.0 - x).abs()))
        .map(|point| point.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_slot_has_the_values_at_its_middle_and_none_stands_where_nothing_is_known() {
        let line = |slope: f64| -> Vec<(f64, f64)> {
            let value = |i: i32| if i < 50 { f64::NAN } else { slope * f64::from(i) };
            (0..=100).map(|i| (f64::from(i), value(i))).collect()
        };
        let (measured, other) = (line(1.0), line(2.0));
        let lines = [(&measured[..], Some("measured")), (&other[..], None)];
        let all = slots(&lines, (0.0, 100.0), |v| format!("{v:.1}"));
        // Points 99 and 100 are equally near; the first is used.
        assert_eq!(all.last().map(|s| &*s.text), Some("99.5 s: measured 99.0, 198.0"));
        assert!(
            all.iter().all(|slot| slot.from >= 49.0) && all.len() >= 49,
            "{}",
            all.len()
        );
        assert_eq!(slots(&[], (0.0, 100.0), |v| v.to_string()), []);
    }
}
