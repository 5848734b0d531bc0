//! A change of one group with all its rows since: how well changed parameters explain them, and how
//! well errors of a drive or a sensor do. `cause_search.rs` judges over all groups.
//!
//! ```text
//! J(δ, a) = Σ (f − φᵀδ − a d)²/σ²     rows since the change, at θ₀ of before it                  (a)
//! J_θ = min J(δ, 0) + δᵀD⁻¹δ          other parameters: D = diag(size²)                          (b)
//! J_0 = min J(δ, 0) + δᵀV⁻¹δ          nothing: V = P₀ + ε² diag(θ₀²)                              (c)
//! J_s = min J(δ, a) + δᵀV⁻¹δ          error s: V = P₀ + (ε² + ρ²r²) diag(θ₀²)                     (d)
//! P   ← P + P₀ + (θ̂ − θ₀)(θ̂ − θ₀)ᵀ   covers both (b), whose estimate is θ̂, and (d), with θ₀       (e)
//!
//! δ_θ: the shift of (b);  C: its covariance;  r² = δ_θᵀ Σφφᵀ δ_θ/θ₀ᵀ Σφφᵀ θ₀
//! ```
//!
//! P₀ is the covariance published before the change, so parameters unknown then do not count now;
//! it excludes the widening by considered errors, because these have not changed. Rows are
//! linearised at θ₀, where (d) holds, however far the estimate has moved since; ρ allows for an
//! error so large that its column is nonlinear. σ² exceeds the noise if the rows leave more than
//! noise.
//!
//! **A plant that has changed** differs from before in some parameters, and others, such as the
//! back EMF of a motor, are what they were. Parameter i stays if |δ_i| < 3 √(C_ii + V_ii), and the
//! rows can show a change of it if r θ₀_i is at least twice that. A cause that moves all parameters
//! whose change the rows can show, two or more, is more likely an error of the measurement.

use super::equation::{EquationState, TINY, add_gram, add_score};
use super::linalg::{Cholesky, Eigen, dot, gather, mul_vec};
use super::pass::{Summable, Sums};
use super::persist::Visit;
use std::ops::Range;

/// ρ: relative error of the columns due to nonlinearity.
const CURVED: f64 = 0.05;
/// ε: negligible relative change of a parameter.
const NOTABLE: f64 = 1e-3;
/// χ² above that of (b), in excess of one per parameter, that refutes (c) or (d).
pub const REFUTED: f64 = 30.0;
/// Relative change of the parameters that the rows must be able to show in more than half of the
/// directions.
const KNOWN: f64 = 0.5;
/// Standard deviations by which the rows must distinguish such a change from none, in more than
/// half of the directions.
const DISTINCT: f64 = 5.0;
/// Standard deviations within which a parameter counts as unchanged, and by which the rows must be
/// able to show a change.
const STAYS: f64 = 3.0;

/// A change of one group, with all rows since.
#[derive(Debug, Clone)]
pub struct Inquiry {
    n: usize,
    open: bool,
    /// χ² per row before the change, at least 1, and the square by which innovations exceeded it.
    usual: [f64; 2],
    /// θ̂ is not θ₀.
    moved: bool,
    /// θ₀, P₀ and the size of each parameter.
    reference: Vec<f64>,
    known: Vec<f64>,
    size: Vec<f64>,
    /// Σ φφᵀ, Σ φ f, Σ f² and the number of rows since, in units of σ².
    information: Vec<f64>,
    vector: Vec<f64>,
    cost: f64,
    rows: f64,
    /// Σ φ d_s at s n, Σ d_s² and Σ d_s f.
    cross: Vec<f64>,
    gram: Vec<f64>,
    score: Vec<f64>,
    /// Score and square of each column after δ has taken its part, in units of the residuals.
    pulls: Vec<[f64; 2]>,
    // scratch
    matrix: Vec<f64>,
    packed: Vec<f64>,
    inverse: Vec<f64>,
    factor: Cholesky,
    eigen: Eigen,
    shift: Vec<f64>,
    image: Vec<f64>,
}

