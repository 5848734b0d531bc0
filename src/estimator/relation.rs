//! Relations between parameters: equal ratios, imposed on the published estimate.
//!
//! ```text
//! ρ(θ) = θ_i θ_l − θ_j θ_k = 0                     θ_i/θ_j = θ_k/θ_l
//! θ_M  = argmin (θ − θ̂)ᵀ M⁻¹ (θ − θ̂) with ρ(θ) = 0
//!      : θ ← θ̂ − M a (ρ(θ) + aᵀ(θ̂ − θ)) / (aᵀ M a), a = ∂ρ/∂θ, until it converges             (1)
//! θ*   = θ_W,   P* = P − P a aᵀ P / (aᵀ P a) + (θ_W − θ_P)(θ_W − θ_P)ᵀ                           (2)
//! ```
//!
//! The arm's θ₁/θ₃ and θ₂/θ₄ are both L/R of one winding, so nine parameters have eight degrees of
//! freedom. θ̂ and P contain all information from the data, so the constrained estimate follows
//! from them alone. The recursion, its test for changes and its weights do not use the relation, so
//! [`product_ratio`](super::BlockEstimator::product_ratio) still shows whether the data agree with
//! it.
//!
//! P says how far θ̂ may be off, W how well the data determine it: W lacks drifts and errors that
//! contradict the relation (`considered_covariance.rs`). θ_P is the mean of what P and the relation
//! leave possible. Published is θ_W, which is right if there is no such error, with its second
//! moment about θ_W: that is (2). Without such errors both are the same.
//!
//! If ρ is more than [`EVIDENT`] standard deviations s_W from 0, it may be such an error, for
//! example viscous friction behind an inductance. With T_v its effect on θ̂ per unit, θ_V is the
//! estimate if it explains all of ρ:
//!
//! ```text
//! θ_V = θ̂ − T_v ρ/(aᵀ T_v),    P* ← P* + (1 − (2 s_W/ρ)²) (θ_W − θ_V)(θ_W − θ_V)ᵀ               (3)
//! ```
//!
//! Nothing is imposed if W gives ρ a standard deviation of half the size of its products or more,
//! or if the result would leave the bounds. If ρ is more than [`CONTRADICTION`] standard deviations
//! from 0, the data contradict the relation: the model lacks a term, and the block is a misfit.
//! Viscous friction behind an inductance does this, though the nine parameters fit the data.

use super::group::GroupState;
use super::groups::Groups;
use super::index_set::IndexSet;
use super::linalg::dot;

/// |ρ| over its standard deviation above which the data contradict the relation. If no error is
/// considered, that happens by chance in one run of 2000.
const CONTRADICTION: f64 = 3.5;
/// |ρ| over the standard deviation that W gives it, above which an error may have caused it.
const EVIDENT: f64 = 2.0;
/// Standard deviation that W gives ρ, relative to its products, above which nothing is imposed.
const OPEN: f64 = 0.5;
const ITERATIONS: usize = 20;

/// The published estimate: θ̂ and P of each group, with the relations imposed.
#[derive(Debug, Clone)]
pub struct Published {
    pub theta: Vec<f64>,
    /// P of each group, in the order of the groups.
    covariance: Vec<Vec<f64>>,
    /// W of each group.
    weights: Vec<Vec<f64>>,
    gradient: Vec<f64>,
    image: Vec<f64>,
    /// θ_P and θ_W.
    mean: Vec<f64>,
    nearest: Vec<f64>,
}

impl Published {
    /// Workspace for groups of these sizes.
    pub fn new(theta: &[f64], groups: &[GroupState]) -> Self {
        let largest = groups.iter().map(|g| g.n).max().unwrap_or(0);
        Self {
            theta: theta.to_vec(),
            covariance: groups.iter().map(|g| g.widened.total().to_vec()).collect(),
            weights: groups.iter().map(|g| g.widened.weights().to_vec()).collect(),
            gradient: vec![0.0; largest],
            image: vec![0.0; largest],
            mean: vec![0.0; largest],
            nearest: vec![0.0; largest],
        }
    }

    /// Copies θ̂ and P and imposes the relations, each \[i, j, k, l\] for θ_i/θ_j = θ_k/θ_l, one
    /// after the other. Returns the equations of groups that contradict one.
    #[must_use]
    pub fn take(&mut self, theta: &[f64], groups: &Groups, relations: &[[usize; 4]]) -> IndexSet {
        self.theta.copy_from_slice(theta);
        let published = self.covariance.iter_mut().zip(&mut self.weights);
        for (k, ((covariance, weights), group)) in published.zip(groups.iter()).enumerate() {
            covariance.copy_from_slice(&group.confirmation.covariance);
            weights.copy_from_slice(group.widened.weights());
            if groups.cause_search.is_ambiguous(k) {
                group.inquiry.widen(&theta[group.parameters.clone()], covariance);
            }
        }
        let mut contradicting = IndexSet::EMPTY;
        for relation in relations {
            let holder = groups.iter().position(|g| g.parameters.contains(&relation[0]));
            if let Some(k) = holder
                && self.impose(k, &groups[k], relation.map(|index| index - groups[k].parameters.start))
            {
                groups[k]
                    .equations
                    .states()
                    .iter()
                    .for_each(|e| contradicting.insert(e.index));
            }
        }
        contradicting
    }

