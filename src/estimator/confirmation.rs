//! Evidence from the data since the last change alone: only this can make a parameter usable.
//!
//! ```text
//! I ← λ I + Σ_e S_e/σ_e²,  b ← λ b + Σ_e (S_e (θ_m − θ_r) + g_e)/σ_e²     rows since the change
//! C = (I + D⁻¹)⁻¹, D = diag(size²)                                         what they leave open
//! e = C (b − I (θ̂ − θ_r))                                                  how far these rows alone would move θ̂
//! V = P + M (C + e eᵀ) M, M = diag(m_i), m_i = 1 until parameter i is confirmed
//!
//! θ_m: where block m's rows were linearised;  θ_r: θ̂ at the change;  size: the prior's, of each parameter
//! ```
//!
//! θ̂ and P of the recursion keep what was known before the change, because a group without a sign
//! of a change is probably right, and its accuracy is worth keeping. That is not evidence, however:
//! a payload picked up while the arm rests changes the inertia at a joint whose signals do not show
//! it. So the published covariance is V, as if every parameter might have changed by its size,
//! until the rows since then show otherwise. Parameter i is confirmed as soon as
//!
//! * C_ii + e_i² ≤ 3 P_ii: the rows since the change determine it nearly as well as P claims, or
//! * 3 √(C_ii + e_i²) < 0.5 % of it: a change too small for these rows to show is negligible.
//!
//! Both apply to a parameter, not a direction: a combination that the rows leave open leaves all
//! its members open, because C is inverted as a whole. e accounts for rows that contradict θ̂
//! slightly, but in no block enough to raise an alarm.
//!
//! P is that of the recursion here. The covariance to be published may be wider for a time, with
//! considered errors or an open inquiry. As long as 3 of its P_ii exceed C_ii + e_i², it covers the
//! parameter, which then needs no M. It may become narrow again without a further row, however, so
//! it confirms nothing for good.
//!
//! If a line was fitted to the block, its end is the estimate. The variance of the end of a line
//! through evenly spread rows is four times that of their mean, so the rows count a quarter, and e
//! is unknown.
//!
//! The same sums show whether the data have ever informed on more than half of the directions of
//! the free parameters: a machine that has not moved shows one or two. Requiring all of them would
//! mean never publishing on smooth motion, which does not show an inductance; a parameter that the
//! motion does not show simply stays unconfirmed.

use super::curvature::Curvature;
use super::equation::TINY;
use super::equations::Equations;
use super::linalg::{Eigen, mul_vec};
use super::persist::Visit;

/// Largest ratio of the variance from the rows since the change to that of the recursion at which
/// they confirm a parameter.
const RATIO: f64 = 3.0;
/// Three standard deviations from the rows since the change, relative to the parameter, below which
/// they confirm it whatever the recursion claims.
const NOTABLE: f64 = 0.005;
/// Share of the rows' information on their mean that remains for the end of a line through them:
/// 1/(1 + 12/4), the slope over the length having 12 times the variance of the mean.
const LINE_END: f64 = 0.25;
/// Eigenvalues of the scaled information below this share of the largest are rounding.
const ROUNDING: f64 = 1e-13;

/// Information since the last change, and the covariance that may be published.
#[derive(Debug, Clone)]
pub struct Confirmation {
    n: usize,
    information: Vec<f64>,
    vector: Vec<f64>,
    reference: Vec<f64>,
    confirmed: Vec<bool>,
    /// Parameters that need no M at present: confirmed, or P is as wide.
    covered: Vec<bool>,
    /// The rows since the start, or since a parameter was fixed or set free, informed on more than
    /// half of the directions.
    informed: bool,
    /// V, n × n.
    pub covariance: Vec<f64>,
    eigen: Eigen,
    scaled: Vec<f64>,
    open: Vec<f64>,
    discrepancy: Vec<f64>,
    image: Vec<f64>,
}

impl Confirmation {
    /// A group of n parameters without data.
    pub fn new(n: usize) -> Self {
        let (matrix, vector) = (vec![0.0; n * n], vec![0.0; n]);
        Self {
            n,
            information: matrix.clone(),
            vector: vector.clone(),
            reference: vector.clone(),
            confirmed: vec![false; n],
            covered: vec![false; n],
            informed: false,
            covariance: matrix.clone(),
            eigen: Eigen::new(n),
            scaled: matrix.clone(),
            open: matrix,
            discrepancy: vector.clone(),
            image: vector,
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.information);
        v.reals(&mut self.vector);
        v.reals(&mut self.reference);
        self.confirmed.iter_mut().for_each(|confirmed| v.flag(confirmed));
        v.flag(&mut self.informed);
    }

    /// Call this if the plant may have changed: nothing remains confirmed. `theta` is θ̂ of the
    /// group.
    pub fn restart(&mut self, theta: &[f64]) {
        self.information.fill(0.0);
        self.vector.fill(0.0);
        self.reference.copy_from_slice(theta);
        self.confirmed.fill(false);
    }

    /// Call this if a parameter was fixed or freed: the data must determine the new set of
    /// parameters again.
    pub fn begin(&mut self, theta: &[f64]) {
        self.restart(theta);
        self.informed = false;
    }

