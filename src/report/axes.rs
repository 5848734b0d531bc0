//! Strokes and scales shared by the figures.

use super::layers::{BLUE, GREY, Layer, ORANGE, Scale, Stroke};

pub(super) const SMALL_PANEL: f64 = 170.0;
pub(super) const FIRST: Stroke = Stroke::solid(BLUE, 1.6);
pub(super) const SECOND: Stroke = Stroke::dashed(ORANGE, 1.8, "5 3");
const BOUND: Stroke = Stroke::dashed(GREY, 1.4, "1.5 3");
/// Largest distance of a bound from the axis range, as a share of it, at which the bound is shown.
const BOUND_NEAR: f64 = 0.3;

/// The value if a logarithmic axis can show it; otherwise the line is broken.
pub(super) fn positive(value: f64) -> f64 {
    if value > 0.0 && value.is_finite() {
        value
    } else {
        f64::NAN
    }
}

pub(super) fn extent(values: &[f64]) -> (f64, f64) {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    (
        finite().fold(f64::INFINITY, f64::min),
        finite().fold(f64::NEG_INFINITY, f64::max),
    )
}

pub(super) fn padded(from: f64, to: f64, part: f64) -> Scale {
    // An almost constant line is shown as such and not magnified to its last digits.
    let least = 0.02 * from.abs().max(to.abs());
    let least = if least > 0.0 { least } else { 1.0 };
    let pad = ((to - from) * part).max((least - (to - from) / 2.0).max(0.0));
    Scale::Linear {
        from: from - pad,
        to: to + pad,
    }
}

/// An axis for a value over time: includes the truth and all estimates, except a few outliers that
/// would hide everything else.
pub(super) fn value_scale(estimates: &[f64], truths: &[f64]) -> Scale {
    let mut sorted = estimates.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (mut from, mut to) = extent(&[&sorted[..], truths].concat());
    if !(from.is_finite() && to.is_finite()) {
        return Scale::Linear { from: 0.0, to: 1.0 };
    }
    if sorted.len() >= 20 {
        let cut = (sorted.len() as f64 * 0.04).ceil() as usize;
        let (low, high) = extent(&[&sorted[cut..sorted.len() - cut], truths].concat());
        if to - from > 6.0 * (high - low) && high > low {
            let room = high - low;
            (from, to) = (from.max(low - room), to.min(high + room));
        }
    }
    padded(from, to, 0.08)
}

/// The bounds on the axis, or so near that the axis is extended to show them.
pub(super) fn bound_lines((lower, upper): (f64, f64), scale: &mut Scale, x: (f64, f64)) -> Vec<Layer> {
    let Scale::Linear { from, to } = scale else {
        return Vec::new();
    };
    let room = BOUND_NEAR * (*to - *from);
    let edge = 0.03 * (*to - *from);
    let shown = [lower, upper].map(|bound| bound.is_finite() && (*from - room..=*to + room).contains(&bound));
    for (bound, shown) in [lower, upper].into_iter().zip(shown) {
        if shown {
            (*from, *to) = (from.min(bound - edge), to.max(bound + edge));
        }
    }
    let lines = [lower, upper].into_iter().zip(shown).filter(|(_, shown)| *shown);
    lines
        .enumerate()
        .map(|(nth, (bound, _))| Layer::Line {
            points: vec![(x.0, bound), (x.1, bound)],
            stroke: BOUND,
            legend: (nth == 0).then(|| "bound".to_string()),
        })
        .collect()
}

/// Whole decades around the values.
pub(super) fn decades(values: &[f64]) -> Scale {
    let (from, to) = extent(values);
    if !(from.is_finite() && to.is_finite() && from > 0.0) {
        return Scale::Log { from: 0.1, to: 1.0 };
    }
    let from = from.log10().floor();
    let to = to.log10().ceil().max(from + 1.0);
    Scale::Log {
        from: 10f64.powf(from),
        to: 10f64.powf(to),
    }
}
