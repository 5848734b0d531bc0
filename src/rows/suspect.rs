//! Possible errors of a machine beyond its model: kinds, expected sizes and descriptions.
//! `suspect_columns.rs` has their effect on the rows.

use std::fmt;

/// Standard deviations of errors that are not estimated but widen the standard deviations of the
/// estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Considered {
    /// Further delay of the recorded input \[s\], ≥ 0. `None`: a quarter of the sample period, and
    /// at least 50 µs.
    pub input_delay_s: Option<f64>,
    /// Gain of each drive, relative, ≥ 0.
    pub gain: f64,
    /// Coulomb friction at each joint whose model has none, as a share of the largest root mean
    /// square of its input so far, ≥ 0.
    pub coulomb: f64,
    /// Friction that falls with speed at each joint whose model has Coulomb friction, as a share of
    /// the same size, ≥ 0.
    pub stribeck: f64,
    /// Offset of each recorded input whose equation has no constant term, as a share of the same
    /// size, and at least of 400 standard deviations of the input's noise, ≥ 0.
    pub offset: f64,
    /// Dead band of each drive whose joint's model has Coulomb friction, and dead time of each that
    /// has back EMF and an inductance, as a share of the same size, ≥ 0.
    pub dead_band: f64,
    /// Spring, such as a cable, at each joint whose model has none: its input at the root mean
    /// square of the travel, as a share of the same size, ≥ 0.
    pub spring: f64,
    /// Gain of each drive by the sign of its input, half the relative difference, if the joint's
    /// model has Coulomb friction, ≥ 0.
    pub gain_by_direction: f64,
    /// Viscous friction by direction, half the difference, at each joint whose model has Coulomb
    /// friction: its input at the root mean square of the velocity in the first block that moves,
    /// as a share of the same size, ≥ 0.
    pub viscous_by_direction: f64,
    /// Friction that grows with the load, such as that of a screw or a gear, as a share of the
    /// input, at each joint whose model has Coulomb friction, ≥ 0.
    pub load_friction: f64,
    /// Inertia without weight, such as a rotor's, at each joint whose model has no parameter for
    /// it, as a share of the joint's inertia in the model, ≥ 0.
    pub inertia: f64,
    /// Viscous friction at each joint whose model has none, or whose drive has an inductance: its
    /// input at the root mean square of the velocity in the first block that moves, as a share of
    /// the same size, ≥ 0.
    pub viscous: f64,
    /// Viscous friction that the back EMF of a drive with an inductance contains, because it acts
    /// like it: its input at the largest root mean square of the velocity so far, as a share of the
    /// same size, ≥ 0.
    pub friction_in_back_emf: f64,
    /// Natural frequency of the flexibility between each motor and its load \[Hz\], one standard
    /// deviation of 1/(2π f)²; 0 for rigid joints.
    pub resonance_hz: f64,
    /// Rate at which each parameter may change \[1/s\], relative to the parameter, ≥ 0; the
    /// estimator makes its column.
    pub drift_per_s: f64,
    /// Zero of each encoder \[rad\], ≥ 0: an error of the angle against gravity and the links,
    /// which a tilted base causes, too.
    pub zero_rad: f64,
    /// Eccentricity of each encoder \[rad\], ≥ 0: the amplitude of an error of one period per turn.
    /// This and the zero are considered only at joints that turn.
    pub eccentricity_rad: f64,
}

impl Considered {
    /// No error is considered; errors are still tested for.
    pub const NONE: Self = Self {
        input_delay_s: Some(0.0),
        gain: 0.0,
        coulomb: 0.0,
        stribeck: 0.0,
        offset: 0.0,
        dead_band: 0.0,
        spring: 0.0,
        gain_by_direction: 0.0,
        viscous_by_direction: 0.0,
        load_friction: 0.0,
        inertia: 0.0,
        viscous: 0.0,
        friction_in_back_emf: 0.0,
        resonance_hz: 0.0,
        drift_per_s: 0.0,
        zero_rad: 0.0,
        eccentricity_rad: 0.0,
    };

