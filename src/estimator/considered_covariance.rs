//! What considered errors add to a covariance.
//!
//! ```text
//! P_pub = P + T M Tᵀ + D          all errors                                   (d) of considered.rs
//! W     = P + T_W M_W T_Wᵀ        without drifts and errors that contradict relations between parameters
//! ```
//!
//! D is diagonal: the variance due to errors that act exactly like a parameter, such as viscous
//! friction b, which is R b/kₘ more back EMF. No rows tell them apart, so D never shrinks.
//!
//! W weighs the parameters if a relation is imposed on them (`relation.rs`). How far a moving
//! parameter may lag, or how far viscous friction may have pushed θ₃ off θ₁ θ₄/θ₂, is no measure of
//! how well the data determine it. If W contained such an error, what noise does to the relation
//! would be taken for that error, and every parameter that the error changes would be moved. With
//! viscous friction in W, the error of θ₅ of an arm without friction was 7 times its Cramér–Rao
//! bound in multisine motion.

use super::considered::Considered;
use super::linalg::dot;

impl Considered {
    /// The error that widens parameter i most, and the sum of the variances that the errors with
    /// columns add one by one, without their correlations and without drifts.
    pub fn leading(&self, i: usize) -> Option<(usize, f64)> {
        let room = self.room();
        let widening = |s: usize| self.moments[s * room + s] * self.sensitivity[s * self.n + i].powi(2);
        let leading = (0..self.known).max_by(|&a, &b| widening(a).total_cmp(&widening(b)));
        leading.map(|s| (s, (0..self.known).map(widening).sum()))
    }

    /// T of the error that changes a relation of value ρ and gradient a most, of those that
    /// contradict relations, and its amplitude if it causes all of ρ. Friction has a positive one.
    pub fn against(&self, a: &[f64], rho: f64) -> Option<(&[f64], f64)> {
        let of = |s: usize| &self.sensitivity[s * self.n..(s + 1) * self.n];
        let effects = (0..self.known).filter(|s| self.contradicting[*s]).map(of);
        let slopes = effects.map(|effect| (effect, dot(a, effect)));
        let (effect, slope) = slopes.max_by(|x, y| x.1.abs().total_cmp(&y.1.abs()))?;
        let amplitude = rho / slope;
        (amplitude.is_finite() && amplitude > 0.0).then_some((effect, amplitude))
    }

    /// Adds T_W M_W T_Wᵀ.
    pub fn widen_weights(&mut self, covariance: &mut [f64]) {
        self.widen_by(self.known, true, covariance);
    }

    /// Adds T M Tᵀ of (d), and D.
    pub fn widen(&mut self, covariance: &mut [f64]) {
        self.widen_by(self.count, false, covariance);
        for (i, variance) in self.inseparable.iter().enumerate() {
            covariance[i * self.n + i] += variance;
        }
    }

    fn widen_by(&mut self, count: usize, agreeing: bool, covariance: &mut [f64]) {
        let (n, room) = (self.n, self.room());
        let counts = |s: &usize| !(agreeing && self.contradicting[*s]);
        for s in (0..count).filter(counts) {
            // (M Tᵀ)_s
            self.vector.fill(0.0);
            for r in (0..count).filter(counts) {
                let (moment, t) = (self.moments[s * room + r], &self.sensitivity[r * n..(r + 1) * n]);
                if moment != 0.0 {
                    self.vector.iter_mut().zip(t).for_each(|(v, t)| *v += moment * t);
                }
            }
            let t = &self.sensitivity[s * n..(s + 1) * n];
            for i in 0..n {
                for j in 0..n {
                    covariance[i * n + j] += t[i] * self.vector[j];
                }
            }
        }
    }
}
