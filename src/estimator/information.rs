//! The information Γ⁻¹ of a group, and the rule by which it goes from block to block.

use super::conditioning::LARGEST_CONDITION;
use super::equations::Equations;
use super::error_covariance::clear_entries;
use super::forgetting::{Excitation, Rule};
use super::limits::Limits;
use super::options::EstimatorOptions;
use super::persist::Visit;
use super::workspace::Workspace;

/// The information on n parameters.
#[derive(Debug, Clone)]
pub struct Information {
    n: usize,
    /// Γ⁻¹, n × n.
    matrix: Vec<f64>,
    rule: Rule,
    /// Condition number of the column-scaled Γ⁻¹.
    condition: f64,
}

impl Information {
    /// No information, with the rule of validated options.
    pub fn new(options: &EstimatorOptions, n: usize) -> Self {
        Self {
            n,
            matrix: vec![0.0; n * n],
            rule: Rule::new(options, n),
            condition: 1.0,
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.matrix);
    }

    /// Adopts λ and ε.
    pub fn retune(&mut self, options: &EstimatorOptions) {
        self.rule.retune(options);
    }

    /// Forgets the condition of the last block.
    pub fn forget_condition(&mut self) {
        self.condition = 1.0;
    }

    /// Leaves the information `floor` on parameter i, not correlated with the others.
    pub fn forget_parameter(&mut self, i: usize, floor: f64) {
        clear_entries(self.n, &mut self.matrix, i, floor);
    }

    /// Γ⁻¹, n × n.
    pub fn matrix(&self) -> &[f64] {
        &self.matrix
    }

    /// Condition number of the column-scaled Γ⁻¹.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// True if Γ⁻¹ was near singular, so that it had to be changed.
    pub fn was_repaired(&self) -> bool {
        self.condition > LARGEST_CONDITION
    }

    /// True if Γ⁻¹ is symmetric and positive definite.
    pub fn is_sound(&self, room: &mut Workspace) -> bool {
        let (n, m) = (self.n, &self.matrix);
        let symmetric = (0..n).all(|i| (0..i).all(|j| m[i * n + j] == m[j * n + i]));
        symmetric && room.cholesky.factor(n, m)
    }

    /// Writes Λ, which forgetting leaves of Γ⁻¹, to `prior`.
    pub fn carry(&mut self, excitation: &Excitation, prior: &mut [f64]) {
        self.rule.prior(self.n, &self.matrix, excitation, prior);
    }

    /// Γ_m⁻¹ of (9) or (10) from Λ + S, in place.
    pub fn bound(&mut self, sum: &mut [f64]) {
        self.rule.posterior(self.n, sum);
    }

    /// Takes the sums of a block with the prior Λ.
    pub fn update(&mut self, prior: &[f64], equations: &Equations, room: &mut Workspace) {
        self.matrix.copy_from_slice(prior);
        equations.add_grams(&mut self.matrix); // (9), first line of (10)
        self.rule.posterior(self.n, &mut self.matrix); // second line of (10)
        self.condition = room.repair(&mut self.matrix);
    }

    /// Takes what is known in place of Γ⁻¹.
    pub fn replace(&mut self, known: &[f64], room: &mut Workspace) {
        self.matrix.copy_from_slice(known);
        self.condition = room.repair(&mut self.matrix);
    }

    /// The same for the free parameters alone. A fixed one keeps its own information, uncorrelated
    /// with the others.
    pub fn replace_free(&mut self, known: &[f64], limits: &Limits) {
        for i in limits.free() {
            for j in limits.free() {
                self.matrix[i * self.n + j] = known[i * self.n + j];
            }
        }
    }
}
