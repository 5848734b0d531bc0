//! The place of each possible error of a machine among the columns, and what it is.
//!
//! ```text
//! 0: the input delay      1 + K e + k: error k of equation e      K errors per equation
//! ```

use super::suspect::SuspectKind;
use crate::estimator::ERRORS_PER_EQUATION;

/// An error of the whole machine.
pub(super) const DELAY: usize = 0;
/// Number of errors of each equation, and the index of each.
pub(super) const PER_EQUATION: usize = ERRORS_PER_EQUATION;
pub(super) const GAIN: usize = 0;
/// Coulomb friction; friction that falls fast with speed if the model has Coulomb friction.
pub(super) const FRICTION: usize = 1;
/// Eccentricity, by its sine and its cosine.
pub(super) const SINE: usize = 2;
pub(super) const COSINE: usize = 3;
pub(super) const RESONANCE: usize = 4;
pub(super) const ZERO: usize = 5;
pub(super) const OFFSET: usize = 6;
/// Friction that falls slowly with speed.
pub(super) const SLOW_FRICTION: usize = 7;
pub(super) const DEAD_BAND: usize = 8;
pub(super) const SPRING: usize = 9;
pub(super) const SCALE: usize = 10;
/// An error of the whole machine; index in the first equation.
pub(super) const CLOCK: usize = 11;
/// An inertia without weight.
pub(super) const INERTIA: usize = 12;
/// Viscous friction.
pub(super) const VISCOUS: usize = 13;
pub(super) const GAIN_BY_DIRECTION: usize = 14;
pub(super) const VISCOUS_BY_DIRECTION: usize = 15;
/// Friction that grows with the load.
pub(super) const LOAD_FRICTION: usize = 16;
/// What has a column only if the model has Coulomb friction, or it would hardly differ from it.
pub(super) const WITH_COULOMB: [usize; 4] = [SLOW_FRICTION, GAIN_BY_DIRECTION, VISCOUS_BY_DIRECTION, LOAD_FRICTION];

/// Place of an equation's error.
pub(super) const fn place(equation: usize, index: usize) -> usize {
    1 + PER_EQUATION * equation + index
}

/// What stands at each place.
#[derive(Debug, Clone)]
pub(super) struct SuspectPlaces {
    /// The joint of each equation's input.
    pub inputs: Vec<usize>,
    /// Equations with Coulomb friction or a similar jump.
    pub jumps: Vec<bool>,
}

impl SuspectPlaces {
    /// Number of errors, including those without a column.
    pub fn count(&self) -> usize {
        place(self.inputs.len(), 0)
    }

    /// The equation of an error and its index there; `None` for the delay.
    pub fn within(suspect: usize) -> Option<(usize, usize)> {
        let own = suspect.checked_sub(1)?;
        Some((own / PER_EQUATION, own % PER_EQUATION))
    }

    /// The joint of an error; `None` for the whole machine.
    pub fn joint(&self, suspect: usize) -> Option<usize> {
        let (equation, index) = Self::within(suspect)?;
        (index != CLOCK).then(|| self.inputs[equation])
    }

    /// What an error is.
    pub fn kind(&self, suspect: usize) -> SuspectKind {
        let Some((equation, index)) = Self::within(suspect) else {
            return SuspectKind::InputDelay;
        };
        match index {
            GAIN => SuspectKind::Gain,
            FRICTION if self.jumps[equation] => SuspectKind::Stribeck,
            FRICTION => SuspectKind::Coulomb,
            SINE | COSINE => SuspectKind::Eccentricity,
            RESONANCE => SuspectKind::Resonance,
            ZERO => SuspectKind::Zero,
            OFFSET => SuspectKind::Offset,
            DEAD_BAND => SuspectKind::DeadBand,
            SPRING => SuspectKind::Spring,
            INERTIA => SuspectKind::Inertia,
            VISCOUS => SuspectKind::Viscous,
            GAIN_BY_DIRECTION => SuspectKind::GainByDirection,
            VISCOUS_BY_DIRECTION => SuspectKind::ViscousByDirection,
            LOAD_FRICTION => SuspectKind::LoadFriction,
            SCALE => SuspectKind::Scale,
            CLOCK => SuspectKind::Clock,
            _ => SuspectKind::Stribeck, // SLOW_FRICTION
        }
    }

    /// False for the dead time of a drive whose joint's model has no Coulomb friction: that, or an
    /// offset, looks the same in most motion and is likelier.
    pub fn is_named(&self, suspect: usize) -> bool {
        let jumps = |equation: usize| self.jumps.get(equation).is_none_or(|&jumps| jumps);
        Self::within(suspect).is_none_or(|(equation, index)| index != DEAD_BAND || jumps(equation))
    }

    /// The delay, for a resonance.
    pub fn lags_as(&self, suspect: usize) -> Option<usize> {
        (self.kind(suspect) == SuspectKind::Resonance).then_some(DELAY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_all_but_a_dead_time_without_coulomb_friction_are_named() {
        let places = SuspectPlaces {
            inputs: vec![0, 1],
            jumps: vec![true, false],
        };
        // beyond the last error are the drifts of parameters
        let unnamed: Vec<usize> = (0..2 * places.count()).filter(|&s| !places.is_named(s)).collect();
        assert_eq!(unnamed, [place(1, DEAD_BAND)]);
    }
}
