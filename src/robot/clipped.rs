//! Torques that stop at a limit of the signal or of the drive, sample by sample.
//!
//! A clipped torque has its largest magnitude in many samples, and no other value in nearly as
//! many. A torque rounded to counts has every value in many samples: for a sine, the second largest
//! count has 1/2.4 of the samples of the largest. Samples at rest are ignored, because the torque
//! of a resting joint stays constant for long.

/// Smallest share of the samples in motion at the largest torque that indicates clipping; a
/// resolution of a thousandth of the range gives a tenth of that.
const LEAST: f64 = 0.01;
const MOST: f64 = 0.9;
/// Smallest ratio of the samples at the largest torque to those at the next smaller one: a lower
/// ratio indicates a grid of counts.
const STANDS_OUT: usize = 4;
/// Smallest number of samples at the largest torque that is not chance.
const ENOUGH: usize = 10;

/// The two largest magnitudes of a joint's torque, with the numbers of samples that have them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Largest {
    samples: usize,
    first: (f64, usize),
    second: (f64, usize),
}

impl Largest {
    /// Adds a torque of a moving joint.
    pub fn take(&mut self, torque: f64) {
        let size = torque.abs();
        self.samples += 1;
        if size > self.first.0 {
            (self.second, self.first) = (self.first, (size, 1));
        } else if size == self.first.0 {
            self.first.1 += 1;
        } else if size > self.second.0 {
            self.second = (size, 1);
        } else if size == self.second.0 {
            self.second.1 += 1;
        }
    }

    /// The limit, and the share of samples at it, 0 to 1; `None` for a torque that is not clipped.
    pub fn clipped(&self) -> Option<(f64, f64)> {
        let (size, count) = self.first;
        let share = count as f64 / self.samples.max(1) as f64;
        let stands_out = count >= ENOUGH && count > STANDS_OUT * self.second.1;
        (size > 0.0 && stands_out && (LEAST..MOST).contains(&share)).then_some((size, share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(torque: impl Fn(f64) -> f64) -> Option<(f64, f64)> {
        let mut largest = Largest::default();
        (0..4000).for_each(|k| largest.take(torque(0.00314 * f64::from(k))));
        largest.clipped()
    }

    #[test]
    fn prop_a_limit_is_told_from_the_counts_of_a_sensor() {
        let sine = |t: f64| 10.0 * t.sin() + 4.0 * (2.7 * t).cos();
        assert_eq!(of(sine), None);
        let limit = of(|t| sine(t).clamp(-7.0, 7.0)).expect("clipped");
        assert!(limit.0 == 7.0 && limit.1 > 0.1);
        for count in [0.05, 0.2, 0.5, 1.0, 2.0, 5.0] {
            assert_eq!(of(|t| (sine(t) / count).round() * count), None, "{count}");
        }
        // clipped counts
        assert!(of(|t| ((sine(t) / 0.2).round() * 0.2).clamp(-7.0, 7.0)).is_some());
        assert_eq!(of(|_| 3.0), None);
    }
}
