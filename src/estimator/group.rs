//! One independent least squares problem: the parameters of a connected group of equations, block by block.
//!
//! ```text
//! θ̂_m = argmin Σ w f_n(θ)² + (θ − θ̄)ᵀ Λ (θ − θ̄)        θ̄ = θ̂_{m−1}, Λ from the forgetting rule      (6)
//! δ   = (Λ + S)⁻¹ (g − Λ (θ − θ̄))                       S = Σ w φφᵀ, g = Σ w φ f at the present θ     (8)
//! Γ_m⁻¹ = Λ + S                                                                                      (9)
//! ```
//!
//! With one iteration from θ = θ̄ this is (8) as it stands. With more, θ is linearised anew at each iteration while the prior
//! stays frozen, so that an old linearisation at a bad estimate leaves nothing in the information. A step is the
//! minimiser of the quadratic model in a box, the bounds and a factor `step_factor` per positive parameter, and is halved until
//! the total cost, prior included, falls.
//!
//! # Covariance
//! θ̂ is a linear function of what came before: with K = Γ_m and A = I − K S the error obeys e_m = A e_{m−1} + K Σ φ n, whatever
//! the forgetting rule. So its covariance is carried along as it is (Joseph's form):
//!
//! ```text
//! P ← A P Aᵀ + K (Σ_e σ_e² S_e) K
//! ```
//!
//! For exponential forgetting this is the sandwich Γ M Γ with M ← λ² M + S; it is kept per equation for unit noise, so that the
//! noise levels can be estimated all along, and apart for the start value.

use super::constrained::ConstrainedStep;
use super::forgetting::{Excitation, Rule};
use super::linalg::{Cholesky, Eigen, RANK_TOLERANCE, congruence, mul, mul_vec};
use super::options::EstimatorOptions;
use super::pass::{Loss, Sums, accumulate};
use super::{Group, Residuals, Structure};
use std::ops::Range;

/// An equation as its group sees it.
#[derive(Debug, Clone)]
pub struct EquationState {
    /// Index in the structure.
    pub index: usize,
    /// Its parameters among all.
    pub own: Range<usize>,
    /// Its first parameter in the group.
    offset: usize,
    divisor: f64,
    floor: f64,
    /// Forgotten sum of squares and degrees of freedom of the residuals.
    spread: f64,
    freedom: f64,
    /// Σ ρ(f) at θ̄.
    pub innovation_cost: f64,
    /// Noise variance of the divided rows, as used.
    pub variance: f64,
    /// Covariance caused by this equation's noise of unit variance, n × n.
    noise_covariance: Vec<f64>,
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Iterations made.
    pub iterations: u32,
    /// False where the iterations ran out.
    pub converged: bool,
}

/// The state of a group.
#[derive(Debug, Clone)]
pub struct GroupState {
    pub parameters: Range<usize>,
    pub n: usize,
    pub equations: Vec<EquationState>,
    /// Γ⁻¹, n × n.
    pub information: Vec<f64>,
    /// Covariance of the error that the start values caused, n × n.
    start_covariance: Vec<f64>,
    /// σ²-weighted total, n × n.
    pub covariance: Vec<f64>,
    pub fixed: Vec<bool>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    start_std: Vec<f64>,
    pub excitation: Excitation,
    /// Condition number of the column-scaled information.
    pub condition: f64,
    prior: Vec<f64>,
    centre: Vec<f64>,
    pub at: Vec<Sums>,
    trial: Vec<Sums>,
    // workspaces
    step: ConstrainedStep,
    rule: Rule,
    cholesky: Cholesky,
    eigen: Eigen,
    total: Vec<f64>,
    gain: Vec<f64>,
    transition: Vec<f64>,
    work: Vec<f64>,
    work2: Vec<f64>,
    gradient: Vec<f64>,
    offset: Vec<f64>,
    box_lower: Vec<f64>,
    box_upper: Vec<f64>,
    scale: Vec<f64>,
    free: Vec<bool>,
}

