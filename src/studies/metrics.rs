//! Metrics of a run: errors, blocks to settle, excursions.

/// Largest relative error over the chosen parameters; `inf` if an estimate is not finite.
pub fn worst_relative_error(theta: &[f64], truth: &[f64], parameters: &[usize]) -> f64 {
    parameters
        .iter()
        .map(|&p| {
            let error = ((theta[p] - truth[p]) / truth[p]).abs();
            if error.is_nan() { f64::INFINITY } else { error }
        })
        .fold(0.0, f64::max)
}

/// Blocks from that of the change (0) to the first after which all errors stay at or below `limit`;
/// `None` if they never do.
///
/// `errors` has one value per block, `from` is the index of the block with the change.
pub fn blocks_to_stay_within(errors: &[f64], from: usize, limit: f64) -> Option<usize> {
    let after = errors.get(from..)?;
    let outside = after.iter().rposition(|&error| error.is_nan() || error > limit);
    match outside {
        None => Some(0),
        Some(last) if last + 1 < after.len() => Some(last + 1),
        Some(_) => None,
    }
}

/// Median of values, the upper one for an even count; `NaN` for none.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_blocks_to_stay_within_counts_from_the_block_of_the_change() {
        let errors = [0.1, 0.0, 0.5, 0.2, 0.009, 0.02, 0.01, 0.003];
        assert_eq!(blocks_to_stay_within(&errors, 2, 0.01), Some(4));
        assert_eq!(blocks_to_stay_within(&errors, 2, 0.5), Some(0));
        assert_eq!(blocks_to_stay_within(&errors, 2, 0.001), None);
        assert_eq!(blocks_to_stay_within(&errors, 7, 0.01), Some(0));
        assert_eq!(blocks_to_stay_within(&errors, 9, 0.01), None);
        assert_eq!(blocks_to_stay_within(&[0.0, f64::NAN, 0.0], 0, 0.01), Some(2));
    }

    #[test]
    fn prop_errors_that_are_not_numbers_count_as_infinite() {
        assert_eq!(
            worst_relative_error(&[f64::NAN, 2.0], &[1.0, 2.0], &[0, 1]),
            f64::INFINITY
        );
        assert_eq!(worst_relative_error(&[1.5, 2.0], &[1.0, 2.0], &[0, 1]), 0.5);
        assert_eq!(worst_relative_error(&[1.5, 2.0], &[1.0, 2.0], &[1]), 0.0);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
    }
}