    /// Standard deviation of the delay for samples a period \[s\] apart. By mistake, inputs are
    /// often recorded half a sample or one sample off: a held input is taken for a continuous one,
    /// for example. A shorter delay is that of the drive, which does not depend on the period.
    pub fn input_delay_std_s(&self, sample_period_s: f64) -> f64 {
        self.input_delay_s.unwrap_or((0.25 * sample_period_s).max(5e-5))
    }
}

impl Default for Considered {
    /// The errors of a good installation. Delay: a quarter of the sample period, so that a record
    /// that is one sample late lies within four standard deviations. Gain: 0, because parameters
    /// are in the units that the drive reports. Coulomb friction: 1 % of the input, friction that
    /// falls with speed: 2 %, offset: 0.1 %. By direction: 0.2 % of the gain, viscous friction of
    /// 0.3 % of the input. Friction that grows with the load: 1 %. Inertia: 1 % of the joint's.
    /// Viscous friction: 0.03 % of the input, and 0.5 % within a back EMF. Resonance: 70 Hz. Drift:
    /// 0.6 % in a minute. Zero: 1 mrad, 0.06°. Eccentricity: 0.05 mrad, 10″. With motion that shows
    /// an error, σ becomes what it is without the error; with other motion, σ includes its possible
    /// effect.
    fn default() -> Self {
        Self {
            input_delay_s: None,
            gain: 0.0,
            coulomb: 1e-2,
            stribeck: 2e-2,
            offset: 1e-3,
            dead_band: 3e-3,
            spring: 1e-2,
            gain_by_direction: 2e-3,
            viscous_by_direction: 3e-3,
            load_friction: 1e-2,
            inertia: 1e-2,
            viscous: 3e-4,
            friction_in_back_emf: 5e-3,
            resonance_hz: 70.0,
            drift_per_s: 1e-4,
            zero_rad: 1e-3,
            eccentricity_rad: 5e-5,
        }
    }
}

/// Kinds of errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SuspectKind {
    /// The recorded input acts later, or earlier, than specified.
    InputDelay,
    /// A drive produces more, or less, than specified.
    Gain,
    /// Coulomb friction that the model lacks.
    Coulomb,
    /// Friction that falls with speed, besides the model's Coulomb friction.
    Stribeck,
    /// The recorded input is off by a constant, or a constant force acts that the model lacks.
    Offset,
    /// An encoder off its centre.
    Eccentricity,
    /// A drive that produces nothing for small inputs, and correspondingly less for others. If the
    /// model has back EMF and an inductance: an amplifier whose dead time takes a constant voltage
    /// with the sign of the current.
    DeadBand,
    /// A spring that the model lacks.
    Spring,
    /// A drive whose gain differs by the sign of its input.
    GainByDirection,
    /// Viscous friction that differs by direction.
    ViscousByDirection,
    /// Friction that grows with the load.
    LoadFriction,
    /// An inertia without weight that the model lacks.
    Inertia,
    /// Viscous friction that the model lacks, or takes for a larger back EMF.
    Viscous,
    /// A resonance that the model lacks.
    Resonance,
    /// The zero of an encoder, or the direction of gravity.
    Zero,
    /// An encoder whose counts are larger, or smaller, than specified.
    Scale,
    /// Time stamps that run faster, or slower, than time.
    Clock,
    /// A parameter that moves.
    Drift,
}

/// An error for which the rows have a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspect<'a> {
    /// What it is.
    pub kind: SuspectKind,
    /// The parameter that moves, if one does.
    pub parameter: Option<&'a str>,
    /// Joint, counted from 0; `None` for the whole machine.
    pub joint: Option<usize>,
    /// Unit of the amplitude.
    pub unit: &'a str,
    /// Smallest magnitude of the amplitude that samples can show.
    pub smallest: f64,
    /// Largest magnitude that a machine can have.
    pub largest: f64,
}

