//! An input under feedback may jump for one sample because the position did: by an encoder count,
//! or by a spike that the controller saw too.

use super::mended_signal::MendedSignal;
use std::ops::Range;

/// Samples on either side in which counts are sought to which the input responded.
const AROUND: usize = 500;

/// The cause of an input's jump in the position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Answer {
    /// None.
    None,
    /// An encoder count; the jump is then real.
    Count,
    /// A spike, if the controller saw it.
    Spike,
}

/// The cause of the input's jump at `k`: a spike of the position, or a count by which the position
/// changed after a while at rest. Counts are assumed to have an effect if a third of those around
/// it have one.
pub(super) fn answers(
    q: &[f64],
    u: &[f64],
    position: &MendedSignal,
    stretch: &Range<usize>,
    k: usize,
    count: f64,
) -> Answer {
    let near = k.saturating_sub(2).max(stretch.start)..(k + 2).min(stretch.end);
    if near.clone().any(|i| position.bad[i]) {
        return Answer::Spike;
    }
    if !(count > 0.0) {
        return Answer::None;
    }
    let moves = |i: usize| (q[i] - q[i - 1]).abs() > 0.5 * count;
    let moving = |from: usize, to: usize| {
        let range = from.max(stretch.start + 1)..to.min(stretch.end);
        range.filter(|&i| moves(i)).count()
    };
    // at most two counts among a dozen samples at rest
    let alone = |k: usize| moving(k.saturating_sub(1), k + 2) > 0 && moving(k.saturating_sub(6), k + 7) <= 3;
    if !alone(k) {
        return Answer::None;
    }
    // distance of the input from the mean of its neighbours, here and at other counts
    let off = |i: usize| (u[i] - 0.5 * (u[i - 1] + u[i + 1])).abs();
    let around = k.saturating_sub(AROUND).max(stretch.start + 2)..(k + AROUND).min(stretch.end.saturating_sub(3));
    let (mut counts, mut effects) = (0, 0);
    for i in around.filter(|i| i.abs_diff(k) > 6).filter(|&i| moves(i) && alone(i)) {
        counts += 1;
        effects += usize::from(off(i).max(off(i + 1)) > 0.3 * off(k));
    }
    if counts > 0 && 3 * effects > counts {
        Answer::Count
    } else {
        Answer::None
    }
}
