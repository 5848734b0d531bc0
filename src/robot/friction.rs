//! Friction and other torques that act on a single joint, linear in their parameters.
//!
//! ```text
//! f = f_v q̇ + f_c z + f_0 + c |g| z + f_s z e^−(q̇/v_s)² + f_r w + k q + f_d q̇ |q̇| + f_a |q̇|  (1)
//! dz/dt = (q̇ − |q̇| z)/δ:     z' = s + (z − s) e^−|Δq|/δ,   s = sign Δq                      (2)
//! w = ∂z/∂ln δ:               w' = (w + (z − s) |Δq|/δ) e^−|Δq|/δ                             (3)
//! ```
//!
//! z is the engagement, P. Dahl's presliding model (1968): in steady motion it is sign q̇, a
//! reversal takes a distance of about δ, and a joint that comes to rest keeps it, because its servo
//! stops pushing as soon as friction holds the load. With z instead of sign q̇ the model stays
//! linear, has no jump, and does not depend on the sign of a velocity that is only noise. Δq is the
//! velocity integrated over one sample: positions of a log are often rounded to 1e-4 rad, and steps
//! back and forth between two values would count as motion.
//!
//! δ is never known well, and joints reverse where their acceleration is largest: with δ three
//! times too large, the rotor inertia of a small joint was estimated 10 % too large, by ten
//! standard deviations. f_r absorbs this: it is f_c times the relative excess of the true δ. For
//! windows that are long compared with a reversal this is exact, because only the area under z
//! matters.
//!
//! k is a spring, such as a hose pack or a balancer; its rest position is part of f_0. f_d is drag,
//! of a fluid or of churned grease, and f_a half the difference of viscous friction between the
//! directions; that of Coulomb friction is part of f_0. Few machines have these three, so by
//! default they are not among the terms but tested for.
//!
//! Below the rest speed v_r a joint may creep under any torque up to that of friction, which (1)
//! does not describe, see [`rows`](super::rows). |g| is the joint's gravity load by the URDF's
//! bodies: a known function of q. The measured torque cannot be used: at a joint whose torque is
//! mostly friction, |τ| z is τ itself and would explain everything.
//!
//! Sources: H. Olsson et al., European J. of Control 4 (1998) on Stribeck's and Dahl's models; A.
//! Wahrburg et al., IEEE RA-L 3 (2018) on load.

use super::error::FrictionError;

/// One term of (1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrictionTerm {
    /// f_v q̇.
    Viscous,
    /// f_c z.
    Coulomb,
    /// f_0, which includes an offset of the current or torque sensor.
    Offset,
    /// c |g| z.
    Load,
    /// f_s z e^−(q̇/v_s)².
    Stribeck,
    /// f_r w.
    Reversal,
    /// k q.
    Spring,
    /// f_d q̇ |q̇|.
    Drag,
    /// f_a |q̇|.
    Asymmetric,
}

impl FrictionTerm {
    /// Every term with its name in configurations and parameter names.
    pub const NAMES: [(&'static str, Self); 9] = [
        ("viscous", Self::Viscous),
        ("coulomb", Self::Coulomb),
        ("offset", Self::Offset),
        ("load", Self::Load),
        ("stribeck", Self::Stribeck),
        ("reversal", Self::Reversal),
        ("spring", Self::Spring),
        ("drag", Self::Drag),
        ("asymmetric", Self::Asymmetric),
    ];

    /// True for what few machines have, and many other effects resemble slightly.
    pub fn is_rare(self) -> bool {
        matches!(self, Self::Spring | Self::Drag | Self::Asymmetric)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        let (name, _) = Self::NAMES
            .iter()
            .find(|(_, term)| *term == self)
            .unwrap_or(&Self::NAMES[0]);
        name
    }

    /// SI unit at a revolute (`turns`) or prismatic joint.
    pub fn unit(self, turns: bool) -> &'static str {
        match (self, turns) {
            (Self::Viscous | Self::Asymmetric, true) => "N m s/rad",
            (Self::Viscous | Self::Asymmetric, false) => "N s/m",
            (Self::Drag, true) => "N m s^2/rad^2",
            (Self::Drag, false) => "N s^2/m^2",
            (Self::Load, _) => "1",
            (Self::Spring, true) => "N m/rad",
            (Self::Spring, false) => "N/m",
            (_, true) => "N m",
            (_, false) => "N",
        }
    }

    /// Its meaning.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Viscous => "viscous friction",
            Self::Coulomb => "Coulomb friction",
            Self::Offset => {
                "constant torque, offset of the sensor, half the difference of Coulomb friction between the directions"
            }
            Self::Load => "Coulomb friction per weight that the joint bears",
            Self::Stribeck => "additional friction at low speed",
            Self::Reversal => "Coulomb friction times the relative excess of the travel of a reversal over presliding",
            Self::Spring => "stiffness of a spring, a hose pack or a balancer",
            Self::Drag => "drag that grows with the square of the speed",
            Self::Asymmetric => "half the difference of viscous friction between the directions",
        }
    }

    /// A short description of the physical effect, with the term's name.
    pub fn phrase(self) -> &'static str {
        match self {
            Self::Viscous => "viscous friction",
            Self::Coulomb => "Coulomb friction",
            Self::Offset => "a constant torque (offset)",
            Self::Load => "load-dependent friction",
            Self::Stribeck => "Stribeck friction",
            Self::Reversal => "another travel of reversals (reversal)",
            Self::Spring => "a spring or a hose pack (spring)",
            Self::Drag => "quadratic drag (drag)",
            Self::Asymmetric => "asymmetric friction (asymmetric)",
        }
    }
}