    /// True once the data have informed on more than half of the directions of the free parameters:
    /// the rows alone determine these to within the parameters' size.
    pub fn is_informed(&self) -> bool {
        self.informed
    }

    /// True if nothing remains to be confirmed.
    pub fn is_settled(&self) -> bool {
        self.informed && self.confirmed.iter().all(|&confirmed| confirmed)
    }

    /// Adds the sums of a block, taken at `theta` of the group.
    pub fn take(&mut self, equations: &Equations, theta: &[f64], forgetting_factor: f64) {
        if self.is_settled() {
            return;
        }
        self.information.iter_mut().for_each(|v| *v *= forgetting_factor);
        self.vector.iter_mut().for_each(|v| *v *= forgetting_factor);
        self.add_information(equations, 1.0);
        for (e, sums) in equations.pairs() {
            let (p, weight) = (sums.params, 1.0 / e.variance.max(TINY));
            let moved = |j: usize| theta[e.offset + j] - self.reference[e.offset + j];
            for i in 0..p {
                let along: f64 = (0..p).map(|j| sums.gram[i * p + j] * moved(j)).sum();
                self.vector[e.offset + i] += weight * (sums.score[i] + along);
            }
        }
    }

    /// Adds the information of a block that was fitted with a line. Call [`restart`](Self::restart)
    /// before, because earlier blocks say nothing about a parameter that moves.
    pub fn take_line(&mut self, equations: &Equations) {
        self.add_information(equations, LINE_END);
    }

    fn add_information(&mut self, equations: &Equations, share: f64) {
        let n = self.n;
        for (e, sums) in equations.pairs() {
            let (p, weight) = (sums.params, share / e.variance.max(TINY));
            for i in 0..p {
                let row = (e.offset + i) * n + e.offset;
                for (total, gram) in self.information[row..row + p].iter_mut().zip(&sums.gram[i * p..]) {
                    *total += weight * gram;
                }
            }
        }
    }

    /// Refers the information at `centre`, θ̂ before the block, to `theta`, which becomes θ_r; see
    /// `curvature.rs`.
    pub fn turn(&mut self, curvature: &Curvature, theta: &[f64], centre: &[f64]) {
        if self.is_settled() {
            return;
        }
        for i in 0..self.n {
            let since = centre[i] - self.reference[i];
            self.discrepancy[i] = since + curvature.displacement(i, theta, centre);
        }
        mul_vec(self.n, &self.information, &self.discrepancy, &mut self.image);
        for (vector, image) in self.vector.iter_mut().zip(&self.image) {
            *vector -= image;
        }
        curvature.turn_slope(&mut self.vector);
        curvature.turn_information(&mut self.information);
        self.reference.copy_from_slice(theta);
    }

    /// V for θ̂ of the group, whose parameters have the sizes `size`, 0 for a fixed one: from the P
    /// of the recursion, and that P as `widened` by what the recursion does not see.
    pub fn publish(&mut self, theta: &[f64], size: &[f64], recursion: &[f64], widened: &[f64]) {
        let n = self.n;
        self.covariance.copy_from_slice(widened);
        if self.is_settled() {
            return;
        }
        for i in 0..n {
            for j in 0..n {
                self.scaled[i * n + j] = self.information[i * n + j] * size[i] * size[j];
            }
        }
        self.eigen.decompose(n, &self.scaled);
        let largest = self.eigen.values[..n].iter().fold(0.0, |a: f64, &b| a.max(b));
        let known = |value: f64| if value > ROUNDING * largest { value } else { 0.0 };
        let free = size.iter().filter(|&&size| size > 0.0).count();
        let rank = self.eigen.values[..n]
            .iter()
            .filter(|&&value| known(value) > 1.0)
            .count();
        self.informed |= 2 * rank > free || free == 0;
        self.eigen
            .rebuild(n, &mut self.open, |value| 1.0 / (1.0 + known(value)));
        for i in 0..n {
            for j in 0..n {
                self.open[i * n + j] *= size[i] * size[j];
            }
        }
        for i in 0..n {
            self.discrepancy[i] = theta[i] - self.reference[i];
        }
        mul_vec(n, &self.information, &self.discrepancy, &mut self.image);
        for (image, vector) in self.image.iter_mut().zip(&self.vector) {
            *image = vector - *image;
        }
        mul_vec(n, &self.open, &self.image, &mut self.discrepancy);
        for i in 0..n {
            let variance = self.open[i * n + i] + self.discrepancy[i] * self.discrepancy[i];
            self.confirmed[i] |= size[i] == 0.0
                || variance <= RATIO * recursion[i * n + i]
                || 3.0 * variance.sqrt() < NOTABLE * theta[i].abs();
            self.covered[i] = self.confirmed[i] || variance <= RATIO * widened[i * n + i];
        }
        for i in (0..n).filter(|&i| !self.covered[i]) {
            for j in (0..n).filter(|&j| !self.covered[j]) {
                self.covariance[i * n + j] += self.open[i * n + j] + self.discrepancy[i] * self.discrepancy[j];
            }
        }
    }
}
