//! The pointwise form of any plant by automatic differentiation.
//!
//! ```text
//! f_e(θ) = s_e u_e − Σ_d (d/dt)^d g_{e,d}(q, q̇; θ)      φ_e = −∂f_e/∂θ = Σ_d (d/dt)^d ∂g_{e,d}/∂θ
//! ```
//!
//! Time derivatives come from numbers that carry a value with its first and second derivative: the
//! arguments are q = (q, q̇, q̈) and q̇ = (q̇, q̈, q⃛), so every term has derivatives up to
//! (d/dt)². Derivatives in θ come from dual numbers inside these, one parameter at a time, so sizes
//! need not be known at compile time and nothing is allocated.

use super::{AutoDiff, JointSample, MAX_JOINTS, MAX_PARAMS, Plant, PointwiseModel};
use num_dual::{Dual2, Dual64};

/// A value with its first two time derivatives, each with its derivative in one parameter.
type Series = Dual2<Dual64>;

/// Highest time derivative available from a sample with q, q̇, q̈, q⃛.
const MAX_ORDER: usize = 2;

fn constant(value: f64) -> Series {
    Dual2::from_re(Dual64::from(value))
}

impl<P: Plant> PointwiseModel for AutoDiff<P> {
    type Features = JointSample;

    fn features(&self, sample: &JointSample) -> JointSample {
        *sample
    }

    /// See [`PointwiseModel::row`]. The equation's order must be at most 2: samples have no
    /// derivative beyond the jerk.
    fn row(&self, equation: usize, sample: &JointSample, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let plant = &self.0;
        let joints = plant.joints();
        let form = &plant.equations()[equation];
        debug_assert!(
            form.order <= MAX_ORDER,
            "equation {} needs derivatives that samples do not carry",
            form.name
        );

        let mut q = [constant(0.0); MAX_JOINTS];
        let mut dq = [constant(0.0); MAX_JOINTS];
        for joint in 0..joints {
            let [q0, q1, q2, q3] = [sample.q[joint], sample.dq[joint], sample.ddq[joint], sample.dddq[joint]];
            q[joint] = Dual2::new(q0.into(), q1.into(), q2.into());
            dq[joint] = Dual2::new(q1.into(), q2.into(), q3.into());
        }
        let mut dual_theta = [constant(0.0); MAX_PARAMS];
        for (dual, &value) in dual_theta.iter_mut().zip(theta) {
            dual.re.re = value;
        }

        let mut sum = Dual64::from(0.0);
        for (slot, parameter) in form.parameters.clone().enumerate() {
            dual_theta[parameter].re.eps = 1.0;
            let mut g = [constant(0.0); MAX_ORDER + 1];
            plant.terms(
                equation,
                &q[..joints],
                &dq[..joints],
                &dual_theta[..theta.len()],
                &mut g[..=form.order],
            );
            // (d/dt)^0 g₀ + d/dt g₁ + d²/dt² g₂
            sum = g[0].re + g[1].v1 + g[2].v2;
            regressor[slot] = sum.eps;
            dual_theta[parameter].re.eps = 0.0;
        }
        form.input_scale * sample.input[form.input] - sum.re
    }
}
