//! Moves from point to point, the usual commands of robots and servo axes.
//!
//! A move takes the setpoint from level a to level b in the time T; with s = t/T from 0 to 1 it is
//! a + (b − a) p(s) with
//!
//! ```text
//! minimum jerk   p = 10 s³ − 15 s⁴ + 6 s⁵                speed and acceleration are 0 at both ends
//! trapezoidal    p = (9/4) s², then (3/2) s − 1/4, then 1 − (9/4)(1 − s)²
//! ```
//!
//! the latter changes at s = 1/3 and 2/3, so speeding up, cruising and slowing down take a third of
//! the time each. T. Flash, N. Hogan, The coordination of arm movements, J. Neuroscience 5 (1985),
//! for the first; any textbook on robots for the second.

use super::error::{SimError, finite, in_range};
use super::noise::Noise;

/// Profile of a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MoveProfile {
    /// The polynomial of degree 5 with the least jerk: smooth up to the acceleration.
    #[default]
    MinimumJerk,
    /// A trapezoid of the speed with three equal parts: the acceleration jumps.
    Trapezoidal,
}

impl MoveProfile {
    /// All profiles with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] =
        [(Self::MinimumJerk, "minimum_jerk"), (Self::Trapezoidal, "trapezoidal")];

    /// Share of the distance covered after the share `s` of the time; 0 before and 1 after the
    /// move.
    pub fn position(self, s: f64) -> f64 {
        let s = s.clamp(0.0, 1.0);
        match self {
            Self::MinimumJerk => s * s * s * (10.0 + s * (6.0 * s - 15.0)),
            Self::Trapezoidal if s < 1.0 / 3.0 => 2.25 * s * s,
            Self::Trapezoidal if s < 2.0 / 3.0 => 1.5 * s - 0.25,
            Self::Trapezoidal => 1.0 - 2.25 * (1.0 - s) * (1.0 - s),
        }
    }
}

/// Moves between levels drawn from the seed, each followed by a rest; levels, durations and rests
/// are uniform.
///
/// The run begins with a move, from 0 or from the level nearest to 0. Times are rounded to whole
/// samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moves {
    /// Shape of each move.
    pub profile: MoveProfile,
    /// Lowest level \[rad\].
    pub min_rad: f64,
    /// Highest level \[rad\].
    pub max_rad: f64,
    /// Shortest duration of a move \[s\], at least one sample period.
    pub min_move_s: f64,
    /// Longest duration of a move \[s\].
    pub max_move_s: f64,
    /// Shortest rest after a move \[s\], ≥ 0.
    pub min_rest_s: f64,
    /// Longest rest after a move \[s\].
    pub max_rest_s: f64,
}

impl Moves {
    /// Checks every value against its domain.
    pub(super) fn validate(&self, sample_period_s: f64) -> Result<(), SimError> {
        finite("setpoint.min_rad", self.min_rad)?;
        finite("setpoint.max_rad", self.max_rad)?;
        in_range("setpoint.max_rad", self.max_rad, self.min_rad, f64::MAX)?;
        in_range("setpoint.min_move_s", self.min_move_s, sample_period_s, 1e9)?;
        in_range("setpoint.max_move_s", self.max_move_s, self.min_move_s, 1e9)?;
        in_range("setpoint.min_rest_s", self.min_rest_s, 0.0, 1e9)?;
        in_range("setpoint.max_rest_s", self.max_rest_s, self.min_rest_s, 1e9)
    }
}

/// Running [`Moves`].
#[derive(Debug, Clone)]
pub(super) struct MovesSource {
    moves: Moves,
    noise: Noise,
    from: f64,
    to: f64,
    /// First sample of the move, its length and the first sample of the next move.
    begin: u64,
    len: u64,
    next: u64,
}

impl MovesSource {
    pub fn new(moves: Moves, noise: Noise) -> Self {
        let level = 0.0f64.clamp(moves.min_rad, moves.max_rad);
        Self {
            moves,
            noise,
            from: level,
            to: level,
            begin: 0,
            len: 1,
            next: 0,
        }
    }

