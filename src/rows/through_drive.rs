//! Columns of forces at a joint that pass through its drive: of an inertia without weight, such as
//! the rotor of a geared motor, and of viscous friction.
//!
//! ```text
//! g_d = c_d(q, θ) q̇_j + …  for d ≥ 1       c_1 holds the model's inertia of joint j, as a factor of the input     (1)
//! J q̈_j passes through the drive as c_1 q̈_j does, and so does b q̇_j:
//!     f = … + a Σ_d (c_d/c_1) (d/dt)^(d−1) x,   x = q̈_j or q̇_j                                                    (2)
//! column  s Σ_d (c_d/c_1) Σ_k K_{d+1}(k) q_j(k), for friction K_d    a [unit of the input per rad/s² or rad/s]     (3)
//! ```
//!
//! If all inertias of a model have a weight, such as that of a link which hangs from its joint, a
//! rotor makes both wrong. With gears, its inertia counts by the square of their ratio. The
//! amplitude is no share of c_1, because a payload changes the inertia of the link and not that of
//! the rotor.
//!
//! Viscous friction looks like back EMF. If the drive has an inductance L and a resistance R, it
//! also adds (L/R) a to the factor of q̈_j, as an inertia does. On the arm, friction of 0.08 % of
//! the back EMF makes θ₃ 48 % larger. The rows can only show the inductance's part; the back EMF
//! always contains the friction.

use super::kernel::{Kernels, dot};
use super::passes::terms;
use super::present_terms::{has_term, term};
use super::theta_polynomial::MAX_ORDER;
use crate::model::{AnyPlant, MAX_JOINTS};

/// Speed \[rad/s or m/s\] of the central difference for c_d, exact for a term linear in it.
const STEP: f64 = 1e-3;

/// Columns of one equation.
#[derive(Debug, Clone)]
pub(super) struct ThroughDrive {
    equation: usize,
    joint: usize,
    /// c_d/c_1 at d − 1; 0 beyond the equation's order.
    shares: [f64; MAX_ORDER],
    /// |c_1|/s, the model's inertia in units of the amplitude.
    size: f64,
    has_inertia: bool,
    has_friction: bool,
    back_emf: Option<BackEmf>,
}

/// The parameter that multiplies q̇_j, and by how much it changes with b, which acts exactly like
/// it but for the inductance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BackEmf {
    pub parameter: usize,
    pub per_friction: f64,
}

impl BackEmf {
    /// The back EMF \[unit of the input per rad/s or m/s\] at θ.
    pub fn per_speed(&self, theta: &[f64]) -> f64 {
        theta[self.parameter] / self.per_friction
    }
}

impl ThroughDrive {
    /// `None` if the equation has no inertia of its joint, or if the model has parameters that are
    /// nothing but both: the inertia, and the friction without an inductance.
    pub fn new(plant: &dyn AnyPlant, equation: usize) -> Option<Self> {
        let form = &plant.equations()[equation];
        let lacks = |d: usize| form.order >= d && !has_term(plant, equation, d, |_, dq| dq[form.input]);
        let (has_inertia, has_friction) = (lacks(1), form.order > 1 || form.order == 1 && lacks(0));
        if !has_inertia && !has_friction {
            return None;
        }
        let speed = term(plant, equation, 0, |_, dq| dq[form.input]).filter(|_| has_friction);
        let back_emf = speed.map(|(parameter, factor)| BackEmf {
            parameter,
            per_friction: form.input_scale / factor,
        });
        Some(Self {
            equation,
            joint: form.input,
            shares: [0.0; MAX_ORDER],
            size: 0.0,
            has_inertia,
            has_friction,
            back_emf,
        })
    }

    /// True if the model lacks an inertia without weight.
    pub fn has_inertia(&self) -> bool {
        self.has_inertia
    }

    /// True if the model lacks viscous friction, or what it does behind an inductance.
    pub fn has_friction(&self) -> bool {
        self.has_friction
    }

    /// `None` if the model lacks it, or has viscous friction of its own.
    pub fn back_emf(&self) -> Option<BackEmf> {
        self.back_emf
    }

    /// True if the model has a back EMF that viscous friction would be part of.
    pub fn has_back_emf(&self) -> bool {
        self.back_emf.is_some()
    }