impl GroupState {
    /// The start state of validated options.
    pub fn new(group: &Group, structure: &Structure, options: &EstimatorOptions) -> Self {
        let parameters = group.parameters.clone();
        let n = parameters.len();
        let equations: Vec<EquationState> = group
            .equations
            .iter()
            .map(|&index| {
                let own = structure.equations[index].clone();
                EquationState {
                    index,
                    offset: own.start - parameters.start,
                    own,
                    divisor: options.noise_std[index],
                    floor: options.noise_floor[index],
                    spread: 0.0,
                    freedom: 0.0,
                    innovation_cost: 0.0,
                    variance: 0.0,
                    noise_covariance: vec![0.0; n * n],
                }
            })
            .collect();
        let sums: Vec<Sums> = equations.iter().map(|e| Sums::new(e.own.len())).collect();
        let mut state = Self {
            n,
            information: vec![0.0; n * n],
            start_covariance: vec![0.0; n * n],
            covariance: vec![0.0; n * n],
            fixed: options.fixed[parameters.clone()].to_vec(),
            lower: options.lower[parameters.clone()].to_vec(),
            upper: options.upper[parameters.clone()].to_vec(),
            start_std: options.start_std[parameters.clone()].to_vec(),
            excitation: Excitation::new(n),
            condition: 1.0,
            prior: vec![0.0; n * n],
            centre: vec![0.0; n],
            at: sums.clone(),
            trial: sums,
            step: ConstrainedStep::new(n),
            rule: Rule::new(options, n),
            cholesky: Cholesky::new(n),
            eigen: Eigen::new(n),
            total: vec![0.0; n * n],
            gain: vec![0.0; n * n],
            transition: vec![0.0; n * n],
            work: vec![0.0; n * n],
            work2: vec![0.0; n * n],
            gradient: vec![0.0; n],
            offset: vec![0.0; n],
            box_lower: vec![0.0; n],
            box_upper: vec![0.0; n],
            scale: vec![0.0; n],
            free: vec![true; n],
            parameters,
            equations,
        };
        for i in 0..n {
            state.forget_parameter(i, options.information_floor);
        }
        state
    }

    /// Puts parameter i back to what is known at the start: information ε, no correlation.
    pub fn forget_parameter(&mut self, i: usize, floor: f64) {
        let n = self.n;
        let clear = |m: &mut [f64], diagonal: f64| {
            for k in 0..n {
                m[i * n + k] = 0.0;
                m[k * n + i] = 0.0;
            }
            m[i * n + i] = diagonal;
        };
        clear(&mut self.information, floor);
        let variance = if self.fixed[i] {
            0.0
        } else {
            self.start_std[i] * self.start_std[i]
        };
        clear(&mut self.start_covariance, variance);
        clear(&mut self.covariance, variance);
        for e in &mut self.equations {
            clear(&mut e.noise_covariance, 0.0);
        }
    }

