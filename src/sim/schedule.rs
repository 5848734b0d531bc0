//! The mass of link 2 over time.

use super::error::{SimError, finite, positive};

/// Interpolation between two points of a schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// The value of the last point.
    #[default]
    Step,
    /// The straight line to the next point; the last value after the last point.
    Linear,
}

impl Interpolation {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Step, "step"), (Self::Linear, "linear")];
}

/// m₂ as points over time. The value of a sample holds from its own instant until the next sample.
///
/// A ramp is therefore a staircase with one step per sample: (24) is derived for a constant mass,
/// and holds exactly at each sample with the mass of that sample.
#[derive(Debug, Clone, PartialEq)]
pub struct MassSchedule {
    /// Times \[s\] and masses \[kg\], the first at 0 s, times increasing, masses > 0.
    pub points: Vec<(f64, f64)>,
    /// Interpolation between the points.
    pub interpolation: Interpolation,
}

impl MassSchedule {
    /// One mass throughout.
    pub fn constant(mass_kg: f64) -> Self {
        Self {
            points: vec![(0.0, mass_kg)],
            interpolation: Interpolation::Step,
        }
    }

    /// A mass that jumps to `then_kg` at `at_s`.
    pub fn jump(first_kg: f64, at_s: f64, then_kg: f64) -> Self {
        Self {
            points: vec![(0.0, first_kg), (at_s, then_kg)],
            interpolation: Interpolation::Step,
        }
    }

    /// Section 5 of the paper: 150 kg, from 45 s on 170 kg.
    pub fn cedro2022() -> Self {
        Self::jump(150.0, 45.0, 170.0)
    }

    /// Mass at time `t_s` \[kg\]; `t_s` ≥ 0.
    ///
    /// A point counts as reached from 1 ns before its time, so that k Δ rounded down still belongs
    /// to it.
    pub fn mass_kg(&self, t_s: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 <= t_s + 1e-9).max(1);
        let (t0, m0) = self.points[after - 1];
        match (self.interpolation, self.points.get(after)) {
            (Interpolation::Linear, Some(&(t1, m1))) => m0 + (m1 - m0) * ((t_s - t0) / (t1 - t0)).clamp(0.0, 1.0),
            _ => m0,
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        match self.points.first() {
            None => return Err(SimError::new("mass_2.points", "at least one point", "none")),
            Some(&(t, _)) if t != 0.0 => return Err(SimError::new("mass_2.points", "a first point at 0 s", t)),
            Some(_) => {}
        }
        for &(t, mass) in &self.points {
            finite("mass_2.points", t)?;
            positive("mass_2.points", mass)?;
        }
        for pair in self.points.windows(2) {
            if pair[1].0 <= pair[0].0 {
                return Err(SimError::new(
                    "mass_2.points",
                    "rising times",
                    format!("{} s after {} s", pair[1].0, pair[0].0),
                ));
            }
        }
        Ok(())
    }
}
