//! Relations between parameters: equal ratios, imposed on the published estimate.
//!
//! ```text
//! ρ(θ) = θ_i θ_l − θ_j θ_k = 0                     θ_i/θ_j = θ_k/θ_l
//! θ*   = argmin (θ − θ̂)ᵀ P⁻¹ (θ − θ̂) with ρ(θ) = 0
//!      : θ ← θ̂ − P a (ρ(θ) + aᵀ(θ̂ − θ)) / (aᵀ P a), a = ∂ρ/∂θ, until it converges
//! P*   = P − P a aᵀ P / (aᵀ P a)
//! ```
//!
//! The arm's θ₁/θ₃ and θ₂/θ₄ are both L/R of one winding, so nine parameters have eight degrees of
//! freedom. θ̂ and P contain all information from the data, so the constrained estimate follows
//! from them alone. The recursion, its test for changes and its weights do not use the relation, so
//! [`product_ratio`](super::BlockEstimator::product_ratio) still shows whether the data agree with
//! it.
//!
//! If drifts are considered, (θ* − θ̂) is weighted by the covariance W without them, because the
//! possible lag of a moving parameter is no measure of the information on a constant one; with G =
//! I − W a aᵀ/(aᵀ W a), P* = G P Gᵀ.
//!
//! Nothing is imposed if ρ is not known to within half the size of its products, or if the result
//! would leave the bounds. If ρ is more than [`CONTRADICTION`] standard deviations from 0, the data
//! contradict the relation: the model lacks a term, and the block is a misfit. Viscous friction
//! behind an inductance does this, though the nine parameters fit the data.

use super::group::GroupState;
use super::groups::Groups;
use super::linalg::dot;

/// |ρ| over its standard deviation above which the data contradict the relation. If no error is
/// considered, that happens by chance in one run of 2000.
const CONTRADICTION: f64 = 3.5;
/// Standard deviation of ρ, relative to its products, above which nothing is imposed.
const OPEN: f64 = 0.5;
const ITERATIONS: usize = 20;

/// The published estimate: θ̂ and P of each group, with the relations imposed.
#[derive(Debug, Clone)]
pub struct Published {
    pub theta: Vec<f64>,
    /// P of each group, in the order of the groups.
    covariance: Vec<Vec<f64>>,
    /// W of each group, if it differs from P.
    weights: Vec<Vec<f64>>,
    gradient: Vec<f64>,
    image: Vec<f64>,
    candidate: Vec<f64>,
}

impl Published {
    /// Workspace for groups of these sizes.
    pub fn new(theta: &[f64], groups: &[GroupState]) -> Self {
        let largest = groups.iter().map(|g| g.n).max().unwrap_or(0);
        Self {
            theta: theta.to_vec(),
            covariance: groups.iter().map(|g| g.honest.clone()).collect(),
            weights: groups.iter().map(|g| g.undrifted.clone()).collect(),
            gradient: vec![0.0; largest],
            image: vec![0.0; largest],
            candidate: vec![0.0; largest],
        }
    }

    /// Copies θ̂ and P and imposes the relations, each \[i, j, k, l\] for θ_i/θ_j = θ_k/θ_l, one
    /// after the other. Returns the equations of groups that contradict one, as bits.
    #[must_use]
    pub fn take(&mut self, theta: &[f64], groups: &Groups, relations: &[[usize; 4]]) -> u64 {
        self.theta.copy_from_slice(theta);
        let published = self.covariance.iter_mut().zip(&mut self.weights);
        for (k, ((own, weights), group)) in published.zip(groups.iter()).enumerate() {
            own.copy_from_slice(&group.confirmation.covariance);
            weights.copy_from_slice(&group.undrifted);
            if groups.inquest.is_ambiguous(k) {
                group.inquiry.widen(&theta[group.parameters.clone()], own);
            }
        }
        let mut contradicting = 0;
        for relation in relations {
            let holder = groups.iter().position(|g| g.parameters.contains(&relation[0]));
            if let Some(k) = holder
                && self.impose(k, &groups[k], relation.map(|index| index - groups[k].parameters.start))
            {
                contradicting |= groups[k].equations.iter().fold(0, |mask, e| mask | 1 << e.index);
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
    fn impose(&mut self, k: usize, group: &GroupState, [i, j, k1, l]: [usize; 4]) -> bool {
        let n = group.n;
        let own = &mut self.theta[group.parameters.clone()];
        let (covariance, widened) = match self.weights[k].is_empty() {
            true => (&mut self.covariance[k], None),
            false => (&mut self.weights[k], Some(&mut self.covariance[k])),
        };
        let (a, v, candidate) = (&mut self.gradient[..n], &mut self.image[..n], &mut self.candidate[..n]);
        let rho = |theta: &[f64]| theta[i] * theta[l] - theta[j] * theta[k1];
        let size = (own[i] * own[l]).abs() + (own[j] * own[k1]).abs();
        let mut variance = 0.0;
        let mut differentiate = |theta: &[f64], v: &mut [f64]| {
            a.fill(0.0);
            (a[i], a[j], a[k1], a[l]) = (theta[l], -theta[k1], -theta[j], theta[i]);
            for (row, value) in v.iter_mut().enumerate() {
                *value = dot(&covariance[row * n..(row + 1) * n], a);
            }
            let along: f64 = (0..n).map(|p| a[p] * theta[p]).sum();
            (dot(a, v), along, dot(a, own))
        };
        candidate.copy_from_slice(own);
        for iteration in 0..ITERATIONS {
            let (spread, along, along_own) = differentiate(candidate, v);
            if iteration == 0 {
                let std = spread.max(0.0).sqrt();
                if !(std > 0.0 && std < OPEN * size) {
                    return false;
                }
                if rho(candidate).abs() >= CONTRADICTION * std {
                    return true;
                }
            }
            variance = spread;
            let excess = (rho(candidate) + along_own - along) / spread;
            let mut moved = 0.0f64;
            for p in 0..n {
                let next = own[p] - v[p] * excess;
                moved = moved.max((next - candidate[p]).abs() / next.abs().max(f64::MIN_POSITIVE));
                candidate[p] = next;
            }
            if moved < 1e-14 {
                break;
            }
        }
        let inside = (0..n).all(|p| {
            let value = candidate[p];
            value.is_finite() && (group.lower[p]..=group.upper[p]).contains(&value)
        });
        if !inside || !(variance > 0.0) || rho(candidate).abs() > 1e-9 * size {
            return false;
        }
        own.copy_from_slice(candidate);
        if let Some(widened) = widened {
            // the parameters' own values are no longer needed
            for (p, image) in candidate.iter_mut().enumerate() {
                *image = dot(&widened[p * n..(p + 1) * n], a);
            }
            let spread = dot(candidate, a) / variance;
            for p in 0..n {
                for q in 0..n {
                    widened[p * n + q] += (v[p] * v[q] * spread - v[p] * candidate[q] - candidate[p] * v[q]) / variance;
                }
            }
        }
        for p in 0..n {
            for q in 0..n {
                covariance[p * n + q] -= v[p] * v[q] / variance;
            }
        }
        false
    }
}
