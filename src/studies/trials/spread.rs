//! Numbers that a seed chooses, without a generator.

/// A number in [0, 1) that seed and place choose: the fractions of multiples of the golden section
/// cover the range evenly.
pub(super) fn spread(seed: u64, place: u64) -> f64 {
    ((13 * seed + place + 1) as f64 * 0.618_033_988_75).fract()
}
