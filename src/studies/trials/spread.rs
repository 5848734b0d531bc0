//! Numbers from a seed, without a generator.

use std::f64::consts::{SQRT_2, TAU};

/// A number in [0, 1) from seed and place, of a sequence that covers the square of both evenly
/// (multiples of the inverse plastic number and of its square): consecutive seeds are far apart.
pub(super) fn spread(seed: u64, place: u64) -> f64 {
    (seed as f64 * 0.754_877_666_246_692_7 + (place + 1) as f64 * 0.569_840_290_998_053_2).fract()
}

/// A normally distributed number from seed and place (G. E. P. Box and M. E. Muller, 1958).
pub(super) fn normal(seed: u64, place: u64) -> f64 {
    let turns = seed as f64 * SQRT_2 + place as f64 * 3f64.sqrt();
    (-2.0 * (1.0 - spread(seed, place)).ln()).sqrt() * (TAU * turns).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of 4096 numbers scatter by 1/64 and √2/64; those of an evenly covering sequence by
    /// less.
    #[test]
    fn prop_seeds_cover_the_range_and_the_normal_distribution() {
        let mut places = [0u32; 4];
        (0..8).for_each(|seed| places[(4.0 * spread(seed, 99)) as usize] += 1);
        assert!(places.iter().all(|&count| count >= 1), "{places:?}");
        let numbers: Vec<f64> = (0..64)
            .flat_map(|seed| (0..64).map(move |place| normal(seed, place)))
            .collect();
        let mean = numbers.iter().sum::<f64>() / 4096.0;
        let square = numbers.iter().map(|x| x * x).sum::<f64>() / 4096.0;
        assert!(mean.abs() < 0.05 && (square - 1.0).abs() < 0.07, "{mean} {square}");
    }
}
