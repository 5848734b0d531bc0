//! Effects that the equations of a robot leave out, and that its rows may have columns of.

use super::friction::FrictionTerm;

/// An effect missing in the equations of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unmodelled {
    /// A term of a joint's friction.
    Friction {
        /// The joint, counted from 0.
        joint: usize,
        /// The term.
        term: FrictionTerm,
    },
    /// Stribeck friction falls over another speed than the model's; the amplitude is the friction
    /// with three times the speed, or a third of it.
    StribeckSpeed {
        /// The joint, counted from 0.
        joint: usize,
        /// True if the speed is higher.
        higher: bool,
    },
    /// The zero of a joint's encoder differs from the URDF; the amplitude is the error of its
    /// reading \[rad\].
    Zero {
        /// The joint, counted from 0.
        joint: usize,
    },
    /// The direction of gravity differs from the model's \[rad\].
    Tilt,
    /// Torques are later than positions and velocities, or filtered more \[s\].
    Delay,
}

impl Unmodelled {
    /// True for what many other effects resemble slightly: a delay, and friction that few machines
    /// have.
    pub(super) fn is_one_of_many(self) -> bool {
        match self {
            Self::Friction { term, .. } => term.is_rare(),
            Self::StribeckSpeed { .. } | Self::Delay => true,
            Self::Zero { .. } | Self::Tilt => false,
        }
    }

    /// True for what is known in advance to be small.
    pub(super) fn has_prior(self) -> bool {
        match self {
            Self::Friction { term, .. } => term.is_rare(),
            Self::StribeckSpeed { .. } | Self::Delay => true,
            Self::Zero { .. } | Self::Tilt => false,
        }
    }

    /// True for what only bends the curve of friction over speed, as every real gear does a little.
    pub(super) fn bends_friction(self) -> bool {
        match self {
            Self::Friction { term, .. } => matches!(term, FrictionTerm::Drag | FrictionTerm::Asymmetric),
            Self::StribeckSpeed { .. } => true,
            Self::Zero { .. } | Self::Tilt | Self::Delay => false,
        }
    }

    /// True if estimated parameters imitate a small one, so standard deviations always allow for
    /// it.
    pub(super) fn is_considered(self) -> bool {
        matches!(self, Self::Zero { .. } | Self::Tilt)
    }

    /// The joint, if it affects the rows of only one.
    pub(super) fn only_joint(self) -> Option<usize> {
        match self {
            Self::Friction { joint, .. } | Self::StribeckSpeed { joint, .. } => Some(joint),
            Self::Zero { .. } | Self::Tilt | Self::Delay => None,
        }
    }
}

/// A column of the rows beyond those of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LeftOutTerm {
    pub what: Unmodelled,
    /// Index of its column, after all parameters.
    pub index: usize,
    /// Standard deviation that covers any machine of this size.
    pub scale: f64,
}