    /// Draws the next move if the one before and its rest are over at sample `k`.
    pub fn begin_sample(&mut self, k: u64, sample_period_s: f64) {
        if k < self.next {
            return;
        }
        let Moves {
            min_rad,
            max_rad,
            min_move_s,
            max_move_s,
            min_rest_s,
            max_rest_s,
            ..
        } = self.moves;
        let samples = |seconds: f64| (seconds / sample_period_s).round() as u64;
        self.from = self.to;
        self.to = self.noise.between(min_rad, max_rad);
        self.begin = k;
        self.len = samples(self.noise.between(min_move_s, max_move_s)).max(1);
        self.next = k + self.len + samples(self.noise.between(min_rest_s, max_rest_s));
    }

    /// Commanded position at `k` + `fraction` samples.
    pub fn value(&self, k: u64, fraction: f64) -> f64 {
        let s = ((k - self.begin) as f64 + fraction) / self.len as f64;
        self.from + (self.to - self.from) * self.moves.profile.position(s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_profiles_have_the_derivatives_of_their_definition() {
        // Central differences: h²/6 of third derivatives up to 60 and h²/12 of fourth ones up to
        // 360; rounding adds 1e-14/h and 1e-14/h².
        let h = 1e-4;
        for (profile, _) in MoveProfile::NAMES {
            let p = |s: f64| profile.position(s);
            assert_eq!((p(-1.0), p(0.0), p(1.0), p(2.0)), (0.0, 0.0, 1.0, 1.0));
            for step in 1..100 {
                let s = f64::from(step) / 100.0;
                // Near the end terms of 10, 15 and 6 cancel, each with a relative error of 1e-16.
                assert!((p(s) + p(1.0 - s) - 1.0).abs() < 1e-14, "{profile:?} is symmetric");
                let speed = (p(s + h) - p(s - h)) / (2.0 * h);
                let acceleration = (p(s + h) - 2.0 * p(s) + p(s - h)) / (h * h);
                let (v, a) = match profile {
                    MoveProfile::MinimumJerk => (
                        30.0 * s * s * (1.0 - s) * (1.0 - s),
                        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
                    ),
                    MoveProfile::Trapezoidal if (s - 1.0 / 3.0).abs() < h || (s - 2.0 / 3.0).abs() < h => continue,
                    MoveProfile::Trapezoidal => (
                        1.5f64.min(4.5 * s.min(1.0 - s)),
                        4.5 * f64::from(i8::from(s < 1.0 / 3.0) - i8::from(s > 2.0 / 3.0)),
                    ),
                };
                assert!(
                    (speed - v).abs() < 1e-6,
                    "{profile:?} at {s}: speed {speed}, expected {v}"
                );
                assert!(
                    (acceleration - a).abs() < 1e-5,
                    "{profile:?} at {s}: {acceleration}, expected {a}"
                );
            }
        }
    }

    #[test]
    fn prop_moves_join_without_a_jump_and_rest_as_long_as_they_should() {
        let moves = Moves {
            profile: MoveProfile::Trapezoidal,
            min_rad: -0.8,
            max_rad: 1.0,
            min_move_s: 0.2,
            max_move_s: 0.5,
            min_rest_s: 0.3,
            max_rest_s: 0.7,
        };
        let period = 0.001;
        let mut source = MovesSource::new(moves, Noise::new(3, 0));
        let (mut before, mut still, mut rests) = (0.0, 0, Vec::new());
        for k in 0..60_000 {
            source.begin_sample(k, period);
            let value = source.value(k, 0.0);
            assert!((-0.8..=1.0).contains(&value));
            // The speed is at most 1.5 times the distance over the time.
            assert!(
                (value - before).abs() <= 1.5 * 1.8 / 0.2 * period + 1e-12,
                "a jump at {k}"
            );
            assert_eq!(source.value(k, 0.4), source.value(k, 0.4));
            if value == before {
                still += 1;
            } else {
                if still > 5 {
                    rests.push(still);
                }
                still = 0;
            }
            before = value;
        }
        // One sample more than the rest has the value of the end of the move.
        assert!(
            rests.len() > 50 && rests.iter().all(|samples| (299..=702).contains(samples)),
            "{rests:?}"
        );
    }
}
