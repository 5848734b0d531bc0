//! A plant's equations in the weak form, used for the rows of every block.
//!
//! ```text
//! f_i(θ) = s ∫ψ_i u dt − Σ_d (−1)^d ∫ψ_i^(d) g_d(q, q̇; θ) dt        g = Σ_m μ_m(θ) [Σ_j a_j q̇_j + b_m(q, q̇)]
//! ```
//!
//! with the plant's terms g separated (`separation.rs`), ψ and its derivatives as weights on
//! samples (`kernel.rs`), and the velocity filter. Nothing here changes after construction.

use super::options::{ProjectedError, ProjectedOptions};
use super::velocity_filter::VelocityFilter;
use super::windows::Window;
use crate::model::{AnyPlant, SharedPlant};
use crate::rows::kernel::{Kernels, dot};
use crate::rows::separation::Separation;
use crate::rows::trajectory::Trajectory;
use std::ops::Range;

/// The equations, windows and filter of projected rows.
#[derive(Debug, Clone)]
pub(super) struct WeakForm {
    pub plant: SharedPlant,
    pub options: ProjectedOptions,
    pub separation: Separation,
    pub kernels: Kernels,
    pub velocity: VelocityFilter,
    /// Index of the parameter that is the input's delay.
    pub delay: Option<usize>,
}

impl WeakForm {
    /// Separates the plant's terms and computes the windows' weights. The options must be valid.
    ///
    /// # Errors
    /// If the velocity filter has too few samples.
    pub fn new(plant: SharedPlant, options: ProjectedOptions) -> Result<Self, ProjectedError> {
        let half_width = options.velocity_half_width;
        let velocity = VelocityFilter::new(half_width, options.sample_period_s).ok_or(ProjectedError::Value {
            field: "velocity_half_width",
            expected: "3 to 100",
            got: half_width as f64,
        })?;
        let kernels = Kernels::new(
            options.half(),
            options.sample_period_s,
            highest_order(&*plant) + 1,
            options.timing,
            options.input_delay_s,
        );
        Ok(Self {
            separation: Separation::new(&*plant),
            kernels,
            velocity,
            delay: plant.input_delay(),
            plant,
            options,
        })
    }

    /// Number of equations.
    pub fn equations(&self) -> usize {
        self.separation.equations.len()
    }

    /// Number of positions of each joint that a row depends on, including those in the velocity
    /// filter.
    pub fn support(&self) -> usize {
        2 * (self.kernels.half + self.velocity.half) + 1
    }

    /// Positions of a joint, within the [support](Self::support), that a row depends on: all of
    /// them if the velocity filter is used, otherwise those within the window.
    pub fn span(&self, equation: usize, joint: usize) -> Range<usize> {
        let mut kinds = self.separation.sensitivities[equation].kinds.iter();
        let filtered = kinds.any(|kind| kind.joint == joint && kind.velocity);
        match (filtered, self.moves(equation, joint)) {
            (true, _) => 0..self.support(),
            (false, true) => self.velocity.half..self.support() - self.velocity.half,
            (false, false) => 0..0,
        }
    }

    /// Number of the input of an equation, and its factor s.
    pub fn input(&self, equation: usize) -> (usize, f64) {
        let form = &self.plant.equations()[equation];
        (form.input, form.input_scale)
    }

    /// Number of parameters of an equation.
    #[inline]
    pub fn own(&self, equation: usize) -> usize {
        self.plant.equations()[equation].parameters.len()
    }

    /// True if a joint's position is part of an equation.
    pub fn moves(&self, equation: usize, joint: usize) -> bool {
        let nonlinear = &self.separation.sensitivities[equation];
        let linear = self.separation.equations[equation].iter().flat_map(|p| &p.velocity);
        nonlinear.kinds.iter().any(|kind| kind.joint == joint) || linear.map(|term| term.joint).any(|own| own == joint)
    }

    /// True if an equation depends on where a joint is, not only on how it moves.
    pub fn depends_on_place(&self, equation: usize, joint: usize) -> bool {
        let kinds = &self.separation.sensitivities[equation].kinds;
        kinds.iter().any(|kind| kind.joint == joint && !kind.velocity)
    }

    /// Velocities and features of samples whose neighbours are known.
    pub fn differentiate(&self, signals: &mut Trajectory, samples: Range<usize>) {
        let Trajectory { q, dq, features, .. } = signals;
        for (q, dq) in q.iter().zip(dq.iter_mut()) {
            self.velocity.write(q, samples.clone(), dq);
        }
        let motion = |joint: usize, at: usize| (q[joint][at], dq[joint][at]);
        let put = |feature: usize, at: usize, value: f64| features[feature][at] = value;
        self.separation.extract(&*self.plant, samples, motion, put);
    }

    /// The factors of an equation's monomials \[monomial\]\[window\]; nothing for an equation that
    /// is not a polynomial in θ.
    pub fn project(&self, equation: usize, windows: &[Window], signals: &Trajectory, factors: &mut [Vec<f64>]) {
        let Some(polynomial) = &self.separation.equations[equation] else {
            return;
        };
        let kernels = &self.kernels;
        for (row, window) in windows.iter().enumerate() {
            for column in factors.iter_mut() {
                column[row] = 0.0;
            }
            let span = window.centre - kernels.half..window.centre + kernels.half + 1;
            for term in &polynomial.velocity {
                let weights = &kernels.position[term.derivative + 1];
                factors[term.monomial][row] += term.coefficient * dot(weights, &signals.q[term.joint][span.clone()]);
            }
            for term in &polynomial.features {
                let weights = &kernels.position[term.derivative];
                factors[term.monomial][row] += dot(weights, &signals.features[term.feature][span.clone()]);
            }
        }
    }
}

/// Highest derivative of a term.
pub(super) fn highest_order(plant: &dyn AnyPlant) -> usize {
    plant.equations().iter().map(|e| e.order).max().unwrap_or(0)
}