/// The contribution of a block: its sums, and those over the columns of errors, both at θ₀.
pub struct BlockSums<'a> {
    /// The group's parameters among all.
    pub parameters: Range<usize>,
    /// The group's equations.
    pub equations: &'a [EquationState],
    /// Their sums.
    pub sums: &'a [Sums],
    /// Σ φ d_s at s n, Σ d_s d_t at s room + t, Σ d_s f.
    pub columns: (&'a [f64], &'a [f64], &'a [f64]),
    /// Variance of the noise, in units of the sums.
    pub variance: f64,
}

/// Comparison of the hypotheses for a group.
#[derive(Debug, Clone, Copy)]
pub struct Comparison {
    /// Free parameters.
    pub count: usize,
    /// χ² by which (c) is worse than (b).
    pub nothing: f64,
    /// The same with the V of (d), which is wider.
    pub base: f64,
    /// The rows inform on more than half of the directions.
    pub informed: bool,
    /// The rows distinguish a change of the size in question from none, in more than half of the
    /// directions.
    pub distinguishes: bool,
    /// A change of the plant is plausible, because some parameter has stayed.
    pub plausible: bool,
}

impl Comparison {
    /// True if the parameters may be unchanged.
    pub fn is_nothing(&self) -> bool {
        self.nothing <= REFUTED + self.count as f64
    }
}

impl Inquiry {
    /// Workspace for a group of n parameters and `errors` errors.
    pub fn new(n: usize, errors: usize) -> Self {
        let (matrix, vector) = (vec![0.0; n * n], vec![0.0; n]);
        Self {
            n,
            open: false,
            usual: [1.0, 0.0],
            moved: false,
            reference: vector.clone(),
            known: matrix.clone(),
            size: vector.clone(),
            information: matrix.clone(),
            vector: vector.clone(),
            cost: 0.0,
            rows: 0.0,
            cross: vec![0.0; errors * n],
            gram: vec![0.0; errors],
            score: vec![0.0; errors],
            pulls: vec![[0.0; 2]; errors],
            matrix: matrix.clone(),
            packed: matrix.clone(),
            inverse: matrix,
            factor: Cholesky::new(n),
            eigen: Eigen::new(n),
            shift: vector.clone(),
            image: vector,
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.flag(&mut self.open);
        v.reals(&mut self.usual);
        v.flag(&mut self.moved);
        v.reals(&mut self.reference);
        v.reals(&mut self.known);
        v.reals(&mut self.size);
        self.sums_mut().into_iter().for_each(|sums| v.reals(sums));
        v.real(&mut self.cost);
        v.real(&mut self.rows);
    }

    /// Ends the inquiry without a result.
    pub fn close(&mut self) {
        self.open = false;
    }

    /// θ₀.
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// χ² per row of the blocks before, and the mean square by which innovations exceeded it.
    pub fn usual(&self) -> [f64; 2] {
        self.usual
    }

    /// True while the inquiry is open.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Compares θ̂ (covariance P) with θ₀: if nothing has changed, they agree as closely as (c)
    /// requires.
    pub fn look_at(&mut self, theta: &[f64], covariance: &[f64]) {
        let n = self.n;
        let limit = REFUTED + n as f64;
        self.moved = (0..n).any(|i| {
            let slack = NOTABLE * self.reference[i];
            let variance = covariance[i * n + i] + self.known[i * n + i] + slack * slack;
            (theta[i] - self.reference[i]).powi(2) > limit * variance
        });
    }

    /// True if θ̂ is not θ₀.
    pub fn has_moved(&self) -> bool {
        self.moved
    }

    /// Adds P₀ + (θ̂ − θ₀)(θ̂ − θ₀)ᵀ to a covariance of θ̂: the plant may be what it was.
    pub fn widen(&self, theta: &[f64], covariance: &mut [f64]) {
        let n = self.n;
        for i in 0..n {
            for j in 0..n {
                // (e)
                let shift = (theta[i] - self.reference[i]) * (theta[j] - self.reference[j]);
                covariance[i * n + j] += self.known[i * n + j] + shift;
            }
        }
    }

    /// Score and information of each error relative to (c), after [`compare`](Self::compare).
    pub fn pulls(&self) -> &[[f64; 2]] {
        &self.pulls
    }

    /// Begins with a change from θ₀, of covariance P₀. An unresolved change keeps its own θ₀ and
    /// P₀.
    pub fn begin(&mut self, theta: &[f64], covariance: &[f64], size: &[f64], usual: [f64; 2]) {
        if !self.open {
            self.usual = usual;
            self.reference.copy_from_slice(theta);
            self.known.copy_from_slice(covariance);
            self.size.copy_from_slice(size);
        }
        self.open = true;
        (self.cost, self.rows) = (0.0, 0.0);
        self.sums_mut().into_iter().for_each(|sums| sums.fill(0.0));
    }

    /// Adds a block, after multiplying the earlier sums by `forgetting_factor`.
    pub fn take(&mut self, rows: &dyn Summable, block: &BlockSums<'_>, forgetting_factor: f64) {
        let n = self.n;
        self.forget(forgetting_factor);
        let weight = 1.0 / block.variance.max(TINY);
        for (e, sums) in block.equations.iter().zip(block.sums) {
            self.cost += weight * sums.cost;
            self.rows += sums.rows as f64;
            add_gram(n, e, sums, weight, &mut self.information);
            add_score(e, sums, weight, &mut self.vector);
        }
        let (cross, gram, score) = block.columns;
        let room = score.len();
        let suspects = rows.suspect_rows();
        for s in (0..suspects.count().min(self.gram.len())).filter(|&s| suspects.is_sudden(s)) {
            if let Some(changes) = suspects.imitation(s) {
                self.imitate(s, &changes[block.parameters.clone()]);
                continue;
            }
            let cross = &cross[s * n..(s + 1) * n];
            let sums = &mut self.cross[s * n..(s + 1) * n];
            sums.iter_mut().zip(cross).for_each(|(sum, v)| *sum += weight * v);
            self.gram[s] += weight * gram[s * room + s];
            self.score[s] += weight * score[s];
        }
    }

    /// Sums over the column Σ_i φ_i θ₀_i r_i of an error that looks like these relative `changes`
    /// of the parameters.
    fn imitate(&mut self, s: usize, changes: &[f64]) {
        let n = self.n;
        for i in 0..n {
            self.shift[i] = changes[i] * self.reference[i];
        }
        let cross = &mut self.cross[s * n..(s + 1) * n];
        mul_vec(n, &self.information, &self.shift, cross);
        self.gram[s] = dot(cross, &self.shift);
        self.score[s] = dot(&self.vector, &self.shift);
    }

    /// The sums over the rows since.
    fn sums_mut(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.information,
            &mut self.vector,
            &mut self.cross,
            &mut self.gram,
            &mut self.score,
        ]
    }