    /// Covariance of the errors of two parameters; 0 between groups.
    pub fn covariance(&self, groups: &Groups, i: usize, j: usize) -> f64 {
        groups.entry(i, j, |k| &self.covariance[k])
    }

    /// Writes the correlation matrix, P × P and row-major; 1 on the diagonal, 0 for parameters
    /// whose standard deviation is 0.
    pub fn correlation(&self, groups: &Groups, out: &mut [f64]) {
        let params = self.theta.len();
        for i in 0..params {
            for j in 0..params {
                let scale = (self.covariance(groups, i, i) * self.covariance(groups, j, j)).sqrt();
                let value = if scale > 0.0 {
                    self.covariance(groups, i, j) / scale
                } else {
                    0.0
                };
                out[i * params + j] = if i == j { 1.0 } else { value.clamp(-1.0, 1.0) };
            }
        }
    }

    /// True if the data contradict the relation.
    fn impose(&mut self, k: usize, group: &GroupState, indices: [usize; 4]) -> bool {
        let n = group.n;
        let own = &mut self.theta[group.parameters.clone()];
        let (covariance, weights) = (&mut self.covariance[k], &self.weights[k]);
        let (a, v) = (&mut self.gradient[..n], &mut self.image[..n]);
        let (mean, nearest) = (&mut self.mean[..n], &mut self.nearest[..n]);
        let relation = Relation(indices);
        relation.gradient(own, a);
        let std = |of: &[f64]| {
            let row = |p: usize| dot(&of[p * n..(p + 1) * n], a);
            (0..n).map(|p| a[p] * row(p)).sum::<f64>().max(0.0).sqrt()
        };
        let known = std(weights);
        if !(known > 0.0 && known < OPEN * relation.size(own)) {
            return false;
        }
        let rho = relation.rho(own);
        if rho.abs() >= CONTRADICTION * std(covariance) {
            return true;
        }
        let caused = group.considered.against(a, rho).filter(|_| rho.abs() > EVIDENT * known);
        if !(relation.project(own, weights, a, v, nearest).is_some() && group.limits.allow(nearest)) {
            return false;
        }
        let Some(variance) = relation.project(own, covariance, a, v, mean) else {
            return false;
        };
        for p in 0..n {
            for q in 0..n {
                let shift = (nearest[p] - mean[p]) * (nearest[q] - mean[q]);
                covariance[p * n + q] += shift - v[p] * v[q] / variance; // (2)
            }
        }
        if let Some((effect, amplitude)) = caused {
            let weight = 1.0 - (EVIDENT * known / rho).powi(2);
            let shift = |p: usize| nearest[p] - (own[p] - effect[p] * amplitude);
            for p in 0..n {
                for q in 0..n {
                    covariance[p * n + q] += weight * shift(p) * shift(q); // (3)
                }
            }
        }
        own.copy_from_slice(nearest);
        false
    }
}

/// θ_i θ_l − θ_j θ_k = 0, with the indices i, j, k, l within a group.
#[derive(Debug, Clone, Copy)]
struct Relation([usize; 4]);

impl Relation {
    fn rho(self, theta: &[f64]) -> f64 {
        let [i, j, k, l] = self.0;
        theta[i] * theta[l] - theta[j] * theta[k]
    }

    /// Size of the products.
    fn size(self, theta: &[f64]) -> f64 {
        let [i, j, k, l] = self.0;
        (theta[i] * theta[l]).abs() + (theta[j] * theta[k]).abs()
    }

    /// a = ∂ρ/∂θ.
    fn gradient(self, theta: &[f64], a: &mut [f64]) {
        let [i, j, k, l] = self.0;
        a.fill(0.0);
        (a[i], a[j], a[k], a[l]) = (theta[l], -theta[k], -theta[j], theta[i]);
    }

    /// Writes (1) for `own` and the n × n `metric` M to `nearest`, a and M a there to `a` and `v`.
    /// Returns aᵀ M a; `None` if it does not converge.
    fn project(self, own: &[f64], metric: &[f64], a: &mut [f64], v: &mut [f64], nearest: &mut [f64]) -> Option<f64> {
        let n = own.len();
        let mut variance = 0.0;
        nearest.copy_from_slice(own);
        for _ in 0..ITERATIONS {
            self.gradient(nearest, a);
            for (p, value) in v.iter_mut().enumerate() {
                *value = dot(&metric[p * n..(p + 1) * n], a);
            }
            variance = dot(a, v);
            let excess = (self.rho(nearest) + dot(a, own) - dot(a, nearest)) / variance; // (1)
            let mut moved = 0.0f64;
            for p in 0..n {
                let next = own[p] - v[p] * excess;
                moved = moved.max((next - nearest[p]).abs() / next.abs().max(f64::MIN_POSITIVE));
                nearest[p] = next;
            }
            if moved < 1e-14 {
                break;
            }
        }
        let solved = variance > 0.0 && self.rho(nearest).abs() <= 1e-9 * self.size(own);
        (solved && nearest.iter().all(|t| t.is_finite())).then_some(variance)
    }
}
