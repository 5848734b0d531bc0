//! Reversals that take far longer than the presliding of the model.
//!
//! ```text
//! δ̂ = δ (1 + f_r/f_c)                                                                          (1)
//! ```
//!
//! f_r of [`friction`](super::friction) describes a small excess of the travel δ. A large one
//! leaves a residual at each reversal, which resembles many other effects: a delay, a spring, drag,
//! friction that differs by direction, another Stribeck speed. (1) still estimates the travel,
//! because only the area under the engagement counts over a window: on random robots with 2 to 10
//! times the configured travel it was mostly within a factor of two of the truth. So if (1) shows
//! at least twice the configured travel, and the residuals show one of these effects, the travel is
//! named.

use super::friction::FrictionTerm;
use super::identify::RobotIdentifier;
use std::fmt;

/// Excess of the travel above which it is named, relative to the model's,
const EXCESS: f64 = 1.0;
/// by this many standard deviations.
const SURE: f64 = 2.0;
/// Multiple of the model's travel beyond which (1) no longer gives the size.
const LARGEST: f64 = 10.0;

/// A joint whose reversals take longer than in the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherTravel {
    /// The joint, counted from 0.
    pub joint: usize,
    /// δ of the model \[rad or m\].
    pub presliding: f64,
    /// (1) as a multiple of it: the weighted mean over the joints where it is certain, because a
    /// small joint alone may be off by several times.
    pub factor: f64,
}

impl OtherTravel {
    /// The joint where the excess is most certain, if any, with the mean of all certain ones.
    pub(super) fn of(identifier: &RobotIdentifier) -> Option<Self> {
        let model = identifier.model();
        let mut most: Option<(f64, usize)> = None;
        let (mut sum, mut weights) = (0.0, 0.0);
        for joint in 0..model.friction().len() {
            let of = |term| model.friction_term(joint, term);
            let (Some(coulomb), Some(reversal)) = (of(FrictionTerm::Coulomb), of(FrictionTerm::Reversal)) else {
                continue;
            };
            let size = identifier.theta()[coulomb];
            let excess = identifier.theta()[reversal] / size;
            let std = identifier.theta_std(reversal) / size;
            let sure = (excess - EXCESS) / std;
            if !(size > 0.0 && sure > SURE) {
                continue;
            }
            let weight = std.powi(-2);
            (sum, weights) = (sum + weight * excess, weights + weight);
            if most.is_none_or(|(most, _)| sure > most) {
                most = Some((sure, joint));
            }
        }
        most.map(|(_, joint)| Self {
            joint,
            presliding: model.friction()[joint].presliding,
            factor: 1.0 + sum / weights, // (1)
        })
    }
}

impl fmt::Display for OtherTravel {
    /// Rounded, so that the text does not change with every block.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let joint = self.joint + 1;
        match self.factor < LARGEST {
            true => write!(
                f,
                "reversals of joint {joint} take some {:.0} times its presliding: state about {:.0e}",
                self.factor,
                self.factor * self.presliding
            ),
            false => write!(
                f,
                "reversals of joint {joint} take over {LARGEST} times its presliding: state more than {:.0e}",
                LARGEST * self.presliding
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_its_words_fit_a_status() {
        for (factor, end) in [
            (5.2, "some 5 times its presliding: state about 1e-3"),
            (1234.5, "over 10 times its presliding: state more than 2e-3"),
        ] {
            let what = OtherTravel {
                joint: 7,
                presliding: 2e-4,
                factor,
            };
            let words = what.to_string();
            assert!(words.len() <= 112 && words.ends_with(end), "{words}");
        }
    }
}