    fn forget(&mut self, forgetting_factor: f64) {
        let sums = self.sums_mut().into_iter().flatten();
        sums.for_each(|sum| *sum *= forgetting_factor);
        self.cost *= forgetting_factor;
        self.rows *= forgetting_factor;
    }

    /// Compares (b) to (d); `None` if the rows cannot be compared.
    pub fn compare(&mut self, fixed: &[bool]) -> Option<Comparison> {
        let n = self.n;
        if !self.open || !(self.rows > 0.0) {
            return None;
        }
        // (b), and its residual beyond the noise
        self.matrix.copy_from_slice(&self.information);
        for i in 0..n {
            self.matrix[i * n + i] += self.size[i].powi(-2);
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        if count == 0 || !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        let other = -self.solve(fixed, Side::Rows);
        let excess = ((self.cost + other) / self.rows.max(1.0)).max(1.0);
        let share = self.share_changed();
        self.factor.inverse(&mut self.inverse[..count * count]);
        let plausible = self.some_stay(excess, share, fixed);
        let nothing = self.unchanged(0.0, excess, fixed)?; // (c)
        let base = self.unchanged(share, excess, fixed)?;
        for s in 0..self.gram.len() {
            self.pulls[s] = [0.0; 2];
            if self.gram[s] > 0.0 {
                // (d): the column and its score after δ has taken its part
                let cross = s * n..(s + 1) * n;
                self.solve(fixed, Side::Error(s));
                let left = self.gram[s] - dot(&self.cross[cross], &self.shift);
                let score = self.score[s] - dot(&self.vector, &self.shift);
                if left > 0.0 {
                    self.pulls[s] = [score / excess, left / excess];
                }
            }
        }
        Some(Comparison {
            count,
            nothing: (nothing - other) / excess,
            base: (base - other) / excess,
            informed: self.distinguishes(KNOWN, fixed),
            distinguishes: self.distinguishes(share, fixed),
            plausible,
        })
    }

    /// min J(δ, 0) + δᵀV⁻¹δ, with `share` the relative change of what the equations balance;
    /// `factor` is then that of Σφφᵀ + V⁻¹.
    fn unchanged(&mut self, share: f64, excess: f64, fixed: &[bool]) -> Option<f64> {
        let n = self.n;
        self.matrix.copy_from_slice(&self.known);
        for i in 0..n {
            self.matrix[i * n + i] += self.slack(share, i).powi(2) + f64::MIN_POSITIVE;
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        if !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        self.factor.inverse(&mut self.inverse[..count * count]);
        gather(n, &self.information, fixed, &mut self.packed);
        for (a, v) in self.packed[..count * count].iter_mut().zip(&self.inverse) {
            *a += excess * v;
        }
        if !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        Some(-self.solve(fixed, Side::Rows))
    }

    /// Tolerance of parameter i under no change, in addition to P₀.
    fn slack(&self, share: f64, i: usize) -> f64 {
        (CURVED * share).hypot(NOTABLE) * self.reference[i]
    }

    /// True if some parameter whose change the rows could show has stayed according to (b), with
    /// `shift` and covariance `inverse`, or if they could show fewer than two.
    fn some_stay(&self, excess: f64, share: f64, fixed: &[bool]) -> bool {
        let free = (0..self.n).filter(|&i| !fixed[i]);
        let count = free.clone().count();
        let (mut distinguishable, mut stay) = (0, 0);
        for (k, i) in free.enumerate() {
            let variance = excess * self.inverse[k * count + k];
            let known = self.known[i * self.n + i] + self.slack(share, i).powi(2);
            let open = STAYS * (variance + known).sqrt();
            if 2.0 * open < share * self.reference[i].abs() {
                distinguishable += 1;
                stay += usize::from(self.shift[i].abs() < open);
            }
        }
        stay > 0 || distinguishable < 2
    }

    /// r: the relative change of what the equations balance.
    fn share_changed(&mut self) -> f64 {
        let n = self.n;
        mul_vec(n, &self.information, &self.shift, &mut self.image);
        let changed = dot(&self.shift, &self.image);
        mul_vec(n, &self.information, &self.reference, &mut self.image);
        (changed / dot(&self.reference, &self.image).max(TINY)).max(0.0).sqrt()
    }

    /// True if the rows distinguish a change of all parameters by this share from none, in more
    /// than half of the directions.
    fn distinguishes(&mut self, share: f64, fixed: &[bool]) -> bool {
        let n = self.n;
        for i in 0..n {
            for j in 0..n {
                self.matrix[i * n + j] = self.information[i * n + j] * self.reference[i] * self.reference[j];
            }
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        self.eigen.decompose(count, &self.packed[..count * count]);
        let least = (DISTINCT / share).powi(2);
        let distinguishable = self.eigen.values[..count].iter().filter(|&&value| value > least);
        2 * distinguishable.count() > count
    }

    /// `shift` ← A⁻¹ of one side over the free parameters, 0 for the others; returns the product of
    /// both.
    fn solve(&mut self, fixed: &[bool], side: Side) -> f64 {
        let n = self.n;
        let right = match side {
            Side::Rows => &self.vector,
            Side::Error(s) => &self.cross[s * n..(s + 1) * n],
        };
        let free = (0..n).filter(|&i| !fixed[i]);
        let mut count = 0;
        for i in free.clone() {
            self.image[count] = right[i];
            count += 1;
        }
        self.factor.solve(&mut self.image[..count]);
        self.shift.fill(0.0);
        for (k, i) in free.enumerate() {
            self.shift[i] = self.image[k];
        }
        dot(right, &self.shift)
    }
}

/// Right sides: Σ φ f, or Σ φ d_s.
enum Side {
    Rows,
    Error(usize),
}
