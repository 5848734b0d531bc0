//! Gauss–Newton on one block with the prior frozen.
//!
//! ```text
//! J(θ) = Σ ρ(f_n(θ)) + (θ − θ̄)ᵀ Λ (θ − θ̄)    (6) of one block, its past as Λ
//! δ    = argmin ½ δᵀ (Λ + S) δ − (g − Λ (θ − θ̄))ᵀ δ       in a box
//! ```
//!
//! If the rows contain products of parameters, d(θ) and T of `curvature.rs` take the place of θ − θ̄
//! and I.
//!
//! One iteration from θ = θ̄ is exactly (8). With more, the rows are linearised again at each
//! iteration while the prior stays frozen, so an early linearisation at a bad estimate leaves
//! nothing in the information. The box is the bounds and a factor `step_factor` per positive
//! parameter and iteration: without it, a far start follows the curved valley of the products θ₆θ₉
//! and θ₇θ₉ and takes 15 steps instead of 6. A step is halved until the cost falls.

use super::group::GroupState;
use super::linalg::dot;
use super::options::{EstimatorOptions, Outliers};
use super::pass::{Summable, Sums};
use std::ops::Range;

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Number of iterations.
    pub iterations: u32,
    /// False if the iterations ran out.
    pub converged: bool,
}

impl Fit {
    /// Combines two fits.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            iterations: self.iterations.max(other.iterations),
            converged: self.converged & other.converged,
        }
    }
}

/// How often a step is halved before the fit gives up.
const HALVINGS: usize = 20;

impl GroupState {
    /// Exactly (8): δ = Γ_m Σ φ f, with Γ_m of the forgetting rule.
    pub fn single_step(&mut self, theta: &mut [f64]) {
        self.room.total.copy_from_slice(self.prior.information());
        self.equations.add_grams(&mut self.room.total);
        self.information.bound(&mut self.room.total); // Γ_m⁻¹ of (9) or (10)
        self.room.gradient.fill(0.0);
        self.equations.add_scores(&mut self.room.gradient); // Σ φ f of (8)
        self.room.scale.copy_from_slice(self.prior.centre());
        self.set_box(f64::INFINITY);
        let room = &self.room;
        self.step.solve(&room.total, &room.gradient, &room.lower, &room.upper); // Γ_m Σ φ f
        for (i, delta) in self.step.delta().iter().enumerate() {
            theta[self.parameters.start + i] = self.prior.centre()[i] + delta; // (8)
        }
    }

    /// Minimises the cost over the rows of `range`, starting from the present θ. The equations'
    /// sums are those there before, and those at the result afterwards.
    pub fn fit(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> Fit {
        let mut cost = self.cost(self.equations.at(), theta);
        let mut fit = Fit {
            iterations: 0,
            converged: false,
        };
        // a gate has many optima: it closes only near the optimum of Huber's function, which has
        // one
        let mut closed = !matches!(options.outliers, Outliers::Gate(_));
        while (fit.iterations as usize) < options.max_iterations {
            if options.outliers != Outliers::Keep {
                self.equations
                    .limit_outliers(rows, range.clone(), theta, closed, options);
                cost = self.cost(self.equations.at(), theta);
            }
            if self.tally.is_empty() {
                // before the first block there is no knowledge: ε keeps unexcited directions in
                // place, as in Levenberg's method, but the guess itself does not attract
                self.prior.centre_at(&theta[self.parameters.clone()]);
                cost = self.cost(self.equations.at(), theta);
            }
            self.model(theta);
            self.set_box(options.step_factor);
            let room = &self.room;
            self.step.solve(&room.total, &room.gradient, &room.lower, &room.upper);
            if !closed
                && (self.decrement() <= self.equations.variance()
                    || fit.iterations as usize + 3 >= options.max_iterations)
            {
                closed = true;
                continue;
            }
            if self.is_small(theta) {
                fit.converged = true;
                break;
            }
            fit.iterations += 1;
            if let Some(lower) = self.descend(rows, range.clone(), theta, cost) {
                cost = lower;
            } else if closed {
                fit.converged = true;
                break;
            } else {
                closed = true;
            }
        }
        fit
    }

    /// Takes the step, halved until the cost is no higher than `cost`; returns the new cost. `None`
    /// if only rounding is left to gain: then θ keeps its value.
    fn descend(&mut self, rows: &dyn Summable, range: Range<usize>, theta: &mut [f64], cost: f64) -> Option<f64> {
        let slack = self.equations.rounding();
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            let step = |i: usize| fraction * self.step.delta()[i];
            let clamp = |i: usize, value: f64| self.limits.clamp(i, value);
            let own = &mut theta[self.parameters.clone()];
            self.prior.curvature.step(&self.room.scale, step, clamp, own);
            if self.equations.evaluate_trial(rows, range.clone(), theta) {
                let candidate = self.cost(self.equations.trial(), theta);
                if candidate <= cost + slack {
                    self.equations.accept_trial();
                    return Some(candidate);
                }
            }
            fraction *= 0.5;
        }
        theta[self.parameters.clone()].copy_from_slice(&self.room.scale);
        None
    }

    /// The quadratic model at θ: Tᵀ Λ T + S and g − Tᵀ Λ d; θ itself goes to `scale`.
    fn model(&mut self, theta: &[f64]) {
        let (own, room) = (&theta[self.parameters.clone()], &mut self.room);
        self.prior.expand(own, room);
        self.equations.add_grams(&mut room.total);
        room.scale.copy_from_slice(own);
        self.equations.add_scores(&mut room.gradient);
    }

    /// True if the step is small relative to every parameter, or to the standard deviation of the
    /// estimate.
    fn is_small(&self, theta: &[f64]) -> bool {
        let delta = self.step.delta();
        let own = &theta[self.parameters.clone()];
        let relative = delta.iter().zip(own).all(|(d, t)| d.abs() <= 1e-12 * t.abs());
        relative || self.decrement() <= 1e-8 * self.equations.variance()
    }

    /// δᵀ(g − …), the squared length of the step in standard deviations, times σ².
    fn decrement(&self) -> f64 {
        dot(self.step.delta(), &self.room.gradient)
    }

    fn cost(&self, sums: &[Sums], theta: &[f64]) -> f64 {
        let own = &theta[self.parameters.clone()];
        sums.iter().map(|s| s.cost).sum::<f64>() + self.prior.cost(own) // (6), its past as Λ
    }

    /// The box of a step from the point in `scale`.
    fn set_box(&mut self, factor: f64) {
        for i in 0..self.n {
            let from = self.room.scale[i];
            let (mut down, mut up) = self.limits.reach(i, from);
            if self.prior.curvature.is_factor(i) && from > 0.0 && factor.is_finite() {
                // θ_b/f while θ_a grows by f
                (down, up) = (from * (1.0 - factor), from * (factor - 1.0));
            } else if self.limits.is_never_negative(i) && from > 0.0 && factor.is_finite() {
                down = down.max(from / factor - from);
                // a parameter that noise has driven to zero can return to its usual size in one
                // step
                up = up.min((from * factor).max(self.prior.centre()[i]).max(self.sizes.stated(i)) - from);
            }
            if !self.limits.is_free(i) {
                (down, up) = (0.0, 0.0);
            }
            (self.room.lower[i], self.room.upper[i]) = (down.min(0.0), up.max(0.0));
        }
    }
}