    /// The model's inertia of the joint, in units of the amplitude; 0 before the first block.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        self.size = 0.0;
    }

    /// (1) at θ and at the middle of a block of `len` samples; `q` holds positions, joint after
    /// joint.
    pub fn sense(&mut self, plant: &dyn AnyPlant, theta: &[f64], q: &[Vec<f64>], len: usize) {
        let form = &plant.equations()[self.equation];
        let mut place = [0.0; MAX_JOINTS];
        for (place, q) in place.iter_mut().zip(q) {
            *place = q[len / 2];
        }
        let at = |speed: f64| {
            let mut dq = [0.0; MAX_JOINTS];
            dq[self.joint] = speed;
            terms(plant, self.equation, &place, &dq, theta)
        };
        // (1)
        let (forward, backward) = (at(STEP), at(-STEP));
        let slope = |d: usize| (forward[d] - backward[d]) / (2.0 * STEP);
        let inertia = slope(1);
        self.size = (inertia / form.input_scale).abs();
        let shares = self.shares[..form.order].iter_mut();
        (1..).zip(shares).for_each(|(d, share)| *share = slope(d) / inertia);
        if !self.size.is_finite() || self.shares.iter().any(|share| !share.is_finite()) {
            (self.size, self.shares) = (0.0, [0.0; MAX_ORDER]);
        }
    }

    /// (3) of an inertia for the window around a centre.
    pub fn inertia(&self, q: &[Vec<f64>], centre: usize, scale: f64, kernels: &Kernels) -> f64 {
        self.column(2, q, centre, scale, kernels)
    }

    /// (3) of viscous friction for the window around a centre.
    pub fn friction(&self, q: &[Vec<f64>], centre: usize, scale: f64, kernels: &Kernels) -> f64 {
        self.column(1, q, centre, scale, kernels)
    }

    /// (3) with kernels from this derivative on.
    fn column(&self, first: usize, q: &[Vec<f64>], centre: usize, scale: f64, kernels: &Kernels) -> f64 {
        let q = &q[self.joint][centre - kernels.half..=centre + kernels.half];
        let derivatives = kernels.position.iter().skip(first).zip(&self.shares);
        // an equation of a lower order has fewer
        let own = derivatives.filter(|(_, share)| **share != 0.0);
        scale * own.map(|(kernel, share)| share * dot(kernel, q)).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{DriveInput, Manipulator, Motion, ServoAxis};
    use crate::rows::kernel::InputTiming;

    #[test]
    fn val_only_what_no_parameter_stands_for_has_a_column() {
        let arm = Manipulator::default();
        // θ₃ is the inertia of joint 1 and nothing else
        let has = |e: usize| ThroughDrive::new(&arm, e).map(|own| (own.has_inertia(), own.has_friction()));
        assert_eq!((has(0), has(1)), (Some((false, true)), Some((true, true))));
        // its drive has no inductance, so friction is a parameter of its own
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, 35.0).unwrap();
        assert!(ThroughDrive::new(&axis, 0).is_none());
        let back_emf = |e: usize| ThroughDrive::new(&arm, e).and_then(|own| own.back_emf());
        for (equation, parameter) in [(0, 4), (1, 7)] {
            let own = back_emf(equation).unwrap();
            assert!(own.parameter == parameter && (own.per_friction - 1.0).abs() < 1e-6);
        }
    }

    /// q = t³ has q̇ = 3 t², q̈ = 6 t and q⃛ = 6: (3) is 12 (6 t + 6 θ₆/θ₇), for friction
    /// 12 (3 t² + 6 t θ₆/θ₇), as c_2/c_1 = θ₆/θ₇.
    #[test]
    fn val_the_columns_are_acceleration_and_velocity_behind_the_inductance() {
        let (plant, period_s) = (Manipulator::default(), 1e-3);
        let theta = [0.0, 0.0, 0.0, 0.0, 10.0, 0.02, 0.4, 10.0, 1.5];
        let kernels = Kernels::new(20, period_s, 3, InputTiming::Held, 0.0);
        let cubes: Vec<f64> = (0..101).map(|k| (f64::from(k) * period_s).powi(3)).collect();
        let q = [vec![0.0; 101], cubes];
        let mut own = ThroughDrive::new(&plant, 1).unwrap();
        own.sense(&plant, &theta, &q, 101);
        let column = own.inertia(&q, 60, 12.0, &kernels);
        let expected = 12.0 * (6.0 * 0.06 + 6.0 * 0.05);
        assert!((column - expected).abs() < 1e-6 * expected, "{column} {expected}");
        let column = own.friction(&q, 60, 12.0, &kernels);
        // the mean of 3 t² over 41 ms exceeds its value at the centre by less than 2e-4 s²
        let expected = 12.0 * (3.0 * 0.06 * 0.06 + 6.0 * 0.06 * 0.05);
        assert!((column - expected).abs() < 12.0 * 2e-4, "{column} {expected}");
        // 4 θ₇ θ₉ q̈/12
        assert!((own.size() - 4.0 * 0.4 * 1.5 / 12.0).abs() < 1e-12);
    }
}