/// Engagement of a joint's friction; zero at the start of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Engagement {
    /// z, −1 to 1.
    pub z: f64,
    /// w: derivative of z with respect to ln δ.
    pub slope: f64,
}

impl Engagement {
    /// For a joint that has moved in the direction of `dq` for long.
    pub fn steady(dq: f64) -> Self {
        Self {
            z: if dq == 0.0 { 0.0 } else { dq.signum() },
            slope: 0.0,
        }
    }
}

/// Friction of one joint: its terms and their constants; [`default`](Self::default) suits geared
/// arms.
#[derive(Debug, Clone, PartialEq)]
pub struct JointFriction {
    /// The terms, each at most once.
    pub terms: Vec<FrictionTerm>,
    /// δ: distance after which a reversal is complete to within 1/e \[rad or m\], > 0.
    pub presliding: f64,
    /// v_r: speed below which the joint counts as at rest \[rad/s or m/s\], ≥ 0.
    pub rest_speed: f64,
    /// v_s: speed at which the Stribeck term has fallen to 1/e \[rad/s or m/s\], > 0.
    pub stribeck_speed: f64,
}

impl Default for JointFriction {
    /// All terms except spring, drag and asymmetric friction; δ = 0.2 mrad, rest below 0.01 rad/s,
    /// v_s = 0.1 rad/s. On a UR10e, 0.1 to 0.4 mrad and 0.05 to 0.2 rad/s do nearly as well.
    fn default() -> Self {
        Self {
            terms: {
                let terms = FrictionTerm::NAMES.into_iter().map(|(_, term)| term);
                terms.filter(|term| !term.is_rare()).collect()
            },
            presliding: 2e-4,
            rest_speed: 0.01,
            stribeck_speed: 0.1,
        }
    }
}

impl JointFriction {
    /// Checks the constants.
    ///
    /// # Errors
    /// The first rule that is violated.
    pub fn validate(&self) -> Result<(), FrictionError> {
        if !(self.rest_speed >= 0.0 && self.rest_speed.is_finite()) {
            return Err(FrictionError::RestSpeed(self.rest_speed));
        }
        if !(self.presliding > 0.0 && self.presliding.is_finite()) {
            return Err(FrictionError::Presliding(self.presliding));
        }
        if !(self.stribeck_speed > 0.0 && self.stribeck_speed.is_finite()) {
            return Err(FrictionError::StribeckSpeed(self.stribeck_speed));
        }
        for (i, term) in self.terms.iter().enumerate() {
            if self.terms[..i].contains(term) {
                return Err(FrictionError::Twice(term.name()));
            }
        }
        Ok(())
    }

    /// The engagement after a step of the position, from the engagement before it.
    pub fn engagement(&self, step: f64, before: Engagement) -> Engagement {
        let direction = if step == 0.0 { 0.0 } else { step.signum() };
        let way = step.abs() / self.presliding;
        let (left, kept) = (before.z - direction, (-way).exp());
        Engagement {
            z: direction + left * kept,                // (2)
            slope: (before.slope + left * way) * kept, // (3)
        }
    }

    /// True if the joint's friction changes sign at a reversal, so data at rest do not inform on
    /// it.
    pub fn needs_motion(&self) -> bool {
        use FrictionTerm::{Coulomb, Load, Reversal, Stribeck};
        let jumps = |term: &FrictionTerm| matches!(term, Coulomb | Load | Stribeck | Reversal);
        self.terms.iter().any(jumps)
    }

    /// (1): the regressor over the terms at position `q` and velocity `dq` with an engagement and
    /// weight `weight` \[N m or N\].
    pub fn row(&self, q: f64, dq: f64, engagement: Engagement, weight: f64, row: &mut [f64]) {
        let z = engagement.z;
        for (entry, term) in row.iter_mut().zip(&self.terms) {
            *entry = match term {
                FrictionTerm::Viscous => dq,
                FrictionTerm::Coulomb => z,
                FrictionTerm::Offset => 1.0,
                FrictionTerm::Load => weight.abs() * z,
                FrictionTerm::Stribeck => self.stribeck(dq, engagement, 1.0),
                FrictionTerm::Reversal => engagement.slope,
                FrictionTerm::Spring => q,
                FrictionTerm::Drag => dq * dq.abs(),
                FrictionTerm::Asymmetric => dq.abs(),
            }; // (1)
        }
    }

    /// The Stribeck term of (1) for `factor` times its speed.
    pub(super) fn stribeck(&self, dq: f64, engagement: Engagement, factor: f64) -> f64 {
        engagement.z * (-(dq / (factor * self.stribeck_speed)).powi(2)).exp()
    }

    /// (1) with the values `theta` of the terms.
    pub fn torque(&self, q: f64, dq: f64, engagement: Engagement, weight: f64, theta: &[f64]) -> f64 {
        let mut row = [0.0; FrictionTerm::NAMES.len()];
        self.row(q, dq, engagement, weight, &mut row);
        row.iter().zip(theta).map(|(entry, value)| entry * value).sum() // (1)
    }
}