impl Suspect<'_> {
    /// True if a machine can have the error with this amplitude. Otherwise a base tilted by 1e10
    /// rad could explain whatever no other column does.
    pub fn is_possible(&self, amplitude: f64) -> bool {
        (self.smallest..=self.largest).contains(&amplitude.abs())
    }

    /// True if the machine can have had the error since the start. A change can be a loss of
    /// friction or inertia, but neither of them can be negative.
    pub fn is_possible_from_the_start(&self, amplitude: f64) -> bool {
        let positive = matches!(
            self.kind,
            SuspectKind::Coulomb | SuspectKind::Viscous | SuspectKind::Inertia | SuspectKind::LoadFriction
        );
        self.is_possible(amplitude) && !(positive && amplitude < 0.0)
    }

    /// Describes the error with this amplitude.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write(&self, amplitude: f64, f: &mut impl fmt::Write) -> fmt::Result {
        let words = match self.kind {
            SuspectKind::InputDelay => "an input delay",
            SuspectKind::Gain => "another drive gain",
            SuspectKind::Coulomb => "Coulomb friction",
            // relative to a straight line, drag that grows with the square of the speed looks the
            // same
            SuspectKind::Stribeck if amplitude > 0.0 => "friction not linear in speed (Stribeck, drag)",
            SuspectKind::Stribeck => "friction that is low at low speed",
            SuspectKind::Offset => "an offset of the input or a tilted base",
            SuspectKind::Eccentricity => "an encoder off its centre",
            SuspectKind::DeadBand => "a dead band of the drive or backlash",
            SuspectKind::Spring => "a spring, a cable or a tilted base",
            SuspectKind::GainByDirection => "a drive gain that differs by direction",
            SuspectKind::ViscousByDirection => "viscous friction that differs by direction",
            SuspectKind::LoadFriction => "friction that grows with the load",
            SuspectKind::Inertia => "an inertia without weight (rotor, gear)",
            SuspectKind::Viscous => "viscous friction",
            SuspectKind::Resonance => "a resonance",
            SuspectKind::Zero => "a tilted base or encoder zero",
            SuspectKind::Scale => "another scale of the encoder",
            SuspectKind::Clock => "a clock that runs fast or slow",
            SuspectKind::Drift => "a drift",
        };
        f.write_str(words)?;
        if let Some(parameter) = self.parameter {
            write!(f, " of {parameter}")?;
        }
        match self.joint {
            Some(joint) => write!(f, " at joint {}", joint + 1),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_delay_is_a_share_of_the_sample_period_unless_it_is_stated() {
        let default = Considered::default();
        assert_eq!(default.input_delay_std_s(1e-3), 2.5e-4);
        assert_eq!(default.input_delay_std_s(1e-4), 5e-5);
        assert_eq!(Considered::NONE.input_delay_std_s(1e-3), 0.0);
    }

    #[test]
    fn prop_a_base_that_is_turned_round_and_round_is_no_cause() {
        let tilted = Suspect {
            kind: SuspectKind::Zero,
            parameter: None,
            joint: Some(0),
            unit: "rad",
            smallest: 0.0,
            largest: 0.5,
        };
        assert!(tilted.is_possible(-0.02));
        assert!(!tilted.is_possible(1.1e10) && !tilted.is_possible(f64::NAN));
        let resonance = Suspect {
            kind: SuspectKind::Resonance,
            smallest: 1e-6,
            ..tilted
        };
        assert!(resonance.is_possible(-2e-6) && !resonance.is_possible(8e-8));
    }

    #[test]
    fn prop_a_machine_may_lose_friction_but_never_had_a_negative_one() {
        let friction = Suspect {
            kind: SuspectKind::Coulomb,
            parameter: None,
            joint: Some(0),
            unit: "V",
            smallest: 0.0,
            largest: 0.5,
        };
        assert!(friction.is_possible(-0.02) && !friction.is_possible_from_the_start(-0.02));
        assert!(friction.is_possible_from_the_start(0.02));
    }
}