    /// Takes the block: moves θ̂ within `theta` (all parameters of the plant). False where the rows are not finite at the
    /// present estimate, and nothing changes then.
    pub fn update<R: Residuals>(&mut self, rows: &R, theta: &mut [f64], options: &EstimatorOptions) -> Option<Fit> {
        let range = 0..rows.len();
        if !evaluate(rows, range.clone(), theta, &self.equations, &mut self.at) {
            return None;
        }
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            e.innovation_cost = sums.cost;
        }
        self.set_variances(options);
        self.excite(theta);
        self.rule
            .prior(self.n, &self.information, &self.excitation, &mut self.prior);
        let fit = if options.max_iterations == 1 {
            self.single_step(theta);
            Fit {
                iterations: 1,
                converged: true,
            }
        } else {
            self.fit(rows, range.clone(), theta, options)
        };
        self.conclude();
        if options.max_iterations == 1 {
            // the sums so far belong to θ̄, as (9) has them; the residual after the step is evidence only
            if evaluate(rows, range, theta, &self.equations, &mut self.trial) {
                std::mem::swap(&mut self.at, &mut self.trial);
            }
        }
        self.learn_noise(options);
        self.total_covariance();
        Some(fit)
    }

    /// (8) as it stands: δ = Γ_m Σ φ f, with Γ_m of the forgetting rule.
    fn single_step(&mut self, theta: &mut [f64]) {
        let n = self.n;
        self.centre.copy_from_slice(&theta[self.parameters.clone()]);
        self.total.copy_from_slice(&self.prior);
        add_grams(n, &self.equations, &self.at, &mut self.total);
        self.rule.posterior(n, &mut self.total);
        self.gradient.fill(0.0);
        add_scores(&self.equations, &self.at, &mut self.gradient);
        self.set_box(f64::INFINITY);
        self.step
            .solve(&self.total, &self.gradient, &self.box_lower, &self.box_upper);
        for (i, delta) in self.step.delta().iter().enumerate() {
            theta[self.parameters.start + i] = self.centre[i] + delta;
        }
    }

    /// Gauss–Newton with the prior frozen, from θ = θ̄; `at` holds the sums there, and at the result afterwards.
    fn fit<R: Residuals>(
        &mut self,
        rows: &R,
        range: Range<usize>,
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> Fit {
        let n = self.n;
        let start = self.parameters.start;
        self.centre.copy_from_slice(&theta[self.parameters.clone()]);
        let slack = self.rounding();
        let mut cost = self.cost(theta);
        let mut fit = Fit {
            iterations: 0,
            converged: false,
        };
        while (fit.iterations as usize) < options.max_iterations {
            self.total.copy_from_slice(&self.prior);
            add_grams(n, &self.equations, &self.at, &mut self.total);
            self.gradient.fill(0.0);
            add_scores(&self.equations, &self.at, &mut self.gradient);
            for i in 0..n {
                self.offset[i] = theta[start + i] - self.centre[i];
            }
            mul_vec(n, &self.prior, &self.offset, &mut self.work[..n]);
            for i in 0..n {
                self.gradient[i] -= self.work[i];
                self.scale[i] = theta[start + i];
            }
            self.set_box_at(options.step_factor);
            self.step
                .solve(&self.total, &self.gradient, &self.box_lower, &self.box_upper);
            if self.is_small(theta) {
                fit.converged = true;
                break;
            }
            fit.iterations += 1;
            let mut fraction = 1.0;
            let mut accepted = false;
            for _ in 0..HALVINGS {
                for i in 0..n {
                    let moved = self.scale[i] + fraction * self.step.delta()[i];
                    theta[start + i] = moved.clamp(self.lower[i], self.upper[i]);
                }
                if evaluate(rows, range.clone(), theta, &self.equations, &mut self.trial) {
                    let candidate = self.trial_cost(theta);
                    if candidate <= cost + slack {
                        cost = candidate;
                        accepted = true;
                        std::mem::swap(&mut self.at, &mut self.trial);
                        break;
                    }
                }
                fraction *= 0.5;
            }
            if !accepted {
                // no descent to be had beyond rounding
                theta[self.parameters.clone()].copy_from_slice(&self.scale);
                fit.converged = true;
                break;
            }
        }
        fit
    }

    // a step that is small beside every parameter, or beside the deviation of the estimate
    fn is_small(&self, theta: &[f64]) -> bool {
        let delta = self.step.delta();
        let own = &theta[self.parameters.clone()];
        let relative = delta.iter().zip(own).all(|(d, t)| d.abs() <= 1e-12 * t.abs());
        let decrement: f64 = delta.iter().zip(&self.gradient).map(|(d, g)| d * g).sum();
        // the decrement is the squared length of the step in standard deviations, times σ²
        relative || decrement <= 1e-8 * self.variance()
    }

    // what the cost can change by rounding alone
    fn rounding(&self) -> f64 {
        self.at.iter().map(|s| 1e-28 * s.size).sum()
    }

    fn cost(&self, theta: &[f64]) -> f64 {
        self.at.iter().map(|s| s.cost).sum::<f64>() + self.prior_cost(theta)
    }

    fn trial_cost(&self, theta: &[f64]) -> f64 {
        self.trial.iter().map(|s| s.cost).sum::<f64>() + self.prior_cost(theta)
    }

    fn prior_cost(&self, theta: &[f64]) -> f64 {
        let n = self.n;
        let d = |i: usize| theta[self.parameters.start + i] - self.centre[i];
        (0..n)
            .map(|i| d(i) * (0..n).map(|j| self.prior[i * n + j] * d(j)).sum::<f64>())
            .sum()
    }

    fn set_box(&mut self, factor: f64) {
        self.scale.copy_from_slice(&self.centre);
        self.set_box_at(factor);
    }

    // the room of a step from the point in `scale`
    fn set_box_at(&mut self, factor: f64) {
        for i in 0..self.n {
            let (from, lower, upper) = (self.scale[i], self.lower[i], self.upper[i]);
            let (mut down, mut up) = (lower - from, upper - from);
            if lower >= 0.0 && from > 0.0 && factor.is_finite() {
                down = down.max(from / factor - from);
                up = up.min(from * factor - from);
            }
            if self.fixed[i] {
                (down, up) = (0.0, 0.0);
            }
            (self.box_lower[i], self.box_upper[i]) = (down.min(0.0), up.max(0.0));
        }
    }

    /// Γ_m⁻¹ and the covariance from the prior and the sums in `at`.
    fn conclude(&mut self) {
        let n = self.n;
        self.information.copy_from_slice(&self.prior);
        add_grams(n, &self.equations, &self.at, &mut self.information);
        self.rule.posterior(n, &mut self.information);
        self.repair();
        // K: the inverse over the free parameters
        let mut free = 0;
        for i in 0..n {
            if !self.fixed[i] {
                free += 1;
            }
        }
        let index = |skip: &[bool], k: usize| (0..n).filter(|&i| !skip[i]).nth(k).unwrap_or(0);
        if free == n {
            self.cholesky.factor(n, &self.information);
            self.cholesky.inverse(&mut self.gain, &mut self.work);
        } else {
            for a in 0..free {
                for b in 0..free {
                    self.work[a * free + b] = self.information[index(&self.fixed, a) * n + index(&self.fixed, b)];
                }
            }
            self.gain.fill(0.0);
            if free > 0 && self.cholesky.factor(free, &self.work[..free * free]) {
                self.cholesky.inverse(&mut self.work2, &mut self.work);
                for a in 0..free {
                    for b in 0..free {
                        self.gain[index(&self.fixed, a) * n + index(&self.fixed, b)] = self.work2[a * free + b];
                    }
                }
            }
        }
        // A = I − K S
        self.total.fill(0.0);
        add_grams(n, &self.equations, &self.at, &mut self.total);
        mul(n, &self.gain, &self.total, &mut self.transition);
        for (k, v) in self.transition.iter_mut().enumerate() {
            *v = if k % (n + 1) == 0 { 1.0 - *v } else { -*v };
        }
        congruence(
            n,
            &self.transition,
            &self.start_covariance,
            &mut self.work2,
            &mut self.work,
        );
        self.start_covariance.copy_from_slice(&self.work2);
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            congruence(
                n,
                &self.transition,
                &e.noise_covariance,
                &mut self.work2,
                &mut self.work,
            );
            e.noise_covariance.copy_from_slice(&self.work2);
            self.total.fill(0.0);
            add_gram(n, e, sums, &mut self.total);
            congruence(n, &self.gain, &self.total, &mut self.work2, &mut self.work);
            e.noise_covariance
                .iter_mut()
                .zip(&self.work2)
                .for_each(|(p, v)| *p += v);
        }
    }

    // Keeps the information positive definite to rounding: a block of identical samples adds 1e12 in one direction to 1e-6 in the
    // others, of which a sum of doubles keeps nothing.
    fn repair(&mut self) {
        let n = self.n;
        for i in 0..n {
            self.scale[i] = self.information[i * n + i].max(f64::MIN_POSITIVE).sqrt();
        }
        for i in 0..n {
            for j in 0..n {
                self.work[i * n + j] = self.information[i * n + j] / (self.scale[i] * self.scale[j]);
            }
        }
        self.eigen.decompose(n, &self.work);
        let values = &mut self.eigen.values[..n];
        let largest = values.iter().fold(0.0, |a: f64, &b| a.max(b));
        let smallest = values.iter().fold(f64::INFINITY, |a: f64, &b| a.min(b));
        let least = 100.0 * RANK_TOLERANCE * largest;
        self.condition = if smallest > 0.0 {
            largest / smallest
        } else {
            f64::INFINITY
        };
        if smallest >= least {
            return;
        }
        values.iter_mut().for_each(|v| *v = v.max(least));
        for i in 0..n {
            for j in 0..=i {
                let v: f64 = (0..n)
                    .map(|k| self.eigen.vectors[i * n + k] * self.eigen.values[k] * self.eigen.vectors[j * n + k])
                    .sum();
                let v = v * self.scale[i] * self.scale[j];
                self.information[i * n + j] = v;
                self.information[j * n + i] = v;
            }
        }
    }

    // noise variances for this block's decisions: what was learnt, else what this block allows, never below the floor
    fn set_variances(&mut self, options: &EstimatorOptions) {
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            let size = if sums.rows > 0 {
                sums.size / sums.rows as f64
            } else {
                0.0
            };
            let floor = (e.floor * e.floor).max(options.noise_floor_relative.powi(2) * size);
            let learnt = if e.freedom > 0.0 { e.spread / e.freedom } else { 0.0 };
            e.variance = learnt.max(floor);
        }
    }

    fn learn_noise(&mut self, options: &EstimatorOptions) {
        let lambda = options.forgetting_factor;
        for (e, sums) in self.equations.iter_mut().zip(&self.at) {
            // each equation is charged the parameters that it informs on
            let freedom = sums.rows as f64 - e.own.len() as f64;
            if freedom > 0.0 {
                e.spread = lambda * e.spread + sums.cost;
                e.freedom = lambda * e.freedom + freedom;
            }
        }
        self.set_variances(options);
    }

    fn variance(&self) -> f64 {
        let rows: f64 = self.at.iter().map(|s| s.rows as f64).sum();
        let sum: f64 = self
            .equations
            .iter()
            .zip(&self.at)
            .map(|(e, s)| e.variance * s.rows as f64)
            .sum();
        if rows > 0.0 { sum / rows } else { 0.0 }
    }

    fn excite(&mut self, theta: &[f64]) {
        let n = self.n;
        self.total.fill(0.0);
        add_grams(n, &self.equations, &self.at, &mut self.total);
        for i in 0..n {
            let size = theta[self.parameters.start + i].abs().max(self.start_std[i]);
            self.scale[i] = if size > 0.0 { size } else { 1.0 };
            self.free[i] = !self.fixed[i];
        }
        self.excitation
            .analyse(&self.total, &self.scale, &self.free, self.variance());
    }

    fn total_covariance(&mut self) {
        self.covariance.copy_from_slice(&self.start_covariance);
        for e in &self.equations {
            for (c, p) in self.covariance.iter_mut().zip(&e.noise_covariance) {
                *c += e.variance * p;
            }
        }
    }
}

/// How often a step is halved before the fit gives up.
const HALVINGS: usize = 20;

/// Sums of every equation at θ; false where something is not finite.
fn evaluate<R: Residuals>(
    rows: &R,
    range: Range<usize>,
    theta: &[f64],
    equations: &[EquationState],
    sums: &mut [Sums],
) -> bool {
    let mut finite = true;
    for (e, sums) in equations.iter().zip(sums) {
        accumulate(
            rows,
            e.index,
            range.clone(),
            theta,
            e.own.clone(),
            e.divisor,
            Loss::Square,
            sums,
        );
        finite &= sums.is_finite();
    }
    finite
}

fn add_gram(n: usize, e: &EquationState, sums: &Sums, matrix: &mut [f64]) {
    let p = sums.params;
    for i in 0..p {
        for j in 0..p {
            matrix[(e.offset + i) * n + e.offset + j] += sums.gram[i * p + j];
        }
    }
}

fn add_grams(n: usize, equations: &[EquationState], sums: &[Sums], matrix: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        add_gram(n, e, sums, matrix);
    }
}

fn add_scores(equations: &[EquationState], sums: &[Sums], gradient: &mut [f64]) {
    for (e, sums) in equations.iter().zip(sums) {
        for (g, s) in gradient[e.offset..].iter_mut().zip(&sums.score) {
            *g += s;
        }
    }
}
